"""A motion or a command to the gripper that was planned, and whether all is still as it was then."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cobot.errors import ConflictError
from cobot.motions.forecast import Forecast
from cobot.motions.gripper_bodies import GripperRequest
from cobot.motions.signals import NO_PLACED, Placed
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

START_TOLERANCE_RAD = 1e-6
"""Maximum distance of a joint from the start of a plan. A plan is run unchanged, so an offset is a jump."""
QUEUED_TOLERANCE_RAD = 1e-9
"""Start tolerance in the queue, where a plan follows another motion without a rest. It allows for rounding
only."""


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that can be run.

    Attributes:
        start: where it begins, shape (dof,), rad.
        limits: of the joints, as they were when it was made.
        made_s: when that was, on the service's clock.
        scene: the version of the scene that it was made for.
        tool: the version of the tool that it was made for.
        planners: the planners that were requested.
        by: the client that requested it.
        motions: the number of motions that it consists of.
        to_run: the trajectory that is run; None if nothing moves, and nothing is to be done.
        signals: actions and conditions on its way.
        gripper: the command to the gripper that is the whole plan; None: it is a motion.
    """

    plan_id: str
    start: Array
    forecast: Forecast
    limits: JointLimits
    made_s: float
    scene: int = 0
    tool: int = 0
    planners: frozenset[str] = frozenset()
    by: str = ""
    motions: int = 1
    to_run: Trajectory | None = None
    signals: Placed = NO_PLACED
    gripper: GripperRequest | None = None

    @property
    def words(self) -> Iterator[str]:
        """What it does besides the motion, for people, one sentence each."""
        if self.gripper is not None:
            yield self.gripper.words
        yield from self.signals.words

    @property
    def deeds(self) -> list[str]:
        """What it changes besides the arm's position, in words."""
        own = [] if self.gripper is None else [self.gripper.words]
        return own + [each.action.words for each in self.signals.actions if not each.action.event]

    def require_unchanged(self, robot: RobotDescription) -> None:
        """The limits, the scene and the tool are those that it was made for.

        Raises:
            ConflictError: one is not; with what, and how it was.
        """
        for quantity in JointLimits.QUANTITIES:
            before, now = getattr(self.limits, quantity), getattr(robot.limits, quantity)
            for joint in np.flatnonzero(before != now)[:1]:
                name = self.limits.names[int(joint)]
                raise ConflictError(
                    f"plan {self.plan_id}: {quantity} of {name} was {before[joint]:g} when it was "
                    f"made and is {now[joint]:g} now; allowed is no difference; plan again"
                )
        for what, before, now in (
            ("scene", self.scene, robot.collision.scene.version),
            ("tool", self.tool, robot.model.tool.version),
        ):
            if before != now:
                raise ConflictError(
                    f"plan {self.plan_id}: the {what} had version {before} when it was made and has version "
                    f"{now} now; plan again"
                )

    def require_start(self, joints: Array, where: str = "is", most_rad: float = START_TOLERANCE_RAD) -> None:
        """These joints, shape (dof,), rad, are where it begins; raises `ConflictError` otherwise.

        Args:
            where: the arm is there, or will be.
        """
        off = joints - self.start
        worst = int(np.abs(off).argmax())
        if abs(off[worst]) > most_rad:
            unit = self.limits.unit(worst)
            raise ConflictError(
                f"plan {self.plan_id}: {self.limits.names[worst]} {where} at {joints[worst]:.6f} {unit}, "
                f"{abs(off[worst]):.3g} {unit} from {self.start[worst]:.6f} {unit} where the plan begins; "
                f"allowed are {most_rad:g} {unit}; go there, or plan again"
            )
