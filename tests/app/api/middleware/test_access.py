"""Who may ask what, over HTTP and over both WebSockets, of the whole service on virtual time.

Oracles: the attacks as browsers send them, header by header; the roles as docs/security.md tells them, said
here once more; the standards named in `app.api.middleware.origins`. Long, as it walks through all that can
be asked.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from asgi_client import Closed, Refused, Socket
from fastapi import FastAPI
from fastapi.routing import APIRoute, APIWebSocketRoute
from streaming_client import Frames
from virtual_service import VirtualService, virtual_service

from app.api.errors import status_of
from app.api.middleware.access import Access
from app.api.middleware.origins import Origins
from app.api.roles import PUBLIC_PATHS, endpoint_of, guard
from app.aubo.classes import REGISTRY
from app.rosbridge import roles as rosbridge_roles
from app.rosbridge.operations import OPERATIONS
from app.routes import ENDPOINTS
from cobot.access.authentication import authentication_required, rights_of_ros, ros_access
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.config import Settings, load_settings
from cobot.errors import ConfigError, HeaderError, MisdirectedError, PermissionDenied

NAMES = {role: role.name.lower() for role in Role if role}
APP = "https://app.example"
CSV = "joint1,joint2,joint3,joint4,joint5,joint6,joint7,t\n" + "".join(
    f"{0.001 * step},0,0,-1.57,0,1.57,0,{0.01 * step}\n" for step in range(50)
)
LUA = 'robot.move_named("work")'


@pytest.fixture(scope="module")
def run(service: VirtualService) -> VirtualService:
    """A service as it is shipped: on this computer alone, without tokens."""
    return service


class Guarded:
    """A service that asks for tokens, and a token of each role."""

    def __init__(self, run: VirtualService, file: TokenFile, tokens: dict[Role, str]) -> None:
        self.run, self.file, self.tokens = run, file, tokens

    def ask(self, method: str, path: str, token: str | Role | None = None, **content: Any) -> httpx.Response:
        text = self.tokens[token] if isinstance(token, Role) else token
        headers = content.pop("headers", {}) | (
            {"Authorization": f"Bearer {text}"} if text is not None else {}
        )
        return self.run.ask(method, path, headers=headers, **content)

    def connect(self, path: str, role: Role, **headers: str) -> Socket:
        return self.run.connect(path, authorization=f"Bearer {self.tokens[role]}", **headers)


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    folder = tmp_path_factory.mktemp("guarded")
    file = TokenFile(folder / "tokens.json")
    tokens = {role: file.create(f"the-{name}", role) for role, name in NAMES.items()}
    web = (
        "web: {authentication: required, tokens: tokens.json, "
        f"allowed_origins: ['{APP}'], allowed_hosts: [arm.example]}}\n"
    )
    with virtual_service(folder, more=web) as started:
        yield Guarded(started, file, tokens)


# What a page of somebody else's may not do

FROM_ELSEWHERE: dict[str, dict[str, str]] = {
    "plain http": {"origin": "http://evil.com"},
    "localhost": {"origin": "http://evil.com", "sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors"},
    "sandboxed": {"origin": "null"},
    "file": {"origin": "null", "sec-fetch-site": "cross-site"},
    "another port": {"origin": "http://localhost:3000", "sec-fetch-site": "same-site"},
    "another name of ours": {"origin": "http://127.0.0.1"},
    "an image": {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "image"},
    "a form": {"origin": "http://evil.com", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"},
    "a lookalike": {"origin": "http://robot.test.evil.com"},
    "a beginning": {"origin": "http://robot.tes"},
    "empty": {"origin": ""},
    "no web page": {"origin": "chrome-extension://robot.test"},
}


def files(name: str, file: str, content: str) -> dict[str, Any]:
    return {"files": {name: (file, content, "text/plain")}}


ATTACKS: dict[str, tuple[str, dict[str, Any]]] = {
    "/trajectory/send_csv?move_to_start=true": ("POST", files("file", "a.csv", CSV)),
    "/sequences/start": ("POST", files("config", "a.lua", LUA)),
    "/stop": ("POST", {}),
    "/robot/reset": ("POST", {}),
    "/robots/NAME/stop": ("POST", {}),
    "/NAME/RobotManage/poweroff": ("POST", {}),
    "/NAME/MotionControl/stopJoint": ("POST", {"content": "{}", "headers": {"content-type": "text/plain"}}),
}


@pytest.mark.parametrize("path", ATTACKS)
@pytest.mark.parametrize("page", FROM_ELSEWHERE)
def test_a_page_from_elsewhere_moves_nothing_and_stops_nothing(
    run: VirtualService, path: str, page: str
) -> None:
    method, content = ATTACKS[path]
    headers = FROM_ELSEWHERE[page] | content.get("headers", {})
    services = run.app.state.services
    stops = services.ownership.stops
    answer = run.ask(method, path.replace("NAME", run.name), **(content | {"headers": headers}))
    assert (answer.status_code, answer.json()["code"]) == (403, "forbidden")
    assert services.ownership.stops == stops
    assert services.ownership.owner is None
    assert services.sequences.status.status == "idle"
    assert run.health()["robot"]["mode"] == "HOLD"


def test_a_page_from_elsewhere_reads_nothing(run: VirtualService) -> None:
    for headers in (
        {"origin": "http://evil.com"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "no-cors", "sec-fetch-dest": "script"},
        {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "iframe"},
        {"sec-fetch-site": "same-site", "sec-fetch-mode": "cors", "sec-fetch-dest": "empty"},
    ):
        answer = run.ask("GET", "/robot/joint_states", headers=headers)
        assert answer.status_code == 403, headers
        assert "access-control-allow-origin" not in answer.headers


@pytest.mark.parametrize("path", ["/robot/stream", "/rosbridge"])
@pytest.mark.parametrize("page", [name for name, headers in FROM_ELSEWHERE.items() if "origin" in headers])
def test_a_page_from_elsewhere_opens_no_websocket(run: VirtualService, path: str, page: str) -> None:
    with pytest.raises(Refused) as refused:
        run.connect(path, **FROM_ELSEWHERE[page])
    assert refused.value.status == 403
    assert "may not move the robot" in refused.value.body.decode()


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"origin": "http://robot.test"},
        {"origin": "http://robot.test:80", "sec-fetch-site": "same-origin"},
        {"origin": "http://localhost:9000", "host": "localhost:9000", "sec-fetch-site": "same-origin"},
        {"sec-fetch-site": "none", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"},
    ],
)
def test_its_own_pages_and_programs_may(run: VirtualService, headers: dict[str, str]) -> None:
    assert run.ask("POST", "/stop", headers=headers).status_code == 200


def test_a_link_from_anywhere_leads_to_a_page_and_nowhere_else(run: VirtualService) -> None:
    link = {"sec-fetch-site": "cross-site", "sec-fetch-mode": "navigate", "sec-fetch-dest": "document"}
    for path in ("/docs", "/health"):
        assert run.ask("GET", path, headers=link).status_code == 200
    for wrong in ({"sec-fetch-dest": "iframe"}, {"sec-fetch-dest": "embed"}, {"sec-fetch-mode": "no-cors"}):
        assert run.ask("GET", "/docs", headers=link | wrong).status_code == 403
    assert run.ask("POST", "/stop", headers=link).status_code == 403


@pytest.mark.parametrize("page", ["/docs", "/docs/robots", "/docs/vendor", "/redoc"])
def test_nobody_lays_the_documentation_under_a_page_of_theirs(run: VirtualService, page: str) -> None:
    headers = run.get(page).headers
    assert headers["x-frame-options"] == "DENY"
    assert "frame-ancestors 'none'" in headers["content-security-policy"]


# By which name the service is called

FOREIGN = [
    *("evil.com", "evil.com:8007", "localhost.evil.com", "127.0.0.1.evil.com", "localhost@evil.com"),
    *("evil.com#localhost", "localhost/evil.com", "evil.com, localhost", "10.0.0.1", "[::2]", "[::1", "::1"),
    *("", ":80", "0.0.0.0", "localhost:99999999", "2130706433", "robot.test.", "xrobot.test", "lócalhost"),
]
OURS = [
    *("localhost", "LOCALHOST:1", "localhost.", "localhost:8007", "127.0.0.1", "127.0.0.1:8007", "127.1.2.3"),
    *("[::1]", "[::1]:8007", "[0:0:0:0:0:0:0:1]:80", "[::ffff:127.0.0.1]", "robot.test", "Robot.Test:9"),
]


@pytest.mark.parametrize("host", [each for each in FOREIGN if each != "robot.test."])
def test_whoever_calls_it_by_a_name_that_is_not_its_own_is_elsewhere(run: VirtualService, host: str) -> None:
    stops = run.app.state.services.ownership.stops
    headers = {"host": host, "origin": f"http://{host}"}
    for request in (headers, {"host": host}):
        answer = run.ask("POST", "/stop", headers={k: v.encode("latin-1") for k, v in request.items()})
        assert (answer.status_code, answer.json()["code"]) == (421, "misdirected")
    for path in ("/robot/stream", "/rosbridge"):
        with pytest.raises(Refused) as refused:
            run.connect(
                path,
                **{
                    name: value.encode("latin-1").decode("utf-8", "replace")
                    for name, value in headers.items()
                },
            )
        assert refused.value.status == 421
    assert run.app.state.services.ownership.stops == stops


@pytest.mark.parametrize("host", OURS)
def test_its_own_names_are_good_with_any_port(run: VirtualService, host: str) -> None:
    assert run.ask("GET", "/health", headers={"host": host}).status_code == 200
    same = {"host": host, "origin": f"http://{host}"}
    assert run.ask("GET", "/health", headers=same).status_code == 200


def test_a_header_that_stands_twice_is_refused(run: VirtualService) -> None:
    for name, first, second, status in (
        ("host", "robot.test", "evil.com", 421),
        ("origin", "http://robot.test", "http://evil.com", 403),
        ("sec-fetch-site", "same-origin", "cross-site", 403),
        ("authorization", "Bearer a", "Bearer b", 403),
    ):
        answer = run.ask("POST", "/stop", headers=[(name, first), (name, second)])
        assert answer.status_code == status, name


def origins_at(address: str, *hosts: str) -> Origins:
    return Origins(hosts, address, load_settings().web)


def scope(server: str, scheme: str = "http") -> dict[str, Any]:
    return {"type": "http", "method": "POST", "scheme": scheme, "server": (server, 8007)}


def test_a_request_without_a_host_is_told_which_header_is_missing() -> None:
    with pytest.raises(HeaderError, match="the header Host is missing") as caught:
        origins_at("127.0.0.1").check(scope("127.0.0.1"), {})
    assert status_of(caught.value) == 400


@pytest.mark.parametrize(
    ("server", "host"),
    [
        ("192.168.1.5", "192.168.1.5:8007"),
        ("::ffff:192.168.1.5", "192.168.1.5"),
        ("fe80::1%eth0", "[fe80::1]:8007"),
        ("2001:db8::5", "[2001:db8:0::5]"),
    ],
)
def test_the_address_on_which_a_request_came_in_is_its_own_and_no_other(server: str, host: str) -> None:
    origins = origins_at("0.0.0.0")
    origins.check(scope(server), {b"host": host.encode()})
    origins.check(scope(server), {b"host": host.encode(), b"origin": f"http://{host}".encode()})
    for other in ("192.168.1.6", "[2001:db8::6]", "[fe80::2]"):
        with pytest.raises(MisdirectedError):
            origins.check(scope(server), {b"host": other.encode()})


def test_the_computer_s_name_is_good_beyond_this_computer_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.api.middleware.origins.socket.gethostname", lambda: "Cell7")
    for host in ("cell7", "cell7.local:8007", "CELL7"):
        origins_at("0.0.0.0").check(scope("10.0.0.5"), {b"host": host.encode()})
        with pytest.raises(MisdirectedError):
            origins_at("127.0.0.1").check(scope("127.0.0.1"), {b"host": host.encode()})


@pytest.mark.parametrize(
    ("served", "foreign"), [("https", "http"), ("http", "https"), ("wss", "http"), ("ws", "https")]
)
def test_a_page_of_another_scheme_than_is_served_is_not_the_same_unless_it_is_listed(
    served: str, foreign: str
) -> None:
    """On a listener without TLS `https://localhost` is a page of some other program; or a proxy's."""
    own = b"http" if foreign == "https" else b"https"
    for host in (b"localhost:8007", b"127.0.0.1:8007", b"arm.example"):
        origins = origins_at("0.0.0.0", "arm.example")
        origins.check(scope("127.0.0.1", served), {b"host": host, b"origin": own + b"://" + host})
        from_there = {b"host": host, b"origin": foreign.encode() + b"://" + host}
        with pytest.raises(PermissionDenied):
            origins.check(scope("127.0.0.1", served), from_there)
        origins.listed = frozenset([from_there[b"origin"]])
        origins.check(scope("127.0.0.1", served), from_there)


