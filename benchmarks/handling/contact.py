"""Motion until contact: how far the arm continues after a contact, and which forces a free motion appears to
have.

The oracle of a braking distance is Ruckig's fastest stop: of each joint, or of the path time within the
joints' limits, which numpy checks. The wall is a body in MuJoCo, and its oracle is MuJoCo's contact force.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from physical_cell import with_cell, write_cell
from rig import Rig
from shortest_stop import rest_of_joints, rest_on_path

from benchmarks.table import Row, row
from cobot.config import Settings, load_settings
from cobot.errors import InputError, PlanningError
from cobot.ipc.layout import MotionResult
from cobot.ipc.signal_record import Met, signal_report
from cobot.motions.requests import MotionRequest, TcpSpeed
from cobot.motions.signals import Condition, Placed, Quantity, Until
from cobot.planners import plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, PlannerName, Pose, Scaling
from rtloop.backends import Backend, make_backend
from rtloop.backends.cell import CellBackend

SPEEDS_M_S = (0.005, 0.25)
THRESHOLD_N = 15.0
PLACES_M = ((0.42, 0.62), (-0.3, 0.3), (0.35, 0.55))
"""Where the tool reaches the wall: ranges of x, y and z."""
LEAN_RAD = 0.3
"""How far the approach leans away from straight down, about x and y."""
THICKNESS_M = 0.05
BEFORE_M, BEYOND_M = 0.06, 0.03
"""Where an approach begins, and where it would end without the wall."""
PAYLOAD = Tool(1, "load", 5.0, (0.0, 0.0, 0.1))
UNDECLARED_KG = 1.0
SHOWN = (
    ("force at the TCP", "torque at the TCP", "external torque on a joint"),
    ("N", "N·m", "N·m"),
    (20.0, 5.0, 5.0),
)
"""What a motion shows, in which unit, and the default threshold of each."""


@dataclass(frozen=True)
class Stop:
    """How an approach ended.

    Attributes:
        excess: how much further than with the shortest stop the TCP was commanded, in cycles of travel; NaN
            if there is no such stop.
        shortest_mm: the way of the shortest stop.
        latency: cycles from MuJoCo's contact force above the threshold to the reaction.
        met: whether the motion ended at the contact.
    """

    excess: float = 0.0
    shortest_mm: float = 0.0
    latency: float = 0.0
    met: bool = False


def contact(approaches: int) -> Iterator[Row]:
    """Approaches to a wall in MuJoCo: how much further than necessary the commanded TCP moves."""
    for fast in (True, False):
        found = [approach(seed, fast) for seed in range(approaches)]
        stops = [stop for stop in found if stop.met]
        judged = [stop for stop in stops if not math.isnan(stop.excess)]
        name = "fast" if fast else "path"
        yield row(
            f"contact, stop {name}: beyond the shortest stop, in cycles of travel, {len(stops)} of "
            f"{approaches} approaches ended at the wall, {len(judged)} have such a stop, "
            f"{sum(stop.excess > 1.0 for stop in judged)} went on for more than one cycle's travel",
            "median / p99 / max",
            _spread([stop.excess for stop in judged]),
            f"Ruckig: the shortest stop{'' if fast else ' on the path'}, mm",
            _spread([stop.shortest_mm for stop in judged]),
            columns=("median", "p99", "max"),
            aim="≤ 1",
        )
        yield row(
            f"contact, stop {name}: cycles from the wall's {THRESHOLD_N:g} N to the reaction",
            "median / p99 / max",
            _spread([stop.latency for stop in stops]),
            "one cycle",
            (1.0,) * 3,
            columns=("median", "p99", "max"),
            aim="",
        )


def _spread(values: list[float]) -> tuple[float, float, float]:
    return float(np.median(values)), float(np.percentile(values, 99)), float(max(values))


def approach(seed: int, fast: bool) -> Stop:
    """Approach a wall straight, from a random side at a random speed, until the contact."""
    random = np.random.default_rng(seed)
    settings = load_settings(None)
    robot = load_robot(settings)
    speed_m_s = float(np.exp(random.uniform(*np.log(SPEEDS_M_S))))
    motion, start, wall = _way(robot, random, speed_m_s)
    backend = _backend(settings, robot, {"fixtures": {"wall": wall}})
    rig = Rig(settings, robot, backend=backend, start=start)
    try:
        until = Until(Condition(Quantity.FORCE, THRESHOLD_N), fast=fast)
        refusal = rig.start(motion, signals=Placed(until=until))
        assert not refusal, refusal
        pushed: list[float] = []
        commands: list[Array] = []
        while rig.loop.controller.moving:
            rig.step()
            pushed.append(_contact_force(backend))
            commands.append(rig.loop.controller.safety.command.copy())
        met = signal_report(rig.memory.signals.data).met
        if met is None or rig.result is not MotionResult.MET:
            return Stop()
        return _judged(rig, met, pushed, commands, speed_m_s, motion, fast)
    finally:
        rig.close()


def _way(
    robot: RobotDescription, random: np.random.Generator, speed_m_s: float
) -> tuple[Trajectory, Array, dict[str, object]]:
    """A straight TCP path that the arm can follow, its start, and the wall in its middle."""
    home = np.array(robot.positions["home"].joints)
    while True:
        position = np.array([random.uniform(*bounds) for bounds in PLACES_M])
        angles = np.array([np.pi, 0.0, 0.0]) + LEAN_RAD * random.uniform(-1.0, 1.0, 3)
        turned, ahead = np.zeros(4), np.zeros(3)
        mujoco.mju_euler2Quat(turned, angles, "XYZ")
        mujoco.mju_rotVecQuat(ahead, np.array([0.0, 0.0, 1.0]), turned)
        begin, end = Pose(position - BEFORE_M * ahead, turned), Pose(position + BEYOND_M * ahead, turned)
        try:
            there = plan(robot, MotionRequest(home, begin, PlannerName.PTP, Scaling(1.0)))
            assert there is not None
            motion = plan(
                robot,
                MotionRequest(
                    there.end, end, PlannerName.LIN, Scaling(1.0), tcp_speed=TcpSpeed(linear_m_s=speed_m_s)
                ),
            )
        except (InputError, PlanningError):  # out of reach, or in collision
            continue
        assert motion is not None
        wall = {
            "shape": "box",
            "size_m": [0.3, 0.3, THICKNESS_M],
            "position_m": (position + 0.5 * THICKNESS_M * ahead).tolist(),
            "rotation_deg": np.degrees(angles).tolist(),
        }
        return motion, there.end, wall


def _contact_force(backend: CellBackend) -> float:
    """The resultant force of all contacts in MuJoCo, including friction, N. Only the tool touches the
    wall.
    """
    data, force, total = backend._plant_data, np.zeros(6), np.zeros(3)
    for index in range(data.ncon):
        mujoco.mj_contactForce(backend.plant.mj, data, index, force)
        total += data.contact[index].frame.reshape(3, 3).T @ force[:3]
    return float(np.linalg.norm(total))


def _judged(
    rig: Rig,
    met: Met,
    pushed: list[float],
    commands: list[Array],
    speed_m_s: float,
    path: Trajectory,
    fast: bool,
) -> Stop:
    period_s, forward = rig.settings.rt.period_s, rig.robot.model.forward
    count = int(rig.memory.state.data["cycle"])
    cycle = len(commands) - (count - round(met.robot_time_s / period_s)) - 1
    before = commands[cycle - 1]  # the last command before the reaction
    begin = forward(path.start).position
    ahead = forward(path.end).position - begin
    ahead /= np.linalg.norm(ahead)

    def depth(joints: Array) -> float:
        return float((forward(joints).position - begin) @ ahead)

    rest = rest_of_joints(before, rig.limits) if fast else rest_on_path(path, met.path_time_s, rig.limits)
    shortest_m = math.nan if rest is None else depth(rest) - depth(before[0])
    # With `fast` the arm may give way at the end: the way counts to the furthest command.
    way_m = max(depth(command[0]) for command in commands[cycle - 1 :]) - depth(before[0])
    exceeded = next(n for n, force in enumerate(pushed) if force > THRESHOLD_N)
    excess = (way_m - shortest_m) / (speed_m_s * period_s)
    return Stop(excess, 1e3 * shortest_m, float(cycle - exceeded), True)


def free_motions(motions: int) -> Iterator[Row]:
    """The largest forces that free motions with a payload appear to have, from their start.

    The simulation's model of itself is exact, so a declared payload shows errors of ours, and none of a real
    arm's model. The payload that is not declared is a hand of the cell, of which the arm does not know.
    """
    for undeclared in (False, True):
        shown, left_out = zip(*(_shown(seed, undeclared) for seed in range(motions)), strict=True)
        load = f"{UNDECLARED_KG:g} kg, undeclared," if undeclared else f"{PAYLOAD.mass:g} kg"
        for name, unit, threshold, values in zip(*SHOWN, np.array(shown).T, strict=True):
            yield row(
                f"{name} in a free motion with {load} at up to full speed, {motions} motions "
                f"({sum(left_out)} random goals that cannot be planned left out)",
                unit,
                _spread(list(values)),
                f"default threshold; {int((values > threshold).sum())} false triggers",
                (threshold,) * 3,
                columns=("median", "p99", "max"),
                aim="below 1",
            )


def _shown(seed: int, undeclared: bool) -> tuple[tuple[float, float, float], int]:
    """The largest value that a motion shows, and the number of goals before it that could not be planned."""
    random = np.random.default_rng(seed)
    settings = load_settings(None)
    robot = load_robot(settings)
    rig = Rig(settings, robot, backend=_with_hand(settings, robot) if undeclared else None, simulated=True)
    try:
        tool = BARE if undeclared else PAYLOAD
        rig.loop.controller.tool_and_scene.carry(tool)
        motion, left_out = _free_motion(robot, rig.home, random)
        rig.step(200)
        refusal = rig.start(motion, tool=tool.version)
        assert not refusal, refusal
        state = rig.memory.state.data
        first, torques = state["wrench"].copy(), state["external_effort"].copy()
        most = np.zeros(3)
        while rig.loop.controller.moving:
            rig.step()
            wrench = state["wrench"] - first
            torque = np.abs(state["external_effort"] - torques).max()
            most = np.maximum(most, [np.linalg.norm(wrench[:3]), np.linalg.norm(wrench[3:]), torque])
        # With a payload that is not declared, the arm is a little below its goal.
        assert rig.loop.controller.clock.path_time_s == motion.duration_s, rig.reason
        return (float(most[0]), float(most[1]), float(most[2])), left_out
    finally:
        rig.close()


def _free_motion(robot: RobotDescription, home: Array, random: np.random.Generator) -> tuple[Trajectory, int]:
    """A random motion, and the number of goals before it that could not be planned."""
    left_out = 0
    while True:
        goal = home + random.uniform(-0.9, 0.9, robot.limits.dof)
        request = MotionRequest(home, goal, PlannerName.PTP, Scaling(float(random.uniform(0.1, 1.0))))
        try:
            motion = plan(robot, request)
        except (InputError, PlanningError):  # beyond a joint limit, or in collision
            left_out += 1
            continue
        assert motion is not None
        return motion, left_out


def _with_hand(settings: Settings, robot: RobotDescription) -> Backend:
    hand = {"mass_kg": UNDECLARED_KG, "palm_m": [0.05, 0.05, 0.05], "finger_m": [0.01, 0.01, 0.02]}
    return _backend(settings, robot, {"hand": hand})


def _backend(settings: Settings, robot: RobotDescription, cell: dict[str, object]) -> CellBackend:
    """The simulation with a cell that has no floor."""
    with tempfile.TemporaryDirectory() as folder:
        file = write_cell(Path(folder), {"floor_m": None, **cell})
        return make_backend(with_cell(settings, file), robot.limits)
