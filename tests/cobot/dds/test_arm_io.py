"""Inputs and outputs of drivers beside services of the test, and outputs of a GPIO controller.

Oracle: the published definitions of the services, the clock of the event loop, and the messages that are
sent. rclpy's services are in tests/e2e/realtime/test_ros2_control.py.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any

import pytest

from cobot.dds import arm_io
from cobot.dds.arm_io import GpioIo, PolledIo, UrIo
from cobot.dds.gpio_values import message_of, values_of
from cobot.dds.node import Message
from cobot.errors import CobotError, InputError
from cobot.ros.driver_io import DRIVERS
from cobot.ros.messages import Messages

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
        (
            rejecting,
            "digital_out/16 cannot be set: the service /io/set_io has rejected the request; see the driver's",
        ),
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
        await asyncio.gather(*made._tasks)
        assert [(each["pin"], each["state"]) for each in asked] == [(8, 0.0), (16, 1.0)]
        assert {each["fun"] for each in asked} == {1}
        assert made.problem.startswith(problem)
        made.set_output("digital_out/8", 0.0)
        assert made.problem == "", "the failure of an earlier output is not that of this one"

    asyncio.run(run())


def test_the_rejection_of_one_output_stays_when_another_one_is_set(
    driver: Callable[[Answer], tuple[UrIo, list[Message]]],
) -> None:
    """rtloop reads the problem only several times a second."""

    async def only_16(request: Message) -> Message:
        return {"success": request["pin"] == 16}

    async def run() -> None:
        made, _ = driver(only_16)
        made.set_output("digital_out/8", 1.0)
        made.set_output("digital_out/16", 1.0)
        await asyncio.gather(*made._tasks)
        assert made.problem.startswith("digital_out/8 cannot be set")

    asyncio.run(run())


def test_an_output_without_a_service_is_rejected_at_once(
    driver: Callable[[Answer], tuple[UrIo, list[Message]]],
) -> None:
    made, asked = driver(silent)
    made._services["set_io"].is_ready = False  # type: ignore[misc]
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


class Driver:
    """The signals of a controller, and the services of its driver."""

    def __init__(self, signals: dict[tuple[str, int], float]) -> None:
        self.signals = signals
        self.asked: list[tuple[str, Message]] = []
        self.hangs = self.refuses = self.is_away = False
        self.ret = 0

    async def answer(self, name: str, type_: str, request: Message) -> Message:
        answer: Message
        self.asked.append((name, request))
        if self.hangs:
            await asyncio.Event().wait()
        short = type_.rpartition("/")[2]
        if type_.startswith("motoros2"):
            place = "io", request["address"]
            done = not self.refuses and place in self.signals
            if done and short == "WriteSingleIO":
                self.signals[place] = request["value"]
            answer = {"success": done, "message": "Success" if done else "Address cannot be read from"}
            return answer | ({"value": self.signals.get(place, 0)} if short == "ReadSingleIO" else {})
        if type_.startswith("dsr_msgs2"):
            kind = name.partition("_")[2]
            place = kind, request["index"] if "index" in request else request["channel"]
            if short.startswith("Set") and not self.refuses:
                self.signals[place] = request["value"]
            answer = {"success": not self.refuses}
            return answer | ({} if short.startswith("Set") else {"value": self.signals.get(place, 0)})
        if short == "SetDigitalIO":
            return {"ret": 9 if self.refuses else self.ret, "message": f"ionum={request['ionum']}"}
        if short == "GetAnalogIO":
            return {"ret": self.ret, "message": "", "data": self.signals[name, request["ionum"]]}
        digitals = [int(self.signals.get((name, number), 0)) for number in range(16)]
        return {"ret": self.ret, "message": "", "digitals": digitals}


@pytest.fixture
def polled(monkeypatch: pytest.MonkeyPatch) -> Callable[..., PolledIo]:
    """Makes a `PolledIo` beside a `Driver`, whose messages pass through CDR."""
    messages = Messages()
    monkeypatch.setattr(arm_io, "READ_S", 0.001)

    def made(driver: Driver, name: str, *interfaces: str) -> PolledIo:
        class Service:
            def __init__(self, node: object, name: str, type_: str, **_: object) -> None:
                self._name, self._type = name.rpartition("/")[2], type_

            @property
            def is_ready(self) -> bool:
                return not driver.is_away

            async def call(self, request: Message) -> Message:
                sent = messages.from_cdr(
                    f"{self._type}_Request", messages.to_cdr(f"{self._type}_Request", request)
                )
                answer = await driver.answer(self._name, self._type, sent)
                packed = messages.to_cdr(f"{self._type}_Response", answer)
                return messages.from_cdr(f"{self._type}_Response", packed)

        monkeypatch.setattr(arm_io, "ServiceCaller", Service)
        node: Any = None
        return PolledIo(node, name, "/arm", interfaces, TIMEOUT_S)

    return made


async def until(condition: Callable[[], bool]) -> None:
    async with asyncio.timeout(10.0):
        while not condition():
            await asyncio.sleep(0.001)


@pytest.mark.parametrize(
    ("name", "signals", "expected", "output", "request_", "place"),
    [
        (
            "motoros2",
            {("io", 20): 1, ("io", 10010): 0},
            {"io/20": 1.0, "io/10010": 0.0},
            "io/10010",
            ("write_single_io", {"address": 10010, "value": 1}),
            ("io", 10010),
        ),
        (
            "doosan",
            {
                ("ctrl_box_digital_input", 2): 1,
                ("ctrl_box_analog_input", 1): 2.5,
                ("tool_digital_output", 6): 0,
            },
            {"digital_in/2": 1.0, "digital_in/1": 0.0, "analog_in/1": 2.5, "tool_digital_out/6": 0.0},
            "tool_digital_out/6",
            ("set_tool_digital_output", {"index": 6, "value": 1}),
            ("tool_digital_output", 6),
        ),
    ],
)
def test_a_driver_is_asked_for_its_inputs_and_outputs(
    polled: Callable[..., PolledIo],
    name: str,
    signals: dict[tuple[str, int], float],
    expected: dict[str, float],
    output: str,
    request_: tuple[str, Message],
    place: tuple[str, int],
) -> None:
    async def run() -> None:
        driver = Driver(signals)
        made = polled(driver, name, *expected)
        await until(lambda: made.values == expected)
        made.set_output(output, 1.0)
        await until(lambda: made.values == expected | {output: 1.0})
        assert request_ in driver.asked
        assert driver.signals[place] == 1
        assert made.problem == ""

    asyncio.run(run())


def test_outputs_that_a_driver_cannot_read_are_those_that_it_has_confirmed(
    polled: Callable[..., PolledIo],
) -> None:
    async def run() -> None:
        driver = Driver({("get_cgpio_digital", 8): 1, ("get_tgpio_analog", 1): 3.25})
        made = polled(
            driver, "xarm", "digital_in/8", "tool_analog_in/1", "digital_out/3", "tool_digital_out/1"
        )
        here = {"digital_in/8": 1.0, "tool_analog_in/1": 3.25}
        await until(lambda: made.values == here)
        made.set_output("digital_out/3", 1.0)
        made.set_output("tool_digital_out/1", 0.0)
        await until(lambda: made.values == here | {"digital_out/3": 1.0, "tool_digital_out/1": 0.0})
        sent = [(name, request) for name, request in driver.asked if name.startswith("set")]
        assert [(name, each["ionum"], each["value"]) for name, each in sent] == [
            ("set_cgpio_digital", 3, 1),
            ("set_tgpio_digital", 1, 0),
        ]
        assert {each["delay_sec"] for _, each in sent} == {0.0}, "the output is set at once"
        driver.refuses = True
        made.set_output("digital_out/3", 0.0)
        await until(lambda: made.problem != "")
        assert made.problem == (
            "digital_out/3 cannot be set: the service /arm/set_cgpio_digital has rejected the request; "
            "see the driver's log (ret is 9: ionum=3)"
        )
        assert "digital_out/3" not in made.values

    asyncio.run(run())


def test_a_number_that_the_controller_does_not_have_is_unknown_and_named(
    polled: Callable[..., PolledIo],
) -> None:
    async def run() -> None:
        driver = Driver({("io", 20): 1})
        made = polled(driver, "motoros2", "io/19", "io/20")
        await until(lambda: made.values == {"io/20": 1.0} and made.problem != "")
        assert made.problem == (
            "io/19 cannot be read: the service /arm/read_single_io has rejected the request; see the "
            "driver's log (success is False: Address cannot be read from)"
        )
        driver.signals["io", 19] = 1
        await until(lambda: made.values == {"io/19": 1.0, "io/20": 1.0} and made.problem == "")

    asyncio.run(run())


def test_a_digital_value_other_than_0_and_1_is_unknown_and_named(polled: Callable[..., PolledIo]) -> None:
    """Doosan's driver answers -1, with success, if its controller does not tell the value."""

    async def run() -> None:
        driver = Driver({("ctrl_box_digital_input", 1): -1, ("ctrl_box_analog_input", 1): -1.0})
        made = polled(driver, "doosan", "digital_in/1", "analog_in/1")
        await until(lambda: made.values == {"analog_in/1": -1.0} and made.problem != "")
        assert made.problem == (
            "digital_in/1 cannot be read: the service /arm/get_ctrl_box_digital_input has answered -1; "
            "valid values: 0 and 1"
        )
        driver.signals["ctrl_box_digital_input", 1] = 1
        await until(lambda: made.values.get("digital_in/1") == 1.0 and made.problem == "")

    asyncio.run(run())


