"""Actions on the path, on the virtual clock.

The oracle of the planned cycle is the command itself: numpy finds how far along the planned trajectory the
arm was commanded in each cycle.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rig import Rig
from wired_arm import WiredArm

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


def actions(places: int) -> Iterator[Row]:
    """In which cycle outputs on the path are set, at random places, speeds, overrides and pauses."""
    off: list[int] = []
    seed = 0
    while len(off) < places:
        off += _fired(seed)
        seed += 1
    wrong = np.abs(off)
    yield row(
        f"output on the path: cycles off the planned one, {len(off)} places",
        "cycles",
        (float(np.median(wrong)), float(np.percentile(wrong, 99)), float(wrong.max())),
        "numpy: where the commanded joints reach the place",
        (0.0, 0.0, 0.0),
        columns=("median", "p99", "max"),
        aim="0",
    )


def _fired(seed: int) -> list[int]:
    """By how many cycles each action of a random motion was off."""
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
    """The first command that has reached a place: joint 1 moves in one direction only."""
    sign = np.sign(motion.end[0] - motion.start[0])
    there = motion.sample([place_s])[0, 0]
    return int(np.argmax(sign * (commanded[:, 0] - there) >= -1e-12))
