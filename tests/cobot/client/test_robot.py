"""`cobot.Robot` on virtual time: every method that libpyflexiv's README names, by both names.

Oracles: what REST says about the same arm; pinocchio's kinematics; the numbers of joint_limits.yaml.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from independent_models import second_robot
from scipy.spatial.transform import Rotation
from virtual_service import VirtualService

from cobot import CoordType, Mode, Robot
from cobot.client import SWITCHES, RobotStates
from cobot.errors import (
    ConflictError,
    ExecutionError,
    InputError,
    MotionStopped,
    NotReadyError,
    UnavailableError,
)
from cobot.types import LoopMode

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


@pytest.fixture
def robot(service: VirtualService) -> Iterator[Robot]:
    """Connected, IDLE, its arm at home."""
    service.post("/robot/reset")
    service.go_home()
    with Robot(service.name, verbose=False, clock=service.clock, client=service.client) as connected:
        yield connected


def joint_control(robot: Robot, **options: object):  # type: ignore[no-untyped-def]
    robot.SwitchMode(Mode.RT_JOINT_IMPEDANCE)
    return robot.start_joint_impedance_control(**options)


def cartesian_control(robot: Robot, **options: object):  # type: ignore[no-untyped-def]
    robot.SwitchMode(Mode.RT_CARTESIAN_MOTION_FORCE)
    return robot.start_cartesian_control(**options)


@pytest.mark.parametrize("kind", ["none", "linear", "quintic", "ruckig"])
def test_a_first_target_that_is_too_far_away_is_an_error_once(
    robot: Robot, service: VirtualService, kind: str
) -> None:
    with joint_control(robot, inner_control_hz=30, interpolation=kind) as control:
        control.set_target_joints([0.8, *HOME[1:]])
        service.sleep(1 / 30)
        with pytest.raises(
            InputError, match=r"joint1 is at 0.000, but the target is at 0.800: 0.800 apart. A str"
        ):
            control.set_target_joints([0.8, *HOME[1:]])
        for _ in range(30):
            control.set_target_joints([0.8, *HOME[1:]])
            service.sleep(1 / 30)
        np.testing.assert_allclose(control.get_state().q, HOME, atol=2e-3)
        for step in range(30):
            control.set_target_joints([0.002 * step, *HOME[1:]])
            service.sleep(1 / 30)
        assert control.get_state().q[0] > 0.03


# Lifecycle


def test_a_robot_that_is_not_there_is_named_with_those_that_are(service: VirtualService) -> None:
    left = Path(f"/dev/shm/cobot-{service.name}-left.ring")
    left.touch()
    try:
        with pytest.raises(
            UnavailableError, match=f"robot 'Rizon4s-9' is not running.*{service.name}"
        ) as caught:
            Robot("Rizon4s-9", connect_retries=0)
        assert f"{service.name}-left" not in str(caught.value)
    finally:
        left.unlink()


def test_a_mode_is_chosen_though_the_states_lag_behind_the_answer_that_the_arm_has_arrived(
    robot: Robot, service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As they do over a network; an arm that really moves is said to."""
    states, begun_s = robot._transport.state, service.clock.now_s()

    def late() -> np.ndarray:
        state = states()
        if service.clock.now_s() < begun_s + lag_s:
            state["mode"] = LoopMode.TRAJECTORY
        return state

    monkeypatch.setattr(robot._transport, "state", late)
    lag_s = 0.2
    robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
    robot.switch_mode(Mode.IDLE)
    lag_s = math.inf
    with pytest.raises(ConflictError, match="the arm is in mode TRAJECTORY: stop it first"):
        robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)


def test_enable_needs_a_robot_without_a_latch_and_clear_fault_gives_it(
    robot: Robot, service: VirtualService
) -> None:
    robot.Enable()
    with joint_control(robot) as control:
        control.trigger_estop()
        service.until(lambda: not robot.estop_released())
    assert not robot.operational()
    assert not robot.fault()
    with pytest.raises(NotReadyError, match="ESTOP: e-stop requested by the streaming client"):
        robot.Enable()
    with pytest.raises(NotReadyError, match="clear_fault"):
        robot.SwitchMode(Mode.IDLE)
    assert robot.ClearFault(timeout=5)
    robot.enable()
    assert robot.mode() is Mode.IDLE


