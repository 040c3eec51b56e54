"""`python -m benchmarks stress`: random requests of every planner on five arms, each answer judged anew.

A motion is judged by `judge`: limits on true extrema, C2, rest, steps, distances, efforts, the end, the path
of the TCP, constraints. A refusal has to be an error of cobot's own, with a reason; a share of them is looked
at again by an exhaustive search, see `second_search`.
"""

from __future__ import annotations

import argparse
import sys
import time
import traceback
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from benchmarks.arms import NAMES, SHIPPED, Arm, arm
from benchmarks.stress import shape
from benchmarks.stress.cases import CORRIDOR_RAD, KINDS, Case, case
from benchmarks.stress.judge import END_M, Judge
from benchmarks.stress.second_search import confirmed
from cobot.errors import CobotError, InputError
from cobot.motions.planners import Way
from cobot.motions.requests import MotionRequest
from cobot.planners import plan, plan_waypoints
from cobot.planners.blending.joined import joined, leg_of
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits, Pose

MANY, FEW = 10_000, 200
SEED = 1
ALLOWANCE = 2e-4
"""Of constraints, rad or m."""


@dataclass(slots=True)
class Tally:
    """The results of one planner on one arm. `missed`: requests that were rejected, although a search has
    found a motion.
    """

    asked: int = 0
    planned: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    confirmed: int = 0
    looked_at: int = 0
    missed: list[str] = field(default_factory=list)
    wrong: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        reasons = ", ".join(f"{count} {reason}" for reason, count in self.refused.most_common())
        return (
            f"{self.asked} | {self.planned} | {reasons} | {self.confirmed} of {self.looked_at} | "
            f"{len(self.missed)} | {len(self.wrong)} |"
        )


