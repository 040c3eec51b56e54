"""Finds what is wrong with a motion, without cobot: with pinocchio's kinematics and dynamics, MuJoCo's
distances, and numpy's polynomials.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator

import mujoco
import numpy as np
import pinocchio
from scipy.spatial.transform import Rotation

from benchmarks.arms import Arm, loaded_model
from cobot.motions.constraints import Constraints
from cobot.robot.description import RobotDescription
from cobot.trajectory import Trajectory
from cobot.types import Array, CartesianLimits, JointLimits, Pose

NEAR_M = 0.02
"""Pairs of geoms that are nearer, by MuJoCo's collision detection, have their distance measured."""
SLACK_M = 1e-4
"""By which MuJoCo's iteration may miss a distance."""
LOOKS = 200
PER_PIECE = np.linspace(0.0, 1.0, 17)
ROUNDING = 2e-9
JUMPS = (1e-8, 1e-7, 1e-5)
"""Of position, velocity and acceleration between two polynomials: rounding."""
EFFORT_SLACK, TCP_SLACK = 5e-3, 5e-3
END_M = 1e-6
POWERS = np.arange(6)


class Judge:
    """Judges the motions of one arm in one scene, with its load."""

    def __init__(self, arm: Arm, robot: RobotDescription) -> None:
        self.arm, self.robot = arm, robot
        self._data = arm.model.createData()
        self._loaded = loaded_model(arm.model, arm.tcp, robot.model.tool)
        self._loaded_data = self._loaded.createData()
        self._mj = copy.copy(robot.model.among(robot.collision.scene))
        self._state = mujoco.MjData(self._mj)
        self._mj.geom_margin[:] = NEAR_M
        self._points = np.zeros(6)

    def tcp(self, joints: Array) -> tuple[Array, Array]:
        """Position (3,) and rotation matrix of the TCP in the base frame."""
        pinocchio.framesForwardKinematics(self.arm.model, self._data, joints)
        place = self._data.oMf[self.arm.base].inverse() * self._data.oMf[self.arm.tcp]
        return place.translation.copy(), place.rotation.copy()

    def path(self, rows: Array) -> tuple[Array, Rotation]:
        """Positions and rotations of the TCP for joint samples, shape (n, dof)."""
        places = [self.tcp(joints) for joints in rows]
        return np.array([p for p, _ in places]), Rotation.from_matrix(np.array([r for _, r in places]))

    def off(self, joints: Array, pose: Pose) -> float:
        """The deviation of the TCP from a pose, m or rad, whichever is larger."""
        position, turn = self.tcp(joints)
        wanted = Rotation.from_quat(pose.quaternion, scalar_first=True)
        angle = (wanted.inv() * Rotation.from_matrix(turn)).magnitude()
        return float(max(np.linalg.norm(position - pose.position), angle))

    def jacobian(self, joints: Array) -> Array:
        """The TCP's Jacobian, shape (6, dof), in the base frame's axes. The bases of these arms are not
        rotated.
        """
        frame = pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        return np.array(
            pinocchio.computeFrameJacobian(self.arm.model, self._data, joints, self.arm.tcp, frame)
        )

    def distance(self, joints: Array) -> float:
        """The distance of the nearest pair that may collide, m; `NEAR_M` if no pair is nearer."""
        self._state.qpos[:] = joints
        mujoco.mj_kinematics(self._mj, self._state)
        mujoco.mj_collision(self._mj, self._state)
        found = NEAR_M
        for pair in {tuple(map(int, geoms)) for geoms in self._state.contact.geom[: self._state.ncon]}:
            bodies = frozenset(self._mj.body(self._mj.geom_bodyid[geom]).name for geom in pair)
            if bodies not in self.robot.collision.disabled:
                distance = mujoco.mj_geomDistance(self._mj, self._state, *pair, NEAR_M, self._points)
                found = min(found, float(distance))
        return found

    def flaws(self, motion: Trajectory, limits: JointLimits, tolerance: float = 1e-9) -> Iterator[str]:
        """Yield violations of limits at the true extrema, jumps, ends that are not at rest, collisions, and
        efforts that are too high.
        """
        yield from broken_limits(motion, limits, tolerance)
        yield from jumps(motion)
        times = np.linspace(0.0, motion.duration_s, LOOKS)
        values = [motion.sample(times, derivative) for derivative in range(3)]
        yield from self._contacts(motion, values[0])
        efforts = np.array(
            [pinocchio.rnea(self._loaded, self._loaded_data, *row) for row in zip(*values, strict=True)]
        )
        used = np.abs(efforts).max(axis=0) / limits.max_effort
        if used.max() > 1.0 + EFFORT_SLACK:
            yield f"effort: {limits.names[int(used.argmax())]} at {100 * used.max():.2f} % of its limit"

    def _contacts(self, motion: Trajectory, rows: Array) -> Iterator[str]:
        least = self.robot.collision.margin_m - 5e-4 - SLACK_M
        distances = [self.distance(joints) for joints in rows]
        if any(notice.kind == "left_start" for notice in motion.notices):
            out = next((i for i, distance in enumerate(distances) if distance >= least), len(distances))
            if out == len(distances) or min(distances[:out], default=NEAR_M) < distances[0] - 2.0 * SLACK_M:
                yield f"collision: gets deeper on the way out, {1e3 * min(distances):.2f} mm"
            distances = distances[out:]
        if min(distances, default=NEAR_M) < least:
            yield f"collision: {1e3 * min(distances):.2f} mm, sample {int(np.argmin(distances))} of {LOOKS}"

    def tcp_flaws(self, motion: Trajectory, limits: CartesianLimits) -> Iterator[str]:
        """Yield violations of the TCP's speed limits."""
        times = np.linspace(0.0, motion.duration_s, LOOKS)
        rows, rates = motion.sample(times), motion.sample(times, 1)
        twists = np.array([self.jacobian(q) @ v for q, v in zip(rows, rates, strict=True)])
        for name, part, limit in (
            ("linear", twists[:, :3], limits.max_linear_velocity),
            ("angular", twists[:, 3:], limits.max_angular_velocity),
        ):
            most = float(np.linalg.norm(part, axis=1).max())
            if most > limit * (1.0 + TCP_SLACK):
                yield f"TCP: {name} speed {most:.6g}, its limit is {limit:.6g}"

    def broken(self, constraints: Constraints, rows: Array, start: Array) -> float:
        """The largest violation of the constraints in all rows, rad or m; negative if there is none."""
        positions, turns = self.path(rows)
        worst = -np.inf
        if constraints.cone is not None:
            axes = turns.apply(constraints.cone.axis)
            direction = constraints.cone.direction
            if direction is None:
                direction = self.tcp(start)[1] @ constraints.cone.axis
            chord = np.linalg.norm(axes - direction, axis=1)
            worst = (
                float((2.0 * np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))).max()) - constraints.cone.within_rad
            )
        if constraints.box is not None:
            box = constraints.box
            worst = max(worst, float(np.maximum(box.low - positions, positions - box.high).max()))
        for joint, low, high in constraints.joints:
            worst = max(worst, float(np.maximum(low - rows[:, joint], rows[:, joint] - high).max()))
        return worst

    def solutions(self, pose: Pose, random: np.random.Generator, tries: int) -> list[Array]:
        """Joint positions within the limits that reach a pose, found by damped descents from random
        configurations.
        """
        limits, target = self.robot.limits, Rotation.from_quat(pose.quaternion, scalar_first=True)
        found = []
        for _ in range(tries):
            joints = random.uniform(limits.min_position, limits.max_position)
            for _ in range(60):
                position, turn = self.tcp(joints)
                angles = (target * Rotation.from_matrix(turn).inv()).as_rotvec()
                error = np.concatenate([pose.position - position, angles])
                if np.abs(error).max() < 1e-7:
                    found.append(joints)
                    break
                jacobian = self.jacobian(joints)
                damped = jacobian @ jacobian.T + 1e-3 * float(error @ error) * np.eye(6)
                step = jacobian.T @ np.linalg.lstsq(damped, error, rcond=None)[0]
                step *= min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-12))
                joints = np.clip(joints + step, limits.min_position, limits.max_position)
        return found


