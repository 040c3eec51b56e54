"""`cobot new-robot`. Oracle: pinocchio's kinematics of the given URDF, and files broken by hand."""

from __future__ import annotations

from pathlib import Path

import httpx
import mujoco
import numpy as np
import pinocchio
import pytest
import yaml
from cobot_run import RunOfFolder
from scipy.spatial.transform import Rotation
from urdf_arms import ARMS, urdf

from cobot.config import load_settings
from cobot.errors import ConfigError
from cobot.launch.cli import main
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.planners import MotionRequest, plan
from cobot.robot.description import load_robot
from cobot.types import PlannerName, Scaling
from rtloop.backends import Measured, make_backend

RATES = ("velocity", "acceleration", "jerk")


@pytest.fixture(scope="module", params=sorted(ARMS))
def arm(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp(request.param)
    (folder / "arm.urdf").write_text(urdf(ARMS[request.param]))
    assert main(["new-robot", str(folder / "arm.urdf"), "--output", str(folder / "made")]) == 0
    return folder


def test_the_tcp_is_where_pinocchio_finds_it(arm: Path) -> None:
    robot = load_robot(load_settings(arm / "made" / "cobot-setting.yaml"))
    other = pinocchio.buildModelFromUrdf(str(arm / "arm.urdf"))
    data, frame = other.createData(), other.getFrameId("tool0")
    random = np.random.default_rng(1)
    for joints in random.uniform(robot.limits.min_position, robot.limits.max_position, (20, other.nq)):
        pinocchio.framesForwardKinematics(other, data, joints)
        np.testing.assert_allclose(
            robot.model.forward(joints).position, data.oMf[frame].translation, atol=1e-12
        )
        np.testing.assert_allclose(
            robot.model.gravity_torques(joints), pinocchio.rnea(other, data, joints, joints * 0, joints * 0),
            atol=1e-9,
        )  # fmt: skip


def test_streams_keep_less_distance_where_links_are_always_near_each_other(tmp_path: Path) -> None:
    """The balls of link3 and link5 are sqrt((0.15 - 0.15 sin 0.1)² + (0.15 cos 0.1)²) m apart, whatever the
    joint between them does, less their diameter: 13.3 mm. Streams keep 0.8 of it, in whole millimetres.
    """
    file = tmp_path / "arm.urdf"
    file.write_text(urdf(ARMS["ur"]).replace('sphere radius="0.03"', 'sphere radius="0.094"'))
    new = NewRobot(file)
    new.write(tmp_path / "near")
    assert load_settings(tmp_path / "near" / "cobot-setting.yaml").streaming.collision_margin_m == 0.01
    (said,) = (each for each in new.guessed if each.startswith("streaming."))
    assert "0.010: link3 and link5 are always closer than the usual 20 mm, but at least 13 mm apart" in said
    file.write_text(urdf(ARMS["ur"]))
    NewRobot(file).write(tmp_path / "far")
    assert load_settings(tmp_path / "far" / "cobot-setting.yaml").streaming.collision_margin_m == 0.02


def test_it_plans_ptp_lin_and_ompl(arm: Path) -> None:
    robot = load_robot(load_settings(arm / "made" / "cobot-setting.yaml"))
    start = np.array([0.3, 0.4, -0.3, 0.7, 0.4, 0.5, 0.2])[: robot.limits.dof]
    goal = start + 0.05
    for planner in (PlannerName.PTP, PlannerName.OMPL):
        motion = plan(robot, MotionRequest(start, goal, planner, Scaling(speed=1.0), None, timeout_s=5.0))
        assert motion is not None
        np.testing.assert_allclose(motion.end, goal, atol=1e-9)
    pose = robot.model.forward(goal)
    motion = plan(robot, MotionRequest(start, pose, PlannerName.LIN, Scaling(speed=1.0), None, timeout_s=5.0))
    assert motion is not None
    end = robot.model.forward(motion.end)
    np.testing.assert_allclose(end.position, pose.position, atol=1e-6)


@pytest.mark.parametrize("as_urdf", [False, True])
def test_it_is_simulated_and_holds_itself(arm: Path, as_urdf: bool) -> None:
    settings = load_settings(arm / "made" / "cobot-setting.yaml")
    if as_urdf:
        robot_section = settings.robot.model_copy(update={"model": arm / "arm.urdf", "base_frame": "world"})
        settings = settings.model_copy(update={"robot": robot_section})
    limits = load_robot(load_settings(arm / "made" / "cobot-setting.yaml")).limits
    backend = make_backend(settings, limits)
    start = np.full(limits.dof, 0.2)
    backend.open(start)
    command = np.zeros((3, limits.dof))
    command[0] = start
    measured = Measured(limits.dof)
    for _ in range(300):
        backend.write(command)
        backend.read(measured)
    np.testing.assert_allclose(measured.position, start, atol=1e-3)


BROKEN = {
    "malformed": ("<robot", "arm.urdf:1: is not XML: unclosed token"),
    "xacro": ('<robot name="a">\n<link name="${name}"/></robot>', "name 'name' is not defined"),
    "other": ("<sdf/>", "must be <robot>"),
    "no joints": ('<robot name="a"><link name="b"/></robot>', "has no joint that moves"),
    "no inertia": (urdf(ARMS["ur"], inertial=False).replace("<collision>", "<visual>").replace(
        "</collision>", "</visual>"), "inertia"),
    "mimic": (urdf(ARMS["ur"]).replace('<axis xyz="0.0 1.0 0.0"/>', '<axis xyz="0 1 0"/><mimic joint="a0"/>',
                                       1), "--without a1"),
    "floating": (urdf(ARMS["ur"]).replace("revolute", "floating", 1), "the base must be fixed"),
    "velocity": (urdf(ARMS["ur"]).replace('velocity="1.5"', 'velocity="fast"', 1),
                 "'a0': velocity of <limit> is 'fast'; it must be a decimal number"),
    "effort": (urdf(ARMS["ur"]).replace('effort="200"', 'effort="inf"', 1),
               "'a0': effort of <limit> is 'inf'; it must be"),
    "upside down": (urdf(ARMS["ur"]).replace('lower="-2.9" upper="2.9"', 'lower="1" upper="-1"', 1),
                    "'a0': its lower limit 1 is above its upper limit -1"),
    "mesh": (urdf(ARMS["ur"]).replace('<sphere radius="0.03"/>', '<mesh filename="package://p/a.stl"/>', 1),
             "add --package FOLDER"),
}  # fmt: skip


@pytest.mark.parametrize("kind", sorted(BROKEN))
def test_a_broken_file_is_refused_and_nothing_is_written(kind: str, tmp_path: Path) -> None:
    text, reason = BROKEN[kind]
    file = tmp_path / "arm.urdf"
    file.write_text(text)
    with pytest.raises(ConfigError, match=reason):
        NewRobot(file).write(tmp_path / "made")
    assert list(tmp_path.iterdir()) == [file]


def test_what_was_guessed_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><worldbody><body name="stand"><geom size="0.02"/><body name="one" pos="0 0 .2">'
        '<joint name="j" range="-90 90"/><geom size=".03" pos=".1 0 0"/></body></body></worldbody>'
        '<actuator><position joint="j"/></actuator></mujoco>'
    )
    assert main(["new-robot", str(file), "--output", str(tmp_path / "made")]) == 0
    said = capsys.readouterr().out
    for guess in ("j: velocity 1 rad/s", "j: effort", "base_frame stand", "tcp one", "home"):
        assert guess in said
    limits = yaml.safe_load((tmp_path / "made" / "joint_limits.yaml").read_text())
    assert limits["joint_limits"]["j"]["max_position"] == pytest.approx(np.pi / 2)


