"""What `cobot new-robot` makes of the files that people have. Oracles: pinocchio's kinematics and dynamics of
the given URDF, and the numbers written into the files.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
import pytest
import yaml
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import PlannerName, Pose, Scaling
from rtloop.backends import Measured, make_backend

SPHERE = '<sphere radius="0.03"/>'
BALL = f"<collision><geometry>{SPHERE}</geometry></collision>"
FINGER = (
    '<link name="{0}"><inertial><mass value="0.2"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" '
    'iyz="0"/></inertial></link><joint name="{0}_joint" type="prismatic"><parent link="link5"/>'
    '<child link="{0}"/><origin xyz="0 {1} 0.1"/><axis xyz="0 1 0"/>'
    '<limit lower="0" upper="0.04" velocity="0.2" effort="20"/>{2}</joint>'
)
GRIPPER = FINGER.format("left", 0.02, "") + FINGER.format("right", -0.02, '<mimic joint="left_joint"/>')
FINGERS = ["left_joint", "right_joint"]
MJCF = """<mujoco><compiler angle="radian"/><worldbody><body name="stand"><geom size="0.02"/>
<body name="one" pos="0 0 .2"><joint name="j" range="-1.5 1.5"/><geom size=".03" pos=".1 0 0"/>
<body name="two" pos=".3 0 0"><joint name="k" axis="0 1 0" range="-1.5 1.5"/><geom size=".03"/>
<site name="tcp" pos=".2 0 0"/>
<body name="left" pos=".2 .05 0"><joint name="fl" type="slide" axis="0 1 0" range="0 .04"/><geom size=".01"/>
</body><body name="right" pos=".2 -.05 0"><joint name="fr" type="slide" axis="0 -1 0" range="0 .04"/>
<geom size=".01"/></body></body></body></body></worldbody>
<tendon><fixed name="split"><joint joint="fl" coef=".5"/><joint joint="fr" coef=".5"/></fixed></tendon>
<equality><joint joint1="fl" joint2="fr"/><tendon tendon1="split"/></equality>
<actuator><position joint="j" kp="100" forcerange="-87 87"/><motor joint="k" ctrlrange="-3 3" gear="20"/>
<general tendon="split" ctrlrange="0 255"/></actuator>
<sensor><jointpos joint="fl"/><tendonpos tendon="split"/></sensor>
<keyframe><key qpos="0 0 0 0"/></keyframe></mujoco>"""


def made_of(file: Path, text: str, **options: object) -> RobotDescription:
    file.write_text(text)
    NewRobot(file, **options).write(file.with_suffix(""))  # type: ignore[arg-type]
    return load_robot(load_settings(file.with_suffix("") / "cobot-setting.yaml"))


def mounted(rpy: str) -> str:
    """On a stand that turns it: a wall, a ceiling, anything."""
    mount = (
        '<link name="stand"/><link name="base_link"/><joint name="mount" type="fixed"><parent link="stand"/>'
        f'<child link="base_link"/><origin xyz="0.3 0.1 1.5" rpy="{rpy}"/></joint>'
    )
    return urdf(ARMS["ur"]).replace('<link name="base_link"/>', mount)


@pytest.mark.parametrize("rpy", ["3.14159265358979 0 0", "0 1.5707963267949 0", "2.1 -0.4 0.7"])
def test_a_base_that_is_turned_has_its_own_frame_and_the_gravity_of_the_world(
    tmp_path: Path, rpy: str
) -> None:
    of_urdf = made_of(tmp_path / "one.urdf", mounted(rpy), base="base_link")
    model = pinocchio.buildModelFromXML(mounted(rpy))
    data, base, tip = model.createData(), model.getFrameId("base_link"), model.getFrameId("tool0")
    of_mjcf = made_of(
        tmp_path / "two.xml", (tmp_path / "one" / "model.xml").read_text(), base="base_link", tcp="tool0"
    )
    for robot in (of_urdf, of_mjcf):
        assert robot.base_frame == "base_link"
        for joints in np.random.default_rng(2).uniform(-2.0, 2.0, (10, 6)):
            pinocchio.framesForwardKinematics(model, data, joints)
            wanted = data.oMf[base].actInv(data.oMf[tip])
            pose = robot.model.forward(joints)
            np.testing.assert_allclose(pose.position, wanted.translation, atol=1e-12)
            still = np.zeros(6)
            np.testing.assert_allclose(
                robot.model.gravity_torques(joints),
                pinocchio.rnea(model, data, joints, still, still),
                atol=1e-9,
            )
    _holds_itself(tmp_path / "two")
    _goes_straight_down_in_its_base(of_urdf, model)


def _holds_itself(made: Path) -> None:
    settings = load_settings(made / "cobot-setting.yaml")
    backend = make_backend(settings, load_robot(settings).limits)
    start = np.full(6, 0.2)
    backend.open(start)
    command = np.zeros((3, 6))
    command[0] = start
    measured = Measured(6)
    for _ in range(300):
        backend.write(command)
        backend.read(measured)
    np.testing.assert_allclose(measured.position, start, atol=1e-3)


def _goes_straight_down_in_its_base(robot: RobotDescription, model: pinocchio.Model) -> None:
    start = np.array([0.3, 0.4, -0.3, 0.7, 0.4, 0.5])
    pose = robot.model.forward(start)
    goal = Pose(pose.position - 0.05 * np.eye(3)[2], pose.quaternion)
    motion = plan(robot, MotionRequest(start, goal, PlannerName.LIN, Scaling(1.0), None, timeout_s=5.0))
    assert motion is not None
    data, base, tip = model.createData(), model.getFrameId("base_link"), model.getFrameId("tool0")
    places = []
    for joints in motion.sample(np.linspace(0.0, motion.duration_s, 20)):
        pinocchio.framesForwardKinematics(model, data, joints)
        places.append(data.oMf[base].actInv(data.oMf[tip]).translation)
    way = np.array(places) - pose.position
    np.testing.assert_allclose(way[:, :2], 0.0, atol=5e-5)
    assert way[-1, 2] == pytest.approx(-0.05, abs=1e-6)


@pytest.mark.parametrize("options", [{"without": FINGERS}, {"actuators": [f"a{i}" for i in range(6)]}])
def test_fingers_are_left_out_by_name_and_keep_their_weight(
    tmp_path: Path, options: dict[str, list[str]]
) -> None:
    text = urdf(ARMS["ur"], GRIPPER)
    robot = made_of(tmp_path / "arm.urdf", text, **options)
    assert robot.limits.names == tuple(f"a{i}" for i in range(6))
    model = pinocchio.buildModelFromXML(text)
    model = pinocchio.buildReducedModel(
        model, [model.getJointId(name) for name in FINGERS], np.zeros(model.nq)
    )
    data, still = model.createData(), np.zeros(6)
    for joints in np.random.default_rng(3).uniform(-2.0, 2.0, (10, 6)):
        wanted = pinocchio.rnea(model, data, joints, still, still)
        np.testing.assert_allclose(robot.model.gravity_torques(joints), wanted, atol=1e-9)


def test_a_finger_that_does_not_exist_is_named_with_those_that_do(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"has no joint 'thumb'; valid names: a0, .*, left_joint, right_joint"
    ):
        made_of(tmp_path / "arm.urdf", urdf(ARMS["ur"], GRIPPER), without=[*FINGERS, "thumb"])


def test_a_gripper_of_mjcf_goes_with_its_tendon_equality_actuator_and_sensors(tmp_path: Path) -> None:
    robot = made_of(tmp_path / "arm.xml", MJCF, without=["fl", "fr"])
    assert robot.limits.names == ("j", "k")
    assert (robot.model.mj.nu, robot.model.mj.ntendon, robot.model.mj.nsensor, robot.model.mj.neq) == (
        2,
        0,
        0,
        0,
    )


def test_a_whole_scene_of_mjcf_is_taken_with_its_objects_standing_still(tmp_path: Path) -> None:
    """As those of others come: with textures that are not there, and a cube that falls."""
    colour = '<asset><texture type="2d" name="t" file="t.png"/><material name="m" texture="t"/></asset>'
    cube = '<body name="cube" pos="2 0 1"><freejoint/><geom type="box" size=".1 .1 .1" material="m"/></body>'
    text = MJCF.replace("<worldbody>", f"{colour}<worldbody>{cube}").replace('<key qpos="0 0 0 0"/>', "")
    for name, options in (("one", {}), ("two", {"actuators": ["j", "k"]})):
        robot = made_of(tmp_path / f"{name}.xml", text, **options)
        assert robot.limits.names == ("j", "k")
        assert robot.model.mj.body("cube").pos.tolist() == [2.0, 0.0, 1.0]


def test_a_joint_that_is_neither_a_hinge_nor_a_slide_is_no_actuator(tmp_path: Path) -> None:
    text = MJCF.replace('<joint name="k" axis="0 1 0" range="-1.5 1.5"/>', '<joint name="k" type="ball"/>')
    text = text.replace('<motor joint="k" ctrlrange="-3 3" gear="20"/>', "")
    with pytest.raises(ConfigError, match=r"'k' is a free or ball joint: .*, or leave it out of --actuators"):
        made_of(tmp_path / "one.xml", text.replace('<key qpos="0 0 0 0"/>', ""), actuators=["j", "k"])
    with pytest.raises(ConfigError, match="the arm has a ball joint, at 'two'"):
        made_of(tmp_path / "two.xml", text.replace('<key qpos="0 0 0 0"/>', ""), without=["fl", "fr"])


def test_efforts_are_those_of_the_actuators_in_mjcf(tmp_path: Path) -> None:
    robot = made_of(tmp_path / "arm.xml", MJCF, without=["fl", "fr"])
    assert robot.limits.max_effort.tolist() == [87.0, 60.0]


def test_defaults_for_actuators_do_not_limit_or_multiply_the_motors(tmp_path: Path) -> None:
    """Oracle: MuJoCo, which applies the torque that it is told to."""
    defaults = (
        '<default><general ctrllimited="true" ctrlrange="-1 1" gear="9"/>'
        '<position ctrllimited="true"/></default><worldbody>'
    )
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><worldbody><body name="base"><geom size=".05"/><body name="one" pos="0 0 .2"><joint '
        'name="j" axis="0 1 0" range="-1 1"/><geom size=".02" pos="0 0 .1"/></body></body>'
        "</worldbody></mujoco>".replace("<worldbody>", defaults)
    )
    NewRobot(file).write(tmp_path / "made")
    mj = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml")).model.mj
    data = mujoco.MjData(mj)
    data.ctrl[:] = 5.0
    mujoco.mj_forward(mj, data)
    assert data.qfrc_actuator[0] == 5.0


def test_slides_without_a_range_stay_with_the_option_that_is_offered(tmp_path: Path) -> None:
    """As the base of an arm on wheels, which simulations hold by three slides."""
    slides = '<joint name="s0" type="slide" axis="1 0 0"/><joint name="s1" type="slide" axis="0 1 0"/>'
    file = tmp_path / "arm.xml"
    file.write_text(
        f'<mujoco><worldbody><body name="base">{slides}<geom size=".05"/><body name="one" pos="0 0 .2">'
        '<joint name="j" axis="0 1 0" range="-1 1"/><geom size=".02" pos="0 0 .1"/></body></body>'
        "</worldbody></mujoco>"
    )
    with pytest.raises(ConfigError, match=r"'s0' has no range; give it a range .* with --without s0 s1$"):
        NewRobot(file).write(tmp_path / "made")
    robot = NewRobot(file, without=["s0", "s1"])
    robot.write(tmp_path / "made")
    assert load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml")).limits.names == ("j",)


@pytest.mark.parametrize("head", ["ctrllimited", "forcelimited"])
def test_a_default_without_a_range_is_no_reason_to_refuse(tmp_path: Path, head: str) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(
        f'<mujoco><default><general {head}="true"/></default><worldbody><body name="base"><geom size=".05"/>'
        '<body name="one" pos="0 0 .2"><joint name="j" axis="0 1 0" range="-1 1"/><geom type="capsule" '
        'size=".02" fromto="0 0 .06 0 0 .3"/></body></body></worldbody><actuator><motor joint="j" '
        'ctrlrange="-3 3" forcerange="-3 3"/></actuator></mujoco>'
    )
    NewRobot(file).write(tmp_path / "made")
    limits = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml")).limits
    assert limits.max_effort.tolist() == [3.0]


def test_an_effort_that_the_file_gives_is_kept_however_great(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace('effort="200"', 'effort="100000"', 1))
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "arm")
    limits = load_robot(load_settings(tmp_path / "arm" / "cobot-setting.yaml")).limits
    assert limits.max_effort.tolist() == [100000.0, *[200.0] * 5]
    assert not [sentence for sentence in new.guessed if "effort" in sentence]


def test_an_effort_that_the_file_does_not_give_is_guessed_in_the_joints_unit(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["gantry"]).replace('effort="200"', 'effort="0"'))
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "arm")
    said = [sentence for sentence in new.guessed if "effort" in sentence]
    assert [sentence.split()[3].rstrip(",") for sentence in said] == ["N", "N", *["N·m"] * 4]


@pytest.mark.parametrize("given", ["", "parts"])
def test_packages_are_found_in_or_as_the_folders_given(tmp_path: Path, given: str) -> None:
    stl(tmp_path / "ws" / "parts" / "meshes" / "a.stl")
    text = urdf(ARMS["ur"]).replace(
        '<sphere radius="0.03"/>', '<mesh filename="package://parts/meshes/a.stl"/>', 1
    )
    robot = made_of(tmp_path / "arm.urdf", text, packages=[tmp_path, tmp_path / "ws" / given])
    assert robot.model.mj.nmesh == 1


def test_a_folder_that_is_given_is_the_package_whatever_its_name(tmp_path: Path) -> None:
    """The way out of the error. A folder with a manifest is only the package that the manifest names."""
    folder = tmp_path / "clone-main"
    stl(folder / "meshes" / "a.stl")
    text = urdf(ARMS["ur"]).replace(SPHERE, '<mesh filename="package://parts/meshes/a.stl"/>', 1)
    assert made_of(tmp_path / "arm.urdf", text, packages=[folder]).model.mj.nmesh == 1
    (folder / "package.xml").write_text("<package><name>others</name></package>")
    with pytest.raises(ConfigError, match="there is no package 'parts'"):
        NewRobot(tmp_path / "arm.urdf", packages=[folder]).write(tmp_path / "second")


@pytest.mark.parametrize(("base", "told"), [("link3", "moves with the joints"), ("up", "is not a link of")])
def test_a_base_that_moves_or_is_none_is_named_with_those_that_can_be(
    tmp_path: Path, base: str, told: str
) -> None:
    with pytest.raises(ConfigError, match=rf"^--base: '{base}' {told}.*; valid names: world, base_link$"):
        made_of(tmp_path / "arm.urdf", urdf(ARMS["ur"]), base=base)


def test_a_package_without_its_name_is_found_next_to_the_file(tmp_path: Path) -> None:
    """Tools that copy a URDF out of its package leave package://meshes/a.stl."""
    stl(tmp_path / "meshes" / "a.stl")
    text = urdf(ARMS["ur"]).replace(SPHERE, '<mesh filename="package://meshes/a.stl"/>', 1)
    assert made_of(tmp_path / "arm.urdf", text).model.mj.nmesh == 1