# Pages that are let in


def test_a_listed_origin_is_asked_first_and_let_in(guarded: Guarded) -> None:
    asking = {
        "origin": APP,
        "access-control-request-method": "POST",
        "access-control-request-headers": "authorization,content-type,x-control-token",
        "access-control-request-private-network": "true",
    }
    preflight = guarded.ask("OPTIONS", "/robot/move/joints", headers=asking)
    assert preflight.status_code == 200
    assert preflight.headers["access-control-allow-origin"] == APP
    assert "POST" in preflight.headers["access-control-allow-methods"]
    assert "authorization" in preflight.headers["access-control-allow-headers"].lower()
    assert preflight.headers["access-control-allow-private-network"] == "true"
    page = {"origin": APP, "sec-fetch-site": "cross-site", "sec-fetch-mode": "cors"}
    for token, status in ((Role.OBSERVER, 200), (None, 401)):
        answer = guarded.ask("GET", "/robot/joint_states", token, headers=page)
        assert answer.status_code == status
        assert answer.headers["access-control-allow-origin"] == APP
        assert "origin" in answer.headers["vary"].lower()
    with guarded.connect("/rosbridge", Role.OBSERVER, origin=APP) as socket:
        socket.send('{"op": "call_service", "service": "/rosapi/nodes"}')
        assert json.loads(socket.recv())["values"] == {"nodes": ["/cobot"]}
    refused = guarded.ask("OPTIONS", "/stop", headers=asking | {"origin": "https://other.example"})
    assert refused.status_code == 403
    assert "access-control-allow-origin" not in refused.headers