def test_an_arm_with_too_many_joints_is_rejected_with_a_way_out_that_works(tmp_path: Path) -> None:
    file = tmp_path / "snake.urdf"
    joints = [("r", (0, 0, 1), (0.0, 0.0, 0.05))] * 17
    file.write_text(urdf(joints))
    with pytest.raises(ConfigError, match=r"snake\.urdf: the arm has 17 joints, allowed: up to 16; use"):
        NewRobot(file).write(tmp_path / "made")
    for way in ({"without": ["a16"]}, {"actuators": ["a0", "a1"]}):
        folder = tmp_path / next(iter(way))
        NewRobot(file, **way).write(folder)
        assert load_robot(load_settings(folder / "cobot-setting.yaml")).limits.dof in (16, 2)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("", "", ""),
        (
            "0.0 0.0 0.3",
            "0.0 0.0 300",
            "the origins of the moving links add up to 600.1 m, which looks like millimetres",
        ),
        (
            "</robot>",
            '<mujoco><option gravity="0 0 0"/></mujoco></robot>',
            "gravity is that of the file: 0, 0, 0 m/s² along x, y, z of the world",
        ),
    ],
)
def test_origins_in_millimetres_and_another_gravity_are_reported(
    tmp_path: Path, old: str, new: str, sentence: str
) -> None:
    file = tmp_path / "arm.urdf"
    text = urdf([("r", (0, 0, 1), (0.0, 0.0, 0.3)), ("r", (0, 1, 0), (0.0, 0.0, 0.3))])
    assert old in text
    file.write_text(text.replace(old, new))
    new_robot = NewRobot(file)
    new_robot.write(tmp_path / "made")
    said = [each for each in new_robot.guessed if "add up to" in each or "gravity" in each]
    assert [each[: len(sentence)] for each in said] == ([sentence] if sentence else []), said


