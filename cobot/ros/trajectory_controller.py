"""A joint trajectory controller without a robot. It behaves like ros2_control's JointTrajectoryController
with mock hardware, as its documentation describes it.

It uses no network and no clock. `cobot simulate ros2_control` and the contract of the backend use it.

Source: ros2_controllers, joint_trajectory_controller, userdoc and trajectory representation.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cobot.ros.failures import FjtError
from cobot.types import Array

Message = dict[str, Any]
ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = 1, 2, 3, 4, 5, 6
"""Values of action_msgs/msg/GoalStatus."""


def seconds(duration: Message) -> float:
    """The seconds of a builtin_interfaces/Duration."""
    return float(duration["sec"]) + 1e-9 * float(duration["nanosec"])


def between(share: float, duration_s: float, start: Array, end: Array) -> Array:
    """Position, velocity and acceleration between two points, shape (3, dof).

    Each point contains as many of these rows as it defines: 1 for a straight line, 2 for a cubic, 3 for a
    quintic.
    """
    degree = min(len(start), len(end))
    step, t = end[0] - start[0], share * duration_s
    c = np.zeros((6, len(step)))
    c[0] = start[0]
    if degree == 1:
        c[1] = step / duration_s
    elif degree == 2:
        c[1] = start[1]
        c[2] = (3.0 * step / duration_s - 2.0 * start[1] - end[1]) / duration_s
        c[3] = (-2.0 * step / duration_s + start[1] + end[1]) / duration_s**2
    else:
        v0, v1 = start[1] * duration_s, end[1] * duration_s
        a0, a1 = start[2] * duration_s**2, end[2] * duration_s**2
        c[1], c[2] = start[1], 0.5 * start[2]
        c[3] = (20.0 * step - (8.0 * v1 + 12.0 * v0) - (3.0 * a0 - a1)) / (2.0 * duration_s**3)
        c[4] = (-30.0 * step + (14.0 * v1 + 16.0 * v0) + (3.0 * a0 - 2.0 * a1)) / (2.0 * duration_s**4)
        c[5] = (12.0 * step - 6.0 * (v1 + v0) - (a0 - a1)) / (2.0 * duration_s**5)
    powers = t ** np.arange(6)
    places = np.arange(6)
    first = np.where(places > 0, places * t ** np.maximum(places - 1, 0), 0.0)
    second = np.where(places > 1, places * (places - 1) * t ** np.maximum(places - 2, 0), 0.0)
    return np.array([powers @ c, first @ c, second @ c])


@dataclass(slots=True)
class RunningGoal:
    """A goal and the progress of its execution.

    Attributes:
        key: key that identifies the goal for its client.
        times_s: times of the points, counted from the start of the execution.
        points: for each point its position and, if given, its velocity and acceleration.
        done_s: time up to which the goal has been executed.
    """

    key: str
    times_s: list[float]
    points: list[Array]
    done_s: float = 0.0


@dataclass(slots=True)
class TrajectoryController:
    """The simulated controller, see the module. It follows each goal exactly.

    Attributes:
        joints: joint names, in the controller's order.
        rows: position, velocity and acceleration, shape (3, dof).
        active: whether the controller is activated.
        rate: ratio between the time along the path and the time on the clock, as a speed slider sets it.
        on_end: called with the key, the status and the result of a goal that has ended.
    """

    joints: Sequence[str]
    rows: Array
    on_end: Callable[[str, int, Message], None]
    active: bool = True
    rate: float = 1.0
    goal: RunningGoal | None = None

    def refusal(self, goal: Message) -> str:
        """The reason why a goal is rejected; "" if it is accepted."""
        trajectory = goal["trajectory"]
        names, points = trajectory["joint_names"], trajectory["points"]
        if not self.active:
            return "the controller is not active"
        if not points:
            return "the trajectory is empty"
        if unknown := sorted(set(names) - set(self.joints)):
            return f"the joint {unknown[0]!r} is unknown"
        if len(set(names)) != len(self.joints) or len(names) != len(self.joints):
            return f"joints are missing: {', '.join(sorted(set(self.joints) - set(names)))}"
        before_s = -1.0
        for point in points:
            time_s = seconds(point["time_from_start"])
            if time_s <= before_s:
                return f"time_from_start {time_s:g} s does not increase"
            before_s = time_s
            for name, needed in (("positions", True), ("velocities", False), ("accelerations", False)):
                if len(point[name]) != len(names) and (needed or point[name]):
                    return f"a point has {len(point[name])} {name} for {len(names)} joints"
        if np.any(np.abs(points[-1]["velocities"]) > 1e-6):
            return "the velocity of the last point is not zero"
        return ""

    def begin(self, key: str, goal: Message) -> None:
        """Begin an accepted goal. The current goal ends."""
        self.end(CANCELED, FjtError.INVALID_GOAL, "Current goal cancelled due to new incoming action.")
        self.follow(key, goal["trajectory"])

    def follow(self, key: str, trajectory: Message) -> None:
        """Follow a trajectory that starts at the current state."""
        order = [trajectory["joint_names"].index(name) for name in self.joints]
        times_s, points = [0.0], [self.rows.copy()]
        for point in trajectory["points"]:
            stated = [point[name] for name in ("positions", "velocities", "accelerations") if point[name]]
            rows = np.array(stated, float)[:, order]
            time_s = seconds(point["time_from_start"])
            if time_s <= 0.0:
                times_s, points = [], []
            times_s.append(max(time_s, 0.0))
            points.append(rows)
        self.goal = RunningGoal(key, times_s, points)

    def hold(self) -> None:
        """Hold the current position."""
        self.rows[1:] = 0.0

    def end(self, status: int, error: int, text: str) -> None:
        """End the current goal, if there is one, and hold the position."""
        goal, self.goal = self.goal, None
        if goal is not None:
            self.hold()
            self.on_end(goal.key, status, {"error_code": int(error), "error_string": text})

    def step(self, duration_s: float) -> None:
        """Simulate the next `duration_s`."""
        goal = self.goal
        if goal is None:
            return
        goal.done_s += self.rate * duration_s
        if goal.done_s >= goal.times_s[-1]:
            self.rows[0] = goal.points[-1][0]
            self.end(SUCCEEDED, FjtError.SUCCESSFUL, "Goal successfully reached!")
            return
        after = int(np.searchsorted(goal.times_s, goal.done_s, side="right"))
        start_s, end_s = goal.times_s[after - 1], goal.times_s[after]
        share = (goal.done_s - start_s) / (end_s - start_s)
        self.rows[:] = between(share, end_s - start_s, goal.points[after - 1], goal.points[after])
        self.rows[1:] *= self.rate