def test_a_listed_host_is_the_service_s_own(guarded: Guarded) -> None:
    answer = guarded.ask("GET", "/health", Role.OBSERVER, headers={"host": "arm.example:8007"})
    assert answer.status_code == 200


# Tokens


def test_without_a_valid_token_there_is_nothing_but_the_documentation_and_the_stop(guarded: Guarded) -> None:
    for token in (None, "", "nonsense", guarded.tokens[Role.ADMIN][:-1]):
        answer = guarded.ask("GET", "/robot/joint_states", token)
        assert (answer.status_code, answer.json()["code"]) == (401, "unauthenticated")
        assert answer.headers["www-authenticate"] == "Bearer"
        assert guarded.ask("POST", "/stop", token).status_code == 200
        for page in ("/docs", "/docs/robots", "/redoc", "/openapi.json", "/openapi/robot.json"):
            assert guarded.ask("GET", page, token).status_code == 200
        for path in ("/robot/stream", "/rosbridge"):
            with pytest.raises(Refused) as refused:
                guarded.run.connect(path, **({"authorization": f"Bearer {token}"} if token else {}))
            assert refused.value.status == 401
    basic = {"authorization": f"Basic {guarded.tokens[Role.ADMIN]}"}
    assert guarded.ask("GET", "/health", headers=basic).status_code == 401
    query = f"/health?token={guarded.tokens[Role.ADMIN]}"
    assert guarded.ask("GET", query).status_code == 401, (
        "an address is no place for a token but where it has to be"
    )


