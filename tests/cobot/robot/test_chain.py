"""The compiled kinematics of serial arms.

Oracle: MuJoCo, for the shipped arm and for random ones; pinocchio, for random URDF files.
"""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from independent_models import MJCF
from laws import coordinates
from sample_counts import samples

from cobot.errors import ConfigError, InputError
from cobot.robot.chain import Chain
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array, JointLimits

SEEDS = range(20)
CONFIGURATIONS = samples(2500)
TOLERANCE = 1e-12


def words(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def placed(random: np.random.Generator) -> str:
    return f'pos="{words(random.uniform(-0.4, 0.4, 3))}" quat="{words(random.normal(size=4))}"'


def random_arm(seed: int, *, slide: bool = False) -> tuple[mujoco.MjModel, Array]:
    """Six or seven joints anywhere on bodies, some with two of them, some with none; a base beside the arm.

    Also whether each joint is a slide.
    """
    random = np.random.default_rng(seed)
    left, inner, outer = 6 + seed % 2, "", ""
    slides = np.zeros(left, bool)
    slides[seed % left] = slide
    total = left
    while left:
        joints = ""
        for _ in range(min(left, int(random.integers(3)))):
            kind = "slide" if slides[total - left] else "hinge"
            joints += (
                f'<joint name="j{total - left}" type="{kind}" axis="{words(random.normal(size=3))}" '
                f'pos="{words(random.uniform(-0.1, 0.1, 3))}" ref="{random.uniform(-1, 1)!r}"/>'
            )
            left -= 1
        inner += f'<body {placed(random)}>{joints}<geom size="0.01"/>'
        outer += "</body>"
    site = f'<site name="tcp" {placed(random)}/>'
    standing = f'<body {placed(random)}><body name="base_link" {placed(random)}/>'
    text = (
        f'<mujoco><compiler angle="radian"/><worldbody>{standing}</body>{inner}{site}{outer}'
        f"</worldbody></mujoco>"
    )
    return mujoco.MjModel.from_xml_string(text), slides


def by_mujoco(model: mujoco.MjModel, data: mujoco.MjData, joints: Array) -> tuple[Array, Array, Array]:
    """Position, quaternion and Jacobian of the TCP in the base frame."""
    base, site = model.body("base_link").id, model.site("tcp").id
    data.qpos[:] = joints
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    jacobian, quaternion = np.empty((6, model.nv)), np.empty(4)
    mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], site)
    turn = data.xmat[base].reshape(3, 3).T
    mujoco.mju_mat2Quat(quaternion, (turn @ data.site_xmat[site].reshape(3, 3)).ravel())
    jacobian = np.vstack([turn @ jacobian[:3], turn @ jacobian[3:]])
    return turn @ (data.site_xpos[site] - data.xpos[base]), quaternion, jacobian


def check_against_mujoco(model: mujoco.MjModel, configurations: Array) -> None:
    chain = Chain(model, model.body("base_link").id, model.site("tcp").id)
    data, turn, expected, own = mujoco.MjData(model), np.empty(9), [], []
    for joints in configurations:
        position, quaternion, jacobian = by_mujoco(model, data, joints)
        mujoco.mju_quat2Mat(turn, quaternion)
        expected.append(np.concatenate([position, quaternion, turn, jacobian.ravel()]))
        position, own_turn, jacobian = chain.solve(joints)
        own.append(np.concatenate([position, own_turn.ravel(), jacobian.ravel()]))
    poses, wanted, found = chain.poses(configurations), np.array(expected), np.array(own)
    assert abs(poses - wanted[:, :7]).max() < TOLERANCE
    assert abs(found - np.delete(wanted, slice(3, 7), axis=1)).max() < TOLERANCE


def test_the_shipped_arm_is_that_of_mujoco(robot: RobotDescription) -> None:
    random = np.random.default_rng(1)
    check_against_mujoco(robot.model.mj, random.uniform(-np.pi, np.pi, (samples(50_000), 7)))


@pytest.mark.parametrize("seed", SEEDS)
def test_random_arms_are_those_of_mujoco(seed: int) -> None:
    model, _ = random_arm(seed)
    check_against_mujoco(model, np.random.default_rng(seed).uniform(-4.0, 4.0, (CONFIGURATIONS, model.nq)))


@pytest.mark.parametrize("seed", range(4))
def test_an_arm_on_a_slide_is_that_of_mujoco(seed: int) -> None:
    model, slides = random_arm(seed, slide=True)
    assert slides.sum() == 1
    check_against_mujoco(model, np.random.default_rng(seed).uniform(-4.0, 4.0, (200, model.nq)))


def random_urdf(seed: int) -> str:
    """Links l0 to ln, joints with any axis, fixed links in between, a displaced base; no sites."""
    random = np.random.default_rng(seed)
    dof, parent, parts = 6 + seed % 2, "world_link", ['<robot name="arm"><link name="world_link"/>']

    def add(name: str, joint: str, kind: str, rest: str = "") -> None:
        nonlocal parent
        x, y = random.uniform(-0.4, 0.4, 3), random.uniform(-3.0, 3.0, 3)
        parts.append(
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" '
            f'ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="{joint}" type="{kind}">'
            f'<origin xyz="{words(x)}" rpy="{words(y)}"/><parent link="{parent}"/><child link="{name}"/>'
            f"{rest}</joint>"
        )
        parent = name

    add("base_link", "to_base", "fixed")
    for index in range(dof):
        if random.random() < 0.4:
            add(f"plate{index}", f"to_plate{index}", "fixed")
        axis = random.normal(size=3)
        add(
            f"l{index}",
            f"j{index}",
            "revolute",
            f'<axis xyz="{words(axis / np.linalg.norm(axis))}"/>'
            '<limit lower="-3" upper="3" effort="100" velocity="3"/>',
        )
    add("tcp", "to_tcp", "fixed")
    return "\n".join([*parts, "</robot>"])


