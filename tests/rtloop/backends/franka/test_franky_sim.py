"""The real pylibfranka in the real cycle, against a simulator that nobody here wrote, in another process.

Oracles: where the simulator says that its arm is; the limits that Franka Robotics publishes, of each position
that was commanded. The simulator waits for a busy computer. The whole service is driven against it in
tests/e2e/realtime/test_franka.py, on request.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from franka_settings import franka_settings
from franky_run import TRACKING_RAD, FrankySimulator
from rig import Rig

from cobot.ipc.layout import Command, MotionResult
from cobot.planners import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import load_robot
from cobot.types import LoopMode, PlannerName, Scaling
from rtloop.backends.franka import FrankaBackend

pytest.importorskip("pylibfranka", reason="pylibfranka is not installed: pip install 'cobot[franka]'")
pytest.importorskip("franky_sim", reason="franky-sim is not installed")
MAX_CYCLES = 5000


class FrankyRig(Rig):
    """A rig whose cycles are the simulator's states."""

    def __init__(self, simulator: FrankySimulator) -> None:
        self.simulator = simulator
        settings = franka_settings(address=simulator.address, realtime="ignore")
        rt = settings.rt.model_copy(update={"tracking_error_rad": TRACKING_RAD, "settle_position_rad": 0.01})
        settings = settings.model_copy(update={"rt": rt})
        robot = load_robot(settings)
        super().__init__(settings, robot, backend=FrankaBackend(settings, robot.limits))

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            self.loop.beat()
            super().step()

    def until(self, happened: Callable[[], bool]) -> None:
        for _ in range(MAX_CYCLES):
            if happened():
                return
            self.step()
        raise AssertionError(f"did not happen in {MAX_CYCLES} cycles: {self.mode.name}, {self.reason}")

    def move(self, turn_rad: float) -> None:
        """Joint 1 by so much; it arrives."""
        here = self.loop.controller.safety.position.copy()
        goal = here + np.array([turn_rad, 0, 0, 0, 0, 0, 0])
        request = MotionRequest(here, goal, PlannerName.PTP, Scaling(1.0))
        assert self.start(plan_ptp(self.robot, request, goal)) == ""
        self.until(lambda: self.result is MotionResult.ARRIVED)


@pytest.fixture
def rig() -> Iterator[FrankyRig]:
    with FrankySimulator() as simulator:
        made = FrankyRig(simulator)
        try:
            yield made
        finally:
            made.loop.close()
            made.close()


@pytest.mark.thorough
def test_moves_and_recovers_from_a_reflex(rig: FrankyRig) -> None:
    begun = rig.simulator.ask()["q"][0]
    rig.move(0.1)
    assert rig.simulator.ask()["q"][0] - begun == pytest.approx(0.1, abs=0.01)
    rig.simulator.ask("protective_stop")
    rig.until(lambda: rig.mode is LoopMode.FAULT)
    assert "harder than the collision thresholds allow" in rig.reason
    rig.simulator.ask("")
    rig.step(50)
    assert rig.answer(rig.send(Command.RESET)) == ""
    rig.until(lambda: rig.mode is LoopMode.HOLD)
    rig.move(-0.1)
    assert max(rig.simulator.ask()["worst"]) < 1.0
