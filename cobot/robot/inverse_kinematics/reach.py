"""The smallest distance of the TCP from an unreachable pose, and the reason."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from cobot.errors import UnreachableError
from cobot.findings import Finding
from cobot.types import FREE_AXES, Array, FreeAxis, Pose

if TYPE_CHECKING:
    from cobot.robot.model import RobotModel

STEPS = 60
MIN_GAP_M = 1e-6
"""A pose that is beyond the reach by less than this is not reported as out of reach."""
DESCENTS = 100
"""Number of descents of `seems_reachable`. Half of them found each of 555 reachable poses of an FR3."""
NEAR_STARTS, NEAR_STEPS = 12, 300
"""Number of random starts, and number of steps, of the descents towards an unreachable pose."""
FIRST_STEPS, KEPT = 40, 3
"""Number of steps after which most of these descents end, and number of the best ones, which continue."""
TURN_RAD = 2.0 * np.pi
NEAR_M, NEAR_RAD = 5e-5, float(np.radians(0.01))
"""Tolerance for an arm that cannot move its TCP in all six directions: within it, the arm is considered to be
at the pose.
"""
POSE_DOF = 6
ROUNDING = 1e-6
"""Values below this, mm or degrees, are reported as 0."""
NUMBERS = ("no", "one", "two", "three", "four", "five")


@dataclass(frozen=True, slots=True)
class Descent:
    """The end of a descent: a solution, or the point nearest to the pose that the descent reached (m,
    rad).
    """

    joints: Array
    solved: bool
    distance_m: float
    angle_rad: float


@dataclass(frozen=True, slots=True)
class Cause:
    """The reason why no joint angles reach a pose.

    Attributes:
        says: the reason as a clause of a sentence.
        finding: the same reason as numbers; None if there are no numbers.
    """

    says: str
    finding: Finding | None = None


def row_of(pose: Pose) -> Array:
    """The pose as one row: x, y, z (m) and w, x, y, z, shape (7,)."""
    return np.concatenate([pose.position, pose.quaternion])


def reach_gap(model: RobotModel, pose: Pose, free: tuple[FreeAxis, ...] = ()) -> float:
    """A lower bound for the distance of a pose from the arm's reach, m, if the TCP must keep the pose's
    orientation. It is 0 if the pose is within reach. Joint limits that do not bound the reach are ignored.
    """
    return model.kinematics(free).gap(row_of(pose))


def seems_reachable(model: RobotModel, pose: Pose, free: tuple[FreeAxis, ...] = ()) -> bool:
    """Whether one of a few descents reaches a pose. This takes a fraction of the time that `inverse` needs to
    find that there is no solution. Always true for arms that have a closed form or are not redundant.
    """
    arm, limits = model.kinematics(free), model.limits
    if arm.closed_form or not arm.redundant:
        return True
    within = limits.min_position, limits.max_position
    starts = np.random.default_rng(0).uniform(*within, (DESCENTS, limits.dof))
    return len(arm.descend_all(row_of(pose), starts, STEPS, within)) > 0


def solve_near(
    model: RobotModel, pose: Pose, seed: Array, steps: int = STEPS, free: tuple[FreeAxis, ...] = ()
) -> Descent:
    """Descend from `seed` to a solution, in at most `steps` steps. Along a path, successive solutions are
    continuous.
    """
    return Descent(*model.kinematics(free).descend(row_of(pose), seed, steps))


def nearest_to(
    model: RobotModel, pose: Pose, seed: Array, random_seed: int = 0, free: tuple[FreeAxis, ...] = ()
) -> Descent:
    """Find the smallest distance of the TCP from an unreachable pose. It is the best result of several
    descents, one of which starts from the seed.
    """
    random, limits = np.random.default_rng(random_seed), model.limits
    starts = random.uniform(limits.min_position, limits.max_position, (NEAR_STARTS, limits.dof))
    descend, row = model.kinematics(free).descend, row_of(pose)
    ends = [Descent(*descend(row, start, FIRST_STEPS, True)) for start in (seed, *starts)]
    best = sorted(ends, key=_remaining)[:KEPT]
    ends = [Descent(*descend(row, end.joints, NEAR_STEPS - FIRST_STEPS, True)) for end in best]
    return min(ends, key=_remaining)


def _remaining(end: Descent) -> float:
    return end.distance_m + end.angle_rad


def freed(
    model: RobotModel, pose: Pose, seed: Array, free: tuple[FreeAxis, ...] = ()
) -> tuple[FreeAxis, ...] | None:
    """The rotations of the TCP that must be free so that the arm reaches a pose. If freeing one rotation is
    enough, only one is returned, preferably the one about z, the usual axis of tools. None if the arm can
    move its TCP in every direction, or if no free rotation helps.
    """
    if not model.inverse_kinematics.lacking:
        return None
    return next((more for more in freer(free) if nearest_to(model, pose, seed, free=more).solved), None)


def freer(free: tuple[FreeAxis, ...]) -> Iterator[tuple[FreeAxis, ...]]:
    """Supersets of the free rotations to try. If `free` is empty, each single rotation comes first, starting
    with z. All three together come last.
    """
    if not free:
        yield from ((axis,) for axis in reversed(FREE_AXES))
    if len(free) < len(FREE_AXES):
        yield FREE_AXES


def cause_of(
    model: RobotModel, pose: Pose, near: Array, free: tuple[FreeAxis, ...] = (), share: float = 1.0
) -> Cause:
    """The reason why no joint angles reach a pose. `near` is the result of the descent that came nearest to
    the pose.

    Args:
        share: position of the pose in a motion.
    """
    gap = model.kinematics(free).gap(row_of(pose))
    if gap > MIN_GAP_M:
        finding = Finding("reach", "distance beyond the reach", float(gap), 0.0, "m", share)
        return Cause(f"it is out of reach by {gap:.3g} m", finding)
    return (
        _limit(model, pose, near, free, share)
        or _missing_joint(model, pose, near, free)
        or Cause("no joint angles within the limits reach it")
    )


def _limit(
    model: RobotModel, pose: Pose, near: Array, free: tuple[FreeAxis, ...], share: float
) -> Cause | None:
    """The joint that would have to go beyond its limit to reach the pose."""
    limits = model.limits
    slides = np.array(limits.slides or (False,) * limits.dof)
    more = np.where(slides, limits.max_position - limits.min_position, TURN_RAD)
    within = limits.min_position - more, limits.max_position + more
    joints, solved, _, _ = model.kinematics(free).descend(
        row_of(pose), near, NEAR_STEPS, patient=True, within=within
    )
    beyond = np.maximum(limits.min_position - joints, joints - limits.max_position)
    if not solved or beyond.max() <= 0.0:
        return None
    joint = int(beyond.argmax())
    value, name, unit = float(joints[joint]), limits.names[joint], limits.unit(joint)
    limit = float(limits.min_position[joint] if value < near[joint] else limits.max_position[joint])
    return Cause(
        f"{name} would have to go to {value:.6g} {unit}, but its limit is {limit:.6g} {unit}",
        Finding("limit", "position", value, limit, unit, share, (name,)),
    )


def _missing_joint(model: RobotModel, pose: Pose, near: Array, free: tuple[FreeAxis, ...]) -> Cause | None:
    """A sentence about the motion that an arm with too few joints cannot make."""
    if not model.inverse_kinematics.lacking:
        return None
    dof = model.limits.dof
    few = "it has no joint for it"
    if dof < POSE_DOF:
        few = f"it has {NUMBERS[dof]} joint{'s' if dof > 1 else ''}"
    axes = freed(model, pose, near, free)
    if axes is None:
        return Cause(f"this arm cannot reach this position in any orientation: {few}")
    named = ", ".join(f'"{axis}"' for axis in axes)
    if len(axes) > 1:
        return Cause(
            f"this arm cannot turn its tool into this orientation there: {few}; with free_axes [{named}] "
            "only the position matters"
        )
    axis = axes[0].removeprefix("r")
    return Cause(
        f"this arm cannot turn its tool about the tool's {axis} axis to this angle there: {few}; with "
        f"free_axes [{named}] this angle is free"
    )


def out_of_reach(
    model: RobotModel, pose: Pose, seed: Array, random_seed: int, free: tuple[FreeAxis, ...] = ()
) -> UnreachableError:
    """The error for a pose that no joint angles reach. It reports the reason and the smallest distance of the
    TCP.
    """
    x, y, z = pose.position
    nearest = nearest_to(model, pose, seed, random_seed, free)
    cause = cause_of(model, pose, nearest.joints, free)
    findings = [
        *([] if cause.finding is None else [cause.finding]),
        *missing(model, nearest.distance_m, nearest.angle_rad, "goal", 1.0),
    ]
    near = f"gets as near as {apart(nearest.distance_m, nearest.angle_rad)}{allowed(model)}"
    is_far = cause.finding is not None and cause.finding.check == "reach"
    why = f"{cause.says}, and {near}" if is_far else f"{cause.says}; within the joints' limits it {near}"
    return UnreachableError(
        f"the TCP cannot reach x {x:.6g}, y {y:.6g}, z {z:.6g} m in this orientation: {why}",
        findings=findings,
    )


def missing(
    model: RobotModel, distance_m: float, angle_rad: float, to: str, share: float, of: tuple[str, ...] = ()
) -> list[Finding]:
    """Findings that report how far the TCP is from the goal or the path."""
    most_m, most_rad = (NEAR_M, NEAR_RAD) if model.inverse_kinematics.lacking else (0.0, 0.0)
    return [
        Finding("reach", f"distance to the {to}", float(distance_m), most_m, "m", share, of),
        Finding("reach", f"angle to the {to}", float(angle_rad), most_rad, "rad", share, of),
    ]


def allowed(model: RobotModel) -> str:
    """The end of a message, which gives the tolerance of an arm with fewer than six joints; "" for other
    arms.
    """
    if not model.inverse_kinematics.lacking:
        return ""
    return f", allowed: {1e3 * NEAR_M:g} mm and {np.degrees(NEAR_RAD):g} degrees"


def apart(distance_m: float, angle_rad: float) -> str:
    """A distance and an angle in words, with as many digits as they need."""
    return f"{_digits(1e3 * distance_m)} mm and {_digits(float(np.degrees(angle_rad)))} degrees"


def _digits(value: float) -> str:
    """Three significant digits without an exponent; 0 if the value is only rounding."""
    if value >= 1000.0 or value < ROUNDING:
        return f"{value:.0f}"
    return np.format_float_positional(value, precision=3, fractional=False, trim="-")
