"""rosbridge from a browser's page: npm's roslib in a headless Chromium, which nobody here has written.

Needs chromium and npm with a registry; skipped, with the reason, where they are missing.
"""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from chromium import CHROMIUM, Page, browsing
from running import Run
from websockets.sync.client import ClientConnection

PAGE = Path(__file__).parents[1] / "roslib_page.js"


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
    with browsing(tmp_path) as tools:
        yield tools


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
