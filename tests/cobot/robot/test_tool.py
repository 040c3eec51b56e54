"""What is on the flange: mass, TCP, shapes, gravity, and the file that keeps them.

Oracles: pinocchio, in which the tool is a body of its own on the arm's last joint; MuJoCo, in which the
model's file has the tool as a body.
"""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from flange_tools import INERTIA, TCP, TOOL, loaded
from independent_models import MJCF, Pinocchio, mjcf_root
from scipy.spatial.transform import Rotation

from cobot.errors import ConfigError, InputError, LimitError
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.feasibility import effort_samples
from cobot.robot.inverse_kinematics import inverse as solve
from cobot.robot.model import RobotModel
from cobot.robot.scene import Scene, SceneObject
from cobot.robot.tool import BARE, Tool, ToolFile, check_tool
from cobot.trajectory import from_hermite
from cobot.types import Array, Pose

TOLERANCE = 1e-9
GRAVITY = np.array([0.0, 0.0, -9.81])


@pytest.fixture
def model(robot: RobotDescription) -> RobotModel:
    """One of this test's own: what it carries is nobody else's."""
    return RobotModel.load(MJCF, robot.limits)


def random_joints(robot: RobotDescription, count: int = 50) -> Array:
    return np.random.default_rng(7).uniform(robot.limits.min_position, robot.limits.max_position, (count, 7))


def check_against(model: RobotModel, other: Pinocchio, rows: Array) -> None:
    chance = np.random.default_rng(8)
    for joints in rows:
        velocity, acceleration = chance.uniform(-2.0, 2.0, (2, 7))
        assert model.gravity_torques(joints) == pytest.approx(other.gravity(joints), abs=TOLERANCE)
        assert model.mass_matrix(joints) == pytest.approx(other.mass_matrix(joints), abs=TOLERANCE)
        efforts = pinocchio.rnea(other.model, other.data, joints, velocity, acceleration)
        assert model.dynamics.inverse(joints, velocity, acceleration) == pytest.approx(efforts, abs=1e-8)
        pose, (place, turn) = model.forward(joints), other.forward(joints)
        assert pose.position == pytest.approx(place, abs=TOLERANCE)
        found = Rotation.from_quat(pose.quaternion, scalar_first=True).as_matrix()
        assert found == pytest.approx(turn, abs=TOLERANCE)
        assert model.jacobian(joints) == pytest.approx(other.jacobian(joints), abs=TOLERANCE)


def test_efforts_and_tcp_with_a_tool_are_those_of_pinocchio(
    model: RobotModel, robot: RobotDescription
) -> None:
    rows = random_joints(robot)
    for tool in (TOOL, replace(TOOL, inertia=None), replace(TOOL, tcp=None, gravity=None), Tool(mass=14.0)):
        model.carry(tool)
        check_against(model, loaded(tool), rows)
        assert model.gravity == pytest.approx(tool.gravity or GRAVITY)


def test_without_the_tool_all_is_as_before(model: RobotModel, robot: RobotDescription) -> None:
    rows = random_joints(robot, 10)
    before = [model.mass_matrix(joints) for joints in rows], model.poses(rows)
    model.carry(TOOL)
    model.carry(BARE)
    assert np.array_equal([model.mass_matrix(joints) for joints in rows], before[0])
    assert np.array_equal(model.poses(rows), before[1])
    check_against(model, loaded(BARE), rows)


