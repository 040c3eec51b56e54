"""Actions on the path and motion until contact, on the virtual clock.

The oracle of the planned cycle is the command itself: numpy finds how far along the planned trajectory the
arm was commanded in each cycle. The oracle of a braking distance is Ruckig's fastest stop: of each joint, or
of the path time within the joints' limits.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import ruckig
from rig import Rig
from wired_arm import WiredArm

from benchmarks.table import Row, row
from cobot.config import load_settings
from cobot.errors import InputError, PlanningError
from cobot.ipc.layout import Command
from cobot.ipc.signal_record import Met, signal_report
from cobot.motions.requests import MotionRequest, TcpSpeed
from cobot.motions.signals import Action, Condition, PathPlace, Placed, PlacedAction, Quantity, Until
from cobot.planners import plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.frames import pose_from_abc
from cobot.robot.tool import Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits, LoopMode, PlannerName, Scaling

PLACES = 25
"""Actions of a motion."""
RATES = (0.0, 0.05, 0.3, 0.7, 1.0)
SPEEDS_M_S = (0.005, 0.25)
THRESHOLD_N = 15.0
WALL_N_M = 50_000.0
DOWN = (0.55, 0.0, 0.0, 3.14159, 0.0)
"""Of an approach: x and y, m, then angles a, b, c, rad."""
PAYLOAD = Tool(1, "load", 5.0, (0.0, 0.0, 0.1))


def actions(places: int) -> Iterator[Row]:
    """In which cycle outputs on the path are set, at random places, speeds, overrides and pauses."""
    off: list[int] = []
    seed = 0
    while len(off) < places:
        off += _fired(seed)
        seed += 1
    wrong = np.abs(off)
    yield row(
        f"output on the path: cycles beside the planned one, {len(off)} places",
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


def contact(approaches: int) -> Iterator[Row]:
    """Approaches to an elastic wall: how much further than necessary the TCP is commanded."""
    for fast in (True, False):
        found = np.array([_approached(seed, fast) for seed in range(approaches)])
        excess, braking_mm, latency, missed = found.T
        name = "fast" if fast else "path"
        yield row(
            f"contact, stop {name}: beyond the shortest stop, in cycles of travel, {approaches} approaches",
            "",
            (float(np.median(excess)), float(np.percentile(excess, 99)), float(excess.max())),
            "Ruckig: the shortest stop, mm",
            (float(np.median(braking_mm)), float(np.percentile(braking_mm, 99)), float(braking_mm.max())),
            columns=("median", "p99", "max"),
            aim="1",
        )
        yield row(
            f"contact, stop {name}: cycles from the wall's {THRESHOLD_N:g} N to the reaction",
            "cycles",
            (float(np.median(latency)), float(np.percentile(latency, 99)), float(latency.max())),
            "approaches without contact",
            (float(missed.sum()),) * 3,
            columns=("median", "p99", "max"),
            aim="",
        )


def _approached(seed: int, fast: bool) -> tuple[float, float, float, float]:
    """Excess over the shortest stop in cycles of travel, that stop in mm, cycles of latency, missed."""
    random = np.random.default_rng(seed)
    settings = load_settings(None)
    robot = load_robot(settings)
    speed_m_s = float(np.exp(random.uniform(*np.log(SPEEDS_M_S))))
    wall_m = float(random.uniform(0.45, 0.55))
    motion, start = _descent(robot, wall_m, speed_m_s)
    rig = Rig(settings, robot, simulated=True, start=start)
    try:
        until = Until(Condition(Quantity.FORCE, THRESHOLD_N, direction=(0.0, 0.0, 1.0)), fast=fast)
        assert rig.start(motion, signals=Placed(until=until)) == ""
        tcp = rig.memory.state.data["tcp"]
        pushed: list[float] = []
        states: list[Array] = []
        while rig.loop.controller.moving:
            force = max(0.0, WALL_N_M * (wall_m - float(tcp[2])))
            rig.simulation.push[2] = force
            pushed.append(force)
            rig.step()
            states.append(rig.loop.controller.safety.command.copy())
        met = signal_report(rig.memory.signals.data).met
        if met is None:
            return 0.0, 0.0, 0.0, 1.0
        return _judged(rig, met, pushed, states, speed_m_s, None if fast else motion)
    finally:
        rig.close()


def _judged(
    rig: Rig,
    met: Met,
    pushed: list[float],
    states: list[Array],
    speed_m_s: float,
    path: Trajectory | None,
) -> tuple[float, float, float, float]:
    period_s, forward = rig.settings.rt.period_s, rig.robot.model.forward
    count = int(rig.memory.state.data["cycle"])
    cycle = len(states) - (count - round(met.robot_time_s / period_s)) - 1
    before = states[cycle - 1]  # the last command before the reaction
    z_before, z_end = forward(before[0]).position[2], forward(states[-1][0]).position[2]
    lowest = min(forward(state[0]).position[2] for state in states[cycle - 1 :])
    rest = _stopped(before, rig.limits) if path is None else _stopped_on(path, met.path_time_s, rig.limits)
    shortest = z_before - forward(rest).position[2]
    way = z_before - min(lowest, z_end)
    exceeded = next(n for n, force in enumerate(pushed) if force > THRESHOLD_N)
    return (way - shortest) / (speed_m_s * period_s), 1e3 * shortest, float(cycle - exceeded), 0.0


def _descent(robot: RobotDescription, wall_m: float, speed_m_s: float) -> tuple[Trajectory, Array]:
    """Straight down to 30 mm below a wall from 60 mm above it, and where it begins."""
    x, y, a, b, c = DOWN
    home = np.array(robot.positions["home"].joints)
    begin, end = (pose_from_abc(x, y, wall_m + up, a, b, c) for up in (0.06, -0.03))
    there = plan(robot, MotionRequest(home, begin, PlannerName.PTP, Scaling(1.0)))
    assert there is not None
    request = MotionRequest(
        there.end, end, PlannerName.LIN, Scaling(1.0), tcp_speed=TcpSpeed(linear_m_s=speed_m_s)
    )
    motion = plan(robot, request)
    assert motion is not None
    return motion, there.end


def _stopped(state: Array, limits: JointLimits) -> Array:
    """Where each joint rests that brakes as fast as it may, shape (dof,), rad."""
    return _rest(state, limits.max_velocity, limits.max_acceleration, limits.max_jerk)


def _stopped_on(path: Trajectory, path_time_s: float, limits: JointLimits) -> Array:
    """Where the arm rests, shape (dof,), rad, that brakes on its path at an even speed as fast as its joints
    may."""
    rates = np.abs(path.sample([path_time_s], 1)[0]) + 1e-12
    most = [np.array([(bound / rates).min()]) for bound in (limits.max_acceleration, limits.max_jerk)]
    rest_s = _rest(np.array([[path_time_s], [1.0], [0.0]]), np.array([10.0]), *most)
    return path.sample(rest_s)[0]


def _rest(state: Array, velocity: Array, acceleration: Array, jerk: Array) -> Array:
    """Ruckig's fastest stop of each axis, from position, velocity and acceleration."""
    axes = state.shape[1]
    problem = ruckig.InputParameter(axes)
    problem.control_interface = ruckig.ControlInterface.Velocity
    problem.synchronization = ruckig.Synchronization.No
    problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
    problem.max_velocity = velocity.tolist()
    problem.max_acceleration = acceleration.tolist()
    problem.max_jerk = jerk.tolist()
    problem.target_velocity = [0.0] * axes
    trajectory = ruckig.Trajectory(axes)
    ruckig.Ruckig(axes).calculate(problem, trajectory)
    end, _, _ = trajectory.at_time(trajectory.duration)
    return np.array(end)


