"""A headless Chromium, by its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import re
import shutil
import subprocess
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from cobot_run import WAIT_S, until
from websockets.sync.client import ClientConnection, connect

CODES = {
    "Tab": 9, "Enter": 13, "Escape": 27, "PageDown": 34, "PageUp": 33, "End": 35,
    "ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "Delete": 46, "F2": 113,
}  # fmt: skip
CHROMIUM = shutil.which("chromium")
GONE = "Inspected target navigated or closed"


class LeftPageError(Exception):
    """The page has gone elsewhere, or is loaded anew, before it could answer."""


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
        # Chromium answers no pings while it draws on a busy computer.
        with connect(found.group(), max_size=None, ping_interval=None) as tools:
            yield tools
    finally:
        process.terminate()
        process.communicate(timeout=WAIT_S)


class Page:
    """A page of its own."""

    def __init__(self, tools: ClientConnection) -> None:
        self._tools = tools
        self._numbers = itertools.count(1)
        self._events: deque[dict[str, Any]] = deque(maxlen=1000)
        self._session: dict[str, str] = {}
        self._told: dict[str, Callable[[str], None]] = {}
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        attached = self.ask("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}

    def ask(self, method: str, **params: Any) -> dict[str, Any]:
        number = next(self._numbers)
        self._tools.send(json.dumps({"id": number, "method": method, "params": params, **self._session}))
        while (answer := json.loads(self._tools.recv(WAIT_S))).get("id") != number:
            self._keep(answer)
        if answer.get("error", {}).get("message") == GONE:
            raise LeftPageError(method)
        assert "result" in answer, (method, answer)
        result: dict[str, Any] = answer["result"]
        return result

    def event(self, method: str) -> dict[str, Any]:
        """What the next event of the DevTools of this name says; older ones of other names are forgotten."""
        while True:
            if not self._events:
                self._keep(json.loads(self._tools.recv(WAIT_S)))
                continue
            found = self._events.popleft()
            if found.get("method") == method:
                said: dict[str, Any] = found["params"]
                return said

    def _keep(self, event: dict[str, Any]) -> None:
        said = event.get("params", {})
        if event.get("method") == "Runtime.bindingCalled" and said["name"] in self._told:
            self._told[said["name"]](said["payload"])
        else:
            self._events.append(event)

    def bind(self, name: str, tell: Callable[[str], None]) -> None:
        """Have this page, and whatever it visits, a function of this name, which tells a text."""
        self.ask("Runtime.enable")
        self.ask("Runtime.addBinding", name=name)
        self._told[name] = tell

    def reveal(self, selector: str) -> None:
        """Open the page or the menu that holds an element, as a person does before using it."""
        found = f"document.querySelector({json.dumps(selector)})"
        page = self.run(f"{found}?.closest('[role=tabpanel][hidden]')?.id")
        if page:
            self.click(f"[aria-controls={page}]")
        part = self.run(f"{found}?.closest('[data-part][hidden]')?.dataset.part.split(' ')[0]")
        if part:
            self.click(f"label:has(> #view-{part})")
        menu = self.run(f"!{found}?.matches('summary') && {found}?.closest('details.menu:not([open])')?.id")
        if menu:
            self.click(f"#{menu} > summary")

    def write(self, selector: str, text: str) -> str:
        """In place of what a field has, as a person does: until it loses the focus. What it held then."""
        self.reveal(selector)
        element = f"document.querySelector({json.dumps(selector)})"
        self.run(f"(e => (e.scrollIntoView({{block: 'center'}}), e.focus(), e.select()))({element})")
        if text:
            self.ask("Input.insertText", text=text)
        else:
            self.key("Delete", "Delete")
        held: str = self.run(f"(e => {{ const held = e.value; e.blur(); return held; }})({element})")
        return held

    def set_to(self, selector: str, value: str) -> None:
        """A list, a slider or a field, by the keyboard, as a person does."""
        self.reveal(selector)
        element = f"document.querySelector({json.dumps(selector)})"
        kind = self.run(f"(e => (e.scrollIntoView({{block: 'center'}}), e.focus(), e.type))({element})")
        if kind == "select-one":
            wanted = f"[...{element}.options].findIndex((each) => each.value === {json.dumps(value)})"
            self._press(lambda: self.run(f"{wanted} - {element}.selectedIndex"), "ArrowDown", "ArrowUp")
        elif kind == "range":
            low, high, step = self.run(f"(e => [+e.min, +e.max, +e.step || 1])({element})")
            page = max((high - low) / 10.0, step)

            def left() -> float:
                return (float(value) - float(self.run(f"{element}.value"))) / step

            self._press(lambda: int(left() / page * step), "PageUp", "PageDown")
            self._press(lambda: round(left()), "ArrowRight", "ArrowLeft")
        else:
            assert self.write(selector, value) == value

    def _press(self, left: Callable[[], int], forwards: str, back: str) -> None:
        """A key until nothing is left."""
        presses = 0
        while steps := left():
            key = forwards if steps > 0 else back
            self.key(key, key)
            presses += 1
            assert presses < 2000, (forwards, steps)

    def choose(self, selector: str, file: Path) -> None:
        """A file in the dialogue that a button opens."""
        self.ask("Page.setInterceptFileChooserDialog", enabled=True)
        self._events.clear()
        self.click(selector)
        node = self.event("Page.fileChooserOpened")["backendNodeId"]
        self.ask("DOM.setFileInputFiles", files=[str(file)], backendNodeId=node)
        self.ask("Page.setInterceptFileChooserDialog", enabled=False)

    def save(self, selector: str, folder: Path) -> Path:
        """The file that a button gives to who presses it."""
        self.ask(
            "Browser.setDownloadBehavior", behavior="allow", downloadPath=str(folder), eventsEnabled=True
        )
        self._events.clear()
        self.click(selector)
        file = folder / self.event("Browser.downloadWillBegin")["suggestedFilename"]
        while self.event("Browser.downloadProgress")["state"] == "inProgress":
            pass
        return file

    def touch(self, selector: str) -> None:
        """A finger on it, which stays there until `lift`."""
        x, y = self.place(selector)
        self.ask("Emulation.setTouchEmulationEnabled", enabled=True)
        self.ask("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])

    def lift(self) -> None:
        self.ask("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
        self.ask("Emulation.setTouchEmulationEnabled", enabled=False)

    def block(self, *addresses: str) -> None:
        """What is asked for at these, with `*` for anything, is not answered; none: all is again."""
        self.ask("Network.enable")
        self.ask("Network.setBlockedURLs", urls=list(addresses))

    def visit(self, url: str) -> None:
        """Until it is loaded."""
        self.ask("Page.enable")
        self.ask("Page.navigate", url=url)
        address = url.split("/")[2]
        until(lambda: self.run("location.host + document.readyState") == f"{address}complete")

    def place(self, selector: str) -> tuple[float, float]:
        """The middle of an element, scrolled to. An open menu in front of it is closed, as a person does."""
        self.reveal(selector)
        x, y, menu = self.run(
            """(e => {
                e.scrollIntoView({block: 'center', behavior: 'instant'});
                const box = e.getBoundingClientRect();
                const [x, y] = [box.x + 0.5 * box.width, box.y + 0.5 * box.height];
                const menu = document.elementFromPoint(x, y)?.closest('details.menu[open]');
                return [x, y, menu && !menu.contains(e) ? menu.id : null];
            })"""
            f"(document.querySelector({json.dumps(selector)}))"
        )
        if menu:
            self.click(f"#{menu} > summary")
        return x, y

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

    def key(self, key: str, code: str, text: str = "", modifiers: int = 0) -> None:
        """Down and up.

        Args:
            modifiers: held meanwhile: 1 for Alt, 2 for Control.
        """
        about = {
            "key": key,
            "code": code,
            "windowsVirtualKeyCode": CODES.get(key, 32),
            "modifiers": modifiers,
        }
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
