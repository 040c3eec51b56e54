"""Which joints of a file are the arm, and what becomes of grippers, linkages and other chains.

Oracles: pinocchio's reduced models of the given URDF, MuJoCo's kinematics of the given MJCF, and the names in
the files.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
from urdf_arms import ARMS, link, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.description import RobotDescription, load_robot

NAMES = tuple(f"a{index}" for index in range(6))


def made_of(file: Path, text: str, **options: object) -> tuple[RobotDescription, str]:
    """The robot, and what was said of it."""
    file.write_text(text, encoding="utf-8")
    new = NewRobot(file, **options)  # type: ignore[arg-type]
    new.write(file.with_suffix(""))
    return load_robot(load_settings(file.with_suffix("") / "cobot-setting.yaml")), "\n".join(new.guessed)


def require_held(robot: RobotDescription, text: str, held: dict[str, float], tcp: str) -> None:
    """That it is pinocchio's model of the text with these joints locked there."""
    model = pinocchio.buildModelFromXML(text)
    place = np.zeros(model.nq)
    for name, at in held.items():
        place[model.joints[model.getJointId(name)].idx_q] = at
    model = pinocchio.buildReducedModel(model, [model.getJointId(name) for name in held], place)
    data, still = model.createData(), np.zeros(model.nq)
    base = model.getFrameId(robot.base_frame)
    for joints in np.random.default_rng(5).uniform(-1.0, 1.0, (5, model.nq)):
        pinocchio.framesForwardKinematics(model, data, joints)
        there = data.oMf[base].actInv(data.oMf[model.getFrameId(tcp)])
        np.testing.assert_allclose(robot.model.forward(joints).position, there.translation, atol=1e-9)
        torques = pinocchio.rnea(model, data, joints, still, still)
        np.testing.assert_allclose(robot.model.gravity_torques(joints), torques, atol=1e-7)


PARALLEL = link("left", "link5", "prismatic", range_="0.005 0.04") + link(
    "right", "link5", "prismatic", range_="-0.05 -0.001", mimic='joint="left" multiplier="-1" offset="-0.002"'
)
JAW = link("claw", "link5", "revolute", range_="0.3 1.5", joint="six")
GRASP = (
    '<link name="hand_tcp"/><joint name="h" type="fixed"><parent link="tool0"/><child link="hand_tcp"/>'
    "</joint>"
)
GRIPPERS = {
    "fingers that slide and follow": (PARALLEL, {"left": 0.04, "right": -0.042}),
    "fingers by their names": (link("f", "tool0", "revolute", joint="finger_1"), {"finger_1": 0.0}),
    "a jaw beside the TCP": (JAW, {"six": 0.3}),
    "a hand of three": (
        "".join(link(f"d{i}", "tool0", "revolute") + link(f"e{i}", f"d{i}", "revolute") for i in range(3)),
        {f"{part}{i}": 0.0 for i in range(3) for part in "de"},
    ),
}


@pytest.mark.parametrize("kind", sorted(GRIPPERS))
def test_a_gripper_is_found_and_planned_with_where_its_ranges_allow(kind: str, tmp_path: Path) -> None:
    extra, held = GRIPPERS[kind]
    text = urdf(ARMS["ur"], extra)
    robot, said = made_of(tmp_path / "arm.urdf", text)
    assert robot.limits.names == NAMES
    sentence = next(line for line in said.splitlines() if line.startswith("gripper found"))
    for name, at in held.items():
        assert f"{name} at {at:g}" in sentence
    require_held(robot, text, held, "tool0")


def test_the_tcp_is_that_of_the_hand_and_not_of_a_finger(tmp_path: Path) -> None:
    finger = link("finger_tcp", "hand_tcp", "prismatic", joint="finger")
    robot, said = made_of(tmp_path / "arm.urdf", urdf(ARMS["ur"], GRASP + finger))
    assert "tcp hand_tcp: by its name" in said
    assert robot.limits.names == NAMES