def test_stop_ends_the_session_and_leaves_the_robot_idle(robot: Robot) -> None:
    control = joint_control(robot)
    assert control.is_running()
    robot.Stop()
    assert not control.is_running()
    assert robot.mode() is Mode.IDLE
    assert robot.stopped()
    with pytest.raises(MotionStopped, match="has been stopped"):
        control.set_target_joints(HOME)


def test_every_mode_is_entered_as_the_table_says(robot: Robot) -> None:
    for mode in SWITCHES[Mode.IDLE]:
        robot.SwitchMode(mode)
        assert robot.mode() is mode
        assert SWITCHES[mode] == SWITCHES[Mode.IDLE]
    with pytest.raises(InputError, match="valid modes: IDLE, NRT_CARTESIAN"):
        robot.SwitchMode(Mode.UNKNOWN)


def test_no_mode_is_entered_while_the_arm_is_streamed_to(robot: Robot) -> None:
    with joint_control(robot), pytest.raises(ConflictError, match="JOINT_IMPEDANCE: stop it first"):
        robot.SwitchMode(Mode.IDLE)


@pytest.mark.parametrize(
    ("mode", "start"),
    [
        (Mode.IDLE, "start_joint_impedance_control"),
        (Mode.RT_JOINT_IMPEDANCE, "start_cartesian_control"),
        (Mode.RT_CARTESIAN_MOTION_FORCE, "start_joint_torque_control"),
    ],
)
def test_a_session_needs_its_mode(robot: Robot, mode: Mode, start: str) -> None:
    robot.SwitchMode(mode)
    with pytest.raises(ConflictError, match=f"the mode is {mode.name}, but this call needs"):
        getattr(robot, start)()


# State


def test_the_accessors_agree_about_an_arm_at_rest(robot: Robot) -> None:
    assert robot.connected()
    assert robot.operational()
    assert robot.estop_released()
    assert robot.stopped()
    for wrong in (robot.fault, robot.busy, robot.reduced, robot.recovery):
        assert not wrong()


def test_every_field_of_the_states_means_something(robot: Robot, service: VirtualService) -> None:
    states = robot.states()
    vectors = [getattr(states, name) for name in RobotStates.__slots__ if name != "gripper"]
    assert [len(each) for each in vectors] == [7] * 9 + [6, 7, 6, 6, 6]
    assert states.gripper is None, "this robot has none"
    rest = service.get("/robot/joint_states").json()
    np.testing.assert_allclose(states.q, rest["position"], atol=1e-4)
    assert states.theta == states.q
    assert states.dtheta == states.dq
    position, matrix = second_robot().forward(np.array(states.q))
    turn = Rotation.from_matrix(matrix)
    np.testing.assert_allclose(states.tcp_pose[:3], position, atol=1e-6)
    assert (Rotation.from_quat(states.tcp_pose[3:], scalar_first=True).inv() * turn).magnitude() < 1e-5
    np.testing.assert_allclose(states.flange_pose, states.tcp_pose, atol=1e-9)  # the TCP is the flange
    np.testing.assert_allclose(states.tau, second_robot().gravity(np.array(states.q)), atol=1.0)
    np.testing.assert_allclose(states.tau_des, states.tau, atol=0.5)
    for still in (states.tau_ext, states.ext_wrench_in_tcp, states.ext_wrench_in_world, states.dq):
        np.testing.assert_allclose(still, 0.0, atol=0.5)
    assert np.linalg.norm(states.ft_sensor_raw[:3]) == pytest.approx(0.3 * 9.81, rel=0.05)  # link 7's weight