@pytest.mark.parametrize("name", ["package://parts/a.stl", "a.stl"])
def test_a_mesh_that_is_missing_is_left_out_by_the_option_that_is_offered(tmp_path: Path, name: str) -> None:
    text = urdf(ARMS["ur"]).replace(SPHERE, f'<mesh filename="{name}"/>', 1)
    (tmp_path / "arm.urdf").write_text(text)
    with pytest.raises(
        ConfigError, match=r"arm\.urdf:1: link 'link0': mesh .* leave out such shapes with --skip-missing-mes"
    ):
        NewRobot(tmp_path / "arm.urdf").write(tmp_path / "arm")
    assert main(["new-robot", str(tmp_path / "arm.urdf"), "--output", str(tmp_path / "arm"),
                 "--skip-missing-meshes"]) == 0  # fmt: skip
    new = NewRobot(tmp_path / "arm.urdf", skip_missing_meshes=True)
    new.write(tmp_path / "second")
    assert f"link0: mesh '{name}' is missing and left out" in new.guessed
    assert "links without a collision shape, so their collisions are not detected: link0" in new.guessed


def test_a_shape_that_is_a_point_is_left_out_and_said(tmp_path: Path) -> None:
    points = ('<sphere radius="0.00"/>', '<box size="0 0 0"/>', '<cylinder radius="0" length="0"/>')
    text = urdf(ARMS["ur"])
    for point in points:
        text = text.replace(SPHERE, point, 1)
    (tmp_path / "arm.urdf").write_text(text)
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "arm")
    said = [sentence for sentence in new.guessed if "of size 0" in sentence]
    assert said == [
        "link0: a <sphere> of size 0 is left out",
        "link1: a <box> of size 0 is left out",
        "link2: a <cylinder> of size 0 is left out",
    ]
    (tmp_path / "arm.urdf").write_text(text.replace(points[1], '<box size="0.1 0 0.1"/>'))
    with pytest.raises(
        ConfigError, match=r"link 'link1': size of <box> is '0\.1 0 0\.1'; it must be above 0"
    ):
        NewRobot(tmp_path / "arm.urdf").write(tmp_path / "second")


