"""Each path below /v1 and without it.

Oracles: the answers of the plain paths, which other tests check; ASGI's meaning of `root_path`; the files of
the panel.
"""

from __future__ import annotations

import asyncio
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from asgi_client import Closed, Refused
from mcp.client.session import ClientSession
from virtual_service import URL, VirtualService, virtual_service

from app.api.documentation.swagger import SERVERS
from app.api.middleware.versions import Versions, plain_path
from app.listeners.http import HEALTH, STOP
from app.main import create_app
from app.routes import ENDPOINTS
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.addresses import VERSION, service_of
from cobot.config import Settings

POLLED = [
    name.split(" ")[1]
    for name in ENDPOINTS
    if name.startswith("GET ") and "{" not in name and name not in ("GET /events", "GET /metrics")
]
PAGES = (
    "/",
    "/docs",
    "/redoc",
    "/openapi.json",
    "/openapi/robots.json",
    "/static-offline-docs/redoc.standalone.js",
)


@pytest.mark.parametrize("path", [*POLLED, *PAGES])
def test_what_is_read_is_the_same_with_the_version(service: VirtualService, path: str) -> None:
    plain, versioned = service.get(path), service.get(VERSION + path)
    assert (versioned.status_code, versioned.headers["content-type"]) == (
        plain.status_code,
        plain.headers["content-type"],
    )
    if plain.headers["content-type"] == "application/json" and isinstance(plain.json(), dict):
        assert versioned.json().keys() == plain.json().keys()


def test_all_files_of_the_panel_are_there_too(service: VirtualService) -> None:
    files = re.findall(r'(?:src|href)="(panel/[^"]+)"', service.get(f"{VERSION}/").text)
    assert files
    for file in (f"/{each}" for each in files):
        assert service.get(VERSION + file).content == service.get(file).content != b""


def test_a_motion_has_its_timeout_and_its_job_and_the_audit_names_the_whole_path(
    service: VirtualService,
) -> None:
    body = {"name": "home", "speed": 1.0}
    assert service.post(f"{VERSION}/robot/move/named", body).json()["success"]
    accepted = service.post(f"{VERSION}/robot/move/named?wait=false", body)
    assert accepted.status_code == 202
    assert accepted.headers["location"] == f"{VERSION}/jobs/{accepted.json()['id']}"
    assert service.get(f"{accepted.headers['location']}?wait_s=60").json()["state"] == "finished"
    named = service.post(f"{VERSION}/robots/{service.name}/move/named?wait=false", body)
    assert named.headers["location"] == f"{VERSION}/robots/{service.name}/jobs/{named.json()['id']}"
    assert service.get(f"{named.headers['location']}?wait_s=60").json()["state"] == "finished"
    plain = service.post(f"/robots/{service.name}/move/named?wait=false", body)
    assert plain.headers["location"] == f"/robots/{service.name}/jobs/{plain.json()['id']}"
    assert service.get(f"{plain.headers['location']}?wait_s=60").json()["state"] == "finished"
    entries = service.get("/audit").json()["entries"]
    assert f"POST {VERSION}/robot/move/named" in [each["what"] for each in entries]


def test_the_vendor_services_and_agents_are_there_too(service: VirtualService) -> None:
    assert service.post(f"{VERSION}/{service.name}/RobotConfig/getDof", {}).json()["result"] == 7
    begin = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "initialize",
        "params": {
            "protocolVersion": "2025-03-26",
            "capabilities": {},
            "clientInfo": {"name": ClientSession.__name__, "version": "1"},
        },
    }
    headers = {"accept": "application/json, text/event-stream"}
    assert service.ask("POST", f"{VERSION}/mcp/mcp", json=begin, headers=headers).status_code == 200


@pytest.mark.parametrize("path", ["/robot/stream", "/robots/NAME/stream"])
def test_a_websocket_tells_the_state(service: VirtualService, path: str) -> None:
    with service.connect(f"{VERSION}{path}".replace("NAME", service.name)) as socket:
        assert json.loads(socket.recv())["type"] == "hello"


def test_events_come_as_they_happen(service: VirtualService) -> None:
    away = [0.1, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0]
    with service.listen(f"{VERSION}/events?types=motion") as events:
        service.post(f"{VERSION}/robot/move/joints", {"joints": away, "speed": 1.0})
        assert events.event("motion")["data"]