@pytest.mark.parametrize(
    ("soft", "range_told"),
    [
        ('soft_lower_limit="-1" soft_upper_limit="1.5"', "-1 to 1.5"),
        ('soft_upper_limit="1.5"', "-2.9 to 1.5"),
        ('soft_lower_limit="-2.9" soft_upper_limit="2.9"', ""),
        ("", ""),
    ],
)
def test_narrower_soft_limits_are_reported(tmp_path: Path, soft: str, range_told: str) -> None:
    file = tmp_path / "arm.urdf"
    text = urdf([("r", (0, 0, 1), (0.0, 0.0, 0.3)), ("r", (0, 1, 0), (0.0, 0.0, 0.3))])
    file.write_text(text.replace("<limit ", f'<safety_controller k_velocity="10" {soft}/><limit ', 1))
    new_robot = NewRobot(file)
    new_robot.write(tmp_path / "made")
    said = [each for each in new_robot.guessed if "soft limits" in each]
    assert len(said) == bool(range_told)
    assert all(each.startswith(f"a0: <safety_controller> has soft limits of {range_told},") for each in said)


def test_links_of_which_always_some_shapes_touch_may_touch(tmp_path: Path) -> None:
    """A ring of spheres turns past one of the forearm: which of them touches it depends on the joints."""
    ring = "".join(
        f'<geom size=".02" pos="{0.05 * np.cos(angle):.5f} 0 {0.05 * np.sin(angle):.5f}"/>'
        for angle in np.arange(12) * np.pi / 6.0
    )
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><compiler angle="radian"/><worldbody><body name="stand"><geom size="0.02"/>'
        '<body name="one" pos="0 0 .3"><joint name="j" range="-1.5 1.5"/><geom size=".01" pos=".25 0 0"/>'
        '<body name="two" pos=".3 0 0"><joint name="k" axis="0 1 0" range="-1.5 1.5"/>'
        '<inertial pos="0 .1 0" mass=".1" diaginertia="1e-4 1e-4 1e-4"/>'
        f'<body name="three"><joint name="l" axis="0 1 0" range="-1.5 1.5"/>{ring}<site name="tcp"/></body>'
        "</body></body></body></worldbody></mujoco>"
    )
    new = NewRobot(file)
    new.write(tmp_path / "made")
    assert "one and three may touch, because they do in each of 500 positions" in new.guessed
    robot = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml"))
    assert robot.collision.is_free(np.zeros(3))


def test_shapes_that_a_file_pairs_by_name_are_kept_apart(tmp_path: Path) -> None:
    """Oracle: MuJoCo's contacts. The file gives its shapes no other way to collide."""
    file = tmp_path / "arm.xml"
    file.write_text(
        '<mujoco><compiler angle="radian"/><default><geom contype="0" conaffinity="0"/></default><worldbody>'
        '<geom name="floor" type="plane" size="1 1 .1"/><body name="base"><geom size=".05"/>'
        '<body name="one" pos="0 0 .3"><joint name="j" axis="0 1 0" range="-3 3"/>'
        '<geom name="rod" type="capsule" size=".02" fromto="0 0 .06 0 0 .4"/><site name="tcp" pos="0 0 .4"/>'
        '</body></body></worldbody><contact><pair geom1="rod" geom2="floor"/></contact></mujoco>'
    )
    new = NewRobot(file)
    new.write(tmp_path / "made")
    assert not [each for each in new.guessed if "no collision shape" in each]
    robot = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml"))
    data = mujoco.MjData(robot.model.mj)
    for angle in np.linspace(-2.9, 2.9, 30):
        data.qpos[:] = angle
        mujoco.mj_forward(robot.model.mj, data)
        deep = bool(data.ncon) and data.contact.dist.min() < 0.0
        if abs(abs(angle) - 2.4) > 0.2:  # Elsewhere the margin of cobot decides.
            assert robot.collision.is_free(np.array([angle])) == (not deep)
    assert {each.first for each in robot.collision.contacts(np.array([2.9]))} == {"floor"}