def test_a_wrong_token_is_told_where_none_is_needed(run: VirtualService) -> None:
    headers = {"authorization": "Bearer of-another-robot"}
    assert run.ask("GET", "/health", headers=headers).status_code == 401
    assert run.ask("POST", "/stop", headers=headers).status_code == 200


@pytest.mark.parametrize("header", ["X-Forwarded-For", "Forwarded", "X-Real-IP", "X-Forwarded-Proto", "Via"])
def test_who_comes_through_a_proxy_on_this_computer_does_not_sit_at_it(
    run: VirtualService, header: str
) -> None:
    headers = {header: "192.0.2.7"}
    for method, path in (("GET", "/health"), ("POST", "/robot/reset"), ("POST", "/mcp/mcp")):
        answer = run.ask(method, path, headers=headers)
        assert answer.status_code == 401
        assert answer.json()["detail"].startswith("through a proxy, a valid token of the role ")
        assert run.ask(method, path).status_code != 401
    with pytest.raises(Refused) as refused:
        run.connect("/robot/stream", **{header.lower(): "192.0.2.7"})
    assert refused.value.status == 401
    assert run.ask("POST", "/stop", headers=headers).status_code == 200
    assert run.ask("GET", "/docs", headers=headers).status_code == 200, "where a token can be entered"


def by_header(token: str) -> tuple[str, dict[str, str]]:
    return "", {"authorization": f"bearer {token}"}


def by_query(token: str) -> tuple[str, dict[str, str]]:
    return f"?token={token}&x=1", {}


def by_subprotocol(token: str) -> tuple[str, dict[str, str]]:
    return "", {"subprotocols": f"cobot, cobot.token.{token}"}


@pytest.mark.parametrize("way", [by_header, by_query, by_subprotocol])
@pytest.mark.parametrize("path", ["/robot/stream", "/rosbridge"])
def test_a_websocket_takes_a_token_in_three_ways(
    guarded: Guarded, path: str, way: Callable[[str], tuple[str, dict[str, str]]]
) -> None:
    query, headers = way(guarded.tokens[Role.OBSERVER])
    with guarded.run.connect(path + query, **headers) as socket:
        # A browser closes the connection if none of the subprotocols that it has offered is chosen.
        assert socket.subprotocol == ("cobot" if way is by_subprotocol else None)
    query, headers = way("wrong")
    with pytest.raises(Refused) as refused:
        guarded.run.connect(path + query, **headers)
    assert refused.value.status == 401