@pytest.mark.parametrize("seed", SEEDS)
def test_random_urdf_arms_are_those_of_pinocchio(seed: int, tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(random_urdf(seed))
    other = pinocchio.buildModelFromXML(file.read_text())
    data, dof = other.createData(), other.nq
    ones = np.ones(dof)
    names = tuple(f"j{index}" for index in range(dof))
    limits = JointLimits(names, -3.0 * ones, 3.0 * ones, ones, ones, ones, ones)
    model = RobotModel.load(file, limits)
    tcp, base = other.getFrameId("tcp"), other.getFrameId("base_link")
    for joints in np.random.default_rng(seed).uniform(-3.0, 3.0, (200, dof)):
        pinocchio.framesForwardKinematics(other, data, joints)
        expected = data.oMf[base].inverse() * data.oMf[tcp]
        turn = data.oMf[base].rotation.T
        columns = pinocchio.computeFrameJacobian(
            other, data, joints, tcp, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        position, rotation, jacobian = model.forward_and_jacobian(joints)
        assert abs(position - expected.translation).max() < TOLERANCE
        assert abs(rotation - expected.rotation).max() < TOLERANCE
        assert abs(jacobian - np.vstack([turn @ columns[:3], turn @ columns[3:]])).max() < TOLERANCE


def test_a_tool_is_as_mujoco_has_it(robot: RobotDescription) -> None:
    model = RobotModel.load(MJCF, robot.limits)
    model.carry(Tool(tcp=(0.1, -0.2, 0.3, 0.5, 0.5, -0.5, 0.5)))
    check_against_mujoco(model.mj, np.random.default_rng(2).uniform(-3.0, 3.0, (500, 7)))


def test_poses_of_no_joints_are_none(robot: RobotDescription) -> None:
    assert robot.model.poses(np.zeros((0, 7))).shape == (0, 7)


def test_joints_of_another_number_are_refused(robot: RobotDescription) -> None:
    with pytest.raises(ValueError, match="broadcast"):
        robot.model.forward(np.zeros(6))
    with pytest.raises(ValueError, match="reshape"):
        robot.model.poses(np.zeros((2, 6)))


def test_a_joint_that_is_a_ball_is_refused() -> None:
    text = '<mujoco><worldbody><body><joint type="ball"/><geom size="1"/><site/></body></worldbody></mujoco>'
    with pytest.raises(InputError, match="neither a hinge nor a slide"):
        Chain(mujoco.MjModel.from_xml_string(text), 0, 0)


def test_more_joints_than_compiled_code_has_room_for_are_refused() -> None:
    link = '<body><joint name="j{}"/><geom size="0.1" pos="1 0 0"/>'
    inner = (
        "".join(link.format(index) for index in range(17)) + '<site name="tcp" pos="1 1 0"/>' + "</body>" * 17
    )
    text = f'<mujoco><worldbody><body name="base_link"/>{inner}</worldbody></mujoco>'
    ones = np.ones(17)
    limits = JointLimits(tuple(f"j{i}" for i in range(17)), -ones, ones, ones, ones, ones, ones)
    with pytest.raises(ConfigError, match="17 joints, allowed: up to 16"):
        RobotModel(mujoco.MjModel.from_xml_string(text), limits, "base_link", "tcp")


def test_twists_are_the_jacobian_times_the_joint_velocities(robot: RobotDescription) -> None:
    joints, rates = np.random.default_rng(3).uniform(-2.5, 2.5, (2, 500, robot.model.dof))
    expected = [robot.model.jacobian(q) @ v for q, v in zip(joints, rates, strict=True)]
    np.testing.assert_allclose(robot.model.chain.twists(joints, rates), expected, atol=TOLERANCE)


@pytest.mark.parametrize("slide", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_derivatives_of_twists_are_their_differences_along_a_path(seed: int, slide: bool) -> None:
    mj, _ = random_arm(seed, slide=slide)
    chain, dof = Chain(mj, mj.body("base_link").id, mj.site("tcp").id), mj.nv
    derivatives = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, 20, dof))
    found = chain.motions(derivatives)
    np.testing.assert_allclose(found[0], chain.twists(derivatives[0], derivatives[1]), atol=TOLERANCE)
    np.testing.assert_allclose(found, coordinates.motions(chain, derivatives), atol=1e-7, rtol=1e-7)


def test_motions_of_no_joints_are_none_and_of_another_number_are_refused(robot: RobotDescription) -> None:
    assert robot.model.chain.motions(np.zeros((4, 0, 7))).shape == (3, 0, 6)
    with pytest.raises(ValueError, match=r"not \(4, n, 7\)"):
        robot.model.chain.motions(np.zeros((4, 5, 6)))
