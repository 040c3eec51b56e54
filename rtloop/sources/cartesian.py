"""Cartesian targets, made joint references: motion along some axes, force along the others."""

from __future__ import annotations

from math import cbrt, sqrt

import mujoco
import numpy as np

from cobot.ipc.layout import Interpolation, Intervention
from cobot.robot.model import RobotModel
from cobot.robot.quaternion import between, cross, rotated
from cobot.types import Array, CartesianLimits, JointLimits
from rtloop.backends import Measured
from rtloop.generators.pose_interpolation import MinJerkMove, PoseInterpolator
from rtloop.generators.pose_limiter import PoseLimiter
from rtloop.sources.target_checks import (
    ANGULAR_VELOCITY,
    LINEAR_VELOCITY,
    SLACK_S,
    cartesian_jump,
    clamped_interval,
)

FORCE_RATE_RAD_S = 5.0
"""How fast an error of the force decays where nothing gives way but the arm's own springs; slower where the
surroundings give way too. Well below what the estimate of the external wrench can follow."""
DAMPING = 1e-5
"""Of the inverse, m²: near a singularity the joints' velocity limits take over."""
POSTURE_RATE_RAD_S = 1.0
POSTURE_VELOCITY_RAD_S = 0.2
POSTURE_FILTER_S = 0.1
FORCE_FILTER_S = 0.03
"""Time constants: what pulls at the posture and what the force asks for set in through two filters, or they
would jerk the joints."""
VELOCITY_SHARE = 0.98
LEAD_RAD = 0.2
"""So far the reference may be ahead of the arm: then it waits."""
UNIT_TOLERANCE = 1e-3


