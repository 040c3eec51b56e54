"""Running gripper commands and their results."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Callable
from dataclasses import dataclass, field

from app.services.gripping.checks import grasp_of
from app.services.rights.job import Job
from cobot.errors import CobotError, ExecutionError
from cobot.grippers import Gripper, GripperCapabilities, GripperState
from cobot.motions.gripper_bodies import AnyGripperCommand, GripperGrasp, GripperMove, GripperRelease
from cobot.reasons import Reason, ReasonCode

ARRIVED_M = 0.003
"""Tolerance of the width at the end of a move: m, and a share of the stroke. The larger one applies."""
ARRIVED_SHARE = 0.03


@dataclass(eq=False, slots=True)
class Running:
    """A running command.

    Attributes:
        stops: number of stops when the command began. If it has increased since, the command is ended.
        latched: whether an e-stop or a fault was latched when the command began.
    """

    name: str
    command: AnyGripperCommand
    job: Job | None
    stops: int = 0
    latched: bool = False
    interruption: ExecutionError | None = None
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def interrupt(self, cause: ExecutionError) -> None:
        """End the command. Only the cause from the first call is kept."""
        self.interruption = self.interruption or cause
        self.news.set()


@dataclass(frozen=True, slots=True)
class GripperOutcome:
    """The result of a command, and the gripper's state at its end.

    Attributes:
        error: None if the command has reached its goal, or if the request does not require it.
    """

    error: CobotError | None
    state: GripperState
    held: str | None


@dataclass(frozen=True, slots=True)
class GripperReport:
    """A report about the gripper.

    Attributes:
        command: name of the running command; "" while no command is running.
        held: the scene object that is attached to the gripper.
        age_s: age of the state, s.
    """

    type: str
    capabilities: GripperCapabilities
    problem: str
    state: GripperState | None
    age_s: float
    command: str
    held: str | None


def missed(state: GripperState) -> CobotError | None:
    """Return the error for a grasp that holds nothing; None if an object is held, or if the gripper cannot
    detect it.
    """
    if state.object is None or state.object.is_held:
        return None
    where = "" if state.width is None else f" at {state.width:.4f} m"
    return _failed(
        f"the gripper has closed on nothing{where}: no object is held",
        ReasonCode.GRIPPER_NOTHING,
        state.width,
    )


def _failed(words: str, code: ReasonCode, width: float | None, expected: float = math.nan) -> ExecutionError:
    reason = Reason(words, code, value=math.nan if width is None else width, limit=expected, unit="m")
    return ExecutionError(words, details=reason.fields())


def shortfall(
    command: AnyGripperCommand, state: GripperState, able: GripperCapabilities
) -> CobotError | None:
    """Return the error if an ended command has not reached its goal; otherwise None."""
    if isinstance(command, GripperGrasp):
        nothing = missed(state)
        if nothing is None and state.width is not None and not grasp_of(command).permits(state.width):
            return _failed(
                f"the fingers hold something that is {state.width:.4f} m wide; the expected width is "
                f"{command.width:g} m (-{command.tolerance_inner:g}, +{command.tolerance_outer:g})",
                ReasonCode.GRIPPER_SIZE,
                state.width,
                math.nan if command.width is None else command.width,
            )
        return None if command.if_missed == "success" else nothing
    if not isinstance(command, GripperMove) or command.if_blocked == "success":
        return None
    if has_arrived(command.width, state, able):
        return None
    return _failed(
        f"the fingers stopped at {state.width:.4f} m instead of {command.width:g} m, because something "
        "is in their way; to hold an object, use grasp",
        ReasonCode.GRIPPER_BLOCKED,
        state.width,
        command.width,
    )


def has_arrived(width: float, state: GripperState, able: GripperCapabilities) -> bool:
    """Whether the fingers have reached the given width. Also true if the gripper does not report its
    width.
    """
    if state.width is None or able.width_m is None:
        return True
    least, most = able.width_m
    return abs(state.width - width) <= max(ARRIVED_M, ARRIVED_SHARE * (most - least))


def start_of(command: AnyGripperCommand) -> Callable[[Gripper], None]:
    """Return the function that makes a driver start a command."""
    match command:
        case GripperMove():
            return lambda gripper: gripper.move(command.width, command.speed, command.force)
        case GripperGrasp():
            return lambda gripper: gripper.grasp(grasp_of(command))
        case GripperRelease():
            return lambda gripper: gripper.release(command.width)
        case _:
            return lambda gripper: gripper.home()