def test_joints_of_a_gripper_that_turns_as_a_whole_are_the_arms(tmp_path: Path) -> None:
    text = urdf(ARMS["ur"]).replace('name="a5"', 'name="gripper_roll"')
    robot, _ = made_of(tmp_path / "arm.urdf", text)
    assert robot.limits.names == (*NAMES[:5], "gripper_roll")


@pytest.mark.parametrize("name", ["head", "wheel"])
def test_a_short_branch_off_the_arm_stays_with_its_shape(name: str, tmp_path: Path) -> None:
    parent = {"head": "link0", "wheel": "base_link"}[name]
    text = urdf(ARMS["ur"], link(name, parent, "revolute", range_="-2 -0.4", place="0.4 0 0"))
    robot, said = made_of(tmp_path / "arm.urdf", text)
    assert robot.limits.names == NAMES
    assert f"joints that stay where they are: {name} at -0.4 rad" in said
    assert name in robot.collision.body_names
    require_held(robot, text, {name: -0.4}, "tool0")


def test_rods_of_a_linkage_keep_their_mass_and_lose_their_shapes(tmp_path: Path) -> None:
    rods = link("rod", "link0", "revolute", mimic='joint="a1"') + link(
        "lever", "rod", "revolute", mimic='joint="a1" multiplier="-1"', place="0 0 0.4"
    )
    text = urdf(ARMS["ur"], rods)
    robot, said = made_of(tmp_path / "arm.urdf", text)
    assert robot.limits.names == NAMES
    assert "linkage found; its joints stay where they are, with mass and without shapes: rod at 0" in said
    mj = robot.model.mj
    shapes = {mj.body(int(mj.geom_bodyid[geom])).name for geom in range(mj.ngeom) if mj.geom_contype[geom]}
    assert not {"rod", "lever"} & shapes
    require_held(robot, text, {"rod": 0.0, "lever": 0.0}, "tool0")


def two_arms() -> str:
    """With two joints of a torso below both."""
    torso = link("torso", "base_link", "revolute", joint="t0") + link(
        "chest", "torso", "revolute", joint="t1"
    )
    arms = ""
    for side, place in (("left", "0.3 0 0.1"), ("right", "-0.3 0 0.1")):
        parent = "chest"
        for index in range(5):
            arms += link(
                f"{side}{index}", parent, "revolute", joint=f"{side}_{index}",
                place="0 0 0.2" if index else place, axis="0 1 0" if index % 2 else "1 0 0",
            )  # fmt: skip
            parent = f"{side}{index}"
        arms += f'<link name="{side}_tool0"/><joint name="{side}_tip" type="fixed"><parent link="{parent}"/>'
        arms += f'<child link="{side}_tool0"/></joint>'
    return f'<robot name="two"><link name="base_link"/>{torso}{arms}</robot>'


def test_several_arms_are_listed_and_each_option_listed_takes_one(tmp_path: Path) -> None:
    text = two_arms()
    with pytest.raises(ConfigError) as refused:
        made_of(tmp_path / "arm.urdf", text)
    said = str(refused.value)
    assert "has 2 chains of joints. Choose one by its end" in said
    for side, other in (("left", "right"), ("right", "left")):
        joints = ("t0", "t1", *(f"{side}_{index}" for index in range(5)))
        assert f"--tcp {side}_tool0 (from base_link, 7 joints: {', '.join(joints)})" in said
        robot, guessed = made_of(tmp_path / f"{side}.urdf", text, tcp=f"{side}_tool0")
        assert robot.limits.names == joints
        assert f"joints that stay where they are: {other}_0 at 0" in guessed
        assert f"{other}4" in robot.collision.body_names
        require_held(robot, text, {f"{other}_{index}": 0.0 for index in range(5)}, f"{side}_tool0")


