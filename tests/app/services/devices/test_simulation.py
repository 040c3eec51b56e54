"""The simulation is begun again only where it is known to be one, and while nothing uses it.

Oracle: what the link is asked to do.
"""

from __future__ import annotations

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest

from app.services.devices.simulation import SimulationService
from cobot.errors import ConflictError, NotSupportedError
from cobot.types import LoopMode


class Link:
    """A robot in an e-stop."""

    def __init__(self, device: Any) -> None:
        self.device = lambda: device
        self.done: list[str] = []
        self.commands = self

    async def await_fresh_state(self, timeout_s: float) -> Any:
        return SimpleNamespace(mode=LoopMode.ESTOP)

    async def reset(self, timeout_s: float) -> None:
        self.done.append("reset")

    async def restart(self) -> None:
        self.done.append("restart")


def device(*, hardware: bool) -> Any:
    return "arm", SimpleNamespace(capabilities=SimpleNamespace(hardware=hardware))


def reset(link: Link, in_use: str = "") -> None:
    def require_free(token: str | None) -> None:
        if in_use:
            raise ConflictError(in_use)

    ownership: Any = SimpleNamespace(require_free=require_free)
    cell: Any = SimpleNamespace(cell=None)
    asyncio.run(SimulationService(link, ownership, cell).reset())  # type: ignore[arg-type]


def test_a_real_arm_has_no_time_factor() -> None:
    ownership: Any = SimpleNamespace()
    service = SimulationService(Link(device(hardware=True)), ownership, SimpleNamespace())  # type: ignore[arg-type]
    with pytest.raises(NotSupportedError, match="only a simulation has a time factor, but the backend arm"):
        asyncio.run(service.set_time_factor(0.5))


def test_an_e_stop_is_cleared_and_the_arm_is_put_back() -> None:
    link = Link(device(hardware=False))
    reset(link)
    assert link.done == ["reset", "restart"]


@pytest.mark.parametrize(
    ("found", "in_use", "kind", "words"),
    [
        (None, "", ConflictError, "cannot be read"),
        (device(hardware=True), "", NotSupportedError, "the backend arm moves a real arm"),
        (device(hardware=False), "the robot is in use by a program", ConflictError, "in use by a program"),
    ],
)
def test_otherwise_the_e_stop_stays(found: Any, in_use: str, kind: type[Exception], words: str) -> None:
    link = Link(found)
    with pytest.raises(kind, match=words):
        reset(link, in_use)
    assert link.done == []