def test_the_flange_stays_where_it_is_when_the_tool_changes(robot: Robot, service: VirtualService) -> None:
    """The TCP moves by the tool's length along the flange's z; the arm has not moved."""
    before = robot.states()
    length_m = 0.2
    try:
        assert service.post("/robot/tool", {"tcp": {"z": length_m}}).status_code == 200
        after = robot.states()
    finally:
        assert service.post("/robot/tool", {"tcp": {}}).status_code == 200
    np.testing.assert_allclose(after.flange_pose, before.flange_pose, atol=1e-6)
    there = np.subtract(after.tcp_pose[:3], before.tcp_pose[:3])
    turned = Rotation.from_quat(before.flange_pose[3:], scalar_first=True).apply([0.0, 0.0, length_m])
    np.testing.assert_allclose(there, turned, atol=1e-6)


def test_what_stays_as_it_is(robot: Robot, service: VirtualService) -> None:
    info = robot.info()
    assert (info.serial_num, info.model_name, info.DoF) == (service.name, "iiwa14", 7)
    assert info.q_max == [2.97, 2.1, 2.97, 2.1, 2.97, 2.1, 3.05]
    assert info.q_min == [-limit for limit in info.q_max]
    assert info.dq_max[0] == 1.4835
    assert info.tau_max == [320.0, 320.0, 176.0, 176.0, 110.0, 40.0, 40.0]
    assert min(info.K_q_nom) > 400.0
    assert min(info.K_x_nom[:3]) > 5000.0


def test_a_plan_that_is_unknown_or_out_of_place_is_refused(robot: Robot) -> None:
    with pytest.raises(ConflictError, match="NRT_PLAN_EXECUTION; call switch_mode first"):
        robot.ExecutePlan("PLAN-Home")
    robot.SwitchMode(Mode.NRT_PLAN_EXECUTION)
    with pytest.raises(InputError, match="valid names: PLAN-Home, PLAN-Work"):
        robot.ExecutePlan("PLAN-Lunch")


@pytest.mark.parametrize(
    ("name", "params", "sentence"),
    [
        ("Dance", {}, "no primitive 'Dance'; valid names: Home"),
        ("MoveJ", {}, "MoveJ: target is missing"),
        ("MoveJ", {"target": HOME[:6]}, "target must have 7 numbers"),
        ("MoveL", {"target": HOME[:6]}, "target must have 7 numbers"),
    ],
)
def test_a_wrong_primitive_says_what_is_right(
    robot: Robot, name: str, params: dict[str, object], sentence: str
) -> None:
    robot.SwitchMode(Mode.NRT_PRIMITIVE_EXECUTION)
    with pytest.raises(InputError, match=sentence):
        robot.ExecutePrimitive(name, params)


# Impedance and contact