@pytest.mark.parametrize(("ret", "is_set"), [(1, False), (2, True)])
def test_an_error_or_a_warning_of_an_xarm_hides_no_input(
    polled: Callable[..., PolledIo], ret: int, is_set: bool
) -> None:
    """Its controller adds them to the answer of each request, 1 and 2. The oracle is the vendor's own code,
    `XArmAPI::_check_code`. A new driver sets no output while there is an error, an old one does.
    """

    async def run() -> None:
        driver = Driver({("get_cgpio_digital", 8): 1, ("get_tgpio_analog", 1): 3.25})
        driver.ret = ret
        made = polled(driver, "xarm", "digital_in/8", "tool_analog_in/1", "digital_out/3")
        here = {"digital_in/8": 1.0, "tool_analog_in/1": 3.25}
        await until(lambda: made.values == here)
        assert made.problem == ""
        made.set_output("digital_out/3", 1.0)
        await until(lambda: ("digital_out/3" in made.values) == is_set and bool(made.problem) != is_set)

    asyncio.run(run())


def test_a_late_confirmation_is_not_that_of_a_newer_value(polled: Callable[..., PolledIo]) -> None:
    """The driver has set 1, and may have set 0 since: nobody knows what the output is."""

    async def run() -> None:
        driver, both_sent = Driver({}), asyncio.Event()

        async def answer(name: str, type_: str, request: Message) -> Message:
            if request["value"] == 0:
                both_sent.set()
                await asyncio.Event().wait()
            await both_sent.wait()
            return {"ret": 0}

        driver.answer = answer  # type: ignore[method-assign]
        made = polled(driver, "xarm", "digital_out/3")
        made.set_output("digital_out/3", 1.0)
        made.set_output("digital_out/3", 0.0)
        await asyncio.gather(*made._tasks)
        assert "has not answered" in made.problem
        assert made.values == {}

    asyncio.run(run())