class CartesianSource:
    """Poses of the TCP, interpolated, within the Cartesian limits, and followed by the joints.

    Along an axis with force control the arm moves in proportion to what is missing of the force.

    Attributes:
        reference, refusal, heading: see `Source`.
        move_running: whether a `move_to_pose` is under way.
    """

    def __init__(
        self,
        kind: Interpolation,
        model: RobotModel,
        limits: JointLimits,
        within: CartesianLimits,
        period_s: float,
        command_s: float,
        wish: np.ndarray,
    ) -> None:
        dof = limits.dof
        self._model = model
        self._limits = limits
        self._within = within
        self._period_s = period_s
        self._command_s = command_s
        self._interpolator = PoseInterpolator(
            kind,
            period_s,
            within.max_linear_velocity,
            within.max_linear_acceleration,
            within.max_linear_jerk,
            within.max_angular_velocity,
            within.max_angular_acceleration,
            within.max_angular_jerk,
        )
        self._limiter = PoseLimiter(period_s, within)
        self._move: MinJerkMove | None = None
        self._goal = np.zeros(7)
        self._last = np.zeros(7)
        self._wrench = np.zeros(6)
        self._axes = wish["force_axes"] > 0.0
        self._force_control = bool(self._axes.any())
        self._force_velocity = wish["force_velocity"].copy()
        stiffness = wish["cartesian_stiffness"]
        self._force_gain = FORCE_RATE_RAD_S / np.repeat([stiffness[:3].max(), stiffness[3:].max()], 3)
        self._force_in_tcp = bool(wish["force_in_tcp"])
        self._force_origin = wish["force_frame"][:3].tolist()
        self._force_turn = wish["force_frame"][3:].copy()
        self._turn = np.zeros((3, 3))  # of the force frame in the base frame: its axes are the columns
        mujoco.mju_quat2Mat(self._turn.ravel(), self._force_turn)
        self._lever = (0.0, 0.0, 0.0)  # from the TCP to the force frame's origin
        self._quaternion = np.zeros(4)
        self._rows = np.zeros((2, 3))
        self._own_posture = not np.isfinite(wish["posture"]).all()
        self._posture = wish["posture"].copy()
        self._largest_step = VELOCITY_SHARE * limits.max_velocity * period_s
        self._error = np.zeros(6)
        self._here = np.zeros(7)
        self._jacobian = np.zeros((6, dof))  # where the reference was a cycle ago
        self._damping = DAMPING * np.eye(6)
        self._square = np.zeros((6, 6))
        self._before = np.zeros(dof)
        self._pull = np.zeros((2, dof))
        self._force_pull = np.zeros((2, 6))
        self._commanded = np.zeros(dof)
        self.reference = np.zeros((3, dof))
        self.refusal = ""

    @property
    def heading(self) -> Array:
        """Computed when it is asked for: only a stream that was held because of a collision needs it."""
        error, jacobian = self._distance_to(self._last if self._move is None else self._goal)
        step: Array = jacobian.T @ self._solved(jacobian, error)
        return step

    @property
    def move_running(self) -> bool:
        return self._move is not None

    def begin(self, command: Array) -> None:
        np.copyto(self.reference, command)
        np.copyto(self._commanded, command[0])
        np.copyto(self._before, command[1])
        self._pull[:] = self._force_pull[:] = 0.0
        if self._own_posture:
            np.copyto(self._posture, command[0])
            self._own_posture = False
        self._model.forward_into(command[0], self._last)
        self._jacobian[:] = self._model.jacobian(command[0])
        twist = self._jacobian @ command[1]
        self._interpolator.begin(self._last, twist)
        self._limiter.begin(self._last, twist)
        self._move = None

    def take(self, setpoint: np.ndarray, interval_s: float) -> Intervention | None:
        pose, wrench = setpoint["pose"], setpoint["wrench"]
        twist = setpoint["twist"] if setpoint["feed_forward"] else None
        self.refusal = _flaw(pose, wrench, setpoint["twist"])
        if self.refusal:
            return Intervention.NOT_FINITE
        np.copyto(self._wrench, wrench)
        self.refusal = cartesian_jump(pose, self._last, interval_s, *self._fastest(interval_s))
        if self.refusal:
            return Intervention.JUMP
        np.copyto(self._last, pose)
        self._interpolator.aim(pose, twist, self._command_s)
        return None

    def _fastest(self, interval_s: float) -> tuple[float, float]:
        """Of what the specification and the joints' own velocity limits let the TCP do, m/s and rad/s; the
        latter with the slack that a sender's jitter is granted.
        """
        columns = np.abs(self._jacobian) @ self._limits.max_velocity
        slack = 1.0 + SLACK_S / clamped_interval(interval_s)
        linear, angular = np.linalg.norm(columns[:3]), np.linalg.norm(columns[3:])
        return min(LINEAR_VELOCITY, float(linear) * slack), min(ANGULAR_VELOCITY, float(angular) * slack)

    def start_move(self, pose: Array, duration_s: float) -> Intervention | None:
        """Go to a pose by a minimum-jerk motion; one that is under way to the same pose goes on."""
        self.refusal = _flaw(pose, self._wrench, self._wrench)
        if self.refusal or not np.isfinite(duration_s):
            return Intervention.NOT_FINITE
        if self._move is None or not np.array_equal(pose, self._goal):
            np.copyto(self._goal, pose)
            duration_s = max(duration_s, self._shortest_move_s(pose))
            self._move = MinJerkMove(self._limiter.pose, pose, duration_s, self._period_s)
        return None

    def cancel_move(self) -> None:
        """Forget the move; where the arm goes next is for the next target to say."""
        self._move = None

    def advance(self, measured: Measured) -> None:
        if float(np.abs(self.reference[0] - self._commanded).max()) > LEAD_RAD:
            self.reference[1:] = 0.0
            return
        if self._move is not None:
            self._follow_move(self._move)
        else:
            self._interpolator.advance()
            self._limiter.step(self._interpolator.pose)
        self._step_joints(measured)

    def follow(self, command: Array) -> None:
        np.copyto(self._commanded, command[0])

    def _shortest_move_s(self, pose: Array) -> float:
        """In which the limits hold: the largest velocity of a minimum-jerk motion of length l in time t is
        15/8 l/t, its largest acceleration 10/√3 l/t², its jerk 60 l/t³.
        """
        here, within = self._limiter.pose, self._within
        length = float(np.linalg.norm(pose[:3] - here[:3]))
        angle = float(np.linalg.norm(between(here[3:].tolist(), pose[3:].tolist())))
        return max(
            1.875 * length / within.max_linear_velocity,
            sqrt(5.7735 * length / within.max_linear_acceleration),
            cbrt(60.0 * length / within.max_linear_jerk),
            1.875 * angle / within.max_angular_velocity,
            sqrt(5.7735 * angle / within.max_angular_acceleration),
            cbrt(60.0 * angle / within.max_angular_jerk),
        )

    def _follow_move(self, move: MinJerkMove) -> None:
        move.advance()
        self._limiter.step(move.pose)
        if move.done and not self._limiter.limited:
            self._move = None
            np.copyto(self._last, self._goal)
            self._interpolator.begin(self._limiter.pose)

    def _step_joints(self, measured: Measured) -> None:
        """The joint step that closes the distance to the pose, in the least squares sense, with the posture
        pulled at in the null space: z + J⁺ (e - J z).
        """
        joints, period_s = self.reference[0], self._period_s
        error, jacobian = self._distance_to(self._limiter.pose)
        np.copyto(self._jacobian, jacobian)
        if self._force_control:
            self._replace_by_force(error, measured.wrench)
        pull = self._pull_at_posture(joints)
        error -= jacobian @ pull
        step = pull + jacobian.T @ self._solved(jacobian, error)
        excess = float((np.abs(step) / self._largest_step).max())
        if excess > 1.0:
            step /= excess
        target = np.clip(joints + step, self._limits.min_position, self._limits.max_position)
        np.subtract(target, joints, out=step)
        step /= period_s
        np.subtract(step, self._before, out=self.reference[2])
        self.reference[2] /= period_s
        np.copyto(self._before, step)
        np.copyto(self.reference[1], step)
        np.copyto(joints, target)

    def _pull_at_posture(self, joints: Array) -> Array:
        """The joint step that the null space may have, rad."""
        wanted = POSTURE_RATE_RAD_S * (self._posture - joints)
        np.clip(wanted, -POSTURE_VELOCITY_RAD_S, POSTURE_VELOCITY_RAD_S, out=wanted)
        return self._period_s * _filtered(self._pull, wanted, self._period_s / POSTURE_FILTER_S)

    def _distance_to(self, pose: Array) -> tuple[Array, Array]:
        """From where the reference puts the TCP, in the base frame: m, rad; and the Jacobian there."""
        here = self._here
        self._model.forward_into(self.reference[0], here)
        np.subtract(pose[:3], here[:3], out=self._error[:3])
        self._error[3:] = between(here[3:].tolist(), pose[3:].tolist())
        return self._error, self._model.present_jacobian()

    def _replace_by_force(self, error: Array, wrench: Array) -> None:
        """Along the force axes, a step in proportion to what is missing of the force."""
        turn, rows = self._turn, self._rows
        if self._force_in_tcp:
            mujoco.mju_mulQuat(self._quaternion, self._here[3:], self._force_turn)
            mujoco.mju_quat2Mat(turn.ravel(), self._quaternion)
            self._lever = rotated(self._here[3:].tolist(), self._force_origin)
        np.copyto(rows, wrench.reshape(2, 3))
        rows[1] -= cross(self._lever, rows[0].tolist())
        missing = self._wrench + (rows @ turn).ravel()  # the TCP exerts the opposite of what it meets
        velocity = np.minimum(
            np.maximum(self._force_gain * missing, -self._force_velocity), self._force_velocity
        )
        smooth = _filtered(self._force_pull, velocity, self._period_s / FORCE_FILTER_S)
        np.copyto(rows, error.reshape(2, 3))
        rows[0] -= cross(self._lever, rows[1].tolist())
        in_frame = rows @ turn
        np.multiply(smooth, self._period_s, out=in_frame.ravel(), where=self._axes)
        np.dot(in_frame, turn.T, out=rows)
        rows[0] += cross(self._lever, rows[1].tolist())
        np.copyto(error, rows.ravel())

    def _solved(self, jacobian: Array, error: Array) -> Array:
        """(J J' + damping)⁻¹ e, in place: MuJoCo's Cholesky takes a tenth of numpy's time on six rows."""
        np.dot(jacobian, jacobian.T, out=self._square)
        self._square += self._damping
        mujoco.mju_cholFactor(self._square, 0.0)
        mujoco.mju_cholSolve(error, self._square, error)
        return error


def _filtered(stages: Array, value: Array, share: float) -> Array:
    """The value through two low-pass filters, one after the other, whose stages are shape (2, n)."""
    stages[0] += share * (value - stages[0])
    stages[1] += share * (stages[0] - stages[1])
    smooth: Array = stages[1]
    return smooth


def _flaw(pose: Array, wrench: Array, twist: Array) -> str:
    if not (np.isfinite(pose).all() and np.isfinite(wrench).all() and np.isfinite(twist).all()):
        return "a streamed pose, wrench or velocity is not finite"
    norm = float(np.linalg.norm(pose[3:]))
    return "" if abs(norm - 1.0) <= UNIT_TOLERANCE else f"the streamed quaternion's norm is {norm:.4f}, not 1"