def test_a_protocol_that_the_service_has_chosen_stays_beside_a_token(guarded: Guarded) -> None:
    offered = f"foxglove.sdk.v1, cobot.token.{guarded.tokens[Role.OBSERVER]}"
    with guarded.run.connect("/foxglove", subprotocols=offered) as socket:
        assert socket.subprotocol == "foxglove.sdk.v1"


def test_no_token_is_in_the_log(guarded: Guarded) -> None:
    token = guarded.tokens[Role.OPERATOR]
    with Frames(guarded.run.connect(f"/robot/stream?token={token}")) as client:
        client.session()
        client.send("nonsense")
        client.answer()
    assert token not in guarded.run.output
    assert token not in json.dumps(guarded.run.ask("GET", "/health", headers=by_header(token)[1]).json())


def test_a_websocket_whose_token_is_revoked_is_closed_and_its_arm_comes_to_rest(guarded: Guarded) -> None:
    run = guarded.run
    token = guarded.file.create("leaving", Role.OPERATOR)
    run.sleep(1.0)
    with Frames(run.connect("/robot/stream", authorization=f"Bearer {token}")) as client:
        client.session()
        services = run.app.state.services
        assert services.ownership.owner is not None
        guarded.file.revoke("leaving")
        with pytest.raises(Closed, match="1008"):
            client.until_closed()
    run.until(lambda: services.ownership.owner is None)
    assert guarded.ask("GET", "/health", token).status_code == 401


def test_events_end_when_their_token_is_revoked(guarded: Guarded) -> None:
    run = guarded.run
    token = guarded.file.create("leaving", Role.OBSERVER)
    run.sleep(1.0)
    with (
        run.listen("/events?state_hz=10", authorization=f"Bearer {token}") as events,
        run.listen("/events", authorization=f"Bearer {guarded.tokens[Role.OBSERVER]}") as others,
    ):
        assert events.event("state")["robot"] == run.name
        guarded.file.revoke("leaving")
        with pytest.raises(Closed):
            events.event("nothing")
        run.post("/stop")
        assert others.event("stop")["robot"] == run.name
    assert guarded.ask("GET", "/events", token).status_code == 401
    with run.listen("/events") as nobody:
        assert nobody.status == 401


# Roles: each route, each vendor method, each operation of rosbridge


def role_by_the_docs(endpoint: str) -> Role:
    """docs/security.md: who looks reads; who stops need not be more; who brings a program along, or removes a
    recording, programs; who reads what the others do, and has the settings read anew, is an admin; who
    restarts what does not answer needs no token."""
    method, path = endpoint.split(" ")
    if path.startswith("/health/") or (path.startswith("/robots/") and path.endswith("/health/ready")):
        return Role.PUBLIC
    if path == "/audit" or path.startswith(("/admin/", "/access/")):
        return Role.ADMIN
    if "/plan/" in path or path.endswith(("/rehearse", "/improve")):
        return Role.AGENT
    if method in ("GET", "WS") or path.endswith("/stop") or "{method}" in path:
        return Role.OBSERVER
    if method == "DELETE" and "/recordings/" in path:
        return Role.PROGRAMMER
    if method in ("POST", "DELETE") and "/studies" in path:
        return Role.PROGRAMMER
    if method in ("PUT", "DELETE") and "/programs/" in path:
        return Role.PROGRAMMER
    return Role.PROGRAMMER if path.endswith(("/sequences/start", "/tool")) else Role.OPERATOR


def test_each_endpoint_declares_the_role_of_the_documents() -> None:
    roles = {name: endpoint.role for name, endpoint in ENDPOINTS.items()}
    assert {name: role_by_the_docs(name) for name in ENDPOINTS} == roles


def test_each_route_asks_for_its_role(guarded: Guarded) -> None:
    asked = set()
    for route in guarded.run.app.routes:
        name = endpoint_of(route)
        if name in PUBLIC_PATHS or not isinstance(route, APIRoute) or "{method}" in name:
            continue
        method, _, path = name.partition(" ")
        path = path.replace("{robot}", guarded.run.name)
        path += "?types=none" if path.endswith("/events") else ""  # or its answer would have no end
        needed = role_by_the_docs(name)
        asked.add(name)
        if not path.endswith("/stop"):
            assert (guarded.ask(method, path).status_code == 401) == (needed is not Role.PUBLIC), name
        for role in NAMES:
            status = guarded.ask(method, path, role).status_code
            assert (status == 403) == (role < needed), (name, role)
            assert status != 401
    once = {"GET /robots", "GET /audit", "GET /metrics", "GET /health/live", "POST /admin/reload"}
    once |= {"GET /admin/backup", "POST /admin/restore", "GET /admin/support"}
    once |= {f"{method} /access/tokens" for method in ("GET", "POST")} | {"DELETE /access/tokens/{name}"}
    assert once < asked
    assert len(asked) == 2 * (len(ENDPOINTS) - 5) - len(once)  # each twice, but for those of the service