def test_a_package_that_is_in_no_folder_given_is_named_with_the_folders(tmp_path: Path) -> None:
    text = urdf(ARMS["ur"]).replace('<sphere radius="0.03"/>', '<mesh filename="package://parts/a.stl"/>', 1)
    stl(tmp_path / "others" / "b.stl")
    with pytest.raises(
        ConfigError,
        match=r"package://parts/a\.stl: there is no package .parts. .*others\) .*folder of parts or",
    ):
        made_of(tmp_path / "arm.urdf", text, packages=[tmp_path / "others"])


def test_what_is_only_seen_is_not_needed_and_links_without_a_shape_are_named(tmp_path: Path) -> None:
    seen = '<visual><geometry><mesh filename="package://none/a.dae"/></geometry></visual>'
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace(BALL, seen, 2))
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "arm")
    assert (
        "links without a collision shape, so their collisions are not detected: link0, link1"
    ) in new.guessed


def test_a_mesh_of_another_format_is_to_be_converted(tmp_path: Path) -> None:
    (tmp_path / "a.wrl").write_text("#VRML V2.0 utf8")
    text = urdf(ARMS["ur"]).replace('<sphere radius="0.03"/>', '<mesh filename="a.wrl"/>', 1)
    with pytest.raises(
        ConfigError,
        match=r"arm\.urdf:1: link 'link0': mesh .*a\.wrl has a format .* one of: \.stl, \.obj, \.ply, \.dae",
    ):
        made_of(tmp_path / "arm.urdf", text)


