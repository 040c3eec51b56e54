"""The remote transport, against a service made of `websockets` that says what it is told to.

Oracle: the frames that the fake has received; the classes of cobot/errors.py.
"""

from __future__ import annotations

import http
import json
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from cobot_run import until
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response
from websockets.sync.server import ServerConnection, serve

from cobot.client import websocket as remote
from cobot.client.connection import ERRORS
from cobot.client.websocket import WebSocketTransport
from cobot.errors import InputError, LayoutError, UnavailableError
from cobot.ipc.layout import info_dtype, session_dtype, setpoint_dtype
from cobot.ipc.state_fields import LAYOUT_VERSION, state_dtype

DOF = 3
WISH = np.zeros((), session_dtype(DOF))
SETPOINT = np.zeros((), setpoint_dtype(DOF))


class Fake:
    """A service of one robot; what it answers to a session is a plain attribute."""

    def __init__(self) -> None:
        rng = np.random.default_rng(8007)
        self.info = np.zeros((), info_dtype(DOF))
        for name in self.info.dtype.names[2:]:
            self.info[name] = rng.normal(size=self.info[name].shape)
        self.info["model"], self.info["joint_names"] = b"three", [b"a", b"b", b"c"]
        self.layout = LAYOUT_VERSION
        self.answer: dict[str, Any] | None = {"type": "session", "number": 7}
        self.state = np.zeros((), state_dtype(DOF))
        self.sending = True
        self.refusal: tuple[int, bytes] | None = None
        self.frames: list[bytes] = []
        self.connection: ServerConnection | None = None

    def hello(self) -> str:
        info = {name: self.info[name].tolist() for name in self.info.dtype.names}
        info |= {"model": "three", "joint_names": ["a", "b", "c"]}
        return json.dumps({"type": "hello", "robot": "fake", "dof": DOF, "layout": self.layout, **info})

    def serve(self, connection: ServerConnection) -> None:
        self.connection = connection
        connection.send(self.hello())
        threading.Thread(target=self.publish, args=(connection,), daemon=True).start()
        try:
            while True:
                frame = connection.recv()
                if isinstance(frame, str):
                    continue
                self.frames.append(frame)
                if frame[:4] == struct.pack("<I", 2) and self.answer is not None:
                    self.state["session"] = self.answer.get("number", 0)
                    connection.send(json.dumps(self.answer))
        except ConnectionClosed:
            return

    def publish(self, connection: ServerConnection) -> None:
        try:
            for sequence in range(100_000):
                if self.sending:
                    head = struct.pack("<IIQ", 1, LAYOUT_VERSION, sequence)
                    connection.send(head + self.state.tobytes())
                time.sleep(0.005)
        except ConnectionClosed:
            return

    def refuse(self, connection: ServerConnection, request: Request) -> Response | None:
        if self.refusal is None:
            return None
        response = connection.respond(http.HTTPStatus(self.refusal[0]), "")
        response.body = self.refusal[1]
        del response.headers["Content-Length"]
        response.headers["Content-Length"] = str(len(self.refusal[1]))
        return response


@contextmanager
def running(fake: Fake) -> Iterator[str]:
    with serve(fake.serve, "127.0.0.1", 0, process_request=fake.refuse) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.socket.getsockname()[1]}"
        server.shutdown()
        thread.join()


@pytest.fixture
def fake() -> Fake:
    return Fake()


@pytest.fixture
def url(fake: Fake) -> Iterator[str]:
    with running(fake) as address:
        yield address


@pytest.fixture
def transport(url: str) -> Iterator[WebSocketTransport]:
    made = WebSocketTransport(url + "/")
    yield made
    made.close()


def raised(call: Callable[[], object]) -> Exception:
    with pytest.raises(Exception) as caught:  # noqa: PT011 - the caller looks at its class
        call()
    return caught.value


def test_what_the_robot_is_survives_the_way_bit_by_bit(transport: WebSocketTransport, fake: Fake) -> None:
    assert (transport.robot, transport.dof) == ("fake", DOF)
    assert not transport.url.endswith("/"), "REST is asked at the same address"
    assert transport.info.tobytes() == fake.info.tobytes()


def test_the_flange_is_that_of_the_tool_that_the_service_reported_last(
    transport: WebSocketTransport, fake: Fake
) -> None:
    flange = [0.0, 0.0, -0.2, 1.0, 0.0, 0.0, 0.0]
    assert fake.connection is not None
    fake.connection.send(json.dumps({"type": "tool", "tool_version": 7, "flange": flange}))
    until(lambda: transport.info["tool_version"] == 7)
    assert transport.info["flange"].tolist() == flange
    assert transport.info["max_velocity"].tolist() == fake.info["max_velocity"].tolist()


