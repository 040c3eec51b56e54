"""The Franka Hand driver."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated

from pydantic import Field

from cobot.grippers.franka.link import HandLink, ProcessLink
from cobot.grippers.franka.rig import FrankaHandRig
from cobot.grippers.protocol import (
    Grasp,
    GripperCapabilities,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    PowerLoss,
)

SPEEDS_M_S, FORCES_N = (0.005, 0.1), (1.0, 70.0)
"""Ranges of the speed at which the width changes, and of the continuous force. Source: data sheet of the
Franka Hand.
"""
CLOSED_M = 0.001
"""Width at or below which the fingers hold nothing, m, even if the hand reports an object."""


class FrankaHandOptions(GripperOptions):
    """Options of `FrankaHand`."""

    address: Annotated[
        str,
        Field(
            min_length=1,
            max_length=253,
            description="Address of the robot's control unit, the same as that of the backend.",
        ),
    ]
    max_width: Annotated[
        float, Field(gt=0.0, le=0.2, description="Width of the open fingers, m; it depends on the fingers.")
    ] = 0.08
    default_speed: Annotated[
        float,
        Field(ge=SPEEDS_M_S[0], le=SPEEDS_M_S[1], description="Speed of a command without a speed, m/s."),
    ] = 0.1
    default_force: Annotated[
        float, Field(ge=FORCES_N[0], le=FORCES_N[1], description="Force of a grasp without a force, N.")
    ] = 30.0


class FrankaHand:
    """The driver for the Franka Hand, see the package. `move` ignores the force, because the library accepts
    a force only for `grasp`.
    """

    Options = FrankaHandOptions
    sdk = "pylibfranka"
    state_period_s = 0.02

    def __init__(
        self, options: FrankaHandOptions, port: IoPort, connect: Callable[[], HandLink] | None = None
    ) -> None:
        """
        Args:
            connect: creates a connection that tests use instead of one to `options.address`.
        """
        self._options = options
        self._link = ProcessLink(options.address) if connect is None else connect()
        self._busy = False
        self._fault = ""
        self._commanded: float | None = None
        self._force: float | None = None
        self.capabilities = GripperCapabilities(
            width_m=(0.0, options.max_width),
            force_n=FORCES_N,
            speed_m_s=SPEEDS_M_S,
            object_detection=True,
            on_power_loss=PowerLoss.KEEPS,
        )

    @staticmethod
    def contract_rig(options: FrankaHandOptions) -> FrankaHandRig:
        return FrankaHandRig(options)

    def connect(self) -> None:
        self._link.open()
        self._busy = False
        self._link.read()

    def disconnect(self) -> None:
        self._link.close()

    def open(self) -> None:
        self.move(self._options.max_width, None, None)

    def close(self) -> None:
        self.move(0.0, None, None)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        self._begin("move", width, self._options.default_speed if speed is None else speed)
        self._commanded, self._force = width, None

    def grasp(self, grasp: Grasp) -> None:
        options = self._options
        speed = options.default_speed if grasp.speed is None else grasp.speed
        force = options.default_force if grasp.force is None else grasp.force
        width, inner, outer = grasp.width, grasp.tolerance_inner, grasp.tolerance_outer
        if width is None:
            width, inner, outer = 0.0, 0.0, options.max_width
        self._begin("grasp", width, speed, force, inner, outer)
        self._commanded, self._force = width, force

    def release(self, width: float | None) -> None:
        self.move(self._options.max_width if width is None else width, None, None)

    def stop(self) -> None:
        """Stop a running command. If none is running, nothing is sent, because the library's stop would
        release a held object.
        """
        if self._is_busy():
            self._link.abort()
            self._busy = False

    def home(self) -> None:
        self._begin("homing")
        self._commanded = self._force = None

    def state(self) -> GripperState:
        moving = self._is_busy()
        found = self._link.read()
        holds = found.is_grasped and found.width > CLOSED_M and not moving
        return GripperState(
            found.width,
            self._commanded,
            moving,
            force=self._force if holds else None,
            object=HeldObject.HELD_INSIDE if holds else HeldObject.NONE,
            temperature=found.temperature,
            fault=self._fault,
            ages_s={"width": found.age_s, "temperature": found.age_s} if moving else {},
        )

    def _begin(self, call: str, *arguments: float) -> None:
        """Start a command. A running command is stopped first, because the library accepts only one at a
        time.
        """
        self.stop()
        self._fault = ""
        self._link.begin(call, *arguments)
        self._busy, self._call = True, call

    def _is_busy(self) -> bool:
        if self._busy and (result := self._link.result()) is not None:
            self._busy = False
            if self._call != "grasp" and not result.good:  # a grasp that finds nothing also fails
                self._fault = (
                    f"the hand has not executed {self._call}: {result.failure or 'it was unsuccessful'}"
                )
        return self._busy