def test_degrees_in_the_file_are_asked_about(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace('upper="2.9"', 'upper="170"', 1))
    new = NewRobot(tmp_path / "arm.urdf")
    new.write(tmp_path / "arm")
    assert "a0: position -2.9 to 170 rad as in the file; these values look like degrees" in new.guessed


def test_millimetres_in_the_file_are_refused_by_its_name(tmp_path: Path) -> None:
    text = urdf(ARMS["gantry"]).replace('lower="-0.5" upper="0.5"', 'lower="-500" upper="500"', 1)
    with pytest.raises(
        ConfigError, match=r"arm\.urdf: .*a0 slides from -500 to 500 m, .*millimetres"
    ) as said:
        made_of(tmp_path / "arm.urdf", text)
    assert ".new-robot-" not in str(said.value)


def test_an_output_folder_that_cannot_be_made_is_named_with_the_reason(tmp_path: Path) -> None:
    file, locked = tmp_path / "arm.urdf", tmp_path / "locked"
    file.write_text(urdf(ARMS["ur"]))
    locked.mkdir(mode=0o555)
    with pytest.raises(ConfigError, match="already exists; choose another --output"):
        NewRobot(file).write(tmp_path)
    for folder, reason in (
        (tmp_path / "none" / "made", "there is no folder .*none; create it"),
        (file / "made", r"there is no folder .*arm\.urdf; create it"),
        (tmp_path / ("long" * 100), "File name too long; choose another --output"),
    ):
        with pytest.raises(ConfigError, match=f"cannot be written: {reason}"):
            NewRobot(file).write(folder)
    with nobody(), pytest.raises(ConfigError, match=r"made: cannot be written: Permission denied; choose"):
        NewRobot(file).write(locked / "made")
    assert sorted(tmp_path.iterdir()) == [file, locked]
    assert not list(locked.iterdir())


