"""Inverse kinematics: the share of reachable poses that are solved, and the CPU time for each pose.

The peers, TRAC-IK and ssik, are the extra `bench`; without them the rows say so.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import mujoco
import numpy as np

from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.errors import UnreachableError
from cobot.robot.description import load_robot
from cobot.robot.inverse_kinematics import inverse
from cobot.robot.model import RobotModel
from cobot.ros.urdf import urdf
from cobot.types import Array, JointLimits, Pose

COLUMNS = ("solved, %", "mean, ms", "p99, ms")
OWN_TOLERANCE, PEER_TOLERANCE = 1e-9, 1e-6
"""What counts as solved, m and rad."""
Solver = Callable[[Pose, Array], Array | None]
X, Y, Z = np.eye(3)


def inverse_kinematics(poses: int) -> Iterator[Row]:
    """Measure the shipped arm and four others. The seeds are random and far from the solution."""
    iiwa = load_robot(load_settings(None)).model
    name = "inverse kinematics of the iiwa, 1e-9"
    rows, seeds = _postures(iiwa, poses, singular=False)
    ours = _measured(iiwa, _own(iiwa), rows, seeds, OWN_TOLERANCE)
    for peer, solver in (("TRAC-IK, 1e-6", _trac_ik(iiwa)), ("ssik, 1e-6", _ssik(iiwa))):
        yield _row(name, iiwa, ours, peer, solver, rows, seeds)
    rows, seeds = _postures(iiwa, poses, singular=True)
    ours = _measured(iiwa, _own(iiwa), rows, seeds, OWN_TOLERANCE)
    name += ", joints at limits and at singularities"  # some of which ssik takes minutes for
    yield _row(name, iiwa, ours, "TRAC-IK, 1e-6", _trac_ik(iiwa), rows, seeds)
    for kind, model in _others():
        rows, seeds = _postures(model, poses // 2, singular=False)
        ours = _measured(model, _own(model), rows, seeds, OWN_TOLERANCE)
        yield _row(
            f"inverse kinematics of {kind}, 1e-9", model, ours, "TRAC-IK, 1e-6", _trac_ik(model), rows, seeds
        )


def _row(
    name: str,
    model: RobotModel,
    ours: tuple[float, float, float],
    peer: str,
    solver: Solver | None,
    rows: Array,
    seeds: Array,
) -> Row:
    theirs = (np.nan,) * 3
    if solver is None:
        peer = f"{peer}, not installed"
    else:
        theirs = _measured(model, solver, rows, seeds, PEER_TOLERANCE)
    return row(name, "", ours, peer, theirs, columns=COLUMNS, ratio_of="mean, ms")


def _measured(
    model: RobotModel, solver: Solver, rows: Array, seeds: Array, tolerance: float
) -> tuple[float, float, float]:
    """The share of solved poses, and the mean and the p99 of the CPU time of all threads."""
    solved, times_ms = 0, []
    solver(model.forward(rows[0]), seeds[0])  # what is loaded or made at the first call
    for joints, seed in zip(rows, seeds, strict=True):
        pose = model.forward(joints)
        begun_ns = time.process_time_ns()
        found = solver(pose, seed)
        times_ms.append((time.process_time_ns() - begun_ns) / 1e6)
        solved += found is not None and _off(model, found, pose) < tolerance
    return 100.0 * solved / len(rows), float(np.mean(times_ms)), float(np.percentile(times_ms, 99.0))


def _off(model: RobotModel, joints: Array, pose: Pose) -> float:
    """The deviation, m or rad; infinite if a joint is beyond its limits."""
    limits = model.limits
    if (joints < limits.min_position - 1e-9).any() or (joints > limits.max_position + 1e-9).any():
        return np.inf
    found = model.forward(joints)
    turn = 2.0 * np.linalg.norm(
        np.outer(found.quaternion, found.quaternion) @ pose.quaternion - pose.quaternion
    )
    return float(max(np.linalg.norm(found.position - pose.position), turn))


def _postures(model: RobotModel, count: int, singular: bool) -> tuple[Array, Array]:
    """Joint positions and seeds, shape (count, dof) each. If requested, some joints are at their limits or at
    zero.
    """
    random, limits = np.random.default_rng(11), model.limits
    rows, seeds = random.uniform(limits.min_position, limits.max_position, (2, count, limits.dof))
    if singular:
        places = np.stack(
            [limits.min_position, limits.max_position, np.zeros(limits.dof), np.full(limits.dof, 1e-7)]
        )
        chosen = random.random(rows.shape) < random.random((count, 1))
        drawn = places[random.integers(len(places), size=rows.shape), np.arange(limits.dof)]
        rows = np.where(chosen, drawn, rows)
    return rows, seeds


def _own(model: RobotModel) -> Solver:
    def solve(pose: Pose, seed: Array) -> Array | None:
        try:
            return inverse(model, pose, seed)
        except UnreachableError:
            return None

    return solve


def _trac_ik(model: RobotModel) -> Solver | None:
    try:
        from trac_ik import TracIK
    except ImportError:
        return None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "arm.urdf")
        file.write_text(urdf(model.mj, model.limits, model.tcp_site))
        base = "base_link"
        solver = TracIK(base, model.mj.site(model.tcp_site).name, str(file), timeout=0.02, epsilon=1e-7)
    turn = np.empty(9)

    def solve(pose: Pose, seed: Array) -> Array | None:
        mujoco.mju_quat2Mat(turn, pose.quaternion)
        found = solver.ik(pose.position, turn.reshape(3, 3), seed)
        return None if found is None else np.asarray(found)

    return solve


def _ssik(model: RobotModel) -> Solver | None:
    """ssik's built-in iiwa 14. It has its own limits, and a fixed part between its flange and cobot's
    flange.
    """
    try:
        from ssik.prebuilt import iiwa14_ik
    except ImportError:
        return None
    joints = np.full(model.dof, 0.3)
    position, turn, _ = model.forward_and_jacobian(joints)
    ours = np.eye(4)
    ours[:3, :3], ours[:3, 3] = turn, position
    between = np.linalg.inv(ours) @ iiwa14_ik.fk(joints)
    target, matrix = np.eye(4), np.empty(9)

    def solve(pose: Pose, seed: Array) -> Array | None:
        mujoco.mju_quat2Mat(matrix, pose.quaternion)
        target[:3, :3], target[:3, 3] = matrix.reshape(3, 3), pose.position
        found = iiwa14_ik.solve(target @ between, max_solutions=1, q_seed=seed)
        return np.asarray(found[0].q) if found else None

    return solve


def _others() -> Iterator[tuple[str, RobotModel]]:
    """Arms that are defined by their axes at rest and by points on these axes, m."""
    random = np.random.default_rng(5)
    ur5e = [(0, 0, 0), (0, 0, 0.1625), (-0.425, 0, 0.1625), (-0.8172, 0, 0.1625)]
    ur5e += [(-0.8172, -0.1333, 0.1625), (-0.8172, -0.1333, 0.0628)]
    yield "a UR5e", _arm([Z, -Y, -Y, -Y, -Z, -Y], ur5e)
    wrist = (1.5, 0.0, 1.95)
    large = [(0, 0, 0), (0.35, 0, 0.8), (0.35, 0, 2.0), wrist, wrist, wrist]
    yield "an arm with a spherical wrist", _arm([Z, Y, Y, X, Y, X], large)
    for dof in (6, 7):
        axes = random.normal(size=(dof, 3))
        yield f"{dof} axes anywhere", _arm(axes, np.cumsum(random.uniform(-0.3, 0.3, (dof, 3)), axis=0))


def _arm(axes: list[Array] | Array, points: list[tuple[float, float, float]] | Array) -> RobotModel:
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    parent, before = spec.worldbody.add_body(name="base_link"), np.zeros(3)
    for index, (axis, point) in enumerate(zip(axes, np.asarray(points, dtype=float), strict=True)):
        parent = parent.add_body(name=f"link{index}", pos=point - before)
        parent.add_joint(name=f"joint{index}", axis=axis, range=[-2.9, 2.9], limited=True)
        parent.add_geom(size=[0.01, 0.0, 0.0])
        before = point
    parent.add_site(name="tcp", pos=[0.05, 0.02, 0.1])
    ones = np.ones(len(axes))
    names = tuple(f"joint{index}" for index in range(len(axes)))
    limits = JointLimits(names, -2.9 * ones, 2.9 * ones, ones, ones, ones, ones)
    return RobotModel(spec.compile(), limits, "base_link", "tcp")
