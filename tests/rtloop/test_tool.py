"""A tool on the flange, in the real cycle and the simulation, stepped in robot time.

Oracles: pinocchio, in which the tool is a body of its own; MuJoCo's sensor at the flange, and Newton.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest
from flange_tools import LOAD, TILTED, loaded
from independent_models import MJCF, second_robot
from rig import Rig

from cobot.config import Settings
from cobot.ipc.layout import Command, Stream
from cobot.ipc.tool_record import fill
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, LoopMode, PlannerName, Scaling

SETTLED_CYCLES = 300
HOLDS_NM = 0.5
"""The drives hold the arm with gravity's torques but for what dry friction takes over."""


@pytest.fixture
def own(robot: RobotDescription) -> RobotDescription:
    """A robot of this test's own: what it carries is nobody else's."""
    return replace(robot, model=RobotModel.load(MJCF, robot.limits))


@pytest.fixture
def rig(settings: Settings, own: RobotDescription) -> Iterator[Rig]:
    made = Rig(settings, own, simulated=True)
    made.step(SETTLED_CYCLES)
    yield made
    made.close()


def have(rig: Rig, tool: Tool, **wild: Any) -> str:
    """Have rtloop carry it, and wait until a thread has read its shapes; "" or why not."""
    fill(rig.memory.tool.data, tool, tool)
    for name, value in wild.items():
        rig.memory.tool.data[name] = value
    rig.memory.tool.publish()
    said = rig.answer(rig.send(Command.TOOL, tool=tool.version))
    rig.step()
    rig.await_surroundings()
    return said


def state(rig: Rig) -> Any:
    assert rig.memory.state.try_read()
    return rig.memory.state.data


def gravity(tool: Tool, joints: Array) -> Array:
    return loaded(tool).gravity(joints)


def test_the_arm_holds_the_load_without_a_jump(rig: Rig) -> None:
    before = state(rig).copy()
    assert before["effort"] == pytest.approx(second_robot().gravity(before["position"]), abs=HOLDS_NM)
    commanded = len(rig.commanded)
    assert have(rig, LOAD) == ""
    moved = 0.0
    for _ in range(SETTLED_CYCLES):
        rig.step()
        moved = max(moved, np.abs(state(rig)["position"] - before["position"]).max())
        assert rig.mode is LoopMode.HOLD
    assert np.ptp(rig.commanded[commanded - 1 :], axis=0).max() == 0.0
    assert moved < 1e-6
    assert np.abs(state(rig)["external_effort"]).max() < 0.05  # it is no push of the surroundings
    change = state(rig)["effort"] - before["effort"]
    expected = gravity(LOAD, before["position"]) - second_robot().gravity(before["position"])
    assert change == pytest.approx(expected, abs=0.02)
    assert np.abs(expected).max() > 10.0
    assert have(rig, replace(BARE, version=5)) == ""
    rig.step(SETTLED_CYCLES)
    assert state(rig)["effort"] == pytest.approx(before["effort"], abs=0.02)


def test_the_sensor_at_the_flange_feels_the_weight(rig: Rig) -> None:
    before = state(rig)["sensor"].copy()
    load = replace(LOAD, tcp=None)
    assert have(rig, load) == ""
    rig.step(SETTLED_CYCLES)
    turn = second_robot().forward(rig.home)[1]  # of the flange, which is the TCP
    weight = turn.T @ np.array([0.0, 0.0, -9.81 * load.mass])
    change = state(rig)["sensor"] - before
    assert change[:3] == pytest.approx(weight, abs=0.05)
    assert change[3:] == pytest.approx(np.cross(load.centre, weight), abs=0.05)


def test_gravity_of_a_tilted_base_pulls_another_way(rig: Rig) -> None:
    tilted = Tool(version=1, gravity=TILTED)
    assert have(rig, tilted) == ""
    rig.step(SETTLED_CYCLES)
    assert state(rig)["effort"] == pytest.approx(gravity(tilted, rig.home), abs=HOLDS_NM)


def test_pose_flange_and_tcp_velocity_are_those_of_the_new_tcp(rig: Rig) -> None:
    assert have(rig, LOAD) == ""
    rig.step(2)
    place, _ = loaded(LOAD).forward(state(rig)["position"])
    assert state(rig)["tcp"][:3] == pytest.approx(place, abs=1e-6)
    info = rig.memory.info
    assert info.try_read()
    assert info.data["tool_version"] == LOAD.version
    assert info.data["flange"] == pytest.approx(rig.robot.model.flange_in_tcp().numbers)