def broken_limits(motion: Trajectory, limits: JointLimits, tolerance: float = 1e-9) -> Iterator[str]:
    """Yield the violations of position, velocity, acceleration and jerk limits. Many samples are checked;
    where they are close to a limit, the exact extrema are computed.
    """
    durations, span = np.diff(motion.breakpoints_s), limits.max_position - limits.min_position
    rates = (limits.max_velocity, limits.max_acceleration, limits.max_jerk)
    bounds = [(limits.min_position, limits.max_position), *((-rate, rate) for rate in rates)]
    coefficients = motion.coefficients * durations[:, None, None] ** POWERS  # over [0, 1]
    for derivative, (low, high) in enumerate(bounds):
        if derivative:
            coefficients = coefficients[:, :, 1:] * np.arange(1, coefficients.shape[2])
            coefficients = coefficients / durations[:, None, None]
        values = coefficients @ PER_PIECE ** np.arange(coefficients.shape[2])[:, None]
        slack = (tolerance + ROUNDING) * (span if derivative == 0 else high)
        near = 0.02 * (high - low)
        close = (values.min(axis=2) < low + near) | (values.max(axis=2) > high - near)
        for piece, joint in np.argwhere(close):
            lowest, highest = _extrema(coefficients[piece, joint])
            over = max(low[joint] - lowest, highest - high[joint])
            if over > slack[joint]:
                yield (
                    f"limit: derivative {derivative} of {limits.names[joint]} from {lowest:.9g} to "
                    f"{highest:.9g}, its limits are {low[joint]:.9g} and {high[joint]:.9g}"
                )
                break


def _extrema(coefficients: Array) -> tuple[float, float]:
    """The lowest and highest value of a polynomial with ascending coefficients on [0, 1]."""
    roots = np.roots((coefficients[1:] * np.arange(1, len(coefficients)))[::-1])
    places = np.concatenate([PER_PIECE, np.clip(roots.real, 0.0, 1.0)])
    values = np.polyval(coefficients[::-1], places)
    return float(values.min()), float(values.max())


def jumps(motion: Trajectory) -> Iterator[str]:
    """Yield the jumps of position, velocity or acceleration, and the ends at which the motion is not
    at rest.
    """
    durations = np.diff(motion.breakpoints_s)
    rows = motion.coefficients
    for derivative, allowed in enumerate(JUMPS):
        starts = rows[:, :, 0]
        stops = (rows * durations[:, None, None] ** np.arange(rows.shape[2])).sum(axis=2)
        jump = np.abs(stops[:-1] - starts[1:]).max(initial=0.0)
        if jump > allowed:
            yield f"C2: derivative {derivative} jumps by {jump:.3g}"
        ends = max(np.abs(starts[0]).max(), np.abs(stops[-1]).max())
        if derivative and ends > 10.0 * allowed:
            yield f"rest: derivative {derivative} is {ends:.3g} at an end"
        rows = rows[:, :, 1:] * np.arange(1, rows.shape[2])