def test_an_output_that_was_confirmed_is_unknown_once_the_driver_has_gone(
    polled: Callable[..., PolledIo],
) -> None:
    """A controller that is switched on again has its own values."""

    async def run() -> None:
        driver = Driver({})
        made = polled(driver, "xarm", "digital_out/3")
        made.set_output("digital_out/3", 1.0)
        await until(lambda: made.values == {"digital_out/3": 1.0})
        driver.is_away = True
        assert made.values == {}
        driver.is_away = False
        assert made.values == {}

    asyncio.run(run())


def test_values_of_a_driver_that_hangs_are_unknown(
    polled: Callable[..., PolledIo], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And an output is not confirmed; the request itself returns at once."""
    monkeypatch.setattr(arm_io, "MAX_AGE_S", 0.03)

    async def run() -> None:
        driver = Driver({("ctrl_box_digital_input", 1): 1, ("ctrl_box_digital_output", 1): 0})
        made = polled(driver, "doosan", "digital_in/1", "digital_out/1")
        await until(lambda: len(made.values) == 2)
        driver.hangs = True
        made.set_output("digital_out/1", 1.0)
        await until(lambda: made.values == {})
        await until(lambda: "digital_out/1 cannot be set" in made.problem)
        assert made.problem.endswith("/arm/set_ctrl_box_digital_output has not answered within 0.05 s")
        driver.hangs = False
        driver.signals["ctrl_box_digital_output", 1] = 1
        await until(lambda: made.values == {"digital_in/1": 1.0, "digital_out/1": 1.0})
        await until(lambda: "the device has set the output late" in made.problem)

    asyncio.run(run())


def test_a_service_that_is_not_there_is_named_with_what_to_do(polled: Callable[..., PolledIo]) -> None:
    async def run() -> None:
        driver = Driver({})
        driver.is_away = True
        made = polled(driver, "xarm", "digital_in/0", "digital_out/0")
        with pytest.raises(CobotError, match="/arm/set_cgpio_digital has no server; set it to true in"):
            made.set_output("digital_out/0", 1.0)
        assert made.problem == "", "services may be discovered later than the controllers"
        await until(lambda: "digital_in/0 cannot be read" in made.problem)
        assert "/arm/get_cgpio_digital has no server; set it to true in the" in made.problem
        assert driver.asked == []

    asyncio.run(run())


@pytest.mark.parametrize("driver", DRIVERS)
def test_each_service_of_a_driver_has_a_definition_with_its_fields(driver: str) -> None:
    messages = Messages()
    for kind in DRIVERS[driver].kinds.values():
        for service in (kind.read, kind.write):
            if service is None:
                continue
            request = messages.from_cdr(
                f"{service.type}_Request", messages.to_cdr(f"{service.type}_Request", {})
            )
            answer = messages.from_cdr(
                f"{service.type}_Response", messages.to_cdr(f"{service.type}_Response", {})
            )
            assert {*service.fixed, service.number} - {""} <= set(request)
            assert service.value in (request if service is kind.write else answer)
            assert service.done[0] in answer
