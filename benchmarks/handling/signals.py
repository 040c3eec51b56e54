"""Actions on the path, on the virtual clock.

The oracle of the planned cycle is the command itself. For one motion, numpy finds how far along the planned
trajectory the arm was commanded in each cycle. For motions that blend in the queue, pinocchio finds how long
the path of the TCP is up to each command.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from queued_actions import HOME, Queue, reached, setting
from rig import Rig
from wired_arm import WiredArm, WiredService

from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.ipc.layout import Command
from cobot.motions.requests import MotionRequest
from cobot.motions.signals import Action, PathPlace, Placed, PlacedAction
from cobot.planners import plan
from cobot.robot.description import load_robot
from cobot.trajectory import Trajectory
from cobot.types import Array, LoopMode, PlannerName, Scaling

PLACES = 25
"""Actions of a motion."""
RATES = (0.0, 0.05, 0.3, 0.7, 1.0)
RADIUS_M = 0.05
NEAR_M = 0.15
"""How far from the start of the first queued motion, or from the end of the last one, the places are: outside
of the blend, whose length only the service knows."""
RESOLUTION_M = 1e-6
"""To which two ways of measuring the length of a path agree. For a command this near to a place, its own
cycle and the next one are right."""


def actions(places: int) -> Iterator[Row]:
    """The cycles in which outputs on the path are set, for random places, speeds, overrides and pauses."""
    off: list[int] = []
    seed = 0
    while len(off) < places:
        off += _fired(seed)
        seed += 1
    yield _row("output on the path", off, "numpy: where the commanded joints reach the place")
    with tempfile.TemporaryDirectory() as folder, WiredService(Path(folder)).serving() as run:
        off, seed = [], 0
        while len(off) < places:
            off += _fired_in_the_queue(run, seed)
            seed += 1
    yield _row(
        "output on a blended path in the queue", off, "pinocchio: where the path is that long, within 1 µm"
    )


def _row(what: str, off: list[int], oracle: str) -> Row:
    wrong = np.abs(off)
    return row(
        f"{what}: cycles off the planned one, {len(off)} places",
        "cycles",
        (float(np.median(wrong)), float(np.percentile(wrong, 99)), float(wrong.max())),
        oracle,
        (0.0, 0.0, 0.0),
        columns=("median", "p99", "max"),
        aim="0",
    )


def _fired_in_the_queue(run: WiredService, seed: int) -> list[int]:
    """For each action of two random motions that blend: the error of the time at which it fired, in
    cycles.
    """
    random = np.random.default_rng(seed)
    run.go_home()
    run.arm.wire()
    turn, lift = random.choice([-1.0, 1.0]) * random.uniform(0.6, 1.0), random.uniform(0.4, 0.6)
    before = np.sort(random.uniform(0.002, NEAR_M, PLACES))
    behind = np.sort(random.uniform(0.002, NEAR_M, PLACES))[::-1]
    queue = Queue(run)
    with queue.noting():
        actions = [setting(float(n), distance_m=float(place)) for n, place in enumerate(before)]
        queue.add([turn, *HOME[1:]], RADIUS_M, actions=actions)
        actions = [
            setting(float(PLACES + n), **{"distance_m": float(place), "from": "end"})
            for n, place in enumerate(behind)
        ]
        last = queue.add([turn, lift, *HOME[2:]], actions=actions)
        queue.vary_speed(random, int(random.integers(0, 8)))
        queue.until(last)
    lengths_m = queue.lengths_m()
    assert queue.values == [float(n) for n in range(2 * PLACES)], "each fires once, in order"
    places = [*before, *(lengths_m[-1] - behind)]
    return [_off(lengths_m, cycle, place) for (_, cycle), place in zip(queue.fired, places, strict=True)]


def _off(lengths_m: Array, cycle: int, place_m: float) -> int:
    planned = reached(lengths_m, place_m)
    either = abs(cycle - planned) == 1 and abs(lengths_m[min(cycle, planned)] - place_m) < RESOLUTION_M
    return 0 if either else cycle - planned


def _fired(seed: int) -> list[int]:
    """For each action of a random motion: the error of the time at which it fired, in cycles."""
    random = np.random.default_rng(seed)
    settings = load_settings(None)
    robot = load_robot(settings)
    arm = WiredArm(robot.limits.dof)
    rig = Rig(settings, robot, backend=arm)
    try:
        goal = rig.home + random.uniform(-0.4, 0.4, robot.limits.dof)
        goal[0] = rig.home[0] + random.choice([-1.0, 1.0]) * random.uniform(0.3, 1.2)
        request = MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(float(random.uniform(0.1, 1.0))))
        motion = plan(robot, request)
        assert motion is not None
        places_s = np.sort(random.uniform(0.03, motion.duration_s - 0.03, PLACES))
        before = arm.written
        assert rig.start(motion, signals=_settings_at(places_s)) == ""
        for _ in range(int(random.integers(0, 8))):
            rig.step(int(random.integers(1, 250)))
            if rig.mode is not LoopMode.TRAJECTORY:
                break
            rig.answer(rig.send(Command.SET_RATE, value=float(random.choice(RATES))))
        rig.answer(rig.send(Command.SET_RATE, value=1.0))
        rig.run()
        commanded = np.array(rig.commanded[-(arm.written - before) :])
        expected = [_cycle(motion, commanded, place_s) for place_s in places_s]
        assert len(arm.set) == PLACES, "each fires once"
        return [each.cycle - before - cycle for each, cycle in zip(arm.set, expected, strict=True)]
    finally:
        rig.close()


def _settings_at(places_s: Array) -> Placed:
    place = PathPlace("time_s", 0.0)
    return Placed(
        tuple(
            PlacedAction(number, float(time_s), Action("", place, "pressure", float(number)))
            for number, time_s in enumerate(places_s, start=1)
        )
    )


def _cycle(motion: Trajectory, commanded: Array, place_s: float) -> int:
    """The cycle of the first command that has reached a place. Joint 1 moves in only one direction."""
    sign = np.sign(motion.end[0] - motion.start[0])
    there = motion.sample([place_s])[0, 0]
    return int(np.argmax(sign * (commanded[:, 0] - there) >= -1e-12))