def test_states_are_the_services_and_the_callers_to_keep(transport: WebSocketTransport, fake: Fake) -> None:
    fake.state["position"] = [1.0, 2.0, 3.0]
    until(lambda: transport.state()["position"][2] == 3.0)
    kept = transport.state()
    kept["position"] = 0.0
    assert transport.state()["position"][2] == 3.0


def test_targets_carry_numbers_that_increase_in_each_session(
    transport: WebSocketTransport, fake: Fake
) -> None:
    for _ in range(2):
        fake.frames.clear()
        assert transport.open_session(WISH) == 7
        assert int(transport.state()["session"]) == 7, "who asks at once shall not think that it has ended"
        for _ in range(3):
            transport.send_setpoint(SETPOINT)
        transport.request_estop()
        transport.end_session()
        transport.end_session()
        until(lambda: len(fake.frames) == 6)
        heads = [struct.unpack_from("<IIQ", frame) for frame in fake.frames]
        kinds = [(kind, number) for kind, _, number in heads]
        assert kinds == [(2, 0), (3, 1), (3, 2), (3, 3), (5, 0), (6, 0)]


@pytest.mark.parametrize("code", sorted(ERRORS))
def test_a_refused_session_is_raised_as_the_services_error(
    transport: WebSocketTransport, fake: Fake, code: str
) -> None:
    fake.answer = {"type": "error", "code": code, "detail": "no", "about": "session", "sequence": None}
    error = raised(lambda: transport.open_session(WISH))
    assert type(error) is ERRORS[code]
    assert str(error) == "no"


def test_an_error_in_a_target_is_raised_by_the_next_one(transport: WebSocketTransport, fake: Fake) -> None:
    transport.open_session(WISH)
    assert fake.connection is not None
    transport.send_setpoint(SETPOINT)
    fake.connection.send(json.dumps({"type": "error", "code": "input", "detail": "no", "about": "setpoint"}))
    error = until(lambda: _error_of(transport))
    assert isinstance(error, InputError)
    transport.send_setpoint(SETPOINT)


def _error_of(transport: WebSocketTransport) -> Exception | None:
    try:
        transport.send_setpoint(SETPOINT)
    except InputError as exc:
        return exc
    return None


def test_another_version_of_cobot_is_refused(fake: Fake, url: str) -> None:
    fake.layout += 1
    with pytest.raises(LayoutError, match=f"has layout version {LAYOUT_VERSION + 1}, but this program has"):
        WebSocketTransport(url)


def test_an_old_state_is_none(
    transport: WebSocketTransport, fake: Fake, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "STALE_S", 0.1)
    fake.sending = False
    until(lambda: _is_stale(transport))
    fake.sending = True
    until(lambda: not _is_stale(transport))


def _is_stale(transport: WebSocketTransport) -> bool:
    try:
        transport.state()
    except UnavailableError as exc:
        return "no state of rtloop for 0." in str(exc)
    return False


def test_who_does_not_answer_is_unavailable(
    transport: WebSocketTransport, fake: Fake, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote, "ANSWER_S", 0.1)
    fake.answer = None
    with pytest.raises(UnavailableError, match=r"the service has not answered for 0\.1 s"):
        transport.open_session(WISH)


def test_a_lost_connection_is_unavailable_and_can_still_be_closed(
    transport: WebSocketTransport, fake: Fake
) -> None:
    transport.open_session(WISH)
    assert fake.connection is not None
    fake.connection.close()
    until(lambda: isinstance(raised_or_none(transport.state), UnavailableError))
    calls: list[Callable[[], object]] = [
        transport.state,
        lambda: transport.send_setpoint(SETPOINT),
        transport.request_estop,
        lambda: transport.open_session(WISH),
    ]
    for call in calls:
        with pytest.raises(UnavailableError, match="the connection is lost"):
            call()
    transport.close()
    transport.close()


def raised_or_none(call: Callable[[], object]) -> Exception | None:
    try:
        call()
    except UnavailableError as exc:
        return exc
    return None


def test_a_refusal_of_the_service_is_its_error(fake: Fake, url: str) -> None:
    fake.refusal = (
        503,
        json.dumps({"detail": "32 connections stream already", "code": "unavailable"}).encode(),
    )
    with pytest.raises(UnavailableError, match=r"^32 connections stream already$"):
        WebSocketTransport(url)
    fake.refusal = 404, b"{}"
    with pytest.raises(UnavailableError, match="status 404, so this is not a stream of cobot; check the URL"):
        WebSocketTransport(url)


def test_an_address_without_a_service_is_unavailable() -> None:
    with pytest.raises(UnavailableError, match=r"http://127\.0\.0\.1:1"):
        WebSocketTransport("http://127.0.0.1:1")
    with pytest.raises((InputError, UnavailableError)):
        WebSocketTransport("http://")