def test_a_route_without_a_role_is_not_served() -> None:
    app = FastAPI(openapi_url=None)

    @app.get("/new")
    async def new() -> None: ...

    with pytest.raises(TypeError, match=r"GET /new has no role: declare it with `EndpointRouter\.endpoint`"):
        guard(app.routes, {})


LOOKS = ("get", "is", "has", "peek", "modbusGet", "axisGroupGet", "frameGet", "frameConvert")
COMPUTES = ("Math", "RobotAlgorithm")


def test_each_vendor_method_asks_for_its_role(guarded: Guarded) -> None:
    for (robot_class, method), service in REGISTRY.items():
        path = f"/{guarded.run.name}/{robot_class}/{method}"
        looks = robot_class in COMPUTES or (
            method.startswith(LOOKS) and robot_class not in ("Serial", "Socket")
        )
        assert (service.role is Role.OBSERVER) == looks, path
        assert service.role is not Role.ADMIN, path
        for role in (role for role in (Role(service.role - 1), service.role) if role in NAMES):
            answer = guarded.ask("POST", path, role, json={"no such field": 1})
            assert answer.status_code == (403 if role < service.role else 422), (path, role)
        assert guarded.ask("POST", path, json={}).status_code == 401


def test_who_changes_what_holds_later_programs() -> None:
    for name in (
        *("RobotConfig/setTcpOffset", "RobotConfig/setPayload", "RobotConfig/setJointMaxSpeeds"),
        *("RobotConfig/setCollisionLevel", "ForceControl/fcSetSensorLimits", "RegisterControl/setWatchDog"),
        *("RegisterControl/modbusAddSignal", "Serial/serialOpen", "Socket/socketOpen", "SyncMove/frameAdd"),
    ):
        assert REGISTRY[tuple(name.split("/"))].role is Role.PROGRAMMER, name  # type: ignore[index]


REQUIRED_FIELDS = {"topic": "/x", "service": "/x", "action": "/x", "type": "std_msgs/msg/String"} | {
    "data": "{}",
    "num": 0,
    "total": 2,
    "level": "error",
    "id": "1",
}


def test_each_operation_of_rosbridge_asks_for_its_role(guarded: Guarded) -> None:
    assert set(rosbridge_roles.ROLES) == set(OPERATIONS.values())
    looks = {"subscribe", "unsubscribe", "call_service", "set_level", "status", "fragment", "cobot_gateway"}
    for name in OPERATIONS:
        with guarded.connect("/rosbridge", Role.OBSERVER) as socket:
            socket.send(json.dumps({"op": name, **REQUIRED_FIELDS}))
            socket.send(json.dumps({"op": "call_service", "service": "/rosapi/nodes", "id": "end"}))
            said = ""
            while json.loads(message := str(socket.recv())).get("id") != "end":
                said += message
        assert ("has the role observer" in said) == (name not in looks), (name, said)


def calls(guarded: Guarded, role: Role, service: str, **arguments: Any) -> tuple[bool, str]:
    with guarded.connect("/rosbridge", role) as socket:
        socket.send(json.dumps({"op": "call_service", "service": service, "args": arguments}))
        while (answer := json.loads(socket.recv()))["op"] != "service_response":
            pass
    return answer["result"], str(answer["values"])


def test_a_service_called_over_rosbridge_asks_for_its_own_role(guarded: Guarded) -> None:
    robot = f"/{guarded.run.name}"
    graph = guarded.run.app.state.graph
    for (robot_class, method), service in REGISTRY.items():
        assert graph.service(f"{robot}/{robot_class}/{method}").role is service.role
    assert calls(guarded, Role.OBSERVER, f"{robot}/RobotConfig/getDof")[0]
    called, why = calls(guarded, Role.OBSERVER, f"{robot}/MotionControl/stopJoint")
    assert not called
    assert "the-observer has the role observer, but this request needs the role operator" in why
    entries = guarded.ask("GET", "/audit", Role.ADMIN).json()["entries"]
    seen = [(entry["who"], entry["what"], entry["outcome"]) for entry in entries]
    assert ("the-observer", f"rosbridge {robot}/MotionControl/stopJoint", "forbidden") in seen
    assert not calls(guarded, Role.OPERATOR, f"{robot}/RobotConfig/resetLimits")[0]
    assert calls(guarded, Role.PROGRAMMER, f"{robot}/RobotConfig/resetLimits")[0]
    for name, role in (
        ("send_goal", Role.OPERATOR),
        ("cancel_goal", Role.OPERATOR),
        ("get_result", Role.OBSERVER),
    ):
        assert graph.service(f"{robot}/servo_mode/_action/{name}").role is role


