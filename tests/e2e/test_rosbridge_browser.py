"""Pages in a headless Chromium: npm's roslib at rosbridge, and pages from elsewhere at everything.

Nobody here has written either of the two. Needs chromium, and npm with a registry for roslib; skipped, with
the reason, where they are missing.
"""

from __future__ import annotations

import http.server
import json
import shutil
import subprocess
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from chromium import CHROMIUM, Page, browsing
from cobot_run import Run
from folders import SUPPORT
from websockets.sync.client import ClientConnection

PAGE = SUPPORT / "roslib_page.js"
EVIL = "evil.example"
ATTACKS = """
async (service, robot) => {
    const csv = "joint1,joint2,joint3,joint4,joint5,joint6,joint7,t\\n0.5,0,0,-1.57,0,1.57,0,0\\n"
        + "0.6,0,0,-1.57,0,1.57,0,5\\n";
    const form = (name, file, text) => {
        const body = new FormData();
        body.append(name, new Blob([text]), file);
        return body;
    };
    const attack = (path, body) =>
        fetch(service + path, {method: "POST", mode: "no-cors", body}).then(() => "sent", () => "failed");
    const sent = [
        await attack("/trajectory/send_csv?move_to_start=true", form("file", "a.csv", csv)),
        await attack("/sequences/start", form("config", "a.lua", "robot.move_named('work')")),
        await attack("/" + robot + "/RobotManage/poweroff"),
        await attack("/stop"),
        await attack("/robot/reset"),
    ];
    const sockets = ["/rosbridge", "/robot/stream"].map((path) => new Promise((end) => {
        const socket = new WebSocket(service.replace("http", "ws") + path);
        socket.onopen = () => end("open");
        socket.onerror = () => end("refused");
    }));
    const read = fetch(service + "/health").then((answer) => answer.text(), () => "refused");
    return JSON.stringify({sent, sockets: await Promise.all(sockets), read: await read});
}
"""


@pytest.fixture(scope="module")
def roslib(tmp_path_factory: pytest.TempPathFactory) -> str:
    """roslib as one script, which defines ROSLIB."""
    npm = shutil.which("npm")
    if npm is None or CHROMIUM is None:
        pytest.skip("npm or chromium is not installed")
    folder = tmp_path_factory.mktemp("roslib")
    command = [npm, "install", "--no-audit", "--no-fund", "--silent", "roslib@2", "esbuild"]
    installed = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=200, check=False)
    if installed.returncode != 0:
        pytest.skip(f"npm cannot install roslib: {installed.stderr[-200:]}")
    (folder / "entry.js").write_text('export * from "roslib";\n', encoding="utf-8")
    bundle = ["node_modules/.bin/esbuild", "entry.js", "--bundle", "--format=iife", "--global-name=ROSLIB"]
    return subprocess.run(bundle, cwd=folder, capture_output=True, text=True, timeout=60, check=True).stdout


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[ClientConnection]:
    """The DevTools of a Chromium of its own, for which EVIL is a name of this computer."""
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with browsing(tmp_path, f"--host-resolver-rules=MAP {EVIL} 127.0.0.1") as tools:
        yield tools


@pytest.mark.thorough
def test_roslib_in_a_page_of_the_service(shared: Run, roslib: str, browser: ClientConnection) -> None:
    page = Page(browser)
    page.visit(f"{shared.url}/health")
    page.run(roslib)
    found = json.loads(page.run(f"({PAGE.read_text(encoding='utf-8')})({json.dumps(shared.name)})"))
    assert found["state"]["name"] == [f"joint{number}" for number in range(1, 8)]
    assert found["dof"] == {"code": 0, "message": "", "result": 7}
    assert "unknown key 'x'" in found["wrong"]["error"]
    assert f"/{shared.name}/joint_cmd" in found["topics"]
    assert found["feedback"]["mode"] == 1
    assert "Action was canceled" in found["result"]
    assert "the goal was cancelled" in found["result"]
    assert found["itself"] == {"success": True, "message": "hello"}


@pytest.mark.thorough
def test_a_page_from_elsewhere_may_not_connect(shared: Run, roslib: str, browser: ClientConnection) -> None:
    page = Page(browser)
    address = f"{shared.url.replace('http', 'ws')}/rosbridge"
    opened = "s.onopen = () => end('open'); s.onerror = () => end('refused')"
    script = f"new Promise(end => {{ let s = new WebSocket('{address}'); {opened} }})"
    assert page.run(script) == "refused"


@pytest.fixture
def elsewhere() -> Iterator[int]:
    """The port of a web server that serves an empty page."""

    class Handler(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()

        def log_message(self, *_: object) -> None: ...

    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()


@pytest.mark.thorough
def test_a_page_from_elsewhere_moves_stops_and_reads_nothing(
    shared: Run, browser: ClientConnection, elsewhere: int
) -> None:
    shared.go_home()

    def state() -> Any:
        with httpx.Client(base_url=shared.url) as client:
            paths = ("/trajectory/logs", "/sequences/status", "/robot/joint_states")
            return [client.get(path).json() for path in paths][:2], shared.joints()

    logs, joints = state()
    page = Page(browser)
    for host in (EVIL, "127.0.0.1", "localhost"):  # cross-site, and another port: same-site
        page.visit(f"http://{host}:{elsewhere}/")
        found = json.loads(page.run(f"({ATTACKS})({json.dumps(shared.url)}, {json.dumps(shared.name)})"))
        assert found["sent"] == ["sent"] * 5, "the browser has sent them: it is the service that refuses"
        assert found["sockets"] == ["refused", "refused"]
        assert found["read"] == "refused"
    after, joints_after = state()
    assert after == logs
    np.testing.assert_allclose(joints_after, joints, atol=1e-3)
    assert shared.healthy()


def test_a_page_whose_name_leads_to_the_service_is_not_served(shared: Run, browser: ClientConnection) -> None:
    """DNS rebinding: to the browser the page is of the same origin as the service."""
    page = Page(browser)
    page.visit(f"http://{EVIL}:{shared.url.rsplit(':', 1)[1]}/health")
    assert json.loads(page.run("document.body.innerText"))["code"] == "misdirected"
    stop = "fetch('/stop', {method: 'POST'}).then((answer) => answer.status)"
    assert page.run(stop) == 421


def test_the_service_s_own_page_may_use_it(shared: Run, browser: ClientConnection) -> None:
    page = Page(browser)
    page.visit(f"{shared.url}/health")
    assert page.run("fetch('/stop', {method: 'POST'}).then((answer) => answer.status)") == 200
