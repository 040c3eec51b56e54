"""What `rtloop.sources.cartesian` and `.servo_force` compute, in numpy.

The generators of poses and the robot's kinematics are given: they have oracles of their own.
"""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from laws.quaternions import cross
from laws.target_checks import (
    ANGULAR_VELOCITY,
    LINEAR_VELOCITY,
    SLACK_S,
    clamped_interval,
    pose_jumps,
)

from cobot.ipc.layout import Intervention
from cobot.robot.model import RobotModel
from cobot.robot.quaternion import between, product, rotated
from cobot.types import Array, CartesianLimits, JointLimits
from rtloop.generators.pose_interpolation import MinJerkMove

FORCE_RATE_RAD_S, DAMPING = 5.0, 1e-5
POSTURE_RATE_RAD_S, POSTURE_VELOCITY_RAD_S = 1.0, 0.2
POSTURE_FILTER_S, FORCE_FILTER_S = 0.1, 0.03
VELOCITY_SHARE, LEAD_RAD, UNIT_TOLERANCE = 0.98, 0.2, 1e-3


class CartesianSource:
    """Poses of the TCP, interpolated, within the Cartesian limits, and followed by the joints."""

    def __init__(
        self,
        interpolator: Any,
        limiter: Any,
        targets: Any,
        model: RobotModel,
        limits: JointLimits,
        within: CartesianLimits,
        period_s: float,
        command_s: float,
        request: np.ndarray,
    ) -> None:
        self._interpolator, self._limiter, self._targets = interpolator, limiter, targets
        self._model, self._limits, self._within = model, limits, within
        self._period_s, self._command_s = period_s, command_s
        self._move: MinJerkMove | None = None
        self._goal, self._last, self._wrench = np.zeros(7), np.zeros(7), np.zeros(6)
        self._axes = request["force_axes"] > 0.0
        self._force_velocity = request["force_velocity"].copy()
        stiffness = request["cartesian_stiffness"]
        self._force_gain = FORCE_RATE_RAD_S / np.repeat([stiffness[:3].max(), stiffness[3:].max()], 3)
        self._force_in_tcp = bool(request["force_in_tcp"])
        self._force_frame = request["force_frame"].copy()
        self._posture = request["posture"].copy()
        self._own_posture = not np.isfinite(self._posture).all()
        self.reference = np.zeros((3, limits.dof))

    @property
    def heading(self) -> Array:
        _, error, jacobian = self._distance_to(self._last if self._move is None else self._goal)
        return np.asarray(jacobian.T @ _damped(jacobian, error))

    @property
    def move_running(self) -> bool:
        return self._move is not None

    def begin(self, command: Array) -> None:
        dof = self._limits.dof
        self.reference[:] = command
        self._commanded, self._before = command[:2].copy()
        self._pull, self._force_pull = np.zeros((2, dof)), np.zeros((2, 6))
        if self._own_posture:
            self._posture, self._own_posture = command[0].copy(), False
        self._model.forward_into(command[0], self._last)
        self._jacobian = self._model.jacobian(command[0]).copy()
        twist = np.zeros(6)
        for column, velocity in zip(self._jacobian.T, command[1], strict=True):  # to the last bit
            twist += column * velocity
        self._interpolator.begin(self._last, twist)
        self._limiter.begin(self._last, twist)
        self._targets.begin(self._last)
        self._move = None

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        pose, wrench, twist = (setpoint[name].copy() for name in ("pose", "wrench", "twist"))
        if not _is_pose(pose, wrench, twist):
            return Intervention.NOT_FINITE
        self._wrench = wrench
        if pose_jumps(pose, self._last, interval_s, *self._fastest(interval_s)):
            return Intervention.JUMP
        states_twist = bool(setpoint["feed_forward"]) and not self._targets.stands(pose)
        self._last = pose
        self._targets.update(pose, states_twist and bool(twist.any()))
        self._interpolator.aim(pose, twist if states_twist else None, self._command_s)
        return None

    def press(self, wrench: Array) -> None:
        if np.isfinite(wrench).all():
            self._wrench = wrench.copy()

    def start_move(self, pose: Array, duration_s: float) -> Intervention | None:
        if not _is_pose(pose, self._wrench, self._wrench) or not np.isfinite(duration_s):
            return Intervention.NOT_FINITE
        if self._move is None or not np.array_equal(pose, self._goal):
            self._goal = pose.copy()
            duration_s = max(duration_s, self._shortest_move_s(pose))
            self._move = MinJerkMove(self._limiter.pose, pose, duration_s, self._period_s)
            self._targets.chart.open()
        return None

    def cancel_move(self) -> None:
        self._move = None
        self._targets.begin(self._last)

    def advance(self, external_effort: Array, wrench: Array) -> None:
        if np.abs(self.reference[0] - self._commanded).max() > LEAD_RAD:
            self.reference[1:] = 0.0
            return
        self._step_joints(self._next_pose(external_effort, wrench), wrench)

    def follow(self, command: Array) -> None:
        self._commanded = command[0].copy()

    def _fastest(self, interval_s: float) -> tuple[float, float]:
        """m/s and rad/s, of what the specification and the joints' velocity limits let the TCP do."""
        reach = np.abs(self._jacobian) @ self._limits.max_velocity
        slack = 1.0 + SLACK_S / clamped_interval(interval_s)
        linear, angular = np.linalg.norm(reach[:3]), np.linalg.norm(reach[3:])
        return min(LINEAR_VELOCITY, float(linear * slack)), min(ANGULAR_VELOCITY, float(angular * slack))

    def _shortest_move_s(self, pose: Array) -> float:
        """The largest velocity of a minimum-jerk motion of length l in time t is 15/8 l/t, its largest
        acceleration 10/√3 l/t², its jerk 60 l/t³."""
        here, within = self._limiter.pose, self._within
        length = np.linalg.norm(pose[:3] - here[:3])
        angle = np.linalg.norm(between(here[3:].tolist(), pose[3:].tolist()))
        ways = np.array([[length], [angle]]) * [1.875, 5.7735, 60.0]
        limits = np.array(
            [
                [within.max_linear_velocity, within.max_linear_acceleration, within.max_linear_jerk],
                [within.max_angular_velocity, within.max_angular_acceleration, within.max_angular_jerk],
            ]
        )
        return float(((ways / limits) ** [1.0, 1.0 / 2.0, 1.0 / 3.0]).max())

    def _next_pose(self, external_effort: Array, wrench: Array) -> Array:
        move = self._move
        followed = self._interpolator if move is None else move
        if move is None:
            self._targets.advance()
        followed.advance()
        self._limiter.step(followed.pose)
        if move is not None and move.done and not self._limiter.limited:
            self._move = None
            self._last = self._goal.copy()
            self._interpolator.begin(self._limiter.pose)
            self._targets.begin(self._goal)
        pose: Array = self._limiter.pose
        return pose

    def _step_joints(self, pose: Array, wrench: Array) -> None:
        """z + J⁺ (e - J z), with the pull z at the posture."""
        joints, period_s, limits = self.reference[0], self._period_s, self._limits
        here, error, self._jacobian = self._distance_to(pose)
        jacobian = self._jacobian
        if self._axes.any():
            error = self._with_force(here, error, wrench)
        pull = self._pull_at_posture(joints)
        step = pull + jacobian.T @ _damped(jacobian, error - jacobian @ pull)
        step /= max(1.0, (np.abs(step) / (VELOCITY_SHARE * limits.max_velocity * period_s)).max())
        target = np.clip(joints + step, limits.min_position, limits.max_position)
        velocity = (target - joints) / period_s
        self.reference[:] = target, velocity, (velocity - self._before) / period_s
        self._before = velocity

    def _pull_at_posture(self, joints: Array) -> Array:
        wanted = POSTURE_RATE_RAD_S * (self._posture - joints)
        wanted = np.clip(wanted, -POSTURE_VELOCITY_RAD_S, POSTURE_VELOCITY_RAD_S)
        return self._period_s * _filtered(self._pull, wanted, self._period_s / POSTURE_FILTER_S)

    def _distance_to(self, pose: Array) -> tuple[Array, Array, Array]:
        """Where the reference puts the TCP, how far that is from the pose, and the Jacobian there."""
        here = np.zeros(7)
        self._model.forward_into(self.reference[0], here)
        turn = between(here[3:].tolist(), pose[3:].tolist())
        error = np.concatenate([pose[:3] - here[:3], turn])
        return here, error, self._model.jacobian(self.reference[0]).copy()

    def _with_force(self, here: Array, error: Array, wrench: Array) -> Array:
        """The step, along the force axes in proportion to what is missing of the force."""
        orientation, lever, turn = self._force_frame[3:], np.zeros(3), np.zeros(9)
        if self._force_in_tcp:
            orientation = np.array(product(here[3:].tolist(), orientation.tolist()))
            lever = np.array(rotated(here[3:].tolist(), self._force_frame[:3].tolist()))
        mujoco.mju_quat2Mat(turn, orientation)
        axes = turn.reshape(3, 3)  # of the force frame in the base frame: the columns
        force, moment = wrench.reshape(2, 3)
        met = np.array([force, moment - cross(lever, force)]) @ axes
        missing = self._wrench + met.ravel()  # the TCP exerts the opposite of what it meets
        velocity = np.clip(self._force_gain * missing, -self._force_velocity, self._force_velocity)
        smooth = _filtered(self._force_pull, velocity, self._period_s / FORCE_FILTER_S)
        linear, angular = error.reshape(2, 3)
        in_frame = np.array([linear - cross(lever, angular), angular]) @ axes
        in_frame = np.where(self._axes, self._period_s * smooth, in_frame.ravel()).reshape(2, 3)
        linear, angular = in_frame @ axes.T
        return np.concatenate([linear + cross(lever, angular), angular])