@pytest.mark.parametrize("name", ["floor", ""])
def test_a_floor_that_a_turning_base_is_always_near_may_touch_that_link_alone(
    tmp_path: Path, name: str
) -> None:
    """Oracle: the drawing. The lower link is 3 mm above the floor in each posture, the upper one can reach
    it, and another solid of the surroundings is not allowed to be touched.
    """
    floor = f'<geom name="{name}" type="plane" size="1 1 .1"/>'.replace('name="" ', "")
    file = tmp_path / "arm.xml"
    file.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody>{floor}<geom name="post" pos=".12 0 .053" size=".02"/>'
        '<body name="base"><body name="one" pos="0 0 .053"><joint name="j" range="-1.5 1.5"/>'
        '<geom size=".05"/><body name="two" pos="0 0 .1"><joint name="k" axis="0 1 0" range="-3 3"/>'
        '<geom type="capsule" size=".02" fromto="0 0 .1 0 0 .3"/><site name="tcp" pos="0 0 .3"/></body>'
        "</body></body></worldbody></mujoco>"
    )
    new = NewRobot(file)
    new.write(tmp_path / "made")
    told = name or "the surroundings"
    assert f"{told} and one may touch, because they do in each of 500 positions" in new.guessed
    robot = load_robot(load_settings(tmp_path / "made" / "cobot-setting.yaml"))
    assert robot.collision.is_free(np.zeros(2))
    touching = {each.first for each in robot.collision.contacts(np.array([0.0, 2.9]))}
    assert touching == {told}
    assert frozenset(("one", "post")) in {frozenset(robot.collision.names(pair)) for pair in range(3)}


def test_no_acceleration_is_guessed_from_a_velocity_that_is_a_placeholder(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text(urdf(ARMS["ur"]).replace('velocity="1.5"', 'velocity="10000"', 1))
    new = NewRobot(file)
    new.write(tmp_path / "made")
    guessed = new.guessed
    assert (
        "a0: acceleration limited to 100 rad/s², though the file gives a velocity of 10000 rad/s" in guessed
    )
    limits = yaml.safe_load((tmp_path / "made" / "joint_limits.yaml").read_text())["joint_limits"]
    rates = [[limits[name][f"max_{rate}"] for rate in RATES] for name in ("a0", "a1")]
    assert rates == [[10000.0, 100.0, 1000.0], [1.5, 6.0, 60.0]]


def test_cobot_run_moves_the_gantry(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["gantry"]))
    made = tmp_path / "made"
    NewRobot(tmp_path / "arm.urdf").write(made)
    robot = load_robot(load_settings(made / "cobot-setting.yaml"))
    pose = robot.model.forward(np.array([0.25, 0.15, 0.3, 0.5, 0.6, 0.3]))
    a, b, c = Rotation.from_quat(pose.quaternion, scalar_first=True).as_euler("ZYX")
    line = dict(zip("xyzabc", map(float, (*pose.position, a, b, c)), strict=True))
    running = RunOfFolder(made)
    try:
        running.until(running.healthy)
        for path, goal in (
            ("joints", {"joints": [0.2, 0.1, 0.2, 0.5, 0.6, 0.3], "planner": "ptp"}),
            ("pose", line | {"planner": "lin"}),
            ("joints", {"joints": [-0.2, 0.1, -0.2, 0.4, 0.5, 0.1], "planner": "ompl"}),
        ):
            answer = httpx.post(f"{running.url}/robot/move/{path}", json=goal | {"speed": 1.0}, timeout=60.0)
            assert answer.json().get("success"), answer.text
    finally:
        running.process.terminate()
        running.process.wait(30.0)


def test_the_folder_has_its_meshes_and_may_be_moved(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]], dtype="<f4")
    faces = [
        bytes(12) + corners[list(face)].tobytes() + bytes(2) for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2))
    ]
    package = tmp_path / "parts" / "meshes"
    package.mkdir(parents=True)
    last = bytes(12) + corners[[1, 2, 3]].tobytes() + bytes(2)
    (package / "a.stl").write_bytes(bytes(80) + (4).to_bytes(4, "little") + b"".join([*faces, last]))
    mesh = '<mesh filename="package://parts/meshes/a.stl"/>'
    (tmp_path / "arm.urdf").write_text(urdf(ARMS["ur"]).replace('<sphere radius="0.03"/>', mesh, 2))
    NewRobot(tmp_path / "arm.urdf", packages=[tmp_path]).write(tmp_path / "made")
    (package / "a.stl").unlink()
    (tmp_path / "made").rename(tmp_path / "moved")
    assert load_robot(load_settings(tmp_path / "moved" / "cobot-setting.yaml")).model.mj.nmesh == 1
