"""Outputs of the driver of Universal Robots beside a service of the test, and of a GPIO controller.

Oracle: the definition of ur_msgs/srv/SetIO, the clock of the event loop, and the messages that are sent.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from cobot.dds import arm_io
from cobot.dds.arm_io import SET_DIGITAL_OUT, GpioIo, UrIo
from cobot.dds.gpio_values import message_of, values_of
from cobot.dds.node import Message
from cobot.errors import CobotError, InputError

TIMEOUT_S = 0.05
Answer = Callable[[Message], Awaitable[Message]]


async def silent(request: Message) -> Message:
    await asyncio.Event().wait()
    return {}


async def rejecting(request: Message) -> Message:
    return {"success": False}


async def unreadable(request: Message) -> Message:
    raise InputError("ur_msgs/srv/SetIO_Response: is not readable")


@pytest.fixture
def driver(monkeypatch: pytest.MonkeyPatch) -> Callable[[Answer], tuple[UrIo, list[Message]]]:
    def made(answer: Answer) -> tuple[UrIo, list[Message]]:
        asked: list[Message] = []

        class Service:
            is_ready = True

            def __init__(self, *_: object, **__: object) -> None: ...

            async def call(self, request: Message) -> Message:
                asked.append(request)
                return await answer(request)

        monkeypatch.setattr(arm_io, "ServiceCaller", Service)
        node: Any = type("Node", (), {"subscription": lambda *_, **__: None})()
        return UrIo(node, "/io", ["digital_out/8", "digital_out/16"], TIMEOUT_S), asked

    return made


@pytest.mark.parametrize(
    ("answer", "problem"),
    [
        (silent, "digital_out/16 cannot be set: the service /io/set_io has not answered within 0.05 s"),
        (rejecting, "digital_out/16 cannot be set: the service /io/set_io has rejected it; see the driver's"),
        (unreadable, "digital_out/16 cannot be set: the service /io/set_io: ur_msgs/srv/SetIO_Response: is"),
    ],
)
def test_a_driver_that_does_not_set_an_output_delays_no_other_request(
    driver: Callable[[Answer], tuple[UrIo, list[Message]]], answer: Answer, problem: str
) -> None:
    """The requests of rtloop, such as a cancel, are answered one after the other."""

    async def run() -> None:
        made, asked = driver(answer)
        made.set_output("digital_out/8", 0.0)
        made.set_output("digital_out/16", 1.0)
        assert made.problem == ""
        await asyncio.gather(*made._calls)
        assert [(each["pin"], each["state"]) for each in asked] == [(8, 0.0), (16, 1.0)]
        assert {each["fun"] for each in asked} == {SET_DIGITAL_OUT}
        assert made.problem.startswith(problem)
        made.set_output("digital_out/8", 0.0)
        assert made.problem == "", "the failure of an earlier output is not that of this one"

    asyncio.run(run())


def test_an_output_without_a_service_is_rejected_at_once(
    driver: Callable[[Answer], tuple[UrIo, list[Message]]],
) -> None:
    made, asked = driver(silent)
    made._service.is_ready = False  # type: ignore[misc]
    with pytest.raises(CobotError, match="/io/set_io has no server; start the driver's io_and_status"):
        made.set_output("digital_out/8", 1.0)
    assert asked == []


def test_an_output_that_was_not_set_in_time_is_not_sent_with_another_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A user has been told that it was not set, so it must not be set by the next request for another one."""
    now_s, sent = [10.0], list[dict[str, float]]()
    monkeypatch.setattr(arm_io.time, "monotonic", lambda: now_s[0])

    class Commands:
        readers = 1

        def publish(self, message: Message) -> None:
            sent.append(values_of(message))

    class Node:
        def subscription(self, *_: object, **__: object) -> None: ...

        def publisher(self, *_: object, **__: object) -> Commands:
            return Commands()

    node: Any = Node()
    made = GpioIo(node, "/gpio", ["tool/vacuum", "tool/valve", "tool/lamp"], 2.0)
    made.set_output("tool/lamp", 1.0)
    made._take(message_of({"tool/lamp": 1.0}))
    made.set_output("tool/vacuum", 1.0)
    now_s[0] = 11.0
    made.set_output("tool/valve", 1.0)
    assert sent[-1] == {"tool/lamp": 1.0, "tool/vacuum": 1.0, "tool/valve": 1.0}
    now_s[0] = 12.5
    made.set_output("tool/valve", 0.0)
    assert sent[-1] == {"tool/lamp": 1.0, "tool/valve": 0.0}