def test_all_that_the_simulation_computes_is_as_if_the_file_had_the_tool(
    model: RobotModel, tmp_path: Path
) -> None:
    root = mjcf_root()
    link = next(body for body in root.iter("body") if body.find("site") is not None)
    # MuJoCo's fullinertia is xx, yy, zz, xy, xz, yz.
    xx, xy, xz, yy, yz, zz = INERTIA
    hand = ET.SubElement(link, "body", name="hand", pos="0 0 0.045")
    words = {"mass": "10", "pos": "0.02 -0.05 0.12", "fullinertia": f"{xx} {yy} {zz} {xy} {xz} {yz}"}
    ET.SubElement(hand, "inertial", words)
    file = tmp_path / "with_hand.xml"
    file.write_bytes(ET.tostring(root))
    other = mujoco.MjModel.from_xml_path(str(file))
    model.carry(replace(TOOL, gravity=None))
    ours, theirs = mujoco.MjData(model.mj), mujoco.MjData(other)
    chance = np.random.default_rng(3)
    for _ in range(20):
        ours.qpos[:] = theirs.qpos[:] = chance.uniform(-2.0, 2.0, 7)
        ours.qvel[:] = theirs.qvel[:] = chance.uniform(-1.0, 1.0, 7)
        ours.ctrl[:] = theirs.ctrl[:] = chance.uniform(-50.0, 50.0, 7)
        mujoco.mj_forward(model.mj, ours)
        mujoco.mj_forward(other, theirs)
        assert ours.qfrc_bias == pytest.approx(theirs.qfrc_bias, abs=TOLERANCE)
        assert ours.qacc == pytest.approx(theirs.qacc, rel=1e-6, abs=1e-6)  # with dry friction's constants
        assert ours.sensordata == pytest.approx(theirs.sensordata, rel=1e-6, abs=1e-5)  # the flange's wrench
    assert model.mj.dof_invweight0 == pytest.approx(other.dof_invweight0, rel=1e-9)


def test_inverse_kinematics_is_that_of_the_new_tcp(model: RobotModel, robot: RobotDescription) -> None:
    assert solve(model, model.forward(np.zeros(7)), np.zeros(7)) is not None  # with the TCP before
    model.carry(TOOL)
    other = loaded(TOOL)
    for joints in 0.8 * random_joints(robot, 10):
        place, turn = other.forward(joints)
        goal = Pose(place, Rotation.from_matrix(turn).as_quat(scalar_first=True))
        found = other.forward(solve(model, goal, joints))
        assert found[0] == pytest.approx(place, abs=1e-7)
        assert found[1] == pytest.approx(turn, abs=1e-7)


def test_the_efforts_of_a_motion_are_those_with_the_tool_of_now(model: RobotModel) -> None:
    # They are kept from one look to the next.
    rows = np.array([np.zeros(7), np.full(7, 0.4)])
    motion = from_hermite(np.array([0.0, 1.0]), rows, 0.0 * rows, 0.0 * rows)
    model.carry(BARE)
    bare = effort_samples(model, motion)[1]
    model.carry(TOOL)
    loaded_efforts = effort_samples(model, motion)[1]
    assert np.abs(loaded_efforts - bare).max() > 1.0
    assert effort_samples(model, replace(motion, note="the same motion"))[1] is loaded_efforts


def test_the_flange_stays_where_it_is(model: RobotModel, robot: RobotDescription) -> None:
    model.carry(TOOL)
    for joints in random_joints(robot, 5):
        pose = model.forward(joints)
        flange = pose @ model.flange_in_tcp()
        assert flange.position == pytest.approx(Pinocchio().forward(joints)[0], abs=TOLERANCE)


ROD = SceneObject("box", (0.02, 0.02, 0.6), (0.0, 0.0, 0.3, 1.0, 0.0, 0.0, 0.0))
"""From the flange 0.6 m ahead."""


def test_shapes_are_where_the_flange_is_and_collide(model: RobotModel, robot: RobotDescription) -> None:
    checker = CollisionChecker(model, 0.0)
    tool = replace(TOOL, shapes={"rod": ROD})
    wall = SceneObject("box", (0.02, 4.0, 4.0), (0.9, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    model.carry(tool)
    checker.surround(Scene(1, {"wall": wall}), tool)
    other = loaded(tool)
    for joints in random_joints(robot):
        other.forward(joints)
        flange = other.data.oMi[7] * pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, 0.045]))
        corners = np.array([[x, y, z] for x in (-0.01, 0.01) for y in (-0.01, 0.01) for z in (0.0, 0.6)])
        x = (flange.rotation @ corners.T).T[:, 0] + flange.translation[0]
        through = x.max() > 0.89 and x.min() < 0.91
        found = any({each.first, each.second} == {"rod", "wall"} for each in checker.contacts(joints))
        if abs(x.max() - 0.89) > 1e-3 and abs(x.min() - 0.91) > 1e-3:
            assert found == through
    assert all(own for pair, own in enumerate(checker.are_own()) if "wall" not in checker.names(pair)
               and {"floor"}.isdisjoint(checker.names(pair)))  # fmt: skip
    assert "rod" in checker.body_names