def free_motions(motions: int) -> Iterator[Row]:
    """The forces and torques that free motions with a payload show, from those at their start on.

    The simulation's model of itself is exact, so this finds errors of ours, and none of a real arm's model.
    """
    shown, left_out = zip(*(_shown(seed) for seed in range(motions)), strict=True)
    found = np.array(shown)
    for name, unit, column, threshold in (
        ("force at the TCP", "N", 0, 20.0),
        ("torque at the TCP", "N·m", 1, 5.0),
        ("external torque on a joint", "N·m", 2, 5.0),
    ):
        values = found[:, column]
        yield row(
            f"{name} in a free motion with 5 kg at up to full speed, {motions} motions "
            f"({sum(left_out)} random goals that cannot be planned left out)",
            unit,
            (float(np.median(values)), float(np.percentile(values, 99)), float(values.max())),
            f"default threshold; {int((values > threshold).sum())} false triggers",
            (threshold,) * 3,
            columns=("median", "p99", "max"),
            aim="below 1",
        )


def _shown(seed: int) -> tuple[tuple[float, float, float], int]:
    """The most that a motion shows, and how many goals before it cannot be planned."""
    left_out = 0
    random = np.random.default_rng(seed)
    settings = load_settings(None)
    robot = load_robot(settings)
    rig = Rig(settings, robot, simulated=True)
    try:
        rig.loop.controller.tool_and_scene.carry(PAYLOAD)
        while True:
            goal = rig.home + random.uniform(-0.9, 0.9, robot.limits.dof)
            request = MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(float(random.uniform(0.1, 1.0))))
            try:
                motion = plan(robot, request)
            except (InputError, PlanningError):  # beyond a joint limit, or in collision
                left_out += 1
                continue
            break
        assert motion is not None
        rig.step(200)
        refusal = rig.start(motion, tool=PAYLOAD.version)
        assert not refusal, refusal
        state = rig.memory.state.data
        first, torques = state["wrench"].copy(), state["external_effort"].copy()
        most = np.zeros(3)
        while rig.loop.controller.moving:
            rig.step()
            wrench = state["wrench"] - first
            most = np.maximum(
                most,
                [
                    np.linalg.norm(wrench[:3]),
                    np.linalg.norm(wrench[3:]),
                    np.abs(state["external_effort"] - torques).max(),
                ],
            )
        return (float(most[0]), float(most[1]), float(most[2])), left_out
    finally:
        rig.close()
