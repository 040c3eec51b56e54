"""Path constraints: how far a configuration violates them, and the nearest configuration that keeps them."""

from __future__ import annotations

import numpy as np

from cobot.errors import PlanningError
from cobot.findings import Finding
from cobot.motions.constraints import Box, Cone, Constraints
from cobot.planners.projection import Projection
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName

LOOK_S, MAX_LOOKS = 1e-3, 50_000
"""Time between samples of a motion. Between two samples the motion deviates from the chord by less than a
hundredth of the allowance.
"""
ALLOWANCE = 1e-4
"""A motion, its start or its goal may violate a constraint by this amount, rad or m."""
INSIDE, INSIDE_SHARE = 2e-3, 0.1
"""A projected configuration stays this distance inside the constraints, rad or m. For a constraint with a
narrow range, the distance is this share of the range.
"""


class Held:
    """The constraints of a motion, for one robot and one start.

    Attributes:
        low, high: joint limits, or narrower ranges, shape (dof,), rad.
        projection: the same constraints for a search.
    """

    def __init__(self, robot: RobotDescription, constraints: Constraints, start: Array) -> None:
        self._model = robot.model
        self._limits = robot.limits
        self._constraints = constraints
        self.low, self.high = robot.limits.min_position.copy(), robot.limits.max_position.copy()
        for joint, low, high in constraints.joints:
            self.low[joint], self.high[joint] = max(low, self.low[joint]), min(high, self.high[joint])
        cone = constraints.cone
        self._direction = np.zeros(3)
        if cone is not None:
            turn = self._model.chain.solve(start)[1]
            self._direction = turn @ cone.axis if cone.direction is None else cone.direction
        box = constraints.box
        self.projection = Projection(
            robot.model.chain,
            self.low,
            self.high,
            None if cone is None else (cone.axis, self._direction, cone.within_rad),
            None if box is None else (box.low, box.high),
            INSIDE,
            INSIDE_SHARE,
        )

    def keeps(self, joints: Array) -> bool:
        """Whether a configuration keeps all constraints."""
        return self.projection.keeps(joints)

    def excess(self, rows: Array) -> Array:
        """How far each row violates each constraint. A negative value means that the row keeps the
        constraint. Shape: (n, k), in rad or m.
        """
        constraints = self._constraints
        columns = [np.full(len(rows), -np.inf)]
        if constraints.cone is not None or constraints.box is not None:
            poses = self._model.poses(rows)
            if constraints.cone is not None:
                columns.append(self._angles(constraints.cone, poses) - constraints.cone.within_rad)
            if constraints.box is not None:
                box, places = constraints.box, poses[:, :3]
                columns += list(np.maximum(box.low - places, places - box.high).T)
        for joint, low, high in constraints.joints:
            columns.append(np.maximum(low - rows[:, joint], rows[:, joint] - high))
        return np.stack(columns, axis=1)

    def require(self, joints: Array, what: str, share: float | None = None) -> None:
        """Reject a configuration that violates a constraint. `share` states where in the motion it occurs,
        from 0 to 1.

        Raises:
            PlanningError: the configuration violates a constraint; the message names `what`, the constraint,
                the violation and the allowed value.
        """
        excess = self.excess(joints[None])[0]
        worst = int(excess.argmax())
        if excess[worst] > ALLOWANCE:
            said = self._said(worst, joints)
            raise PlanningError(
                f"{what} violates {said}", findings=[self._finding(worst, float(excess[worst]), share)]
            )

    def check(self, trajectory: Trajectory, planner: PlannerName) -> None:
        """Reject a motion that violates a constraint.

        Raises:
            PlanningError: the motion violates a constraint; the message names the point, the constraint and
                the violation.
        """
        count = min(MAX_LOOKS, int(trajectory.duration_s / LOOK_S) + 2)
        times = np.linspace(0.0, trajectory.duration_s, count)
        rows = trajectory.sample(times)
        excess = self.excess(rows)
        worst = excess.max(axis=1)
        if worst.max() <= ALLOWANCE:
            return
        first, deepest = int((worst > ALLOWANCE).argmax()), int(worst.argmax())
        percent = 100.0 / trajectory.duration_s
        broken = int(excess[deepest].argmax())
        raise PlanningError(
            f"{planner}: the motion violates constraints from {percent * times[first]:.0f} % of its time on; "
            f"the largest violation is after {percent * times[deepest]:.0f} % ({times[deepest]:.2f} s): "
            f"{self._said(broken, rows[deepest])}",
            findings=[
                self._finding(broken, float(worst[deepest]), float(times[deepest]) / trajectory.duration_s)
            ],
        )

    def project(self, joints: Array) -> Array | None:
        """Project a configuration onto the constraints, see `Projection.project`."""
        return self.projection.project(joints)

    def _angles(self, cone: Cone, poses: Array) -> Array:
        """The angle between the tool's axis and its direction, shape (n,), rad."""
        w, vector = poses[:, 3:4], poses[:, 4:]
        twice = 2.0 * np.cross(vector, cone.axis)
        axes = cone.axis + w * twice + np.cross(vector, twice)
        sines = np.linalg.norm(np.cross(axes, self._direction), axis=1)
        return np.asarray(np.arctan2(sines, axes @ self._direction))

    def _finding(self, index: int, excess: float, share: float | None) -> Finding:
        """Report a violated constraint. `index` is its column of `excess`, and the finding's value is the
        excess.
        """
        names = ["", *(["orientation"] if self._constraints.cone is not None else [])]
        units = ["", *(["rad"] if self._constraints.cone is not None else [])]
        if self._constraints.box is not None:
            names += ["box.x", "box.y", "box.z"]
            units += ["m"] * 3
        joints = [self._limits.names[joint] for joint, _, _ in self._constraints.joints]
        names += [f"joints.{name}" for name in joints]
        units += [self._limits.unit(joint) for joint, _, _ in self._constraints.joints]
        of = (joints[index - len(names) + len(joints)],) if index >= len(names) - len(joints) else ()
        return Finding("constraint", f"{names[index]}, beyond it", excess, 0.0, units[index], share, of)

    def _said(self, index: int, joints: Array) -> str:
        """The sentence that describes a violated constraint, chosen by its column of `excess`."""
        cone, box = self._constraints.cone, self._constraints.box
        index -= 1
        pose = self._model.poses(joints[None])
        if cone is not None:
            if index == 0:
                angle = float(self._angles(cone, pose)[0])
                return (
                    f"constraints.orientation: the tool's axis is {angle:.4g} rad from its direction, "
                    f"allowed: {cone.within_rad:g} rad"
                )
            index -= 1
        if box is not None:
            if index < 3:
                return _outside_box(box, index, float(pose[0, index]))
            index -= 3
        joint, low, high = self._constraints.joints[index]
        unit = self._limits.unit(joint)
        value = f"{self._limits.names[joint]} is at {joints[joint]:.4g} {unit}"
        return f"constraints.joints: {value}, allowed: {low:g} to {high:g} {unit}"


def _outside_box(box: Box, axis: int, value: float) -> str:
    return (
        f"constraints.box: the TCP's {'xyz'[axis]} is {value:.4g} m, allowed: {box.low[axis]:g} to "
        f"{box.high[axis]:g} m"
    )