def test_what_is_attached_moves_with_the_new_tcp(model: RobotModel, robot: RobotDescription) -> None:
    checker = CollisionChecker(model, 0.0)
    ball = SceneObject("sphere", (0.01,), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), attached=True)
    tool = replace(TOOL, gravity=None)
    model.carry(tool)
    checker.surround(Scene(1, {"ball": ball}), tool)
    mj = model.among(Scene(1, {"ball": ball}), tool)
    data = mujoco.MjData(mj)
    for joints in random_joints(robot, 5):
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        place = data.body("ball").xpos - data.body("base_link").xpos
        assert place == pytest.approx(loaded(tool).forward(joints)[0], abs=TOLERANCE)


@pytest.mark.parametrize(
    ("change", "kind", "what"),
    [
        ({"mass": -0.1}, LimitError, r"mass: must be from 0 to 14 kg \(robot.max_payload_kg\), got -0.1 kg"),
        ({"mass": 14.1}, LimitError, "mass: must be from 0 to 14 kg .*, got 14.1 kg"),
        ({"centre": (0.0, 0.0, 2.1)}, LimitError, "centre: must be at most 2 m from the flange, got 2.1 m"),
        ({"inertia": (0.1, 0.0, 0.0, 0.1, 0.0, -0.1)}, InputError, "inertia: must be positive definite"),
        ({"inertia": (0.0,) * 6}, InputError, "leave it out for a point mass"),
        ({"inertia": (0.1, 0.2, 0.0, 0.1, 0.0, 0.1)}, InputError, "its principal moments are -0.1, 0.1, 0.3"),
        ({"inertia": (0.1, 0.0, 0.0, 0.1, 0.0, 0.21)}, InputError, "exceeds the sum of the others"),
        ({"inertia": (50.0, 0.0, 0.0, 50.0, 0.0, 50.0)}, LimitError, "10 kg within 2 m have at most 40"),
        ({"mass": 0.0}, LimitError, "0 kg within 2 m have at most 0"),
        ({"tcp": (0.0,) * 7}, InputError, "tcp: the quaternion's length must be 1 within 0.001, got 0"),
        ({"tcp": (0.0, 0.0, 3.0, 1.0, 0.0, 0.0, 0.0)}, LimitError, "tcp: must be at most 2 m"),
        ({"shapes": {"rod": replace(ROD, pose=(0.0,) * 7)}}, InputError, "shapes.rod: the quaternion"),
        ({"gravity": (0.0, 0.0, -1.62)}, LimitError, "must be the model file's 9.81 m/s²"),
    ],
)
def test_what_there_cannot_be_is_refused(change: dict[str, object], kind: type[Exception], what: str) -> None:
    with pytest.raises(kind, match=what):
        check_tool(replace(Tool(mass=10.0, inertia=INERTIA), **change), 14.0, GRAVITY)  # type: ignore[arg-type]


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_what_is_no_number_is_no_tool(value: float) -> None:
    for change in ({"mass": value}, {"centre": (0.0, value, 0.0)}, {"tcp": (*TCP[:6], value)}):
        with pytest.raises(ValueError, match="finite number"):
            replace(TOOL, **change)


def test_the_file_keeps_the_tool_and_a_damaged_one_is_named(tmp_path: Path) -> None:
    file = ToolFile(tmp_path / "logs" / "arm.tool.json")
    assert file.read() is BARE
    tool = replace(TOOL, shapes={"rod": ROD})
    check_tool(tool, 14.0, GRAVITY)
    file.write(tool)
    assert file.read_checked(14.0, GRAVITY) == tool
    with pytest.raises(ConfigError, match=r"arm\.tool\.json: mass: must be from 0 to 5 kg"):
        file.read_checked(5.0, GRAVITY)
    content = json.loads(file.path.read_text(encoding="utf-8"))
    file.path.write_text(json.dumps(content | {"weight": 1}), encoding="utf-8")
    with pytest.raises(ConfigError, match=r"arm\.tool\.json: is not a tool: .*; correct it, or remove it"):
        file.read()