@contextmanager
def nobody() -> Iterator[None]:
    """As a user who may not write everywhere: root may."""
    if os.geteuid() != 0:
        yield
        return
    os.seteuid(65534)
    try:
        yield
    finally:
        os.seteuid(0)


def test_each_command_takes_the_folder_as_config(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made_of(tmp_path / "arm.urdf", urdf(ARMS["ur"]))
    made = tmp_path / "arm"
    settings = yaml.safe_load((made / "cobot-setting.yaml").read_text())
    settings["web"]["tokens"] = "tokens.json"
    settings["logs"] = "logs"
    (made / "cobot-setting.yaml").write_text(yaml.safe_dump(settings))
    here = ["--config", str(made)]
    assert main(["token", "create", "ann", "--role", "observer", *here]) == 0
    assert main(["token", "list", *here]) == 0
    assert "ann" in capsys.readouterr().out
    assert (made / "tokens.json").exists()
    main(["doctor", "--json", *here])
    assert {"item": "configuration", "verdict": "ok"}.items() <= json.loads(capsys.readouterr().out)[
        0
    ].items()
    assert main(["stop", *here]) == 1
    assert "arm" in capsys.readouterr().out
    assert main(["moveit-config", str(tmp_path / "moveit"), *here]) == 0


@pytest.mark.parametrize("words", [["run"], ["check"], ["stop"], ["doctor"], ["token", "list"]])
def test_a_folder_without_settings_is_refused_with_what_to_give_instead(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str]
) -> None:
    with pytest.raises(SystemExit) as left:
        main([*words, "--config", str(tmp_path)])
    assert left.value.code == 2
    assert f"{tmp_path}: has no cobot-setting.yaml; give the file" in capsys.readouterr().err


def stl(file: Path) -> None:
    """A tetrahedron."""
    corners = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]], dtype="<f4")
    faces = ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))
    triangles = b"".join(bytes(12) + corners[list(face)].tobytes() + bytes(2) for face in faces)
    file.parent.mkdir(parents=True)
    file.write_bytes(bytes(80) + len(faces).to_bytes(4, "little") + triangles)
