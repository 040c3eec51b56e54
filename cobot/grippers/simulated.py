"""The hand of a simulated cell, driven through the cell's inputs and outputs."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cobot.clock import SYSTEM, Clock
from cobot.grippers.protocol import (
    Grasp,
    GripperCapabilities,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    PowerLoss,
)

WIDTH, SPEED, FORCE = "hand.width", "hand.speed", "hand.force"
MEASURED_WIDTH, MEASURED_FORCE, MOVING = "hand.measured_width", "hand.measured_force", "hand.moving"
BEYOND_M = 0.003
"""A grasp aims so far beyond the narrowest permitted object: the fingers have to press on it."""
NEAR_M = 0.001
PRESSING_N = 1.0
"""Fingers that press harder, away from the commanded width, hold something."""
REPORT_S = 0.05
"""The cell reports a command no later than this."""


class SimulatedOptions(GripperOptions):
    """Options of `SimulatedGripper`; those of the hand itself are in the cell's file."""

    stroke: Annotated[float, Field(gt=0.0, le=1.0, description="Largest width, m.")] = 0.08
    max_force: Annotated[float, Field(gt=0.0, le=10_000.0, description="N")] = 70.0
    max_speed: Annotated[float, Field(gt=0.0, le=10.0, description="m/s")] = 0.2


class SimulatedGripper:
    """See the module."""

    Options = SimulatedOptions

    def __init__(self, options: SimulatedOptions, port: IoPort, clock: Clock = SYSTEM) -> None:
        self._options, self._port, self._clock = options, port, clock
        self._begun_s = clock.now_s() - REPORT_S
        self.capabilities = GripperCapabilities(
            width_m=(0.0, options.stroke),
            force_n=(1.0, options.max_force),
            speed_m_s=(0.001, options.max_speed),
            object_detection=True,
            on_power_loss=PowerLoss.KEEPS,
            hardware=False,
        )

    def connect(self) -> None:
        for name in (WIDTH, SPEED, FORCE, MEASURED_WIDTH, MEASURED_FORCE, MOVING):
            self._port.read(name)

    def disconnect(self) -> None: ...

    def open(self) -> None:
        self.move(self._options.stroke, None, None)

    def close(self) -> None:
        self.move(0.0, None, None)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        options = self._options
        self._port.set(SPEED, options.max_speed if speed is None else speed)
        self._port.set(FORCE, 0.5 * options.max_force if force is None else force)
        self._port.set(WIDTH, width)
        self._begun_s = self._clock.now_s()

    def grasp(self, grasp: Grasp) -> None:
        present_m = self._port.read(MEASURED_WIDTH)
        if grasp.width is not None and grasp.width > present_m:
            target_m = min(self._options.stroke, grasp.width + grasp.tolerance_outer + BEYOND_M)
        else:
            narrow_m = 0.0 if grasp.width is None else grasp.width - grasp.tolerance_inner
            target_m = max(0.0, narrow_m - BEYOND_M)
        self.move(target_m, grasp.speed, grasp.force)

    def release(self, width: float | None) -> None:
        self.move(self._options.stroke if width is None else width, None, None)

    def stop(self) -> None:
        if self._moves():
            self._port.set(WIDTH, self._port.read(MEASURED_WIDTH))

    def home(self) -> None:
        self.open()

    def state(self) -> GripperState:
        width, target = self._port.read(MEASURED_WIDTH), self._port.read(WIDTH)
        force, moving = abs(self._port.read(MEASURED_FORCE)), self._moves()
        held = HeldObject.NONE
        if not moving and force > PRESSING_N and abs(width - target) > NEAR_M:
            held = HeldObject.HELD_INSIDE if width > target else HeldObject.HELD_OUTSIDE
        return GripperState(width, target, moving, force=force, object=held)

    def _moves(self) -> bool:
        reported = self._clock.now_s() - self._begun_s >= REPORT_S
        return bool(self._port.read(MOVING)) or not reported