def planned(rig: Rig, robot: RobotDescription) -> Trajectory:
    goal = rig.home + np.array([0.5, 0.4, -0.4, 0.5, 0.3, -0.4, 0.5])
    return plan_ptp(robot, MotionRequest(rig.home, goal, PlannerName.PTP, Scaling(0.7)), goal)


def run(rig: Rig, motion: Trajectory, version: int) -> tuple[Array, float]:
    """The largest torques of the drives, and the largest tracking error, rad."""
    rig.memory.slots[0].write(7, motion)
    assert rig.answer(rig.send(Command.START, slot=0, motion_id=7, tool=version)) == ""
    largest, error = np.zeros(7), 0.0
    while rig.loop.controller.moving:
        rig.step()
        now = state(rig)
        largest = np.maximum(largest, np.abs(now["effort"]))
        error = max(error, np.abs(now["position"] - now["commanded_position"]).max())
    return largest, error


def test_a_motion_with_the_load_is_followed_as_well_and_takes_the_torques_of_pinocchio(rig: Rig) -> None:
    assert have(rig, LOAD) == ""
    motion = planned(rig, rig.robot)
    times = np.linspace(0.0, motion.duration_s, 400)
    other = loaded(LOAD)
    rows = [
        pinocchio.rnea(other.model, other.data, *each)
        for each in zip(*(motion.sample(times, derivative) for derivative in range(3)), strict=True)
    ]
    needed = np.abs(rows).max(axis=0)
    largest, error = run(rig, motion, LOAD.version)
    assert rig.result.name == "ARRIVED"
    assert error < 2e-3
    assert largest == pytest.approx(needed, rel=0.05, abs=2.0)  # and some for friction


def test_what_was_planned_with_another_tool_is_not_started(rig: Rig) -> None:
    motion = planned(rig, rig.robot)
    assert have(rig, LOAD) == ""
    rig.memory.slots[0].write(7, motion)
    refusal = rig.answer(rig.send(Command.START, slot=0, motion_id=7))
    assert refusal == "the motion was planned with version 0 of the tool, the arm has version 4"


def test_the_tool_does_not_change_while_the_arm_moves_or_streams(rig: Rig) -> None:
    assert rig.start(planned(rig, rig.robot)) == ""
    rig.step(100)
    assert have(rig, LOAD) == "the tool changes only while the arm rests: it is in mode TRAJECTORY"
    rig.run()
    assert rig.stream(Stream.JOINT_IMPEDANCE) == ""
    assert "while the arm rests" in have(rig, LOAD)
    assert rig.robot.model.tool is BARE


@pytest.mark.parametrize(
    ("wild", "what"),
    [
        ({"mass": -1.0}, "mass: must be from 0 to 14 kg"),
        ({"mass": np.nan}, "finite"),
        ({"mass": 1e300}, "mass: must be from 0 to 14 kg"),
        ({"inertia": [0.1, 0.0, 0.0, 0.1, 0.0, 0.5]}, "is physically impossible"),
        ({"inertia": [0.1, np.nan, 0.0, 0.1, 0.0, 0.1]}, "finite"),
        ({"tcp": [0.0] * 7}, "the quaternion's length"),
        ({"gravity": [0.0, 0.0, 50.0]}, "must be the model file's 9.81"),
        ({"version": 9}, "shared memory has version 9 of the tool, not 4"),
    ],
)
def test_what_a_wild_writer_leaves_is_refused_and_nothing_changes(
    rig: Rig, wild: dict[str, Any], what: str
) -> None:
    assert what in have(rig, LOAD, **wild)
    rig.step(10)
    assert rig.mode is LoopMode.HOLD
    assert rig.robot.model.tool is BARE
    assert state(rig)["effort"] == pytest.approx(second_robot().gravity(rig.home), abs=HOLDS_NM)


def test_rtloop_begins_with_the_load(settings: Settings, own: RobotDescription, rig: Rig) -> None:
    with_load = Rig(settings, own, simulated=True)
    try:
        with_load.loop.open(with_load.home, LOAD)
        with_load.step(SETTLED_CYCLES)
        assert state(with_load)["position"] == pytest.approx(with_load.home, abs=1e-4)
        assert state(with_load)["effort"] == pytest.approx(gravity(LOAD, with_load.home), abs=HOLDS_NM)
        stiff = with_load.simulation.nominal_stiffness
        assert stiff == pytest.approx(rig.simulation.nominal_stiffness)
    finally:
        with_load.close()


def test_what_is_not_told_to_a_backend_is_in_the_model(settings: Settings, own: RobotDescription) -> None:
    rig = Rig(settings, own)
    try:
        rig.step(50)
        assert have(rig, LOAD) == ""
        assert own.model.gravity_torques(rig.home) == pytest.approx(gravity(LOAD, rig.home))
    finally:
        rig.close()
