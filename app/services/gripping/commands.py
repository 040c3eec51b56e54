"""Commands to the gripper: while they are under way, and what they have come to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from app.services.gripping.checks import grasp_of
from app.services.rights.job import Job
from cobot.errors import CobotError, ExecutionError
from cobot.grippers import Gripper, GripperCapabilities, GripperState
from cobot.motions.gripper_bodies import AnyGripperCommand, GripperGrasp, GripperMove, GripperRelease

ARRIVED_M = 0.003
"""A move has arrived when the width is off by no more, m, or by this share of the stroke."""
ARRIVED_SHARE = 0.03


@dataclass(eq=False, slots=True)
class Running:
    """A command that is under way.

    Attributes:
        stops: how many stops there had been when it began; a later one ends it.
        latched: whether an e-stop or a fault was latched then.
    """

    name: str
    command: AnyGripperCommand
    job: Job | None
    stops: int = 0
    latched: bool = False
    interruption: ExecutionError | None = None
    news: asyncio.Event = field(default_factory=asyncio.Event)

    def interrupt(self, cause: ExecutionError) -> None:
        """End it; the first cause counts."""
        self.interruption = self.interruption or cause
        self.news.set()


@dataclass(frozen=True, slots=True)
class GripperOutcome:
    """How a command has ended, and the gripper's state then.

    Attributes:
        error: None if it has reached its end, or if that did not matter.
    """

    error: CobotError | None
    state: GripperState
    held: str | None


@dataclass(frozen=True, slots=True)
class GripperReport:
    """State of the gripper.

    Attributes:
        command: the name of the command that is under way; "" for none.
        held: the object of the scene that is attached to it.
        age_s: of the state.
    """

    type: str
    capabilities: GripperCapabilities
    problem: str
    state: GripperState | None
    age_s: float
    command: str
    held: str | None


def missed(state: GripperState) -> CobotError | None:
    """Why nothing is held after a grasp; None if something is, or if that is not known."""
    if state.object is None or state.object.is_held:
        return None
    where = "" if state.width is None else f" at {state.width:.4f} m"
    return ExecutionError(f"the gripper has closed on nothing{where}: no object is held")


def shortfall(
    command: AnyGripperCommand, state: GripperState, able: GripperCapabilities
) -> CobotError | None:
    """Why a command that has ended has not come to what was asked for; None if it has."""
    if isinstance(command, GripperGrasp):
        nothing = missed(state)
        if nothing is None and state.width is not None and not grasp_of(command).permits(state.width):
            return ExecutionError(
                f"the fingers hold something that is {state.width:.4f} m wide, expected {command.width:g} m "
                f"(-{command.tolerance_inner:g}, +{command.tolerance_outer:g})"
            )
        return None if command.if_missed == "success" else nothing
    if not isinstance(command, GripperMove) or command.if_blocked == "success":
        return None
    if has_arrived(command.width, state, able):
        return None
    return ExecutionError(
        f"the fingers stopped at {state.width:.4f} m, commanded {command.width:g} m: something is in "
        "their way; to hold an object use grasp"
    )


def has_arrived(width: float, state: GripperState, able: GripperCapabilities) -> bool:
    """Whether the fingers are at this width, or may be: not every gripper knows its width."""
    if state.width is None or able.width_m is None:
        return True
    least, most = able.width_m
    return abs(state.width - width) <= max(ARRIVED_M, ARRIVED_SHARE * (most - least))


def start_of(command: AnyGripperCommand) -> Callable[[Gripper], None]:
    """What has a driver start a command."""
    match command:
        case GripperMove():
            return lambda gripper: gripper.move(command.width, command.speed, command.force)
        case GripperGrasp():
            return lambda gripper: gripper.grasp(grasp_of(command))
        case GripperRelease():
            return lambda gripper: gripper.release(command.width)
        case _:
            return lambda gripper: gripper.home()
