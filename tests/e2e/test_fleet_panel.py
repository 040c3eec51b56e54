"""The panel of a cell through the hub. The cell is on a computer that the browser cannot reach.

Oracles: network namespaces of Linux; Chromium; raw TCP connections and httpx, which know nothing of the hub;
the service of the cell, with its jobs and its audit.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from chromium import Page, browsing
from cobot_run import Run, answering, until
from fleets import FLEET, Hub
from network_namespaces import Host, connect, hosts

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.client.tls import tls_context

if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect as connect_socket

from cobot.fleet.certificates import issue_cell, issue_hub, make_authority
from cobot.fleet.panel_messages import MAX_BODY_BYTES, MAX_FRAME_BYTES, MAX_SOCKETS

HUB_ADDRESS = "10.9.1.1"
PARALLEL = 1000
LOAD = Path(__file__).parents[1] / "support" / "parallel_requests.py"
STOP_S = 2.0
"""Maximum time for a stop, the default deadline of one."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("fleet") / "certificates"
    make_authority(made, FLEET)
    issue_hub(made, ["localhost", HUB_ADDRESS], 30)
    issue_cell(made, "one", 30)
    return made


@pytest.fixture(scope="module")
def tokens(folder: Path) -> dict[str, str]:
    file = TokenFile(folder / "tokens.json")
    roles = {"ada": Role.OPERATOR, "bob": Role.OBSERVER, "eve": Role.ADMIN}
    return {name: file.create(name, role) for name, role in roles.items()}


@pytest.fixture(scope="module")
def office() -> Iterator[tuple[Host, Host]]:
    """The computer of the hub and the browser, where the tests run, and that of the cell."""
    with hosts(2) as (office, plant):
        connect(office, plant, 1)
        with office.inside():
            yield office, plant


@pytest.fixture(scope="module")
def hub(office: tuple[Host, Host], folder: Path, tokens: dict[str, str]) -> Iterator[Hub]:
    started = Hub(folder, tokens["bob"], host=HUB_ADDRESS)
    yield started
    started.close()


class PlantRun(Run):
    """`cobot run` on the computer of the cell."""

    def __init__(self, plant: Host, folder: Path, **options: Any) -> None:
        self.plant = plant
        super().__init__(folder, **options)

    def ask(self, method: str, path: str, **options: Any) -> Any:
        with self.plant.inside():
            answer = httpx.request(method, f"{self.url}{path}", timeout=60.0, **options)
        assert answer.status_code < 300, answer.text
        return answer.json()

    def move_slowly(self) -> str:
        """Begin a motion of more than a minute: its job."""
        joints = self.ask("GET", "/robot/joint_states")["position"]
        joints[0] += 1.2 if joints[0] < 0.0 else -1.2
        body = {"joints": joints, "speed": 0.01}
        job = str(self.ask("POST", "/robot/move/joints?wait=false", json=body)["id"])
        until(lambda: self.job(job) not in ("queued", "planning"))
        assert self.job(job) == "running"
        return job

    def job(self, job: str) -> str:
        return str(self.ask("GET", f"/jobs/{job}")["state"])


