"""What `cobot fleet` asks, and what it makes of the answers. Oracle: a web server of Python's library."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cobot_run import until

from cobot.client import Client
from cobot.client.websocket import WebSocketTransport
from cobot.errors import InputError
from cobot.fleet import ordering
from cobot.fleet.__main__ import main
from cobot.fleet.watching import ServiceWatch

ROOT = Path(__file__).parents[3]
CONNECTED = {"code": "conflict", "detail": "the cell two is connected"}


class Server(ThreadingHTTPServer):
    """Answers each request with the next of `answers`, and notes it. The last answer stays."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers: list[tuple[int, str]] = [(200, "{}")]
        self.asked: list[str] = []
        self.url = f"http://127.0.0.1:{self.server_port}"


class Handler(BaseHTTPRequestHandler):
    def _answer(self) -> None:
        server: Any = self.server
        server.asked.append(f"{self.command} {self.path}")
        status, text = server.answers.pop(0) if len(server.answers) > 1 else server.answers[0]
        self.send_response(status)
        self.end_headers()
        self.wfile.write(text.encode())

    do_GET = do_POST = do_DELETE = _answer  # noqa: N815 - names of the library

    def log_message(self, *_: Any) -> None: ...


@pytest.fixture
def servers() -> Iterator[tuple[Server, Server]]:
    made = Server(), Server()
    for each in made:
        threading.Thread(target=each.serve_forever, args=(0.01,), daemon=True).start()
    yield made
    for each in made:
        each.shutdown()
        each.server_close()


@pytest.mark.parametrize("text", ["<html>a page</html>", "[1]", '"text"', "null"])
@pytest.mark.parametrize("status", [200, 404])
def test_an_answer_of_another_program_is_an_error_with_advice(
    servers: tuple[Server, Server], capsys: pytest.CaptureFixture[str], status: int, text: str
) -> None:
    servers[0].answers = [(status, text)]
    assert main(["list", "--url", servers[0].url]) == 1
    said = capsys.readouterr().err
    assert f"/cells: status {status}, the answer does not come from a hub of cobot; check the URL" in said


def test_one_cell_that_cannot_be_removed_does_not_keep_the_others(
    servers: tuple[Server, Server], capsys: pytest.CaptureFixture[str]
) -> None:
    hub = servers[0]
    hub.answers = [(200, '{"removed": "one"}'), (409, json.dumps(CONNECTED)), (200, '{"removed": "three"}')]
    assert main(["forget", "one", "two", "three", "--json", "--url", hub.url]) == 1
    said = capsys.readouterr()
    assert hub.asked == ["DELETE /cells/one", "DELETE /cells/two", "DELETE /cells/three"]
    assert [each["removed"] for each in json.loads(said.out)] == ["one", "three"]
    assert said.err == "cobot: not removed: the cell two is connected\n"


def test_neither_a_stop_nor_the_state_of_an_arm_goes_through_a_web_proxy(
    servers: tuple[Server, Server], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the server that the environment names as the proxy hears nothing."""
    hub, proxy = servers
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.setenv(name, proxy.url)
    robot = {"cell": "one", "robot": "arm", "code": "ok", "text": "at rest"}
    hub.answers = [(200, json.dumps({"robots": [robot]}))]
    assert main(["stop", "one", "--url", hub.url]) == 0
    assert hub.asked == ["POST /cells/one/stop"]
    watch = ServiceWatch(hub.url, "arm", "")
    until(lambda: "GET /robots/arm/health" in hub.asked or proxy.asked)
    watch.end()
    assert proxy.asked == []


def test_a_recording_does_not_go_through_a_web_proxy(
    servers: tuple[Server, Server], monkeypatch: pytest.MonkeyPatch, tmp_path: Any
) -> None:
    """Oracle: the server that the environment names as the proxy hears nothing."""
    hub, proxy = servers
    monkeypatch.setenv("http_proxy", proxy.url)
    monkeypatch.delenv("no_proxy", raising=False)
    monkeypatch.delenv("NO_PROXY", raising=False)
    listed = {"cell": "one", "robot": "arm", "name": "a.mcap", "size": 3}
    listings = [(200, json.dumps({"recordings": [listed]})), (200, '{"robots": []}')]
    hub.answers = [*listings, (206, "abc")]
    assert main(["pull", str(tmp_path), "--url", hub.url]) == 0
    assert (tmp_path / "one" / "arm" / "a.mcap").read_text() == "abc"
    assert proxy.asked == []


@pytest.mark.parametrize(
    "options",
    [("stop", "--all", "--deadline", "nan"), ("speed", "--all", "--fraction", "inf")],
)
def test_a_number_that_is_not_finite_is_wrong_usage(
    servers: tuple[Server, Server], capsys: pytest.CaptureFixture[str], options: tuple[str, ...]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        main([*options, "--url", servers[0].url])
    assert f"argument {options[2]}: {options[3]!r} is not a finite number" in capsys.readouterr().err
    assert servers[0].asked == []


@pytest.mark.parametrize("token", ["t\u00f6ken", "two\nlines"])
def test_a_token_that_no_header_can_have_is_an_error_with_advice(
    servers: tuple[Server, Server], capsys: pytest.CaptureFixture[str], token: str
) -> None:
    assert main(["list", "--url", servers[0].url, "--token", token]) == 1
    assert "has characters other than printable ASCII; copy it again" in capsys.readouterr().err
    connections: list[Any] = [Client, WebSocketTransport]
    for connect in connections:
        with pytest.raises(InputError, match="other than printable ASCII"):
            connect(servers[0].url, token=token)
    assert servers[0].asked == []


def test_ctrl_c_at_the_end_of_a_roll_out_shows_its_result(
    servers: tuple[Server, Server], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: docs/fleet.md: the status is 0 if it is done everywhere."""

    def interrupt(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(ordering, "time", SimpleNamespace(sleep=interrupt))
    running = {"id": "1", "bundle": "b", "title": "seams 1", "lines": [], "state": "running"}
    ended = {"code": "conflict", "detail": "the roll-out 1 has ended: done"}
    done = running | {"lines": ["one/arm: activated"], "state": "done"}
    said = [(200, running), (200, running), (200, running), (409, ended), (200, done)]
    servers[0].answers = [(status, json.dumps(each)) for status, each in said]
    folder = ROOT / "examples" / "fleet" / "seams"
    assert main(["roll-out", str(folder), "one", "--version", "1", "--url", servers[0].url]) == 0
    assert servers[0].asked[-2:] == ["POST /roll-outs/1/cancel", "GET /roll-outs/1"]
    assert capsys.readouterr().out == "one/arm: activated\nseams 1: done\n"
