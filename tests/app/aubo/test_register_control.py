"""RegisterControl without Modbus: registers, named variables, watchdogs.

Oracles: a plain dictionary that the same random writes go to; the struct module for what four bytes hold.
"""

from __future__ import annotations

import asyncio
import random
import struct
from collections.abc import Coroutine
from typing import Any

import pytest
from vendor_calls import Caller, equipped, eventually
from virtual_time import VirtualLoop

from app.services.devices.registers import COUNT
from app.services.rights.stop_reason import StopReason
from cobot.codes import Code

CLASS = "RegisterControl"


def run(work: Coroutine[Any, Any, None]) -> None:
    """On virtual time: no watchdog expires because the computer pauses."""
    loop = VirtualLoop()
    try:
        loop.run_until_complete(work)
    finally:
        loop.close()


def random_value(dice: random.Random, kind: str) -> Any:
    match kind:
        case "Bool":
            return dice.random() < 0.5
        case "Int16":
            return dice.randrange(-(2**15), 2**15)
        case "Int32":
            return dice.randrange(-(2**31), 2**31)
    value = dice.uniform(-1e6, 1e6)
    return value if kind == "Double" else struct.unpack("<f", struct.pack("<f", value))[0]


def test_every_register_keeps_its_own_value() -> None:
    async def check() -> None:
        ask, dice, written = Caller(equipped(), CLASS), random.Random(4), {}
        for _ in range(3000):
            kind = dice.choice(["Bool", "Int16", "Int32", "Float", "Double"])
            bank = dice.choice(["Input", "Output", "Register"])
            index = dice.randrange(COUNT)
            value = random_value(dice, kind)
            await ask(f"set{kind}{bank}", index=index, value=value)
            written[kind, bank, index] = value
        for (kind, bank, index), value in written.items():
            assert await ask(f"get{kind}{bank}", index=index) == value
        assert await ask("getDoubleInput", index=0) == written.get(("Double", "Input", 0), 0.0)

    run(check())


@pytest.mark.parametrize("index", [-1, COUNT])
def test_an_index_that_is_not_there_is_named_with_those_that_are(index: int) -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        for method, fields in (("getBoolInput", {}), ("setInt32Register", {"value": 1})):
            message = await ask.fails(method, Code.INPUT, index=index, **fields)
            assert message == f"index must be from 0 to {COUNT - 1}, got {index}"

    run(check())


def test_what_does_not_fit_is_refused_and_nothing_changes() -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        await ask("setInt16Register", index=3, value=-7)
        await ask.fails("setInt16Register", Code.LIMIT, index=3, value=32768)
        assert await ask("getInt16Register", index=3) == -7
        await ask.fails("setFloatOutput", Code.LIMIT, index=0, value=1e39)
        await ask.fails("setInt32Output", Code.INPUT, index=0, value=2**31)
        await ask.fails("setBoolOutput", Code.INPUT, index=0, value=1)

    run(check())


def test_a_named_variable_is_what_was_written_last() -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        assert await ask("getInt32", key="count", default_value=5) == 5
        assert not await ask("hasNamedVariable", key="count")
        await ask("setInt32", key="count", value=0)
        assert await ask("getInt32", key="count", default_value=5) == 0
        assert await ask("getNamedVariableType", key="count") == "int32"
        assert "is a int32, not a string" in await ask.fails("getString", Code.INPUT, key="count")
        await ask("setString", key="count", value="seven")
        assert await ask("getString", key="count") == "seven"
        assert await ask("getNamedVariables") == ["count"]
        await ask("clearNamedVariable", key="count")
        assert not await ask("hasNamedVariable", key="count")
        await ask.fails("clearNamedVariable", Code.NOT_FOUND, key="count")
        await ask.fails("setBool", Code.INPUT, key="", value=True)
        await ask.fails("setString", Code.LIMIT, key="long", value="x" * 70_000)

    run(check())


class Stopping:
    """Stands in for the service that stops the arm."""

    def __init__(self) -> None:
        self.stops = self.estops = self.pauses = 0

    async def stop(self, timeout_s: float, reason: StopReason) -> None:
        assert timeout_s > 0.0
        assert str(reason) == "stopped by the watchdog plc"
        self.stops += 1

    async def pause(self) -> None:
        self.pauses += 1

    def request_estop(self) -> None:
        self.estops += 1


@pytest.mark.parametrize(
    ("action", "counts"), [(0, (0, 0, 0)), (1, (1, 0, 0)), (2, (0, 1, 0)), (3, (0, 1, 1))]
)
def test_a_watchdog_that_nobody_kicks_acts_once_and_says_so(action: int, counts: tuple[int, ...]) -> None:
    async def check() -> None:
        arm = Stopping()
        robot = equipped(link=arm, stopping=arm, speed_override=arm)
        ask = Caller(robot, CLASS)
        await ask("setWatchDog", key="plc", timeout=0.02, action=action)
        await eventually(
            lambda: (arm.pauses, arm.stops, arm.estops) == counts and robot.equipment.traces.newest(1)
        )
        assert await ask("isWatchDogExpired", key="plc")
        (message,) = robot.equipment.traces.newest(10)
        assert message.text.startswith("watchdog plc: not written in time")
        await ask("setInt32", key="plc", value=1)
        assert not await ask("isWatchDogExpired", key="plc")
        await eventually(lambda: len(robot.equipment.traces.newest(10)) == 2)
        robot.equipment.close()

    run(check())


def test_a_watchdog_that_is_kicked_does_nothing() -> None:
    async def check() -> None:
        arm = Stopping()
        robot = equipped(link=arm, stopping=arm, speed_override=arm)
        ask, loop = Caller(robot, CLASS), asyncio.get_running_loop()
        await ask("setWatchDog", key="plc", timeout=30.0, action=2)
        dog = robot.equipment.variables.watchdog("plc")
        due = dog.timer.when()
        await ask("setBool", key="other", value=True)
        assert dog.timer.when() == due
        await asyncio.sleep(1.0)
        await ask("setBool", key="plc", value=False)
        assert dog.timer.when() > due
        assert dog.timer.when() - loop.time() > 29.0
        assert await ask("getWatchDogTimeout", key="plc") == 30.0
        assert await ask("getWatchDogAction", key="plc") == 2
        await ask("setWatchDog", key="plc", timeout=0.0, action=0)
        assert dog.timer.cancelled()
        assert await ask("getWatchDogTimeout", key="plc") == 0.0
        assert arm.stops == 0

    run(check())


def test_a_wrong_watchdog_is_refused() -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        assert "valid values: 0 none" in await ask.fails(
            "setWatchDog", Code.INPUT, key="a", timeout=1.0, action=4
        )
        for timeout in (0.001, -1.0, 1e5):
            await ask.fails("setWatchDog", Code.LIMIT, key="a", timeout=timeout, action=0)
        for name in ("", "x" * 201):
            await ask.fails("setWatchDog", Code.INPUT, key=name, timeout=1.0, action=0)

    run(check())