@pytest.mark.parametrize(
    ("path", "meant"),
    [
        ("/v1/robot/psoe", "there is no /v1/robot/psoe (did you mean /v1/robot/pose?)"),
        ("/V1/Robot/pose", "there is no /V1/Robot/pose (did you mean /v1/robot/pose?)"),
        ("/v1//robot/pose", "there is no /v1//robot/pose (did you mean /v1/robot/pose?)"),
        ("/v1/v1/robot/pose", "there is no /v1/v1/robot/pose"),
        ("/v2/robot/pose", "there is no /v2/robot/pose (did you mean /robot/pose?)"),
        ("/v1robot/pose", "there is no /v1robot/pose (did you mean /robot/pose?)"),
        ("/v1/v1/", "there is no /v1/v1/"),
    ],
)
def test_a_wrong_path_is_answered_with_the_whole_one(service: VirtualService, path: str, meant: str) -> None:
    answer = service.get(path)
    assert answer.status_code == 404
    assert answer.json()["detail"].startswith(meant)


def test_a_slash_too_much_leads_to_the_versioned_path(service: VirtualService) -> None:
    answer = service.get(f"{VERSION}/robot/pose/")
    assert (answer.status_code, answer.headers["location"]) == (307, f"{URL}{VERSION}/robot/pose")
    assert service.get(VERSION).headers["location"] == f"{URL}{VERSION}/"


def test_a_wrong_method_names_the_right_one(service: VirtualService) -> None:
    answer = service.post(f"{VERSION}/robot/pose", {})
    assert (answer.status_code, answer.headers["allow"]) == (405, "GET")


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[VirtualService, str]]:
    folder = tmp_path_factory.mktemp("guarded")
    token = TokenFile(folder / "tokens.json").create("looks", Role.OBSERVER)
    with virtual_service(folder, more="web: {authentication: required, tokens: tokens.json}\n") as run:
        yield run, f"Bearer {token}"


@pytest.mark.parametrize("below", [VERSION, f"{VERSION}/robots/NAME"])
def test_the_version_is_no_way_around_the_rights(guarded: tuple[VirtualService, str], below: str) -> None:
    run, token = guarded
    at = below.replace("NAME", run.name)
    assert run.get(f"{at}/health").status_code == 401
    move = f"{at}/robot/move/named" if at == VERSION else f"{at}/move/named"
    body = {"json": {"name": "home", "speed": 1.0}}
    assert run.ask("POST", move, **body).status_code == 401
    assert run.ask("POST", move, headers={"Authorization": token}, **body).status_code == 403
    with pytest.raises((Refused, Closed)):
        run.connect(f"{at}/events")
    page = run.get(f"{VERSION}/docs")
    assert page.status_code == 200
    assert page.headers["x-frame-options"] == "DENY"


def test_a_stop_and_health_below_the_version_take_no_turn() -> None:
    for path in ("/v1/stop", "/v1/robots/left-1/stop", "/stop"):
        assert STOP.match(f"POST {path} HTTP/1.1".encode())
    assert HEALTH.match(b"GET /v1/health/live HTTP/1.1")
    for path in ("/v2/stop", "/v1/v1/stop", "/v1stop"):
        assert not STOP.match(f"POST {path} HTTP/1.1".encode())


def test_a_proxy_that_names_a_place_of_its_own_keeps_it() -> None:
    seen: list[Any] = []

    async def application(scope: Any, receive: Any, send: Any) -> None:
        seen.append((scope.get("root_path"), plain_path(scope) if "path" in scope else None))

    async def ask() -> None:
        for scope in (
            {"type": "http", "path": "/v1/stop", "root_path": ""},
            {"type": "websocket", "path": "/arm/v1/stop", "root_path": "/arm"},
            {"type": "http", "path": "/v1"},
            {"type": "lifespan"},
        ):
            await Versions(application)(scope, None, None)  # type: ignore[arg-type]

    asyncio.run(ask())
    assert seen == [("/v1", "/stop"), ("/arm", "/v1/stop"), ("/v1", ""), (None, None)]


def test_the_documents_list_each_path_once_and_name_both_servers(settings: Settings, tmp_path: Path) -> None:
    document = create_app(settings, None, "http://robot.test").openapi()
    assert not [path for path in document["paths"] if path.startswith(VERSION)]
    assert [each["url"] for each in document["servers"]] == ["/v1", "/"]
    assert document["servers"] == SERVERS


def test_the_client_takes_an_address_with_the_version(service: VirtualService) -> None:
    for url in (f"{URL}{VERSION}", f"{URL}{VERSION}/robots/{service.name}", f"{URL}/robots/{service.name}/"):
        with service.client(url) as robot:
            assert robot.pose()["frame_id"] == "base_link"
            assert robot.call_service(service.name, "RobotConfig", "getDof", {})["result"] == 7
    assert service_of("http://host:8007/v1/robots/left") == "/v1"
    assert service_of("http://host/cell/v1/") == "/cell/v1"
    assert service_of("http://host:8007/robots/left") == service_of("http://host") == ""
