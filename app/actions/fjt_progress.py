"""Progress of a FollowJointTrajectory goal, for the check of its tolerances and for the client's feedback."""

from __future__ import annotations

from dataclasses import dataclass

from app.actions.fjt_goal import FjtGoal, Message
from app.services.state.robot_state import RobotState
from cobot.ros.messages import ros_time
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits


@dataclass(frozen=True, slots=True)
class TrajectoryProgress:
    """The state of the arm and of its trajectory at one time. All arrays have the shape (dof,) and are in
    rad, rad/s and rad/s².

    Attributes:
        stamp_ns: time of this state, ns since 1970.
        time_s: time along the trajectory.
    """

    stamp_ns: int
    time_s: float
    desired: tuple[Array, Array, Array]
    actual: tuple[Array, Array]

    @property
    def error(self) -> tuple[Array, Array]:
        """Return the position and velocity errors, desired minus actual, as joint_trajectory_controller
        reports them.
        """
        return self.desired[0] - self.actual[0], self.desired[1] - self.actual[1]

    def path_violation(self, goal: FjtGoal, limits: JointLimits) -> str:
        """See `Tolerance.violation`."""
        return goal.path.violation(*self.error, limits)

    def feedback(self, names: tuple[str, ...]) -> Message:
        """Build a control_msgs/action/FollowJointTrajectory_Feedback message. Fields with ROS's default value
        are omitted.
        """
        return {
            "header": {"stamp": ros_time(self.stamp_ns)},
            "joint_names": list(names),
            "desired": self._point(*self.desired),
            "actual": self._point(*self.actual),
            "error": self._point(*self.error),
        }

    def _point(self, position: Array, velocity: Array, acceleration: Array | None = None) -> Message:
        sec, nanosec = divmod(round(self.time_s * 1e9), 1_000_000_000)
        point: Message = {
            "positions": position.tolist(),
            "velocities": velocity.tolist(),
            "time_from_start": {"sec": sec, "nanosec": nanosec},
        }
        if acceleration is not None:
            point["accelerations"] = acceleration.tolist()
        return point


def on_path(
    trajectory: Trajectory, time_s: float, rate: float, state: RobotState, stamp_ns: int
) -> TrajectoryProgress:
    """Return the progress at a given time on the trajectory's clock. `rate` is the speed of that clock, in
    seconds per second.
    """
    desired = [trajectory.sample([time_s], order)[0] * rate**order for order in range(3)]
    return TrajectoryProgress(
        stamp_ns, time_s, (desired[0], desired[1], desired[2]), (state.position, state.velocity)
    )