@pytest.mark.parametrize(
    ("call", "arguments", "sentence"),
    [
        ("SetJointImpedance", ([1e6] * 7, [0.7] * 7), "K_q must be above 0 and at most"),
        ("SetJointImpedance", ([100.0] * 6,), "K_q must have 7 numbers"),
        ("SetJointImpedance", ([100.0] * 7, [2.0] * 7), "Z_q must be from 0.3 to 1"),
        ("SetCartesianImpedance", ([0.0] * 6,), "K_x must be above 0"),
        ("SetCartesianImpedance", ([100.0] * 6, [math.nan] * 6), "Z_x must be finite"),
        ("SetMaxContactWrench", ([-1.0] * 6,), "wrench must be above 0"),
        ("SetMaxContactTorque", ([1.0] * 6,), "torques must have 7 numbers"),
        ("SetForceControlAxis", ([1, 0, 0, 0, 0, 0],), "six True or False values"),
        ("SetForceControlAxis", ([True] * 6, [0.0] * 3), "max_vel must be above 0"),
        ("SetForceControlFrame", (CoordType.TCP, [0.0] * 7), "quaternion of T must have length 1"),
        ("SetNullSpacePosture", ([9.0] * 7,), "ref_pos must be from"),
    ],
)
def test_settings_that_make_no_sense_are_refused(
    robot: Robot, call: str, arguments: tuple[object, ...], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        getattr(robot, call)(*arguments)


def test_a_session_takes_all_that_was_set(robot: Robot) -> None:
    robot.SetJointImpedance(K_q=[3000, 3000, 800, 800, 200, 200, 200], Z_q=[0.7] * 7)
    robot.SetCartesianImpedance([3000, 3000, 3000, 200, 200, 200])
    robot.SetMaxContactWrench([100.0] * 6)
    robot.SetMaxContactTorque([80.0] * 7)
    robot.SetForceControlAxis([False, False, True, False, False, False], [0.1, 0.1, 0.1])
    robot.SetForceControlFrame(CoordType.TCP)
    robot.SetNullSpacePosture(HOME)
    with cartesian_control(robot) as control:
        control.set_target_pose(control.get_state().tcp_pose, wrench=[0.0] * 6)
        assert robot.mode() is Mode.RT_CARTESIAN_MOTION_FORCE
    with joint_control(robot):
        assert robot.mode() is Mode.RT_JOINT_IMPEDANCE


# Joint control


def test_joints_follow_what_is_streamed(robot: Robot, service: VirtualService) -> None:
    with joint_control(robot, inner_control_hz=100) as control:
        for step in range(100):
            control.set_target_joints(
                [0.001 * step, *HOME[1:]], velocities=[0.1] + [0.0] * 6, accelerations=[0.0] * 7
            )
            service.sleep(0.01)
        service.until(lambda: abs(control.get_state().q[0] - 0.099) < 5e-3)
        state = control.get_state()
        assert len(state.dq) == len(state.tau) == len(state.tau_ext) == len(state.tcp_pose) == 7
    assert robot.mode() is Mode.RT_JOINT_IMPEDANCE
    assert not control.is_running()


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (([0.0] * 6,), "positions must have 7 numbers"),
        (([math.nan] * 7,), "positions must be finite"),
        ((HOME, [0.0] * 3), "velocities must have 7 numbers"),
        ((HOME, [], [math.inf] * 7), "accelerations must be finite"),
    ],
)
def test_a_wrong_target_is_refused_and_the_session_goes_on(
    robot: Robot, arguments: tuple[list[float], ...], sentence: str
) -> None:
    with joint_control(robot) as control:
        with pytest.raises(InputError, match=sentence):
            control.set_target_joints(*arguments)
        assert control.is_running()
        control.set_target_joints(HOME)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"inner_control_hz": 0}, "inner_control_hz must be from 1 to 1000, got 0"),
        ({"inner_control_hz": 2000}, "inner_control_hz must be from 1 to 1000, got 2000"),
        ({"interpolation": "cubic"}, "valid values: none, linear, quintic, ruckig"),
    ],
)
def test_a_session_that_makes_no_sense_is_refused(
    robot: Robot, options: dict[str, object], sentence: str
) -> None:
    with pytest.raises(InputError, match=sentence):
        joint_control(robot, **options)


def test_only_one_session_at_a_time(robot: Robot, service: VirtualService) -> None:
    with joint_control(robot), pytest.raises((ConflictError, ExecutionError), match="JOINT_IMPEDANCE"):
        robot.start_joint_impedance_control()


def test_an_exception_in_the_block_brings_the_arm_to_rest(robot: Robot) -> None:
    with pytest.raises(ZeroDivisionError), joint_control(robot) as control:
        control.set_target_joints([0.005 / 0, *HOME[1:]])
    assert not control.is_running()
    assert robot.stopped()


def test_a_chunk_is_played_on_the_robots_clock(robot: Robot, service: VirtualService) -> None:
    with joint_control(robot) as control:
        begin_s = robot.clock_s() + 0.1
        times = [begin_s + step / 30 for step in range(30)]
        control.set_chunk(times, [[0.05 * (step / 30) ** 2, *HOME[1:]] for step in range(30)])
        service.until(lambda: control.get_state().q[0] > 0.04)
        with pytest.raises(InputError, match="must increase"):
            control.set_chunk(times[::-1], [HOME] * 30)
        with pytest.raises(InputError, match="from 1 to 64 points"):
            control.set_chunk([], [])


def test_torques_move_the_arm(robot: Robot, service: VirtualService) -> None:
    robot.SwitchMode(Mode.RT_JOINT_TORQUE)
    with robot.start_joint_torque_control() as control:
        for _ in range(50):
            control.set_target_torques([2.0] + [0.0] * 6)
            service.sleep(0.01)
        assert control.get_state().q[0] > 0.02
        with pytest.raises(InputError, match="torques must have 7 numbers"):
            control.set_target_torques([1.0])


