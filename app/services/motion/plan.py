"""A planned motion or gripper command, with a check whether its preconditions still hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cobot.errors import ConflictError
from cobot.motions.forecast import Forecast
from cobot.motions.gripper_bodies import GripperRequest
from cobot.motions.improving import Improving, Planned
from cobot.motions.requests import MotionRequest
from cobot.motions.signals import NO_PLACED, Placed
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

START_TOLERANCE_RAD = 1e-6
"""Maximum distance of a joint from the start of a plan, rad. A plan is run unchanged, so the command would
jump by this distance.
"""
QUEUED_TOLERANCE_RAD = 1e-9
"""Maximum distance of a joint from the start of a queued plan, rad. The plan follows another motion directly,
so this only allows for rounding.
"""


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that can be run.

    Attributes:
        start: start of the motion, shape (dof,), rad.
        limits: joint limits at the time of planning.
        made_s: time at which the plan was made, on the service's clock.
        scene: version of the scene at the time of planning.
        tool: version of the tool at the time of planning.
        planners: the planners that were requested.
        by: the client that requested the plan.
        motions: number of motions in the plan.
        to_run: the trajectory to run; None if the plan has neither a motion nor an action.
        signals: actions and conditions on the path.
        gripper: the gripper command, if the plan is a gripper command; None for a motion.
        goal: the request, if the plan consists of one motion.
        found: the planned motion, in the form that the search for a faster one needs; None if there is no
            motion.
        planning_s: duration of planning, s.
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
    goal: MotionRequest | None = None
    found: Trajectory | Improving | None = None
    planning_s: float = 0.0

    @property
    def planned(self) -> Planned | None:
        """The quality of the planned motion; None for several motions and for gripper commands."""
        return None if self.goal is None else Planned.of(self.goal, self.found)

    @property
    def words(self) -> Iterator[str]:
        """Descriptions of the actions, the conditions and the gripper command of the plan, each in one
        sentence.
        """
        if self.gripper is not None:
            yield self.gripper.words
        yield from self.signals.words

    @property
    def effects(self) -> list[str]:
        """Descriptions of what the plan does in addition to moving the arm."""
        own = [] if self.gripper is None else [self.gripper.words]
        return own + [each.action.words for each in self.signals.actions if not each.action.event]

    def require_unchanged(self, robot: RobotDescription) -> None:
        """Check that the limits, the scene and the tool have not changed since planning.

        Raises:
            ConflictError: one of them has changed; the error gives the old and the new value.
        """
        for quantity in JointLimits.QUANTITIES:
            before, now = getattr(self.limits, quantity), getattr(robot.limits, quantity)
            for joint in np.flatnonzero(before != now)[:1]:
                name = self.limits.names[int(joint)]
                raise ConflictError(
                    f"plan {self.plan_id}: {quantity} of {name} was {before[joint]:g} when the plan was "
                    f"made, but is {now[joint]:g} now; plan again",
                    details={"cause": "limits_changed"},
                )
        for what, before, now in (
            ("scene", self.scene, robot.collision.scene.version),
            ("tool", self.tool, robot.model.tool.version),
        ):
            if before != now:
                raise ConflictError(
                    f"plan {self.plan_id}: the {what} had version {before} when the plan was made, but "
                    f"has version {now} now; plan again",
                    details={"cause": f"{what}_changed"},
                )

    def require_start(self, joints: Array, where: str = "is", most_rad: float = START_TOLERANCE_RAD) -> None:
        """Check that the given joint positions are at the start of the plan. They have shape (dof,), in rad.
        Raises `ConflictError` if they are not at the start.

        Args:
            where: "is" or "will be", for the error message.
        """
        off = joints - self.start
        worst = int(np.abs(off).argmax())
        if abs(off[worst]) > most_rad:
            unit = self.limits.unit(worst)
            raise ConflictError(
                f"plan {self.plan_id}: {self.limits.names[worst]} {where} at {joints[worst]:.6f} "
                f"{unit}, {abs(off[worst]):.3g} {unit} away from the start of the plan at "
                f"{self.start[worst]:.6f} {unit}, allowed: {most_rad:g} {unit}; move there first, or "
                "plan again",
                details={"cause": "not_at_start"},
            )
