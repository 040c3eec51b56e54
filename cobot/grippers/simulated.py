"""The hand in the simulation. It is driven through the inputs and outputs of the cell."""

from __future__ import annotations

from typing import Annotated

from pydantic import Discriminator, Field, Tag

from cobot.cell import AnyHand, Hand, OwnHand, TurningHand, hand_of, kind_of_hand
from cobot.clock import SYSTEM
from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.grippers.point_rigs import HandRig
from cobot.grippers.protocol import (
    Grasp,
    GripperCapabilities,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    Now,
    PowerLoss,
)

WIDTH, SPEED, FORCE = "hand.width", "hand.speed", "hand.force"
MEASURED_WIDTH, MEASURED_FORCE, MOVING = "hand.measured_width", "hand.measured_force", "hand.moving"
MIN_FORCE_N, MIN_SPEED_M_S = 0.5, 0.001
DEFAULT_FORCE_SHARE = 0.5
"""Force of the fingers if a command gives no force, as a share of the largest force."""
BEYOND_M = 0.003
"""A grasp closes this distance beyond the narrowest permitted object, m, so that the fingers press on it."""
NEAR_M = 0.001
PRESSING_N, PRESSING_SHARE = 1.0, 0.5
"""Minimum force, N, and minimum share of the commanded force. If fingers press with more but have not reached
the commanded width, they hold something.
"""
REPORT_S = 1.0
"""Time in which the cell must report a command, s. If it does not, another client has changed the outputs of
the cell.
"""


class SimulatedOptions(GripperOptions):
    """Options of `SimulatedGripper`."""

    hand: Annotated[
        Annotated[
            Annotated[OwnHand, Tag("sliding")] | Annotated[TurningHand, Tag("turning")],
            Discriminator(kind_of_hand),
        ]
        | None,
        Field(
            description="Fingers of the arm's model, as written by cobot new-robot; null: the hand of the "
            "cell."
        ),
    ] = None


class SimulatedGripper:
    """The driver for the simulated hand, see the module."""

    Options = SimulatedOptions

    def __init__(self, hand: AnyHand, port: IoPort, clock: Now = SYSTEM) -> None:
        self._hand, self._port, self._clock = hand, port, clock
        self._asked: dict[str, float] = {}
        self._asked_s = 0.0
        self._sent: dict[str, float] = {}
        self._holds = False
        self.capabilities = GripperCapabilities(
            width_m=(hand.closed_m, hand.stroke_m),
            force_n=(MIN_FORCE_N, hand.max_force_n),
            speed_m_s=(MIN_SPEED_M_S, hand.max_speed_m_s),
            object_detection=True,
            on_power_loss=PowerLoss.KEEPS,
            hardware=False,
        )

    @classmethod
    def of_robot(cls, settings: Settings, port: IoPort) -> SimulatedGripper:
        """See `Gripper`.

        Raises:
            ConfigError: the robot has no cell, or its cell has no hand.
        """
        hand, cell = hand_of(settings), settings.robot.cell
        if hand is None and cell is None:
            raise ConfigError(
                "robot.gripper is simulated, which needs a simulated cell, but the robot has no cell; "
                "set robot.cell, or start with cobot run --cell FILE"
            )
        if hand is None:
            raise ConfigError(
                f"robot.gripper is simulated, which needs the hand of the cell, but {cell} has no hand; "
                f"add `hand: {{}}`"
            )
        return cls(hand, port)

    @staticmethod
    def contract_rig(options: SimulatedOptions) -> HandRig:
        """A rig with the hand that the options describe, or with the default hand of a cell."""
        return HandRig(options.hand or Hand())

    def connect(self) -> None:
        self._asked.clear()
        self._sent.clear()
        for name in (WIDTH, SPEED, FORCE, MEASURED_WIDTH, MEASURED_FORCE, MOVING):
            self._port.read(name)

    def disconnect(self) -> None: ...

    def open(self) -> None:
        self.move(self._hand.stroke_m, None, None)

    def close(self) -> None:
        self.move(self._hand.closed_m, None, None)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        hand, self._holds = self._hand, False
        self._asked = {
            SPEED: hand.max_speed_m_s if speed is None else speed,
            FORCE: DEFAULT_FORCE_SHARE * hand.max_force_n if force is None else force,
            WIDTH: width,
        }
        self._asked_s = self._clock.now_s()
        for name, value in self._asked.items():
            reported = self._port.read(name)
            # Each output takes rtloop a few cycles. So a report may be older than the last command.
            if reported != value or self._sent.get(name, reported) != value:
                self._send(name, value)

    def grasp(self, grasp: Grasp) -> None:
        present_m = self._port.read(MEASURED_WIDTH)
        if grasp.width is not None and grasp.width > present_m:
            target_m = min(self._hand.stroke_m, grasp.width + grasp.tolerance_outer + BEYOND_M)
        else:
            narrow_m = 0.0 if grasp.width is None else grasp.width - grasp.tolerance_inner
            target_m = max(self._hand.closed_m, narrow_m - BEYOND_M)
        self.move(target_m, grasp.speed, grasp.force)

    def release(self, width: float | None) -> None:
        self.move(self._hand.stroke_m if width is None else width, None, None)

    def stop(self) -> None:
        if self._moves():
            self._asked, self._asked_s = {WIDTH: self._port.read(MEASURED_WIDTH)}, self._clock.now_s()
            self._send(WIDTH, self._asked[WIDTH])

    def home(self) -> None:
        self.open()

    def state(self) -> GripperState:
        width, target = self._port.read(MEASURED_WIDTH), self._port.read(WIDTH)
        force, moving = abs(self._port.read(MEASURED_FORCE)), self._moves()
        held = HeldObject.NONE
        pressing_n = min(PRESSING_N, PRESSING_SHARE * self._port.read(FORCE))
        presses = force > pressing_n and abs(width - target) > NEAR_M
        # A held part may slip by some micrometres. The fingers then move, but do not lose the part.
        self._holds = presses and (not moving or (self._holds and not self._asked))
        if self._holds:
            held = HeldObject.HELD_INSIDE if width > target else HeldObject.HELD_OUTSIDE
        return GripperState(width, target, moving, force=force, object=held)

    def _send(self, name: str, value: float) -> None:
        self._port.set(name, value)
        self._sent[name] = value

    def _moves(self) -> bool:
        """Whether the fingers move, or the cell has not reported the last command yet."""
        reported = all(self._port.read(name) == value for name, value in self._asked.items())
        if reported or self._clock.now_s() - self._asked_s > REPORT_S:
            self._asked.clear()
        return bool(self._asked) or bool(self._port.read(MOVING))
