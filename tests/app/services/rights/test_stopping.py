"""Leaving an e-stop, with what a stop ends. Oracle: the order in which a person would have it."""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any, cast

import pytest

from app.services.events.ring import Events
from app.services.rights.stopping import StopService
from cobot.types import LoopMode


class Called:
    """Stands for the link, its commands and the sequences, and notes who was asked for what."""

    def __init__(self, mode: LoopMode) -> None:
        self.mode = mode
        self.done: list[str] = []
        self.events = Events().of("left")
        self.commands = self

    def state(self) -> SimpleNamespace:
        return SimpleNamespace(mode=self.mode)

    async def reset(self, timeout_s: float) -> None:
        self.done.append("reset")

    async def stop(self, reason: str) -> None:
        self.done.append("sequence ended")


@pytest.mark.parametrize("mode", [LoopMode.ESTOP, LoopMode.FAULT])
def test_a_sequence_that_has_slept_through_an_estop_ends_before_the_reset(mode: LoopMode) -> None:
    called = Called(mode)
    asyncio.run(StopService(*cast(Any, (called, None, called.stop))).reset(1.0))
    assert called.done == ["sequence ended", "reset"]


def test_a_reset_of_an_arm_that_needs_none_leaves_the_sequence_alone() -> None:
    called = Called(LoopMode.HOLD)
    asyncio.run(StopService(*cast(Any, (called, None, called.stop))).reset(1.0))
    assert called.done == ["reset"]
