"""Escape by the shortest path from a start that is beyond a joint limit or in collision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from cobot.errors import CollisionError
from cobot.motions.requests import MotionRequest
from cobot.planners.goals import is_there
from cobot.planners.ptp import plan_ptp
from cobot.robot.collision import Contact, motion_pieces
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import check_limits
from cobot.trajectory import Notice, Trajectory
from cobot.types import Array, PlannerName, Synchronization

SPARE_M = 1e-3
"""Distance beyond the margin at which the escape ends."""
LOOK_M = 0.03
"""During the escape, pairs of bodies that are nearer than the margin plus this distance are kept apart."""
STEPS = 40
STEP_RAD = 0.2
"""Largest joint step of the search. It is limited because distances are not linear in the joints."""
DEEPER_M = 1e-4
"""A contact may become deeper by this distance on the way, m, because distances are not linear along a
straight motion.
"""
SPREADS_RAD, DRAWS, KEPT = (0.05, 0.1, 0.2, 0.4, 0.8), 60, 4
"""Random sampling around the start: the largest joint offset of each round, the number of samples per round,
and the number of collision-free samples that are tried.
"""


def leave_invalid_start(robot: RobotDescription, request: MotionRequest) -> Trajectory | None:
    """A motion to the nearest collision-free joint angles within the limits; None if the start is valid.

    On the way, no contact becomes deeper. If that is impossible, no contact becomes deeper than the deepest
    one at the start. All other pairs keep the margin. The `note` gives the reason and the distance.

    Raises:
        CollisionError: there is no way out.
    """
    start, limits = request.start, robot.limits
    inside = np.clip(start, limits.min_position, limits.max_position)
    is_free = robot.collision.is_free(inside)
    if is_free and is_there(start, inside):
        return None
    straight = MotionRequest(
        start, request.goal, PlannerName.PTP, request.scaling, synchronization=Synchronization.PHASE
    )
    for least_m in _least(robot, start):
        for exit_joints in [inside] if is_free else exits(robot, inside):
            motion = plan_ptp(robot, straight, exit_joints)
            with robot.collision.keeping(least_m) as clearance:
                if clearance.contact(motion_pieces(motion)) is not None:
                    continue
            check_limits(motion, request.scaled_limits(robot).including(start))
            return replace(
                motion,
                note=_note(robot, start, inside, exit_joints),
                notices=(Notice("left_start", {}),),
            )
    raise _no_way_out(robot, straight, inside)


def _no_way_out(robot: RobotDescription, request: MotionRequest, inside: Array) -> CollisionError:
    contacts = robot.collision.contacts(inside)
    if contacts:
        return CollisionError(
            f"the start is in collision: {contacts[0]}, and no straight joint motion leads out of it",
            findings=[robot.collision.finding(contacts[0], 0.0)],
        )
    beyond = np.abs(inside - request.start)
    joint = int(beyond.argmax())
    unit = robot.limits.unit(joint)
    said = f"the start: {robot.limits.names[joint]} is {beyond[joint]:.4f} {unit} beyond its limit"
    try:
        robot.collision.check_trajectory(plan_ptp(robot, request, inside))
    except CollisionError as exc:
        return exc.with_message(f"{said}, and the straight way back is not free: {exc}")
    return CollisionError(f"{said}, and the straight way back is not free")


def _least(robot: RobotDescription, start: Array) -> tuple[Array, Array]:
    """Two distances for each pair of bodies: the distance that an escape aims for, and the smallest distance
    that it must keep. Each has shape (pairs,), in m.
    """
    margin_m = robot.collision.margin_m
    distances = robot.collision.clearance.distances(start[None], margin_m + LOOK_M)[0]
    kept = np.minimum(margin_m, distances - DEEPER_M)
    return kept, np.where(kept < margin_m, kept.min(initial=margin_m), kept)


def exits(robot: RobotDescription, start: Array) -> list[Array]:
    """Find collision-free joint angles within the limits, nearest first. They are found by pushing the arm
    out of collision, from `start` and from random angles around it.
    """
    wanted_m, random = robot.collision.margin_m + SPARE_M, np.random.default_rng(1)
    limits = robot.limits
    found = _pushed_out(robot, start, start, wanted_m)
    for spread_rad in SPREADS_RAD:
        draws = start + random.uniform(-spread_rad, spread_rad, (DRAWS, limits.dof))
        draws = np.clip(draws, limits.min_position, limits.max_position)
        with robot.collision.keeping(wanted_m) as clearance:
            free = draws[clearance.are_free(draws)]
        for joints in _by_distance(list(free), start)[:KEPT]:
            found += [*_pushed_out(robot, start, joints, wanted_m), joints]
    return _by_distance(found, start)


def _by_distance(found: list[Array], start: Array) -> list[Array]:
    return sorted(found, key=lambda joints: float(np.linalg.norm(joints - start)))


def _pushed_out(robot: RobotDescription, start: Array, begin: Array, wanted_m: float) -> list[Array]:
    """Search for the collision-free joint angles nearest to `start`, by successive linearisation that begins
    at `begin`. Returns a list with the result, or [] if the search fails.
    """
    limits, clearance, joints = robot.limits, robot.collision.clearance, begin
    for _ in range(STEPS):
        distances = clearance.distances(joints[None], wanted_m + LOOK_M)[0]
        if distances.min() >= wanted_m and joints is not begin:
            return [joints]
        rows, needs = [], []
        for pair in np.flatnonzero(distances < wanted_m + LOOK_M):
            distance_m, slope = clearance.gradient(joints, int(pair))
            rows.append(slope)
            needs.append(wanted_m + 1e-5 - distance_m - slope @ (start - joints))
        eye = np.eye(limits.dof)
        rows_all = np.vstack([*rows, eye, -eye])
        needs_all = np.concatenate([needs, limits.min_position - start, start - limits.max_position])
        way = _shortest(rows_all, needs_all)
        if way is None:
            return []
        step = start + way - joints
        joints = joints + step * min(1.0, STEP_RAD / max(float(np.abs(step).max()), 1e-12))
    return []


def _shortest(rows: Array, needs: Array) -> Array | None:
    """The shortest x with rows @ x >= needs; None if there is no such x.

    This is least distance programming (Lawson and Hanson, "Solving Least Squares Problems", 1974, chapter
    23).
    """
    from scipy.optimize import nnls

    matrix = np.vstack([rows.T, needs])
    right = np.zeros(len(matrix))
    right[-1] = 1.0
    try:
        weights, error = nnls(matrix, right)
    except RuntimeError:
        return None
    if error < 1e-10:
        return None
    rest = matrix @ weights - right
    return np.asarray(-rest[:-1] / rest[-1])


def _note(robot: RobotDescription, start: Array, inside: Array, exit_joints: Array) -> str:
    limits, reasons = robot.limits, []
    beyond = np.abs(inside - start)
    if beyond.max() > 0.0:
        joint = int(beyond.argmax())
        reasons.append(f"{limits.names[joint]} is {beyond[joint]:.4f} {limits.unit(joint)} beyond its limit")
    contacts: list[Contact] = robot.collision.contacts(start)
    if contacts:
        reasons.append(f"the start is in collision: {contacts[0]}")
    way = exit_joints - start
    joint = int(np.abs(way).argmax())
    return (
        f"{' and '.join(reasons)}; the motion first takes the shortest way out, "
        f"{np.linalg.norm(way):.4f} {limits.units}, {limits.names[joint]} by {way[joint]:+.4f} "
        f"{limits.unit(joint)}"
    )
