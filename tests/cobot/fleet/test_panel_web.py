"""What a hub does for browsers that leave, hang, or stay for too long.

Oracles: docs/fleet.md, "Panels through the hub"; the specification of ASGI, whose calls these tests make by
hand; a link that notes what it is asked.
"""

from __future__ import annotations

import asyncio
import importlib.util
import json
import time
from typing import Any, cast

import pytest

pytest.importorskip("cryptography")
if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)

from cobot.errors import NotFoundError
from cobot.fleet import panel_link, panel_web
from cobot.fleet.hub import Hub
from cobot.fleet.panel_link import MAX_OPEN_S, UNUSED_S, OpenPanel, PanelLink, PanelPerson
from cobot.fleet.panel_messages import CloseStream, OpenHttp, PanelHead, ReadStream
from cobot.fleet.panel_web import MAX_CONNECTIONS, PanelApp

STREAM = 32 * "5"
BODY = {"type": "http.request", "body": b"", "more_body": False}
GONE = {"type": "http.disconnect"}


class FakeLink:
    """A cell that answers with pieces without an end, or, with `hangs`, with nothing."""

    def __init__(self, *, hangs: bool = False) -> None:
        self.panel = OpenPanel("one", lambda: PanelPerson("ada", "operator"))
        self.asked: list[Any] = []
        self.hangs = hangs

    def get(self, name: str) -> OpenPanel:
        return self.panel

    async def ask(self, panel: OpenPanel, wish: Any, body: bytes = b"") -> tuple[PanelHead, bytes]:
        await asyncio.sleep(0.01)
        self.asked.append(wish)
        if self.hangs:
            return PanelHead(stream=STREAM), b""
        return PanelHead(stream=STREAM, status=200 if isinstance(wish, OpenHttp) else 0), b"x" * 1000

    @property
    def closed(self) -> list[str]:
        return [each.stream for each in self.asked if isinstance(each, CloseStream)]


class FakeHub:
    stops = 0

    def robots_of(self, cell: str) -> list[dict[str, Any]]:
        return [{"alive": True}]

    def command(self, *_: Any) -> list[dict[str, Any]]:
        self.stops += 1
        return [{"robot": "arm", "code": "ok", "text": "at rest"}]


class Browser:
    """A connection of a browser: what it sends, and what it takes."""

    def __init__(self, *messages: dict[str, Any], takes: bool = True) -> None:
        self.sent: list[dict[str, Any]] = []
        self._messages: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        for message in messages:
            self._messages.put_nowait(message)
        self._takes = takes

    def leave(self) -> None:
        self._messages.put_nowait(GONE)
        self._messages.put_nowait(GONE)

    async def ask(self, app: PanelApp, method: str = "GET", path: str = "/robots") -> None:
        scope = {
            "type": "http", "method": method, "raw_path": f"/secret{path}".encode(), "path": f"/secret{path}",
            "query_string": b"", "headers": [], "asgi": {"spec_version": "2.3"},
        }  # fmt: skip
        await app(scope, self._receive, self._send)

    async def _receive(self) -> dict[str, Any]:
        return await self._messages.get()

    async def _send(self, message: Any) -> None:
        self.sent.append(message)
        if not self._takes and message["type"] == "http.response.body":
            await asyncio.Event().wait()

    @property
    def status(self) -> int:
        return int(self.sent[0]["status"])

    @property
    def answer(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.sent[1]["body"])
        return found


def app_of(link: FakeLink, hub: FakeHub | None = None, connections: int = 1) -> PanelApp:
    return PanelApp(cast(Hub, hub or FakeHub()), cast(PanelLink, link), lambda: connections)