def test_an_observer_takes_no_control_on_the_stream_and_the_audit_says_that_it_tried(
    guarded: Guarded,
) -> None:
    with Frames(guarded.connect("/robot/stream", Role.OBSERVER)) as client:
        for kind in ("control", "release"):
            client.send(kind)
            refused = client.answer()
            assert (refused["code"], refused["about"]) == ("forbidden", kind)
    assert guarded.ask("GET", "/robot/control", Role.OBSERVER).json()["holder"] is None
    entries = guarded.ask("GET", "/audit", Role.ADMIN).json()["entries"]
    seen = [(entry["who"], entry["what"], entry["outcome"]) for entry in entries]
    for kind in ("control", "release"):
        assert ("the-observer", f"{kind} on the stream", "forbidden") in seen


def test_an_observer_watches_a_stream_and_opens_none(guarded: Guarded) -> None:
    with Frames(guarded.connect("/robot/stream", Role.OBSERVER)) as client:
        client.send("subscribe", rate_hz=50)
        assert client.state()["mode"] == "HOLD"
        client.send("session", stream="joint_impedance")
        answer = client.answer()
        assert (answer["type"], answer["code"]) == ("error", "forbidden")
        client.binary(2, 0, b"")
        assert client.answer()["type"] == "error"
    assert guarded.run.app.state.services.ownership.owner is None
    with Frames(guarded.connect("/robot/stream", Role.OPERATOR)) as client:
        client.session()
    guarded.run.until(lambda: guarded.run.app.state.services.ownership.owner is None)


def test_each_websocket_has_a_role(guarded: Guarded) -> None:
    paths = [endpoint_of(each) for each in guarded.run.app.routes if isinstance(each, APIWebSocketRoute)]
    below = [f"WS /robots/{{robot}}/{each}" for each in ("events", "foxglove", "stream")]
    assert sorted(paths) == ["WS /events", "WS /foxglove", "WS /robot/stream", *below, "WS /rosbridge"]
    with pytest.raises(Refused) as refused:
        guarded.run.connect(f"/robots/{guarded.run.name}/stream")
    assert refused.value.status == 401


# Settings


@pytest.mark.parametrize(
    ("setting", "address", "required"),
    [
        *(("auto", address, False) for address in ("127.0.0.1", "::1", "127.1.2.3", "::ffff:127.0.0.1")),
        *(
            ("auto", address, True)
            for address in ("0.0.0.0", "::", "192.168.1.5", "fe80::1%eth0", "::ffff:1.2.3.4", "robot")
        ),
        ("required", "127.0.0.1", True),
        ("none", "0.0.0.0", False),
    ],
)
def test_tokens_are_needed_beyond_this_computer(
    settings: Settings, setting: str, address: str, required: bool
) -> None:
    web = settings.web.model_copy(update={"authentication": setting})
    assert authentication_required(web, address) is required


@pytest.mark.parametrize(
    ("access", "localhost_only", "authentication", "role", "told"),
    [
        ("auto", True, "auto", Role.OPERATOR, "on this computer may move the robot without a token"),
        ("auto", True, "none", Role.OPERATOR, "on this computer may move the robot without a token"),
        ("auto", True, "required", Role.OBSERVER, "on this computer observes only"),
        ("auto", False, "auto", Role.OBSERVER, "on these networks observes only"),
        ("observe", True, "auto", Role.OBSERVER, "on this computer observes only"),
        ("move", False, "auto", Role.OPERATOR, "on these networks may move the robot without a token"),
        ("move", True, "required", Role.OPERATOR, "on this computer may move the robot without a token"),
        ("all", False, "auto", Role.ADMIN, "on these networks may do everything without a token"),
    ],
)
def test_ros_moves_the_robot_without_a_token_only_where_the_settings_permit_that(
    settings: Settings, access: str, localhost_only: bool, authentication: str, role: Role, told: str
) -> None:
    """Oracle: the table in docs/security.md, written out by hand."""
    ros = settings.ros.model_copy(update={"access": access, "localhost_only": localhost_only})
    web = settings.web.model_copy(update={"authentication": authentication})
    assert rights_of_ros(ros, web) is role
    assert ros_access(ros, web) == f"over ROS 2 every participant {told} (ros.access: {access})"
    assert ros_access(ros.model_copy(update={"enabled": False}), web) == "no ROS 2"


