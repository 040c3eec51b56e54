"""rosbridge from a browser's page: npm's roslib in a headless Chromium, which nobody here has written.

Needs chromium and npm with a registry; skipped, with the reason, where they are missing.
"""

from __future__ import annotations

import itertools
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from running import WAIT_S, Run
from websockets.sync.client import ClientConnection, connect

PAGE = Path(__file__).parents[1] / "roslib_page.js"
CHROMIUM = shutil.which("chromium")


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
    """The DevTools of a Chromium of its own."""
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0")
    process = subprocess.Popen(
        [str(CHROMIUM), *options, f"--user-data-dir={tmp_path}", "about:blank"],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        assert process.stderr is not None
        found = next(filter(None, (re.search(r"ws://\S+", line) for line in process.stderr)))
        with connect(found.group(), max_size=None) as tools:
            yield tools
    finally:
        process.terminate()
        process.communicate(timeout=WAIT_S)


class Page:
    """A page, by the DevTools protocol."""

    def __init__(self, tools: ClientConnection) -> None:
        self._tools = tools
        self._numbers = itertools.count(1)
        self._session: dict[str, str] = {}
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._tools.send(json.dumps({"id": number, "method": method, "params": params, **self._session}))
        while (answer := json.loads(self._tools.recv(WAIT_S))).get("id") != number:
            pass
        return answer["result"]

    def run(self, script: str) -> Any:
        found = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")


def test_roslib_in_a_page_of_the_service(shared: Run, roslib: str, browser: ClientConnection) -> None:
    page = Page(browser)
    page.ask("Page.enable")
    page.ask("Page.navigate", url=f"{shared.url}/health")
    while page.run("location.host + document.readyState") != f"{shared.url.removeprefix('http://')}complete":
        pass
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


def test_a_page_from_elsewhere_may_not_connect(shared: Run, roslib: str, browser: ClientConnection) -> None:
    page = Page(browser)
    address = f"{shared.url.replace('http', 'ws')}/rosbridge"
    opened = "s.onopen = () => end('open'); s.onerror = () => end('refused')"
    script = f"new Promise(end => {{ let s = new WebSocket('{address}'); {opened} }})"
    assert page.run(script) == "refused"