@pytest.fixture(scope="module")
def cell(
    office: tuple[Host, Host], hub: Hub, folder: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[PlantRun]:
    fleet = (
        f"{{name: {FLEET}, cell: one, connect: ['{hub.address}'], certificates: {folder}/cells/one, "
        "accept: {panel_commands: operator}}"
    )
    with office[1].inside():
        run = PlantRun(office[1], tmp_path_factory.mktemp("cell"), clock="realtime", more=f"fleet: {fleet}\n")
        with answering(run), office[0].inside():
            hub.until_state("one", "ready")
            yield run


def opened(hub: Hub, token: str) -> str:
    """The address of the panel for this person."""
    answer = hub.http.post("/cells/one/panel", headers={"Authorization": f"Bearer {token}"})
    assert answer.status_code == 200, answer.text
    return str(answer.json()["url"])


def client_of(hub: Hub, url: str) -> httpx.Client:
    """A client that knows only the address."""
    assert hub.certificates is not None
    trusted = ssl.create_default_context(cafile=hub.certificates / "ca.pem")
    return httpx.Client(base_url=url, verify=trusted, timeout=30.0)


@pytest.fixture
def viewer(hub: Hub, cell: PlantRun, tokens: dict[str, str]) -> Iterator[httpx.Client]:
    with client_of(hub, opened(hub, tokens["bob"])) as made:
        yield made


@pytest.fixture
def operator(hub: Hub, cell: PlantRun, tokens: dict[str, str]) -> Iterator[httpx.Client]:
    with client_of(hub, opened(hub, tokens["ada"])) as made:
        yield made


def socket_of(client: httpx.Client, path: str, hub: Hub) -> ClientConnection:
    assert hub.certificates is not None
    # This client reads and writes in two threads. Without the context of cobot.client, Python before 3.13
    # loses the request about once in 300 connections (see cobot.client.tls).
    trusted = tls_context(ssl.create_default_context(cafile=hub.certificates / "ca.pem"))
    url = str(client.base_url).replace("https", "wss").rstrip("/") + path
    return connect_socket(url, ssl=trusted, proxy=None, open_timeout=20.0, legacy=True)


def test_the_browser_cannot_reach_the_cell_itself(cell: PlantRun) -> None:
    """What the other tests are worth nothing without."""
    with cell.plant.inside():
        url = cell.url
        assert httpx.get(f"{url}/health").status_code == 200
    with pytest.raises(httpx.ConnectError):
        httpx.get(f"{url}/health")


@pytest.mark.thorough
@pytest.mark.skipif(shutil.which("chromium") is None, reason="chromium is not installed")
def test_a_person_uses_the_panel_of_a_cell_in_a_browser(
    hub: Hub, cell: PlantRun, tokens: dict[str, str], tmp_path: Path
) -> None:
    with browsing(tmp_path / "profile", "--ignore-certificate-errors") as tools:
        page = Page(tools)

        def wait_on(script: str) -> None:
            until(lambda: page.run(script), lambda: f": {script}; {page.run('document.body?.innerText')}")

        page.visit(hub.url)
        wait_on("document.querySelector('#login').open")
        page.write("#token", tokens["bob"])
        page.click("#enter")
        wait_on("document.querySelector('article .open-panel')?.hidden === false")
        page.click("article .open-panel")
        place = f"https://{HUB_ADDRESS}:{hub.panel_port}/"

        def windows() -> list[str]:
            targets = page.ask("Target.getTargets")["targetInfos"]
            return [each["url"] for each in targets if each["url"].startswith(place)]

        (url,) = until(windows)
        panel = Page(tools)
        panel.visit(url)
        page = panel
        wait_on("document.querySelector('#mode')?.textContent.match(/Ready/)")
        assert page.run("document.querySelector('#through-hub').innerText").startswith("You look at this")
        assert not page.run("sessionStorage.length"), "scripts of the cell do not see the token"
        wait_on(f"document.querySelector('#robot-name').textContent === '{cell.name}'")
        wait_on("window.cobotPanel.view !== null && window.cobotPanel.looks !== null")  # meshes have come
        job = cell.move_slowly()
        wait_on("document.querySelector('#mode').textContent.match(/Moving/)")
        page.key("Escape", "Escape")
        until(lambda: cell.job(job) == "cancelled")
        wait_on("!document.querySelector('#halt').hidden")
        hub.end(signal.SIGKILL)
        wait_on("document.body.hasAttribute('data-silent')")
        hub.start()
        hub.until_state("one", "ready")
        page.ask("Page.navigate", url=url)
        wait_on("document.body?.innerText.includes('Open the panel again from the page of the fleet')")


def test_a_viewer_reads_and_changes_nothing(viewer: httpx.Client, cell: PlantRun) -> None:
    assert cell.name in viewer.get("robots").text
    before = cell.ask("GET", "/robot/joint_states")["position"]
    refused = viewer.post("robot/move/joints", json={"joints": [0.0] * 7})
    assert (refused.status_code, "fleet.accept.panel_commands" in refused.text) == (403, True), refused.text
    assert viewer.put("programs/x", json={}).status_code == 403
    assert viewer.delete("robot/positions/x").status_code == 403
    assert viewer.get("access/tokens").status_code == 403
    assert cell.ask("GET", "/robot/joint_states")["position"] == pytest.approx(before, abs=1e-6)


def test_an_operator_moves_because_the_cell_accepts_it_and_the_audit_names_the_person(
    operator: httpx.Client, cell: PlantRun
) -> None:
    speed = operator.post("robot/speed_override", json={"fraction": 0.5})
    assert speed.status_code == 200, speed.text
    assert cell.ask("GET", "/robot/speed_override")["fraction"] == 0.5
    operator.request(speed.request.method, "robot/speed_override", json={"fraction": 1.0}).raise_for_status()
    entries = cell.ask("GET", "/audit")["entries"]
    found = [each for each in entries if each["who"] == "ada" and each["from"] == "fleet"]
    assert found[-1]["what"].startswith("panel "), entries
    assert operator.get("access/tokens").status_code == 403, "never more than a programmer"
    assert operator.post("admin/reload").status_code in (403, 404)


def test_states_and_events_come_over_websockets_and_a_viewer_cannot_jog(
    viewer: httpx.Client, hub: Hub, cell: PlantRun
) -> None:
    with socket_of(viewer, f"/robots/{cell.name}/stream", hub) as stream:
        assert json.loads(stream.recv(10.0))["type"] == "hello"
        stream.send(json.dumps({"type": "subscribe", "rate_hz": 50}))
        frames = [json.loads(stream.recv(10.0)) for _ in range(50)]
        numbers = [each["sequence"] for each in frames if each["type"] == "state"]
        assert numbers == sorted(set(numbers))
        jog = {"type": "jog", "frame": "joint", "velocity": [0.1] + [0.0] * 6}
        stream.send(json.dumps(jog))
        refused = until(lambda: _next(stream, "error"))
        assert refused["code"] == "forbidden" or "input" in refused["code"], refused
    with socket_of(viewer, f"/robots/{cell.name}/events?after=0", hub) as events:
        assert "type" in json.loads(events.recv(10.0))
    with pytest.raises(InvalidStatus):
        socket_of(viewer, "/foxglove", hub)


def _next(stream: ClientConnection, kind: str) -> dict[str, Any] | None:
    found: dict[str, Any] = json.loads(stream.recv(10.0))
    return found if found["type"] == kind else None


def connection_of(hub: Hub) -> ssl.SSLSocket:
    """A bare connection to the panels of the hub."""
    assert hub.certificates is not None
    trusted = ssl.create_default_context(cafile=hub.certificates / "ca.pem")
    plain = socket.create_connection((HUB_ADDRESS, hub.panel_port), 10.0)
    return trusted.wrap_socket(plain, server_hostname=HUB_ADDRESS)


def raw(hub: Hub, request: bytes) -> bytes:
    """The answer to bytes that no well-behaved client sends."""
    with connection_of(hub) as connection:
        connection.sendall(request)
        return connection.recv(65536)


def test_a_browser_that_leaves_during_its_motion_stops_it(
    operator: httpx.Client, hub: Hub, cell: PlantRun
) -> None:
    """As at the cell itself: docs/conventions.md, `web.stop_on_disconnect`."""
    joints = cell.ask("GET", "/robot/joint_states")["position"]
    joints[0] += 1.2 if joints[0] < 0.0 else -1.2
    body = json.dumps({"joints": joints, "speed": 0.01}).encode()
    head = (
        f"POST {urlsplit(str(operator.base_url)).path}robot/move/joints HTTP/1.1\r\nHost: {HUB_ADDRESS}\r\n"
        f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    )
    with connection_of(hub) as connection:
        connection.sendall(head.encode() + body)
        (job,) = until(lambda: cell.ask("GET", "/jobs", params={"state": "running"})["jobs"])
    assert until(lambda: cell.job(job["id"]) not in ("running", "stopping"))
    assert cell.job(job["id"]) == "cancelled"


def test_a_frame_that_is_too_large_ends_its_websocket_only(
    viewer: httpx.Client, hub: Hub, cell: PlantRun
) -> None:
    path = f"/robots/{cell.name}/events?after=0"
    with socket_of(viewer, path, hub) as large, socket_of(viewer, path, hub) as other:
        large.send("x" * (MAX_FRAME_BYTES + 1))
        with contextlib.suppress(ConnectionClosed):
            while True:
                large.recv(10.0)
        assert large.close_code == 1009, "of RFC 6455: the message is too big"
        assert "type" in json.loads(other.recv(10.0))
    assert viewer.get("robots").status_code == 200


@pytest.mark.parametrize(
    "path",
    ["/../access/tokens", "/%2e%2e/x", "/a/%2E%2E/%2e%2e/etc/passwd", "//etc/passwd", "/a%2fb", "/a%5cb",
     "/a%00b", "/%0d%0aX-Role:%20admin", "/é", "/" + 3000 * "a", "/@evil.example/"],
)  # fmt: skip
def test_odd_paths_reach_nothing(viewer: httpx.Client, hub: Hub, path: str) -> None:
    place = urlsplit(str(viewer.base_url)).path.rstrip("/")
    answer = raw(hub, f"GET {place}{path} HTTP/1.1\r\nHost: {HUB_ADDRESS}\r\n\r\n".encode())
    assert answer.split(b" ", 2)[1] in (b"400", b"404", b"414", b"422"), answer
    assert b"Traceback" not in answer


@pytest.mark.parametrize(
    ("line", "statuses"),
    [
        ("X-Request-Id: a\r\n\tX-Role: admin", (b"400", b"200")),
        ("Authorization: Bearer stolen", (b"200",)),
        ("X-Forwarded-For: 127.0.0.1\r\nCookie: a=b\r\nTransfer-Encoding: gzip", (b"200", b"400")),
        ("Host: evil.example", (b"400",)),
        ("X-Request-Id: " + 5000 * "a", (b"422", b"431", b"400")),
    ],
)
def test_odd_headers_change_nothing(
    viewer: httpx.Client, hub: Hub, line: str, statuses: tuple[bytes, ...]
) -> None:
    place = urlsplit(str(viewer.base_url)).path
    host = "" if line.startswith("Host") else f"Host: {HUB_ADDRESS}\r\n"
    answer = raw(hub, f"GET {place}robots HTTP/1.1\r\n{host}{line}\r\n\r\n".encode())
    assert answer.split(b" ", 2)[1] in statuses, answer
    refused = raw(
        hub,
        f"POST {place}robot/reset HTTP/1.1\r\n{host}{line}\r\nContent-Length: 0\r\n\r\n".encode(),
    )
    assert refused.split(b" ", 2)[1] != b"200", refused


@pytest.mark.thorough
def test_a_large_upload_is_refused_with_the_limit(operator: httpx.Client) -> None:
    for content in (b" " * (MAX_BODY_BYTES + 1), iter([b" " * 2**20] * 20)):
        try:
            answer = operator.post("robot/move/joints", content=content)
        except httpx.WriteError:
            continue  # refused before it was sent
        assert (answer.status_code, str(MAX_BODY_BYTES) in answer.json()["detail"]) == (413, True), (
            answer.text
        )
    kind = {"Content-Type": "application/json"}
    fits = operator.post("robot/move/joints", content=b" " * MAX_BODY_BYTES, headers=kind)
    assert fits.status_code == 422, "the service has read it"


def test_secrets_tokens_and_foreign_pages_do_not_get_in(
    viewer: httpx.Client, hub: Hub, folder: Path, tokens: dict[str, str]
) -> None:
    other = str(viewer.base_url.copy_with(path="/" + 32 * "A" + "/"))
    with client_of(hub, other) as unknown:
        assert unknown.get("robots").status_code == 404
        assert unknown.post("stop").status_code == 404
    evil = {"Origin": "https://evil.example"}
    assert viewer.post("stop", headers=evil).status_code == 403
    assert hub.http.post("/cells/one/panel", headers={"Authorization": ""}).status_code == 401
    assert hub.http.post("/cells/nowhere/panel").status_code == 404
    file = TokenFile(folder / "tokens.json")
    with client_of(hub, opened(hub, file.create("dan", Role.OBSERVER))) as former:
        assert former.get("robots").status_code == 200
        file.revoke("dan")
        until(lambda: former.get("robots").status_code == 401)
        assert former.post("stop").status_code == 401


@pytest.mark.thorough
def test_too_many_connections_are_refused(viewer: httpx.Client, hub: Hub, cell: PlantRun) -> None:
    path = f"/robots/{cell.name}/events?after=0"
    kept = [socket_of(viewer, path, hub) for _ in range(MAX_SOCKETS)]
    try:
        with pytest.raises(InvalidStatus):
            socket_of(viewer, path, hub)
    finally:
        for each in kept:
            each.close()
    until(lambda: _opens(viewer, path, hub))


def _opens(viewer: httpx.Client, path: str, hub: Hub) -> bool:
    try:
        socket_of(viewer, path, hub).close()
    except InvalidStatus:
        return False
    return True


@pytest.mark.thorough
@pytest.mark.parametrize("connections", [400, PARALLEL])
def test_a_stop_keeps_its_deadline_while_a_thousand_requests_run(
    viewer: httpx.Client, hub: Hub, cell: PlantRun, connections: int
) -> None:
    """With more connections than the hub accepts, it rejects further requests until some are closed.

    The client opens all connections before it has sent all requests, so the last ones may get status 408.
    """
    assert hub.certificates is not None
    job = cell.move_slowly()
    given = (f"{viewer.base_url}panel/words.json", str(hub.certificates / "ca.pem"))
    command = [sys.executable, str(LOAD), *given, str(PARALLEL), str(connections)]
    load = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert load.stdout is not None
        assert load.stdout.readline() == "begun\n"
        begun_s = time.monotonic()
        stopped = hub.http.post("/cells/one/stop")
        took_s = time.monotonic() - begun_s
        assert stopped.json()["at_rest"], stopped.text
        codes = {int(code): count for code, count in json.loads(load.communicate(timeout=120.0)[0]).items()}
    finally:
        load.kill()
        load.wait()
    print(f"stop {took_s:.2f} s, answers {codes}")
    assert cell.job(job) == "cancelled"
    assert took_s < STOP_S
    assert codes.get(200) or connections == PARALLEL, codes
    assert set(codes) <= {0, 200, 408, 409, 503}, codes
    until(lambda: viewer.get("robots").status_code == 200)


def test_a_stop_in_the_panel_works_without_the_service(viewer: httpx.Client, cell: PlantRun) -> None:
    job = cell.move_slowly()
    service = cell.child("app")
    assert service is not None
    service.suspend()
    try:
        answer = viewer.post("stop")
        assert (answer.status_code, answer.json()["success"]) == (200, True), answer.text
    finally:
        service.resume()
    assert until(lambda: cell.job(job) not in ("running", "planning"))


@pytest.mark.thorough
def test_a_lost_cell_gives_one_clear_page(
    viewer: httpx.Client, hub: Hub, cell: PlantRun, office: tuple[Host, Host]
) -> None:
    """The cable is pulled: packets vanish."""
    office[1].ip("link", "set", "net1", "down")
    hub.until_state("one", "gone")
    page = viewer.get("", headers={"Accept": "text/html", "Accept-Language": "de"})
    assert page.status_code == 503
    assert "Das Bedienpult dieser Zelle ist gerade nicht verfügbar" in page.text
    assert "use the emergency stop" in page.text
    assert page.text.count("<h1>") == 1
    assert viewer.get("robots").json()["code"] == "unavailable"
    stopped = viewer.post("stop").json()
    assert (stopped["success"], "NOT known to be stopped" in stopped["message"]) == (False, True)
    office[1].ip("link", "set", "net1", "up")
    hub.until_state("one", "ready")
    assert viewer.get("robots").status_code == 200