def test_a_stop_needs_no_token_unless_the_settings_ask_for_one_and_never_on_this_computer(
    guarded: Guarded,
) -> None:
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)

    @app.post("/stop")
    async def stop() -> None: ...

    guard(app.routes, {"POST /stop": Role.OBSERVER})
    run = guarded.run
    run.get("/health/live")  # the first request builds the middleware

    async def asked(address: str, token: str | None = None, through: str = "", **required: bool) -> int:
        access: Any = run.app.middleware_stack
        while not isinstance(access, Access):  # the middleware around another application
            access = getattr(access, "app", None) or access._app
        needed = {"required": True, "required_of_proxies": True} | required
        made = Access(app, access._tokens, access._origins, **needed)
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        headers |= {"X-Forwarded-For": through} if through else {}
        transport = httpx.ASGITransport(made, client=(address, 1))
        async with httpx.AsyncClient(transport=transport, base_url=run.url, headers=headers) as client:
            return (await client.post("/stop")).status_code

    assert run.run(asked("10.0.0.9")) == 401
    assert run.run(asked("10.0.0.9", "wrong")) == 401
    for here in ("127.0.0.1", "::1", "::ffff:127.0.0.1"):
        assert run.run(asked(here)) == 200
        assert run.run(asked(here, through="127.0.0.1")) == 401
    assert run.run(asked("127.0.0.1", through="10.0.0.9", required=False)) == 401
    open_to_all = {"required": False, "required_of_proxies": False}
    assert run.run(asked("127.0.0.1", through="10.0.0.9", **open_to_all)) == 200
    assert run.run(asked("10.0.0.9", guarded.tokens[Role.OBSERVER], "10.0.0.10")) == 200


def test_a_stop_that_switches_the_drives_off_needs_no_token_and_its_reset_does(guarded: Guarded) -> None:
    """Refused, it would be missed just when it is wanted."""
    stopped = guarded.ask("POST", "/stop?category=1")
    assert stopped.status_code == 200
    assert guarded.ask("GET", "/health", Role.OBSERVER).json()["robot"]["mode"] == "ESTOP"
    assert guarded.ask("POST", "/robot/reset").status_code == 401
    assert guarded.ask("POST", "/robot/reset", Role.OPERATOR).status_code == 200


# The schema


OPEN_PATHS = {
    *("/stop", "/robots/{robot}/stop"),
    *("/health/live", "/health/ready", "/robots/{robot}/health/ready"),
}


def test_the_schema_asks_for_tokens_where_they_are_needed(guarded: Guarded, run: VirtualService) -> None:
    rest, vendor = (guarded.run.get(path).json() for path in ("/openapi.json", "/openapi/vendor.json"))
    assert rest["paths"].keys() > OPEN_PATHS
    for schema in (rest, vendor):
        assert schema["components"]["securitySchemes"]["token"]["scheme"] == "bearer"
        for path, operations in schema["paths"].items():
            for endpoint in operations.values():
                free = path in OPEN_PATHS
                assert ("security" in endpoint) != free, path
                assert {"401", "403"} <= set(endpoint["responses"]) or free, path
    for path, schema, role in (
        ("/robot/move/joints", rest, "operator"),
        ("/admin/reload", rest, "admin"),
        ("/{robot}/RobotConfig/setPayload", vendor, "programmer"),
    ):
        assert f"Needs the role {role}." in schema["paths"][path]["post"]["description"]
    for path, schema in (("/openapi.json", rest), ("/openapi/vendor.json", vendor)):
        assert guarded.run.get(path).json() == schema
        open_to_all = run.get(path).json()  # the scheme is described, and no operation asks for it
        assert open_to_all["components"]["securitySchemes"] == schema["components"]["securitySchemes"]
        operations = [each for path in open_to_all["paths"].values() for each in path.values()]
        assert not any("security" in each for each in operations)


def test_settings_are_read_strictly(tmp_path: Path) -> None:
    file = tmp_path / "settings.yaml"
    for text, sentence in (
        ("web: {allowed_hosts: ['*']}", "is not a host name or address"),
        ("web: {allowed_hosts: ['http://robot.example']}", "is not a host name or address"),
        ("web: {allowed_hosts: ['robot.example:80']}", "is not a host name or address"),
        ("web: {allowed_origins: ['*']}", "is not the origin of a web page"),
        ("web: {allowed_origins: ['null']}", "is not the origin of a web page"),
        ("web: {allowed_origins: ['https://app.example/']}", "is not the origin of a web page"),
        ("web: {allowed_origins: ['https://App.example']}", "is not the origin of a web page"),
        ("web: {authentication: maybe}", "web.authentication"),
        ("ros: {access: some}", "ros.access"),
    ):
        file.write_text(text, encoding="utf-8")
        with pytest.raises(ConfigError, match=sentence):
            load_settings(file)
    file.write_text(
        "web: {allowed_hosts: [robot.example, 192.168.0.10, 'fe80::1'], "
        "allowed_origins: ['http://localhost:3000', 'https://app.foxglove.dev', 'http://[::1]:3000']}",
        encoding="utf-8",
    )
    assert len(load_settings(file).web.allowed_hosts) == 3