# Cartesian control


def test_the_tcp_follows_what_is_streamed(robot: Robot, service: VirtualService) -> None:
    with cartesian_control(robot, inner_control_hz=100, interpolate_cmds=True) as control:
        begin = control.get_state().tcp_pose
        for step in range(100):
            pose = list(begin)
            pose[1] += 0.0005 * step
            control.set_target_pose(pose, velocity=[0.0, 0.05, 0.0, 0.0, 0.0, 0.0], acceleration=[0.0] * 6)
            service.sleep(0.01)
        service.until(lambda: abs(control.get_state().tcp_pose[1] - pose[1]) < 2e-3)
        state = control.get_state()
        assert len(state.tcp_vel) == len(state.ext_wrench_in_tcp) == len(state.ext_wrench_in_world) == 6
        assert len(state.ft_sensor_raw) == 6
        assert len(state.q) == len(state.tau_ext) == 7


def test_a_move_returns_at_once_and_states_flow_while_it_runs(robot: Robot, service: VirtualService) -> None:
    with cartesian_control(robot) as control:
        goal = control.get_state().tcp_pose
        goal[2] -= 0.05
        control.move_to_pose(goal, duration_sec=1.0)
        assert control.is_moving()
        heights = []
        while control.is_moving():
            heights.append(control.get_state().tcp_pose[2])
            service.sleep(0.01)
        assert len(heights) > 20
        assert np.ptp(heights) > 0.04
        service.until(lambda: abs(control.get_state().tcp_pose[2] - goal[2]) < 1e-3)
        control.set_target_pose(goal)


def test_a_move_can_be_waited_for_and_cancelled(robot: Robot, service: VirtualService) -> None:
    with cartesian_control(robot) as control:
        begin = control.get_state().tcp_pose
        goal = list(begin)
        goal[1] += 0.1
        assert control.move_to_pose_sync(goal, duration_sec=1.0)
        assert not control.move_to_pose_sync(begin, duration_sec=3.0, timeout_sec=0.2)
        control.cancel_move()
        service.until(lambda: not control.is_moving())
        service.until(robot.stopped)
        assert begin[1] < control.get_state().tcp_pose[1] <= goal[1] + 1e-3


@pytest.mark.parametrize(
    ("pose", "duration", "sentence"),
    [
        ([0.4, 0.0, 0.5], 1.0, "pose must have 7 numbers"),
        ([0.4, 0.0, 0.5, 0.0, 0.0, 0.0, 0.0], 1.0, "quaternion"),
        ([0.4, 0.0, 0.5, 0.5, 0.0, 0.0, 0.0], 1.0, "length 1"),
        ([0.4, 0.0, 0.5, 1.0, 0.0, 0.0, 0.0], 0.0, "duration of a move must be from 0.001 to 600 s, got 0"),
    ],
)
def test_a_wrong_move_is_refused(robot: Robot, pose: list[float], duration: float, sentence: str) -> None:
    with cartesian_control(robot) as control:
        with pytest.raises(InputError, match=sentence):
            control.move_to_pose(pose, duration)
        assert control.is_running()


def test_both_names_are_one_method() -> None:
    for camel, snake in {
        "Enable": "enable",
        "Stop": "stop",
        "ClearFault": "clear_fault",
        "SwitchMode": "switch_mode",
        "ExecutePlan": "execute_plan",
        "ExecutePrimitive": "execute_primitive",
        "SetJointImpedance": "set_joint_impedance",
        "SetCartesianImpedance": "set_cartesian_impedance",
        "SetMaxContactWrench": "set_max_contact_wrench",
        "SetMaxContactTorque": "set_max_contact_torque",
        "SetForceControlAxis": "set_force_control_axis",
        "SetForceControlFrame": "set_force_control_frame",
        "SetNullSpacePosture": "set_null_space_posture",
    }.items():
        assert getattr(Robot, camel) is getattr(Robot, snake)
