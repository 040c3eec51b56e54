"""IoControl: the simulated banks.

Oracle: plain lists that the same random writes go to.
"""

from __future__ import annotations

import random
from types import SimpleNamespace

import pytest
from vendor_calls import Caller, equipped, run

from app.services.devices.io_banks import IoBanks
from cobot.codes import Code

CLASS = "IoControl"
DIGITAL = {"Standard": 16, "Tool": 4, "Configurable": 8}
ANALOG = {"Standard": 4, "Tool": 2}


def test_digital_places_keep_their_values_and_the_mask_shows_them_all() -> None:
    async def check() -> None:
        ask, dice = Caller(equipped(), CLASS), random.Random(7)
        for group, count in DIGITAL.items():
            for way in ("Input", "Output"):
                name = f"{group}Digital{way}"
                assert await ask(f"get{name}Num") == count
                assert await ask(f"get{name}s") == 0
                bits = [dice.random() < 0.5 for _ in range(count)]
                for index, bit in enumerate(bits):
                    await ask(f"set{name}", index=index, value=bit)
                assert [await ask(f"get{name}", index=index) for index in range(count)] == bits
                assert await ask(f"get{name}s") == int("".join("01"[bit] for bit in reversed(bits)), 2)

    run(check())


def test_analog_places_keep_values_within_the_range_of_their_domain() -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        for group, count in ANALOG.items():
            for way in ("Input", "Output"):
                name = f"{group}Analog{way}"
                assert await ask(f"get{name}Num") == count
                for index in range(count):
                    assert await ask(f"get{name}Domain", index=index) == 1
                    await ask(f"set{name}", index=index, value=index + 0.5)
                    assert "from 0 to 10 V" in await ask.fails(
                        f"set{name}", Code.LIMIT, index=index, value=10.1
                    )
                    assert await ask(f"get{name}", index=index) == index + 0.5
                await ask(f"set{name}Domain", index=0, domain=0)
                assert await ask(f"get{name}", index=0) == 0.004
                assert "from 0.004 to 0.02 A" in await ask.fails(f"set{name}", Code.LIMIT, index=0, value=1.0)
                await ask(f"set{name}", index=0, value=0.02)
                await ask.fails(f"set{name}Domain", Code.INPUT, index=0, domain=2)

    run(check())


@pytest.mark.parametrize("index", [-1, 16])
def test_a_place_that_is_not_there_is_refused(index: int) -> None:
    async def check() -> None:
        ask = Caller(equipped(), CLASS)
        for method, fields in (
            ("getStandardDigitalInput", {}),
            ("setStandardDigitalOutput", {"value": True}),
            ("getToolAnalogInput", {}),
            ("setToolAnalogOutputDomain", {"domain": 1}),
        ):
            message = await ask.fails(method, Code.INPUT, index=index, **fields)
            assert message.startswith("index must be from 0 to ")

    run(check())


def test_without_a_simulation_there_is_no_cabinet_to_reach() -> None:
    async def check() -> None:
        robot = SimpleNamespace(equipment=SimpleNamespace(io=IoBanks(simulated=False)))
        ask = Caller(robot, CLASS)
        await ask.fails("setStandardDigitalOutput", Code.NOT_SUPPORTED, index=0, value=True)
        await ask.fails("getStandardAnalogInput", Code.NOT_SUPPORTED, index=0)
        await ask.fails("getStandardDigitalInputs", Code.NOT_SUPPORTED)

    run(check())
