"""Requests to a cell's panel, as a cell that reaches no service sees them.

Oracles: docs/fleet.md, "Panels through the hub"; Python's own decoder of URLs; a queue that is read slowly.
"""

from __future__ import annotations

import asyncio
import importlib.util
import secrets
import time
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

pytest.importorskip("cryptography")
if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)

from cobot.config import load_settings
from cobot.errors import BusyError, CobotError, InputError, NotFoundError, PermissionDenied, UnavailableError
from cobot.fleet.certificates import Signer, Verifier, issue_cell, issue_hub, make_authority
from cobot.fleet.messages import HubTime, written
from cobot.fleet.panel_cell import CellPanel
from cobot.fleet.panel_messages import (
    PIECE_BYTES,
    OpenHttp,
    OpenSocket,
    PanelHead,
    PanelRequest,
    ReadStream,
)
from cobot.fleet.panel_streams import MAX_STREAMS, PanelStream, PanelStreams

EPOCH = "0123456789abcdef"
NOWHERE = "http://127.0.0.1:9"
"""The port `discard`, where no service listens."""
GET = OpenHttp(kind="http", method="GET", path="/robots", headers={})
POST = OpenHttp(kind="http", method="POST", path="/robot/move/joints", headers={})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("fleet") / "hall"
    make_authority(made, "hall")
    issue_hub(made, ["hub.example"], 30)
    issue_cell(made, "one", 30)
    return made


class Cell:
    """A panel of a cell, and the audit that it writes."""

    def __init__(self, folder: Path, url: str = NOWHERE, *, verifies: bool = True, **accept: str) -> None:
        self.audit: list[tuple[str, str, str, str]] = []
        accepted = load_settings().fleet.accept.model_copy(update=accept)
        verifier = Verifier(folder / "cells" / "one") if verifies else None
        self.panel = CellPanel(
            "hall", "one", accepted, verifier, self.time, url, "token", lambda *each: self.audit.append(each)
        )
        self.panel.synchronize()
        self._signer = Signer(folder)

    def time(self) -> HubTime:
        return HubTime(epoch=EPOCH, time_s=time.monotonic())

    def request(self, wish: Any, body: bytes = b"", **changes: Any) -> bytes:
        now_s = time.monotonic()
        values = {
            "id": secrets.token_hex(12), "fleet": "hall", "cell": "one", "who": "ada", "role": "operator",
            "epoch": EPOCH, "issued_s": now_s, "expires_s": now_s + 10.0, "wish": wish,
            "body": sha256(body).hexdigest(),
        }  # fmt: skip
        return written(self._signer.signed(PanelRequest(**(values | changes))))

    def execute(self, content: bytes, body: bytes = b"") -> tuple[PanelHead, bytes]:
        run = asyncio.run_coroutine_threadsafe(self.panel._execute(content, body), self.panel._loop)
        return run.result(30.0)


@pytest.fixture
def cell(folder: Path) -> Iterator[Cell]:
    made = Cell(folder)
    yield made
    made.panel.close()


def test_a_request_that_was_changed_or_copied_is_not_executed(cell: Cell) -> None:
    request = cell.request(POST, b"{}")
    with pytest.raises(InputError, match="not the one that the hub has signed"):
        cell.execute(request, b'{"joints": []}')
    with pytest.raises(PermissionDenied, match="is not signed by a hub of this fleet"):
        cell.execute(request.replace(b"joints", b"pose"), b"{}")
    with pytest.raises(InputError, match="the request is for hall/two, but hall/one received it"):
        cell.execute(cell.request(GET, cell="two"))
    late_s = time.monotonic() - 60.0
    with pytest.raises(CobotError, match=r"s late and was not executed"):
        cell.execute(cell.request(GET, issued_s=late_s, expires_s=late_s + 2.0))
    request = cell.request(GET)
    with pytest.raises(UnavailableError, match="the service of the cell does not answer"):
        cell.execute(request)
    with pytest.raises(CobotError, match="was executed before"):
        cell.execute(request)


