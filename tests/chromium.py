"""A headless Chromium, by its DevTools protocol."""

from __future__ import annotations

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

    def run(self, script: str) -> Any:
        found = self.ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")
