"""A simulated controller and a backend in one process, stepped period by period without a clock or
network.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.robot.srdf import load_named_positions
from cobot.types import Array, JointLimits
from rtloop.backends.rsi.backend import RsiBackend
from rtloop.backends.rsi.options import RsiOptions
from rtloop.backends.rsi.simulator.controller import RsiController
from rtloop.backends.rsi.simulator.network import RsiNetwork
from rtloop.backends.rsi.simulator.options import ControllerOptions
from rtloop.backends.rsi.telegrams import layout_of
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.lockstep import RESTART_S, LockStep, LockStepRig
from rtloop.contract import FAULTS

LARGE = 170.0
"""Maximum correction of the simulated controller, degrees or mm. The motions of the contract checks exceed
KUKA's default of 5.
"""
OUTPUTS = {"gripper": 1, "lamp": 2}


def controller_for(
    settings: Settings, limits: JointLimits, options: ControllerOptions, start: Array
) -> RsiController:
    """Create a simulated controller that matches the backend's options."""
    own = settings.backend_options(RsiOptions) or RsiOptions()
    arm = ControllerArm(settings, limits, start)
    return RsiController(arm, layout_of(own, limits), np.array(own.limits_of(limits)), options)


def with_options(settings: Settings, **options: Any) -> Settings:
    """Return the settings with additional backend options."""
    backend = settings.robot.backend
    backend = backend.model_copy(update={"type": "rsi", "options": {**backend.options, **options}})
    return settings.model_copy(update={"robot": settings.robot.model_copy(update={"backend": backend})})


class RsiRig(LockStepRig[LockStep[RsiController]]):
    """A `ContractRig` with the `rsi` backend and a simulated controller."""

    faults = frozenset(FAULTS)

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        given = settings.robot.backend.options
        larger = {"max_correction": LARGE, "outputs": given.get("outputs") or OUTPUTS}
        self._settings, self._limits = with_options(settings, **larger), limits
        own = self._settings.backend_options(RsiOptions) or RsiOptions()
        relative = own.correction == "relative"
        cell = ControllerOptions(
            period_ms=round(1e3 * settings.rt.period_s),
            relative=relative,
            hold_on=not relative,
            in_a_row=True,
        )
        names = settings.robot
        start = load_named_positions(names.srdf, limits.names, names.group)[names.start_position].joints
        controller = controller_for(self._settings, limits, cell, np.array(start))
        self._channel = LockStep(controller, RsiNetwork(controller.layout))

    @property
    def wire(self) -> list[Array]:
        """Return the positions that were sent to the controller."""
        return list(self._channel.controller.wire)

    def backend(self) -> RsiBackend:
        for _ in range(round(RESTART_S / self._channel.controller.period_s)):
            self._channel.receive(0.0)
        return RsiBackend(self._settings, self._limits, channel=self._channel, clock=self._channel.clock)

    def _set_controller(self, fault: str, *, active: bool) -> None:
        controller = self._channel.controller
        if fault == "operation_mode":
            controller.switch_mode("T1" if active else "AUT")
        elif fault == "e_stop":
            controller.stop_safely(active=active)
        else:
            controller.starts_again = not active
            if active:
                controller.switch_off("a limit of the RSI context")
