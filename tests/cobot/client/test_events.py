"""The Python client's iterator of events.

Oracles: streams written down by hand after the HTML standard; the requests that arrive at a transport of the
test.
"""

from __future__ import annotations

import itertools
import json
from collections.abc import Iterator
from typing import Any

import httpx2
import pytest

from cobot.client import Client
from cobot.client.events import EventReader, blocks
from cobot.errors import InputError, UnavailableError


def block(kind: str, number: int | None, epoch: str = "deadbeef") -> bytes:
    place = "" if number is None else f"id: {epoch}-{number}\n"
    content = {"type": kind, "data": {"n": number}} | ({} if number is None else {"id": number})
    return f"{place}event: {kind}\ndata: {json.dumps(content)}\n\n".encode()


class Service:
    """Answers one request after the other; a stream breaks off after its last block.

    Attributes:
        requests: that have come.
    """

    def __init__(self, *answers: Any) -> None:
        self.requests: list[httpx2.Request] = []
        self._answers = iter(answers)

    def __call__(self, request: httpx2.Request) -> httpx2.Response:
        self.requests.append(request)
        answer = next(self._answers)
        if isinstance(answer, Exception):
            raise answer
        if isinstance(answer, tuple):
            status, code = answer
            return httpx2.Response(status, json={"code": code, "detail": f"it is {code}"})
        return httpx2.Response(200, content=self._broken_off(answer))

    @staticmethod
    def _broken_off(parts: list[bytes]) -> Iterator[bytes]:
        yield from parts
        raise httpx2.ReadError("the connection is lost")

    def client(self) -> Client:
        return Client("http://robot.test:8007", transport=httpx2.MockTransport(self))


@pytest.fixture(autouse=True)
def no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cobot.client.events.FIRST_PAUSE_S", 0.0)
    monkeypatch.setattr("cobot.client.events.MAX_PAUSE_S", 0.0)


def test_blocks_are_read_as_the_standard_says() -> None:
    text = "retry: 1\n\n: a comment\nid:7\ndata: one\ndata:  two\n\n\nevent: x\ndata\n\nid: unfinished"
    assert list(blocks(iter(text.split("\n")))) == [
        {"retry": "1"},
        {"id": "7", "data": "one\n two"},
        {"event": "x", "data": ""},
    ]


def test_it_goes_on_after_the_last_event_when_the_connection_is_lost() -> None:
    service = Service(
        [block("hello", 4), block("mode", 5)[:20], block("mode", 5)[20:] + block("state", None)],
        httpx2.ConnectError("nobody is there"),
        (503, "unavailable"),
        [block("hello", 5), b"id: deadbeef-8\n\n"],
        [block("stop", 9)],
    )
    with service.client() as client:
        found = list(itertools.islice(client.events(["mode", "stop"], state_hz=5.0, after="0"), 3))
    assert [each["type"] for each in found] == ["mode", "state", "stop"]
    assert [each.headers.get("Last-Event-ID") for each in service.requests] == [
        None,
        *3 * ["deadbeef-5"],
        "deadbeef-8",
    ]
    for request in service.requests:
        assert request.url.path == "/events"
        assert dict(request.url.params) == {"types": "mode,stop", "state_hz": "5.0", "after": "0"}


def test_what_the_service_refuses_is_raised_as_its_error() -> None:
    with Service((422, "input")).client() as client, pytest.raises(InputError, match="it is input"):
        next(client.events(["moed"]))


def test_who_has_never_heard_anything_learns_at_once_that_nobody_is_there() -> None:
    service = Service(httpx2.ConnectError("nobody is there"))
    with service.client() as client, pytest.raises(UnavailableError, match="nobody is there"):
        next(client.events())
    assert len(service.requests) == 1


def test_it_gives_up_when_its_patience_is_at_an_end() -> None:
    now = itertools.count(0.0, 10.0)
    lines = iter([["id: deadbeef-1", "event: stop", 'data: {"type": "stop"}', ""]])

    class Stream:
        def __init__(self) -> None:
            self.left = next(lines, None)

        def __enter__(self) -> Stream:
            if self.left is None:
                raise httpx2.ConnectError("nobody is there any more")
            return self

        def __exit__(self, *_: object) -> None: ...

        def iter_lines(self) -> Iterator[str]:
            return iter(self.left or ())

    reader = EventReader(lambda headers: Stream(), 60.0, lambda: next(now), lambda seconds: None)
    events = reader.events()
    assert next(events) == {"type": "stop"}
    with pytest.raises(UnavailableError, match="no event for 60 s: nobody is there any more"):
        next(events)


def test_those_of_one_robot_are_asked_for_at_its_address() -> None:
    service = Service([block("stop", 1)])
    transport = httpx2.MockTransport(service)
    with Client("http://robot.test:8007", robot="left", transport=transport) as client:
        assert next(client.events())["type"] == "stop"
    assert service.requests[0].url.path == "/robots/left/events"