def main(words: Sequence[str]) -> int:
    """Print the table. Each request with a wrong or missed motion is also printed to stderr as soon as it is
    found, with its number. Returns 1 if a motion is wrong.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks stress", description=__doc__)
    parser.add_argument("--quick", action="store_true", help=f"{FEW} requests on each arm, not {MANY}")
    parser.add_argument("--requests", type=int, help="so many on each arm")
    parser.add_argument("--first", type=int, default=0, help="the number of the first one")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--arm", choices=NAMES, action="append", help=f"all without; {SHIPPED} is shipped")
    parser.add_argument("--planner", choices=KINDS, action="append", help="all of them without")
    parser.add_argument("--confirm", type=float, default=0.2, help="so many of the refusals are searched")
    parser.add_argument("--minutes", type=float, default=np.inf, help="of each arm; then it ends")
    given = parser.parse_args(words)
    count = given.requests or (FEW if given.quick else MANY)
    print("| Arm | Planner | Asked | Planned | Refused | Confirmed | Missed | Wrong |")
    print("|---|---|---|---|---|---|---|---|", flush=True)
    wrong = 0
    for name in given.arm or NAMES:
        tallies = {kind: Tally() for kind in given.planner or KINDS}
        end_s = time.monotonic() + 60.0 * given.minutes
        for number in range(given.first, given.first + count):
            kind = KINDS[number % len(KINDS)]
            if time.monotonic() > end_s:
                print(f"{name}: ended before request {number}", file=sys.stderr)
                break
            if kind in tallies:
                one(arm(name), case(arm(name), number, given.seed), tallies[kind], given.confirm)
        for kind, tally in tallies.items():
            print(f"| {name} | {kind} | {tally}", flush=True)
            wrong += len(tally.wrong)
    return int(wrong > 0)


def one(arm: Arm, case: Case, tally: Tally, share: float) -> None:
    """Make the request, and judge the answer."""
    judge = Judge(arm, case.robot)
    tally.asked += 1
    known = len(tally.missed), len(tally.wrong)
    try:
        flaws = list(_flaws(judge, case))
    except CobotError as exc:
        tally.refused[exc.code] += 1
        random = np.random.default_rng([case.number, 7])
        if type(exc) is InputError or not str(exc).strip():  # each request is one that may be asked
            tally.wrong.append(f"{case.number} {case.kind}: no reason: {exc.code}: {exc}")
        if random.random() < share:
            answer = confirmed(judge, case, exc, random)
            tally.looked_at += answer is not None
            tally.confirmed += answer is True
            if answer is False:
                tally.missed.append(f"{case.number} {case.kind} missed: {exc.code}: {exc}")
    except Exception:  # noqa: BLE001  a crash of a planner is what is looked for
        trace = traceback.format_exc().strip().splitlines()
        tally.wrong.append(f"{case.number} {case.kind} crashed: {' / '.join(trace[-3:])}")
    else:
        tally.planned += 1
        tally.wrong += [f"{case.number} {case.kind} wrong: {flaw}" for flaw in flaws]
    for line in (*tally.missed[known[0] :], *tally.wrong[known[1] :]):
        print(f"{arm.name} {line}", file=sys.stderr, flush=True)


def _flaws(judge: Judge, case: Case) -> Iterator[str]:
    if case.timed is not None:
        return _timed_flaws(judge, case)
    if case.kind == "joined":
        return _joined_flaws(judge, case)
    motion = plan(case.robot, case.requests[0])
    return _motion_flaws(judge, case.requests[0], motion)


def _motion_flaws(judge: Judge, request: MotionRequest, motion: Trajectory | None) -> Iterator[str]:
    robot = judge.robot
    if motion is None:
        yield from _end_flaws(judge, request.goal, request.start, 1e-5)
        return
    if np.abs(motion.start - request.start).max() > 1e-9:
        yield "start: it begins elsewhere"
    limits = request.scaled_limits(robot)
    yield from judge.flaws(motion, limits.including(request.start))
    if request.arc is None or request.arc.angle_rad is None:
        yield from _end_flaws(judge, request.goal, motion.end, END_M)
    rows = motion.sample(np.linspace(0.0, motion.duration_s, 400))
    if request.traits.way is Way.PATH:
        scaled = robot.cartesian_limits.scaled(request.scaling.speed, 1.0, 1.0)
        asked = request.tcp_speed.linear_m_s or np.inf
        scaled = replace(scaled, max_linear_velocity=min(scaled.max_linear_velocity, asked))
        yield from judge.tcp_flaws(motion, scaled)
        yield from shape.flaws(judge, request, rows)
    if request.constraints is not None:
        broken = judge.broken(request.constraints, rows, request.start)
        if broken > ALLOWANCE:
            yield f"constraints: broken by {broken:.3g}"


def _end_flaws(judge: Judge, goal: Array | Pose, end: Array, tolerance: float) -> Iterator[str]:
    off = judge.off(end, goal) if isinstance(goal, Pose) else float(np.abs(end - goal).max())
    if off > tolerance:
        yield f"end: {off:.3g} beside the goal"


def _joined_flaws(judge: Judge, case: Case) -> Iterator[str]:
    robot, start, legs = judge.robot, case.requests[0].start, []
    for request in case.requests:
        asked = replace(request, start=start)
        motion = plan(robot, asked)
        if motion is None:
            return
        yield from (f"leg {len(legs) + 1}: {flaw}" for flaw in _motion_flaws(judge, asked, motion))
        legs.append(leg_of(robot, asked, motion))
        start = motion.end
    whole = joined(robot, legs, case.radii_m)
    limits = legs[0].limits
    rates = ("max_velocity", "max_acceleration", "max_jerk")
    most = {name: np.max([getattr(leg.limits, name) for leg in legs], axis=0) for name in rates}
    yield from judge.flaws(whole.trajectory, replace(limits, **most))
    yield from _leg_flaws(whole.trajectory, [0.0, *whole.ends_s], [leg.limits for leg in legs])
    for leg, begin, end in zip(legs, [0.0, *whole.ends_s], whole.ends_s, strict=False):
        if leg.constraints is not None:
            rows = whole.trajectory.sample(np.linspace(begin, end, 200))
            if judge.broken(leg.constraints, rows, leg.motion.start) > ALLOWANCE:
                yield "constraints: broken in a corner"
    yield from _end_flaws(judge, legs[-1].motion.end, whole.trajectory.end, 1e-9)
    if whole.trajectory.duration_s > sum(leg.motion.duration_s for leg in legs) * (1.0 + 1e-6):
        yield "joined: takes longer than with stops"
    rows = whole.trajectory.sample(np.linspace(0.0, whole.trajectory.duration_s, 600))
    beside = [leg.motion.sample(np.linspace(0.0, leg.motion.duration_s, 600)) for leg in legs]
    yield from shape.beside_corners(judge, rows, beside, case.radii_m)


def _leg_flaws(motion: Trajectory, ends_s: Sequence[float], limits: Sequence[JointLimits]) -> Iterator[str]:
    """Yield violations of each leg's velocity limits, away from the corners."""
    for begin, end, of_leg in zip(ends_s, ends_s[1:], limits, strict=False):
        rates = np.abs(motion.sample(np.linspace(begin, end, 60)[1:-1], 1)).max(axis=0)
        if (rates > of_leg.max_velocity * (1.0 + 1e-6)).any():
            yield f"limit: a leg is {(rates / of_leg.max_velocity).max():.4g} times as fast as it may be"


def _timed_flaws(judge: Judge, case: Case) -> Iterator[str]:
    request = case.timed
    assert request is not None
    motion = plan_waypoints(case.robot, request)
    yield from judge.flaws(motion, judge.robot.limits.including(request.start), 1e-6)
    points = np.array([point.positions for point in request.points])
    if np.abs(motion.end - points[-1]).max() > 1e-9:
        yield f"end: {np.abs(motion.end - points[-1]).max():.3g} rad beside the last point"
    asked_s = request.points[-1].time_from_start_s
    if motion.duration_s > 1.05 * asked_s + 1e-9 and not request.retime:
        yield f"timed: {motion.duration_s:.3f} s of {asked_s:.3f} s, and nobody was asked"
    rows = motion.sample(np.linspace(0.0, motion.duration_s, 4000))
    step = np.abs(np.diff(rows, axis=0)).max()
    for index, point in enumerate(points[1:], start=1):
        beside = float(np.abs(rows - point).max(axis=1).min())
        if beside > CORRIDOR_RAD + 1e-4 + step:
            yield f"timed: {beside:.3g} rad beside points[{index}]"
            return