@pytest.mark.parametrize(
    ("accept", "role", "wish", "setting"),
    [
        ({}, "operator", POST, "panel_commands"),
        ({}, "admin", POST, "panel_commands"),
        ({"panel": "operator"}, "observer", GET, "panel"),
        ({"panel": "none", "panel_commands": "operator"}, "admin", POST, "panel"),
        ({"panel_commands": "programmer"}, "operator", POST, "panel_commands"),
    ],
)
def test_a_request_needs_the_role_that_the_settings_of_the_cell_name(
    folder: Path, accept: dict[str, str], role: str, wish: Any, setting: str
) -> None:
    cell = Cell(folder, **accept)
    try:
        with pytest.raises(
            PermissionDenied, match=rf"\(fleet.accept.{setting}\), but ada has the role {role}"
        ):
            cell.execute(cell.request(wish, role=role))
        assert cell.audit == []
    finally:
        cell.panel.close()


def test_an_accepted_change_that_fails_is_in_the_audit(folder: Path) -> None:
    cell = Cell(folder, panel_commands="operator")
    try:
        with pytest.raises(UnavailableError):
            cell.execute(cell.request(POST))
        assert [each[:3] for each in cell.audit] == [("ada", "panel POST /robot/move/joints", "error")]
    finally:
        cell.panel.close()


def test_without_a_certificate_or_a_service_there_is_no_panel(folder: Path) -> None:
    for made, error, words in (
        (Cell(folder, verifies=False), PermissionDenied, "without fleet.certificates"),
        (Cell(folder, url=""), NotFoundError, "without its web service"),
    ):
        try:
            with pytest.raises(error, match=words):
                made.execute(made.request(GET))
        finally:
            made.panel.close()


def test_a_stream_that_is_unknown_is_an_error_with_advice(cell: Cell) -> None:
    with pytest.raises(NotFoundError, match="load the page again"):
        cell.execute(cell.request(ReadStream(kind="read", stream="0" * 32)))


@pytest.mark.parametrize("path", ["/", "/panel/main.js", "/robots/arm/positions/caf%C3%A9", "/a/b.c~d"])
def test_paths_of_a_panel_are_passed_on(path: str) -> None:
    assert OpenHttp(kind="http", method="GET", path=path, headers={}).path == path


@pytest.mark.parametrize(
    "path",
    ["", "x", "//x", "/..", "/a/../b", "/%2e%2e/b", "/a/.%2E/b", "/a%2Fb", "/a%5Cb", "/a\\b", "/a%", "/a%0a",
     "/a b", "/a?b", "/a#b", "/é", "/./a", "/" + "a" * 2001],
)  # fmt: skip
def test_paths_that_could_lead_elsewhere_are_refused(path: str) -> None:
    with pytest.raises(ValidationError):
        OpenHttp(kind="http", method="GET", path=path, headers={})


@pytest.mark.parametrize("path", ["/foxglove", "/rosbridge", "/mcp/mcp", "/robots/a/../stream", "/stream/x"])
def test_only_states_and_events_have_websockets(path: str) -> None:
    with pytest.raises(ValidationError):
        OpenSocket(kind="socket", path=path)


@pytest.mark.parametrize(
    "headers", [{"a": "b\r\nc: d"}, {"A": "b"}, {"a:": "b"}, {"a": "é"}, {"a": "b" * 1001}]
)
def test_headers_with_other_headers_in_them_are_refused(headers: dict[str, str]) -> None:
    with pytest.raises(ValidationError):
        PanelHead(headers=headers)


def test_a_stream_that_is_not_read_slows_its_sender_down() -> None:
    async def run() -> tuple[int, bytes]:
        streams, sent = PanelStreams(), 0

        async def send(stream: PanelStream) -> None:
            nonlocal sent
            for _ in range(100):
                await stream.put(b"x" * 4096)
                sent += 4096

        stream = streams.open(send)
        await asyncio.sleep(0.05)
        waiting, content, ended = sent, b"", False
        while not ended:
            frames, ended = await stream.read(1.0)
            content += b"".join(each for _, each in frames)
        return waiting, content

    waiting, content = asyncio.run(run())
    assert waiting <= PIECE_BYTES + 4096
    assert content == b"x" * 409_600


def test_the_number_of_streams_is_bounded_and_those_without_a_reader_are_closed() -> None:
    async def run() -> None:
        streams = PanelStreams()

        async def wait(_: PanelStream) -> None:
            await asyncio.sleep(60.0)

        opened = [streams.open(wait) for _ in range(MAX_STREAMS)]
        with pytest.raises(BusyError, match="close a panel, or try again"):
            streams.open(wait)
        streams.close_unread(-1.0)
        await asyncio.sleep(0.0)
        assert all(each.task is not None and each.task.cancelling() for each in opened)
        streams.open(wait)

    asyncio.run(run())
