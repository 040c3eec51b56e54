"""Simulated inputs and outputs. Oracle: a dictionary of what the test has put where; the manual's counts."""

from __future__ import annotations

import random
from itertools import product

import pytest

from app.services.devices.io_banks import ANALOG, DIGITAL, IoBanks
from cobot.errors import InputError, LimitError, NotSupportedError

SEED = 20261122
WAYS = ("input", "output")


def test_each_place_keeps_what_was_put_there_and_nothing_else() -> None:
    dice, banks = random.Random(SEED), IoBanks(simulated=True)
    kept = {(way, group): [False] * count for way, (group, count) in product(WAYS, DIGITAL.items())}
    for _ in range(500):
        way, group = dice.choice(list(kept))
        index, value = dice.randrange(DIGITAL[group]), dice.random() < 0.5
        banks.set_digital(way, group, index, value)
        kept[way, group][index] = value
        for (each_way, each_group), values in kept.items():
            assert banks.digital(each_way, each_group) == values
            assert f"{banks.mask(each_way, each_group):0{len(values)}b}"[::-1] == "".join(
                "01"[value] for value in values
            )


@pytest.mark.parametrize("way", WAYS)
def test_an_analog_place_takes_what_its_domain_allows(way: str) -> None:
    banks = IoBanks(simulated=True)
    banks.set_analog(way, "tool", 1, 10.0)
    assert banks.analog(way, "tool", 1).value == 10.0
    with pytest.raises(LimitError, match=f"tool analog {way} 1 must be from 0 to 10 V, got 10.5"):
        banks.set_analog(way, "tool", 1, 10.5)
    banks.set_domain(way, "tool", 1, 0)
    assert banks.analog(way, "tool", 1).value == 0.004  # the least current: 0 A would be a broken wire
    with pytest.raises(LimitError, match=r"must be from 0\.004 to 0\.02 A, got 0"):
        banks.set_analog(way, "tool", 1, 0.0)
    with pytest.raises(InputError, match="domain must be 0"):
        banks.set_domain(way, "tool", 1, 2)
    assert banks.analog(way, "standard", 1).domain == 1


@pytest.mark.parametrize("group", list(DIGITAL))
def test_there_are_so_many_places_and_no_more(group: str) -> None:
    banks = IoBanks(simulated=True)
    for index in (-1, DIGITAL[group]):
        with pytest.raises(InputError, match=f"index must be from 0 to {DIGITAL[group] - 1}, got {index}"):
            banks.set_digital("output", group, index, True)
        if group in ANALOG:
            with pytest.raises(InputError, match=f"index must be from 0 to {ANALOG[group] - 1}"):
                banks.analog("input", group, index)


def test_a_real_arm_has_none() -> None:
    banks = IoBanks(simulated=False)
    with pytest.raises(NotSupportedError, match="exist only in simulation"):
        banks.digital("input", "tool")
    with pytest.raises(NotSupportedError):
        banks.set_analog("output", "tool", 0, 1.0)
