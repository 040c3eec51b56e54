"""A headless Chromium, by its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from running import WAIT_S, until
from websockets.sync.client import ClientConnection, connect

CODES = {"Escape": 27, "Enter": 13, "PageDown": 34}
CHROMIUM = shutil.which("chromium")


@contextmanager
def browsing(folder: Path, *more: str) -> Iterator[ClientConnection]:
    """The DevTools of a Chromium of its own, which keeps its files in the folder.

    Args:
        more: options of Chromium.
    """
    options = ("--headless", "--no-sandbox", "--disable-gpu", "--remote-debugging-port=0", *more)
    process = subprocess.Popen(
        [str(CHROMIUM), *options, f"--user-data-dir={folder}", "about:blank"],
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
    """A page of its own."""

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
        result: dict[str, Any] = answer["result"]
        return result

    def visit(self, url: str) -> None:
        """Until it is loaded."""
        self.ask("Page.enable")
        self.ask("Page.navigate", url=url)
        address = url.split("/")[2]
        until(lambda: self.run("location.host + document.readyState") == f"{address}complete")

    def place(self, selector: str) -> tuple[float, float]:
        """The middle of an element, scrolled to."""
        box = self.run(
            f"(e => (e.scrollIntoView({{block: 'center', behavior: 'instant'}}), "
            f"e.getBoundingClientRect().toJSON()))(document.querySelector({json.dumps(selector)}))"
        )
        return box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]

    def mouse(self, kind: str, place: tuple[float, float]) -> None:
        """kind: of DevTools: mousePressed, mouseReleased, mouseMoved."""
        x, y = place
        buttons = {"mousePressed": 1}.get(kind, 0)
        self.ask(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=buttons, clickCount=1
        )

    def click(self, selector: str) -> None:
        """As a person does."""
        place = self.place(selector)
        self.mouse("mousePressed", place)
        self.mouse("mouseReleased", place)

    def key(self, key: str, code: str, text: str = "") -> None:
        """Down and up."""
        about = {"key": key, "code": code, "windowsVirtualKeyCode": CODES.get(key, 32)}
        self.ask("Input.dispatchKeyEvent", type="keyDown", text=text, **about)
        self.ask("Input.dispatchKeyEvent", type="keyUp", **about)

    def picture(self, file: Path) -> None:
        """What it shows, as PNG."""
        file.write_bytes(self.shot())

    def shot(self) -> bytes:
        """What it shows, as the bytes of a PNG."""
        return base64.b64decode(self.ask("Page.captureScreenshot")["data"])

    def run(self, script: str) -> Any:
        found = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")