def test_the_joints_are_refused_before_any_mesh_is_read(tmp_path: Path) -> None:
    """Oracle: the mesh does not exist, and a file of one arm with it is refused for that."""
    mesh = '<mesh filename="missing.stl"/>'
    box = '<box size="0.02 0.02 0.05"/>'
    with pytest.raises(ConfigError, match="has 2 chains of joints"):
        made_of(tmp_path / "two.urdf", two_arms().replace(box, mesh))
    with pytest.raises(ConfigError, match=r"missing\.stl does not exist"):
        made_of(tmp_path / "one.urdf", two_arms().replace(box, mesh), tcp="left_tool0")


REFUSED = {
    "a follower in the chain": (
        urdf(ARMS["ur"]).replace('<child link="link2"/>', '<child link="link2"/><mimic joint="a1"/>'),
        {}, r"arm are coupled: 'a2' follows 'a1' \(mimic\); .*: --without a2$",
    ),
    "a follower among actuators": (
        urdf(ARMS["ur"], PARALLEL), {"actuators": [*NAMES, "left", "right"]},
        "'right' follows 'left'",
    ),
    "a gripper alone": (
        '<robot name="g"><link name="base_link"/>'
        + link("one", "base_link", "prismatic", joint="left_finger")
        + link("two", "base_link", "prismatic", joint="right_finger") + "</robot>",
        {}, r"has no arm: its joints are those of a gripper \(left_finger, right_finger\)",
    ),
    "an unknown TCP": (
        urdf(ARMS["ur"]), {"tcp": "tip"}, "has no site or link 'tip' for the TCP; valid names: .*tool0",
    ),
    "a TCP that stands": (urdf(ARMS["ur"]), {"tcp": "base_link"}, "no joint moves 'base_link'"),
    "a base that moves": (
        urdf(ARMS["ur"]).replace('type="revolute"', 'type="planar"', 1),
        {}, "'a0' is planar: .* with --without a0",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(REFUSED))
def test_what_is_no_serial_arm_is_refused_with_the_way_out(kind: str, tmp_path: Path) -> None:
    text, options, said = REFUSED[kind]
    with pytest.raises(ConfigError, match=said):
        made_of(tmp_path / "arm.urdf", text, **options)


@pytest.mark.parametrize(("kind", "held"), [("a base that moves", "a0"), ("a follower in the chain", "a2")])
def test_the_way_out_that_is_printed_works(kind: str, held: str, tmp_path: Path) -> None:
    robot, _ = made_of(tmp_path / "arm.urdf", REFUSED[kind][0], without=[held])
    assert robot.limits.names == tuple(name for name in NAMES if name != held)


@pytest.mark.parametrize("name", ["arm/joint 2", "it's", "-j2", "--help", "$HOME", "a;b"])
def test_the_way_out_works_for_each_name_when_a_shell_reads_it(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Oracle: `sh`, which makes the words of the sentence."""
    followers = urdf(ARMS["ur"])
    for number, leader in (("2", "a1"), ("4", "a3")):
        followers = followers.replace(
            f'<child link="link{number}"/>', f'<child link="link{number}"/><mimic joint="{leader}"/>'
        )
    (tmp_path / "arm.urdf").write_text(followers.replace('name="a2"', f'name="{name}"'))
    command = ["new-robot", str(tmp_path / "arm.urdf"), "--output", str(tmp_path / "my robot")]
    assert main(command) == 1
    words = "--without" + capsys.readouterr().err.strip().partition("--without")[2]
    split = subprocess.run(
        ["sh", "-c", f"printf '%s\\0' {words}"], capture_output=True, text=True, check=True
    )
    assert main([*command, *split.stdout.split("\0")[:-1]]) == 0
    assert f"Then: cobot check --config '{tmp_path}/my robot' and" in capsys.readouterr().out
    robot = load_robot(load_settings(tmp_path / "my robot" / "cobot-setting.yaml"))
    assert robot.limits.names == ("a0", "a1", "a3", "a5")


MJCF = """<mujoco><compiler angle="degree" eulerseq="zyx"/><worldbody>
<body name="cube" pos="2 0 1"><freejoint/><geom size=".1"/></body>
<body name="stand"><geom size=".02"/>{arm}</body></worldbody>{rest}</mujoco>"""
HINGE = (
    '<body name="{0}" pos="0.1 0 .2" euler="10 20 30">'
    '<joint name="{0}" axis="{1}" range="-90 90"/><geom size=".03"/>'
)
JAWS = (
    '<body name="upper" pos=".1 0 .1" euler="20 -10 40"><joint name="jaw_lift" type="slide" axis="0 1 1" '
    'range=".01 .02"/><joint name="jaw" axis="1 1 0" pos=".01 .02 .03" range="20 60" ref="5"/>'
    '<geom size=".01"/>'
    '<body name="lower" pos="0 0 .1" axisangle="0 1 0 30"><joint name="jaw_tip" axis="0 0 1" range="-90 90"/>'
    '<geom size=".01"/></body></body>'
)  # fmt: skip


def mjcf(rest: str = "") -> str:
    arm = "".join(HINGE.format(f"j{i}", "0 1 0" if i % 2 else "0 0 1") for i in range(5))
    return MJCF.format(arm=f'{arm}<site name="pinch_site" pos="0 0 .1"/>{JAWS}{"</body>" * 5}', rest=rest)


def test_jaws_of_mjcf_stay_as_its_kinematics_have_them_and_its_objects_too(tmp_path: Path) -> None:
    text = mjcf('<equality><joint joint1="jaw_tip" joint2="jaw" polycoef="0.1 0.5 0 0 0"/></equality>')
    robot, said = made_of(tmp_path / "arm.xml", text)
    assert robot.limits.names == tuple(f"j{index}" for index in range(5))
    assert "tcp pinch_site: by its name" in said
    whole = mujoco.MjModel.from_xml_string(text)
    wanted, data = mujoco.MjData(whole), mujoco.MjData(robot.model.mj)
    jaw = np.radians(20.0)
    held = {"jaw_lift": 0.01, "jaw": jaw, "jaw_tip": 0.1 + 0.5 * (jaw - np.radians(5.0))}
    for name, at in held.items():
        wanted.joint(name).qpos = at
        assert f"{name} at {at:.4g}" in said
    joints = np.linspace(-0.5, 0.6, 5)
    for index, at in enumerate(joints):
        wanted.joint(f"j{index}").qpos = at
    data.qpos[:] = joints
    mujoco.mj_kinematics(whole, wanted)
    mujoco.mj_kinematics(robot.model.mj, data)
    for name in ("upper", "lower", "j4", "cube"):
        np.testing.assert_allclose(data.body(name).xpos, wanted.body(name).xpos, atol=1e-9)
        np.testing.assert_allclose(data.body(name).xmat, wanted.body(name).xmat, atol=1e-9)


def test_joints_without_names_stay_where_the_kinematics_have_them(tmp_path: Path) -> None:
    """Oracle: MuJoCo, in which both joints are at the ends of their ranges."""
    bare = JAWS
    for name in ("jaw_lift", "jaw", "jaw_tip"):
        bare = bare.replace(f'name="{name}" ', "")
    named = mjcf()
    robot, said = made_of(tmp_path / "arm.xml", named.replace(JAWS, bare), tcp="pinch_site")
    assert (
        "(no name, number 7) at 0.01 m, (no name, number 8) at 0.3491 rad, (no name, number 9) at 0" in said
    )
    whole = mujoco.MjModel.from_xml_string(named)
    wanted, data = mujoco.MjData(whole), mujoco.MjData(robot.model.mj)
    wanted.joint("jaw_lift").qpos, wanted.joint("jaw").qpos = 0.01, np.radians(20.0)
    wanted.joint("jaw_tip").qpos = 0.0
    mujoco.mj_kinematics(whole, wanted)
    mujoco.mj_kinematics(robot.model.mj, data)
    for name in ("upper", "lower"):
        np.testing.assert_allclose(data.body(name).xpos, wanted.body(name).xpos, atol=1e-9)
        np.testing.assert_allclose(data.body(name).xmat, wanted.body(name).xmat, atol=1e-9)


def test_the_rod_of_a_palletiser_that_closes_a_loop_keeps_its_mass_and_loses_its_shape(
    tmp_path: Path,
) -> None:
    rod = (
        '<body name="rod" pos="-0.1 0 0.1"><joint name="rod" axis="0 1 0" range="-90 90"/>'
        '<geom type="capsule" size=".01" fromto="0 0 0 0 0 .2" mass="0.7"/></body>'
    )
    first = HINGE.format("j0", "0 0 1")
    motors = "".join(f'<motor joint="j{index}"/>' for index in range(5))
    loop = '<equality><connect body1="rod" body2="j2" anchor="0 0 0.2"/></equality>'
    text = mjcf(f"{loop}<actuator>{motors}</actuator>").replace(first, first + rod)
    robot, said = made_of(tmp_path / "arm.xml", text)
    assert robot.limits.names == tuple(f"j{index}" for index in range(5))
    assert "linkage found; its joints stay where they are, with mass and without shapes: rod at 0" in said
    mj = robot.model.mj
    assert mj.neq == 0
    assert mj.body("rod").mass == pytest.approx(0.7)
    assert not mj.geom_contype[mj.body("rod").geomadr[0]]


@pytest.mark.parametrize("tied", ['body1="handle" body2="j4"', 'site1="hold" site2="pinch_site"'])
def test_a_mocap_body_that_pulls_the_arm_closes_no_loop_and_stands_still(tmp_path: Path, tied: str) -> None:
    """Simulations of learning move an arm without actuators by such a handle."""
    handle = '<body name="handle" mocap="true" pos="0 0 2"><geom size=".05"/><site name="hold"/></body>'
    text = mjcf(f"<equality><weld {tied}/></equality>").replace("<worldbody>", f"<worldbody>{handle}")
    robot, said = made_of(tmp_path / "arm.xml", text)
    assert robot.limits.names == tuple(f"j{index}" for index in range(5))
    mj = robot.model.mj
    assert (mj.nmocap, mj.neq, mj.body_weldid[mj.body("handle").id]) == (0, 0, 0)
    assert "handle: mass" not in said


def test_joints_of_the_arm_that_one_tendon_moves_are_named(tmp_path: Path) -> None:
    tendon = (
        '<tendon><fixed name="t"><joint joint="j1" coef="1"/><joint joint="j3" coef="1"/></fixed></tendon>'
    )
    text = mjcf(f'{tendon}<actuator><position tendon="t"/></actuator>')
    with pytest.raises(ConfigError, match=r"one actuator drives j1, j3 through a tendon; .*: --without j3$"):
        made_of(tmp_path / "one.xml", text)
    robot, _ = made_of(tmp_path / "two.xml", text, without=["j3"])
    assert robot.limits.names == ("j0", "j1", "j2", "j4")


def test_a_joint_of_the_arm_that_a_closed_loop_moves_is_named(tmp_path: Path) -> None:
    motors = "".join(f'<motor joint="j{index}"/>' for index in (0, 1, 2, 4))
    loop = '<equality><connect body1="j3" body2="upper" anchor="0 0 0"/></equality>'
    text = mjcf(f"{loop}<actuator>{motors}</actuator>")
    said = r"arm.xml:\d+: joint 'j3' of the arm has no actuator: a closed loop .*: --without j3$"
    with pytest.raises(ConfigError, match=said):
        made_of(tmp_path / "arm.xml", text)
    robot, _ = made_of(tmp_path / "two.xml", text, without=["j3"])
    assert robot.limits.names == ("j0", "j1", "j2", "j4")
