"""The stages of force motions: approach, hold, follow, search, insert, release.

A stage is a generator. It receives samples of the measurements and yields the commanded pose and force. It
returns when it has reached its goal, and raises `NotMet` if a limit is reached first. Stages do not depend on
sessions or clocks, so tests can run them with any model of a contact.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass, replace

import numpy as np

from app.services.streaming.search_patterns import Search, SearchOffset, raster, spiral, tilt
from cobot.motions.force_bodies import InsertMotion, SearchMotion
from cobot.pose import Pose
from cobot.robot.quaternion import exp
from cobot.types import Array

CONTACT_SHARE = 0.5
"""Share of the commanded force above which the TCP is considered to be in contact."""
MIN_CONTACT_N = 1.0
FREE_SHARE = 0.1
"""Share of the commanded force up to which the TCP is considered to be free again."""
LET_GO_S = 1.0
RETRACT_S = 20.0
AT_REST_S = 0.5
"""Time without progress after which a push is complete, s."""
AT_REST_M = 2e-4
GIVE_WAY_PER_S = 5.0
"""Gain with which forces and torques across the push are reduced during an insertion, 1/s."""
GETTING_UP_S, SLOWEST = 0.3, 0.1
"""Time in which a search accelerates to full speed, s, and its speed at the start and in corners, as a share
of full speed.
"""
SETTLING_S = 1.0
"""Maximum time that a search waits for the force before it begins to move, s."""


@dataclass(frozen=True, slots=True)
class ForceSample:
    """A sample of the measurements.

    Attributes:
        step_s: time since the last sample, without pauses, s.
        pose: TCP pose in the base frame.
        force_n: force of the TCP in the pushing direction, N.
    """

    step_s: float
    pose: Pose
    force_n: float


@dataclass(frozen=True, slots=True)
class Aim:
    """The commanded TCP pose, which applies across the push direction, and the commanded force along it, N. A
    negative force pulls.
    """

    pose: Pose
    force_n: float


@dataclass(frozen=True, slots=True)
class Push:
    """A push from a pose along an axis.

    Attributes:
        start: TCP pose at the beginning of the motion.
        axis: unit vector of the push in the base frame at the start, shape (3,).
        force_n: commanded force, N.
        approach_n: commanded force that moves the free TCP at the approach speed, N.
        max_distance_m: maximum distance along the axis, m.
    """

    start: Pose
    axis: Array
    force_n: float
    approach_n: float
    max_distance_m: float

    @property
    def contact_n(self) -> float:
        """Force above which the TCP is considered to be in contact, N."""
        return max(CONTACT_SHARE * self.force_n, MIN_CONTACT_N)

    def distance_m(self, pose: Pose) -> float:
        """Return the distance of a pose from the start, measured along the axis, m."""
        return float((pose.position - self.start.position) @ self.axis)

    def beside(self, position: Array) -> Array:
        """Return a position, projected along the axis onto the plane of the start, shape (3,)."""
        moved: Array = position - float((position - self.start.position) @ self.axis) * self.axis
        return moved

    def shifted(self, offset: SearchOffset) -> Pose:
        """Return the start pose, displaced and tilted across the push direction."""
        x, y = across(self.axis, self.start.rotation)
        lean = Pose.from_numbers((0.0, 0.0, 0.0, *exp((offset.rx * x + offset.ry * y).tolist())))
        turned = (lean @ replace(self.start, position=np.zeros(3))).quaternion
        return Pose(self.start.position + offset.x * x + offset.y * y, turned)


class NotMet(Exception):
    """Raised if a limit is reached before the requested end.

    Attributes:
        by: the word for the limit.
    """

    def __init__(self, by: str, sentence: str) -> None:
        super().__init__(sentence)
        self.by = by


Stage = Generator[Aim, ForceSample, ForceSample]


def across(axis: Array, rotation: Array) -> tuple[Array, Array]:
    """Return two unit vectors perpendicular to an axis. The first is as close as possible to the tool's x
    axis or, if that is along the axis, to its y axis.
    """
    tool = rotation[:, 0] if abs(rotation[:, 0] @ axis) < 0.9 else rotation[:, 1]
    x = tool - (tool @ axis) * axis
    x /= np.linalg.norm(x)
    return x, np.cross(axis, x)


def approach(push: Push) -> Stage:
    """Push until the TCP touches something."""
    while True:
        sample = yield Aim(push.start, push.approach_n)
        if sample.force_n >= push.contact_n:
            return sample
        if push.distance_m(sample.pose) > push.max_distance_m:
            raise NotMet(
                "max_distance",
                f"there is no contact within {push.max_distance_m:g} m: the TCP has felt "
                f"{max(sample.force_n, 0.0):.1f} N, but a contact begins at {push.contact_n:g} N",
            )


def hold(push: Push, duration_s: float, felt: Callable[[float], None]) -> Stage:
    """Hold the force for a given time.

    Args:
        felt: called with each measured force, N.
    """
    left_s = duration_s
    while True:
        sample = yield Aim(push.start, push.force_n)
        felt(sample.force_n)
        left_s -= sample.step_s
        if left_s <= 0.0:
            return sample
        _require_near(push, sample)


def follow(
    push: Push,
    touched: ForceSample,
    path: Callable[[float], Pose],
    duration_s: float,
    max_deviation_m: float,
    felt: Callable[[float], None],
) -> Stage:
    """Move along a path while holding the force.

    Args:
        touched: the sample at the first contact.
        path: function that returns the TCP pose at a time along the path, s.
        felt: function that is called with each measured force, N.
    """
    in_tool = push.start.rotation.T @ push.axis
    touched_m = push.distance_m(touched.pose)
    path_s = 0.0
    while True:
        pose = path(path_s)
        sample = yield Aim(pose, push.force_n)
        felt(sample.force_n)
        off = float((sample.pose.position - pose.position) @ (pose.rotation @ in_tool)) - touched_m
        if abs(off) > max_deviation_m:
            raise NotMet(
                "max_deviation",
                f"after {path_s:.2f} s of the path, the TCP is {1e3 * off:.1f} mm away from it in the "
                f"pushing direction, allowed: {1e3 * max_deviation_m:g} mm",
            )
        if path_s >= duration_s:
            return sample
        path_s = min(path_s + sample.step_s, duration_s)


def pattern_of(body: SearchMotion) -> Search:
    """Return the search pattern of a request."""
    if body.pattern == "tilt":
        return tilt(body.angle)
    return (spiral if body.pattern == "spiral" else raster)(body.radius, body.pitch)


def search(
    push: Push,
    touched: ForceSample,
    body: SearchMotion,
    input_holds: Callable[[], bool],
    found: Callable[[str], None],
) -> Stage:
    """Move along a pattern in contact until the TCP drops, reaches the target, or `input_holds` returns true.

    The drop is measured from the position of the TCP under the full force, because a soft surface yields.

    Args:
        input_holds: function that returns whether the condition on the input is met.
        found: function that is called with the cause of the end, as a word.
    """
    pattern, way_m = pattern_of(body), 0.0
    start_m, settling_s = push.distance_m(touched.pose), SETTLING_S
    target = None if body.target is None else np.array([body.target.x, body.target.y, body.target.z])
    while True:
        offset = pattern.offset(way_m)
        if offset is None:
            raise NotMet("pattern_end", f"the {body.pattern} has ended, but nothing was found")
        sample = yield Aim(push.shifted(offset), push.force_n)
        # A force above the commanded one has pressed the TCP into the surface, which is not a hole.
        most_n = push.contact_n if settling_s > 0.0 else push.force_n
        if push.distance_m(sample.pose) - start_m >= body.drop and sample.force_n <= most_n:
            found("drop")
            return sample
        if target is not None and np.linalg.norm(sample.pose.position - target) <= body.tolerance:
            found("target")
            return sample
        if input_holds():
            found("input")
            return sample
        _require_near(push, sample)
        if settling_s > 0.0:
            settling_s = 0.0 if sample.force_n >= push.force_n else settling_s - sample.step_s
            if settling_s <= 0.0 and sample.force_n >= push.contact_n:
                start_m = push.distance_m(sample.pose)
            continue
        share = np.sqrt(2.0 * pattern.room_m(way_m) / (GETTING_UP_S * body.search_speed))
        way_m += body.search_speed * float(np.clip(share, SLOWEST, 1.0)) * sample.step_s


def insert(push: Push, touched: ForceSample, found: ForceSample, body: InsertMotion) -> Stage:
    """Push at the position where the search has ended, until the depth is reached.

    The commanded pose yields to the walls, so that a peg at a slightly wrong position or angle does not jam.
    """
    touched_m = push.distance_m(touched.pose)
    first = aim = Pose(push.beside(found.pose.position), push.start.quaternion)
    farthest_m, rested_s = push.distance_m(found.pose), 0.0
    while True:
        sample = yield Aim(aim, push.force_n)
        here_m = push.distance_m(sample.pose)
        if here_m - touched_m >= body.depth:
            return sample
        _require_near(push, sample)
        aim = _given_way(push, first, aim, sample, body)
        rested_s += sample.step_s
        if here_m > farthest_m + AT_REST_M:
            farthest_m, rested_s = here_m, 0.0
        if rested_s >= AT_REST_S and sample.force_n >= push.contact_n:
            raise NotMet(
                "force",
                f"the TCP has stopped {1e3 * (here_m - touched_m):.1f} mm beyond the contact at "
                f"{sample.force_n:.1f} N; the requested depth is {1e3 * body.depth:g} mm",
            )


def _given_way(push: Push, first: Pose, aim: Pose, sample: ForceSample, body: InsertMotion) -> Pose:
    """Return the commanded pose, moved towards the measured pose, but no further than `radius` and `angle`
    from the first pose.
    """
    share = 1.0 - np.exp(-GIVE_WAY_PER_S * sample.step_s)
    position = aim.position + share * (push.beside(sample.pose.position) - aim.position)
    way = position - first.position
    position = first.position + way * min(1.0, body.radius / max(float(np.linalg.norm(way)), 1e-12))
    measured = sample.pose.quaternion * (1.0 if sample.pose.quaternion @ aim.quaternion > 0.0 else -1.0)
    quaternion = aim.quaternion + share * (measured - aim.quaternion)
    quaternion /= np.linalg.norm(quaternion)
    turned = 2.0 * np.arccos(min(abs(float(quaternion @ first.quaternion)), 1.0))
    return Pose(position, quaternion if turned <= body.angle else aim.quaternion)


def let_go(push: Push, last: ForceSample, aim: Aim, retract_m: float) -> Stage:
    """Reduce the force to 0, then move back by `retract_m`."""
    pulls = retract_m > 0.0
    most_s = RETRACT_S if pulls else LET_GO_S
    begun_m, left_s = push.distance_m(last.pose), most_s
    while True:
        sample = yield Aim(aim.pose, -push.approach_n if pulls else 0.0)
        left_s -= sample.step_s
        if pulls and begun_m - push.distance_m(sample.pose) >= retract_m:
            return sample
        if not pulls and abs(sample.force_n) <= FREE_SHARE * push.force_n:
            return sample
        if left_s <= 0.0:
            what = f"back {1e3 * retract_m:g} mm" if pulls else "without force"
            raise NotMet("let_go", f"the TCP is not {what} after {most_s:g} s")


def _require_near(push: Push, sample: ForceSample) -> None:
    """Check that the TCP has not moved further than allowed. Raises NotMet if it has."""
    if push.distance_m(sample.pose) > push.max_distance_m:
        raise NotMet(
            "max_distance",
            f"the TCP has moved {push.max_distance_m:g} m in the pushing direction, which is the maximum",
        )