class ForceServo(CartesianSource):
    """Follows the pose of a servo mode's reference, and in the null space its posture."""

    def __init__(self, points: Any, *rest: Any) -> None:
        super().__init__(_Nothing(), _Nothing(), _Nothing(), *rest)
        self.points = points

    def begin(self, command: Array) -> None:
        self.points.begin(command)
        self._before_points = command[0].copy()
        super().begin(command)

    def _next_pose(self, external_effort: Array, wrench: Array) -> Array:
        pose = np.zeros(7)
        self.points.advance(external_effort, wrench)
        self._model.forward_into(self.points.reference[0], pose)
        return pose

    def _pull_at_posture(self, joints: Array) -> Array:
        """The source's own step: what of it moves the TCP is taken out again where it is not wanted."""
        self._posture = self.points.reference[0].copy()
        step: Array = self._posture - self._before_points + super()._pull_at_posture(joints)
        self._before_points = self._posture
        return step


class _Nothing:
    """No generator of poses: a `ForceServo` has its points."""

    def begin(self, *_: Array) -> None: ...


def _damped(jacobian: Array, error: Array) -> Array:
    """(J J' + damping)⁻¹ e."""
    return np.asarray(np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(6), error))


def _filtered(stages: Array, value: Array, share: float) -> Array:
    """The value through two low-pass filters, one after the other, whose stages are shape (2, n)."""
    stages[0] += share * (value - stages[0])
    stages[1] += share * (stages[0] - stages[1])
    return stages[1].copy()


def _is_pose(pose: Array, wrench: Array, twist: Array) -> bool:
    finite = np.isfinite(np.concatenate([pose, wrench, twist])).all()
    return bool(finite and abs(np.linalg.norm(pose[3:]) - 1.0) <= UNIT_TOLERANCE)