@pytest.mark.parametrize("asks", [0, 1, 3])
def test_a_browser_that_leaves_ends_its_request_at_the_cell(asks: int) -> None:
    """So a motion stops as `web.stop_on_disconnect` of the cell says, also before the first answer of it."""

    async def run() -> FakeLink:
        link, browser = FakeLink(hangs=True), Browser(BODY)
        asking = asyncio.create_task(browser.ask(app_of(link), "POST", "/robot/move/joints"))
        while len(link.asked) < asks or link.panel.requests == 0:
            await asyncio.sleep(0.001)
        browser.leave()
        async with asyncio.timeout(5.0):
            await asking
            while not link.closed:
                await asyncio.sleep(0.001)
        return link

    link = asyncio.run(run())
    assert link.closed == [STREAM]
    assert link.panel.requests == 0


def test_a_browser_that_takes_no_answer_or_sends_no_body_does_not_hold_its_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(panel_web, "BROWSER_S", 0.05)

    async def run() -> tuple[FakeLink, Browser, Browser]:
        link = FakeLink()
        app = app_of(link)
        slow, silent = Browser(BODY, takes=False), Browser({**BODY, "more_body": True})
        async with asyncio.timeout(5.0):
            await slow.ask(app)
            await silent.ask(app, "POST")
        return link, slow, silent

    link, slow, silent = asyncio.run(run())
    assert slow.status == 200
    assert not any(each.get("more_body") is False for each in slow.sent), "it is seen to be incomplete"
    assert link.closed == [STREAM]
    assert (silent.status, "have arrived within" in silent.answer["detail"]) == (422, True)
    assert link.panel.requests == 0


def test_beyond_the_connections_a_sentence_says_so_and_a_stop_is_executed() -> None:
    async def run() -> tuple[FakeHub, Browser, Browser]:
        hub = FakeHub()
        app = app_of(FakeLink(), hub, MAX_CONNECTIONS + 1)
        late, stop = Browser(BODY), Browser(BODY)
        await late.ask(app)
        await stop.ask(app, "POST", "/stop")
        return hub, late, stop

    hub, late, stop = asyncio.run(run())
    assert (late.status, late.answer["code"]) == (409, "busy")
    assert f"allowed: {MAX_CONNECTIONS}; try again in a moment" in late.answer["detail"]
    assert (stop.status, stop.answer["success"], hub.stops) == (200, True, 1)


@pytest.mark.parametrize("path", ["/docs", "/docs/robots", "/redoc", "/v1/docs"])
def test_pages_that_work_at_the_cell_only_are_refused_with_the_reason(path: str) -> None:
    async def run() -> Browser:
        browser = Browser(BODY)
        await browser.ask(app_of(FakeLink()), path=path)
        return browser

    browser = asyncio.run(run())
    assert (browser.status, "at the address of the cell itself" in browser.answer["detail"]) == (501, True)


@pytest.mark.parametrize(("after_s", "used_s"), [(MAX_OPEN_S + 1.0, 0.0), (UNUSED_S + 1.0, UNUSED_S + 1.0)])
def test_a_panel_ends_also_while_its_websockets_are_open(after_s: float, used_s: float) -> None:
    link = PanelLink("hall", "0" * 16, cast(Any, None), cast(Any, None), cast(Any, None))
    name = link.open("one", lambda: PanelPerson("ada", "operator"))
    panel = link.get(name)
    panel.sockets = 1
    now_s = time.monotonic()
    panel.opened_s, panel.used_s = now_s - after_s, now_s - used_s
    with pytest.raises(NotFoundError, match="open it again from the page of the fleet"):
        asyncio.run(link.ask(panel, ReadStream(kind="read", stream=STREAM)))
    with pytest.raises(NotFoundError):
        link.get(name)


def test_beyond_the_panels_the_one_that_was_unused_for_longest_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(panel_link, "MAX_PANELS", 2)
    link = PanelLink("hall", "0" * 16, cast(Any, None), cast(Any, None), cast(Any, None))
    first, second = (link.open("one", lambda: PanelPerson("ada", "operator")) for _ in range(2))
    kept, ended = link.get(first), link.get(second)
    kept.use()  # as its WebSocket does
    link.open("one", lambda: PanelPerson("bob", "observer"))
    assert link.get(first) is kept
    with pytest.raises(NotFoundError):
        ended.use()
