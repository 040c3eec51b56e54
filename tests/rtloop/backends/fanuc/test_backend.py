"""The backend against a simulated controller, a period at a time.

Oracle: what the controller says of its arm, and of what it was sent.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from crx_arm import JOINT_2_HEIGHT_M
from folders import ROOT
from lockstep_fanuc import BENT, Driven

from cobot.config import Settings, load_settings
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool
from cobot.types import Array
from rtloop.backends import BackendError, CarriesTool, HasIo, Paced, Reporting, Stepwise
from rtloop.backends.fanuc import FanucBackend
from rtloop.backends.fanuc.codec import decode_received, decode_sent, encode_status
from rtloop.backends.fanuc.messages import CommandPacket, ContactStop, StatusPacket
from rtloop.backends.fanuc.options import FanucOptions
from rtloop.backends.fanuc.simulator.controller import CONTACT, E_STOP, FENCE
from rtloop.backends.fanuc.simulator.options import FanucControllerOptions
from rtloop.backends.fanuc.worker import RmiWorker

Made = Callable[..., Settings]


def commands(driven: Driven) -> list[CommandPacket]:
    decoded = map(decode_sent, driven.channel.sent)
    return [each for each in decoded if isinstance(each, CommandPacket)]


def test_it_moves_the_arm(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open()
    backend = driven.backend
    assert isinstance(backend, Paced)
    assert isinstance(backend, Reporting)
    assert isinstance(backend, Stepwise)
    assert isinstance(backend, CarriesTool)
    assert isinstance(backend, HasIo)
    assert commands(driven) == []  # nothing before it is enabled
    driven.enable().move(1, 0.3)
    np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-6)
    np.testing.assert_allclose(driven.measured.position, driven.command[0], atol=0.01)
    assert [each.sequence for each in commands(driven)] == list(
        range(commands(driven)[0].sequence, commands(driven)[-1].sequence + 1)
    )
    assert driven.controller.alarms == []
    status = backend.status()
    assert (status.connection, status.operation_mode, status.packets_lost) == ("COMMANDING", "AUT", 0)
    backend.disable()
    driven.controller.step()
    assert commands(driven)[-1].is_last
    backend.close()
    assert driven.controller.alarms == []  # it was not stopped in a motion
    assert not driven.controller.streams
    assert not driven.channel.answers.occupied


@pytest.mark.parametrize("period_ms", [1, 2, 4, 8])
def test_every_period_that_it_says(made: Made, arm: RobotDescription, period_ms: int) -> None:
    driven = Driven(made(period_ms), arm).open().enable()
    driven.move(0, 0.1, cycles=800 // period_ms)
    np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-6)


def test_another_period_is_named(made: Made, arm: RobotDescription) -> None:
    with pytest.raises(BackendError, match=r"sends every 4 ms, but rt.period_s is 0.008 s: set it to 0.004"):
        Driven(made(8), arm, FanucControllerOptions(period_ms=4)).open()


@pytest.mark.parametrize("version", [1, 2])
def test_an_old_version_is_named(made: Made, arm: RobotDescription, version: int) -> None:
    with pytest.raises(
        BackendError, match=f"speaks Stream Motion {version}; version 3 or later is needed: update"
    ):
        Driven(made(), arm, FanucControllerOptions(version=version)).open()


def test_version_4_moves_the_arm(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm, FanucControllerOptions(version=4)).open().enable()
    driven.move(5, 0.2)
    assert driven.backend.status().text == "Stream Motion 4, RMI 9.0"
    assert driven.controller.alarms == []


def test_a_state_of_another_version_is_refused_by_name(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.controller.version = 4
    with pytest.raises(
        BackendError,
        match="the status packet has version 4, but the session has version 3: was the controller updated",
    ):
        driven.listen(40)


# Joint 3


@pytest.mark.parametrize("horizon", [False, True])
@pytest.mark.parametrize("check_pose", [False, True])
def test_it_finds_out_what_joint_3_is_measured_from(
    made: Made, arm: RobotDescription, horizon: bool, check_pose: bool
) -> None:
    """By the pose of the face plate, or without it by the other interface."""
    options = FanucControllerOptions(horizon=horizon, table_share=2.0)
    driven = Driven(made(check_pose=check_pose), arm, options).open().enable()
    np.testing.assert_allclose(driven.measured.position, BENT, atol=1e-3)
    for joint in (1, 2):
        driven.move(joint, -0.2)
        np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-9)
    sent = commands(driven)[-1].position
    relative = np.degrees(driven.command[0])
    expected = relative[2] - relative[1] if horizon else relative[2]
    assert sent[2] == pytest.approx(expected)


@pytest.mark.parametrize(("horizon", "asked"), [(False, "horizon"), (True, "relative")])
def test_the_wrong_one_is_refused_with_the_right_one(
    made: Made, arm: RobotDescription, horizon: bool, asked: str
) -> None:
    right = "horizon" if horizon else "relative"
    with pytest.raises(BackendError, match=rf"allowed: .* degrees.* With robot.backend.j3: {right} they"):
        Driven(made(j3=asked), arm, FanucControllerOptions(horizon=horizon, table_share=2.0)).open()


def test_another_arm_is_refused(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm)
    pose = driven.controller.face_plate

    def shorter() -> tuple[float, ...]:
        x, y, z, *turn = pose()
        return (x - 60.0, y, z, *turn)

    driven.controller.face_plate = shorter
    with pytest.raises(BackendError, match=r"60.\d mm and 0.0 degrees apart"):
        driven.open()


@pytest.mark.parametrize("check_pose", [True, False])
@pytest.mark.parametrize("change", [np.radians, np.flip], ids=["radians", "another order"])
def test_joints_in_other_units_or_another_order_are_refused(
    made: Made, arm: RobotDescription, change: Callable[[Array], Array], check_pose: bool
) -> None:
    """By the pose of the face plate, or without it by the other interface."""
    driven = Driven(made(check_pose=check_pose), arm)
    controller, dof = driven.controller, arm.limits.dof
    status = controller.status

    def changed() -> StatusPacket:
        found = status()
        joints = change(np.array(found.joints[:dof])).tolist()
        return replace(found, joints=(*joints, *found.joints[dof:]))

    controller.status = changed
    problem = "the device reports its flange at" if check_pose else "Stream Motion reports axis"
    with pytest.raises(BackendError, match=problem):
        driven.open()
    assert commands(driven) == []


@pytest.mark.parametrize(("asked_m", "good"), [(None, True), (JOINT_2_HEIGHT_M, True), (0.0, False)])
def test_the_world_frame_is_at_the_height_of_joint_2(
    made: Made, arm: RobotDescription, asked_m: float | None, good: bool
) -> None:
    driven = Driven(made(world_z_m=asked_m), arm, FanucControllerOptions(world_z_m=JOINT_2_HEIGHT_M))
    if good:
        driven.open()
    else:
        with pytest.raises(BackendError, match=r"250.0 mm and 0.0 degrees apart"):
            driven.open()


def test_interfaces_that_differ_otherwise_are_named(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(check_pose=False), arm)
    joints = driven.channel.answers._joints
    driven.channel.answers._joints = lambda _: {"JointAngle": {**joints(_)["JointAngle"], "J5": -34.0}}
    with pytest.raises(BackendError, match=r"Stream Motion reports axis 5 at -40.\d+ degrees, the Remote"):
        driven.open()


# Limits


def test_limits_beyond_the_table_are_refused_by_name(made: Made, arm: RobotDescription) -> None:
    options = FanucControllerOptions(table_share=0.8)
    with pytest.raises(BackendError) as found:
        Driven(made(), arm, options).open()
    said = str(found.value)
    allowed = 0.8 * arm.limits.max_velocity[0]
    assert "max_velocity of joint1" in said
    assert f"the table allows {np.floor(1e4 * allowed) / 1e4:.5g} rad/s;" in said
    assert said.endswith("Set joint_limits.yaml to at most these values")
    Driven(made(limits="model"), arm, options).open()


def test_a_heavy_tool_needs_lower_limits(made: Made, arm: RobotDescription) -> None:
    """The simulated table allows half as much again without load."""
    limits = replace(arm.limits, max_acceleration=1.2 * arm.limits.max_acceleration)
    lively = replace(arm, limits=limits)
    driven = Driven(made(rated_payload_kg=10.0), arm)
    backend = FanucBackend(
        made(rated_payload_kg=10.0),
        lively.limits,
        channel=driven.channel,
        rmi=driven.channel.client(),
        clock=driven.channel.clock,
        sleep=driven.channel.sleep,
    )
    backend.open(np.zeros(6))
    backend.set_tool(Tool(mass=5.0))
    with pytest.raises(BackendError, match=r"for 90% of the full payload: max_acceleration of joint1"):
        backend.set_tool(Tool(mass=9.0))


def test_a_controller_without_a_table_is_named(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm)
    hear = driven.controller.hear
    driven.controller.hear = lambda data: b"" if data[3] == 3 else hear(data)
    with pytest.raises(BackendError, match="does not send the velocity limits of axis 1"):
        driven.open()


# Stops and faults


@pytest.mark.parametrize(
    ("cause", "said"),
    [
        (E_STOP, "an emergency stop is pressed"),
        (FENCE, "the controller has an alarm"),
        (CONTACT, "the controller has an alarm"),
    ],
)
def test_a_stop_is_said_and_a_reset_recovers(
    made: Made, arm: RobotDescription, cause: str, said: str
) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.move(0, 0.1)
    driven.controller.press(cause)
    with pytest.raises(BackendError, match=f"the robot does not accept commands: {said}"):
        driven.cycles(3)
    with pytest.raises(BackendError, match=f"the robot does not accept commands: {said}"):
        driven.cycle()  # until a reset
    driven.backend.status()
    driven.backend.wait(0.1)
    text = driven.backend.status().text
    assert {E_STOP: "the emergency stop of the operator panel is pressed: release it (SRVO-001",
            FENCE: "the fence is open: close it (SRVO-004 Fence open)",
            CONTACT: "the controller has detected a collision (SRVO-050"}[cause] in text  # fmt: skip
    with pytest.raises(BackendError, match=r"stop is pressed|the arm's servos are off: .*\(SRVO-0"):
        driven.enable()  # the cause persists
    driven.controller.release(cause)
    driven.enable().move(0, -0.1)
    assert driven.controller.alarms == []
    np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-6)


def test_the_teach_pendant_is_named(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.controller.switch_mode("T1")
    with pytest.raises(BackendError, match=r"the teach pendant is on \(T1 or T2\): select AUTO"):
        driven.cycles(3)
    assert driven.backend.status().operation_mode == "T1"
    with pytest.raises(BackendError, match="select AUTO"):
        driven.enable()
    driven.controller.switch_mode("AUTO")
    driven.enable()
    driven.move(0, 0.1)


def test_a_contact_of_a_collaborative_arm_is_said(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.controller.contact(ContactStop.STOP)
    with pytest.raises(BackendError, match="the collaborative robot has stopped at a contact"):
        driven.cycles(3)
    assert driven.backend.status().safety_stop == "the collaborative robot has stopped at a contact"


def test_the_speed_clamp_is_followed(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.controller.safety_scale = 0.25
    driven.cycle()
    assert driven.backend.status().speed_scaling == 0.25


def test_a_program_that_ends_at_rest_after_enabling_comes_back(made: Made, arm: RobotDescription) -> None:
    """As on a real CRX, a second after it was called."""
    driven = Driven(made(), arm).open().enable()
    driven.cycles(5)
    driven.controller.abort()
    driven.cycles(5)
    driven.controller.call()
    driven.cycles(20)
    driven.move(0, 0.1)
    np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-6)


def test_a_program_that_ends_in_motion_is_a_fault(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.command[1, 0] = 0.1
    driven.cycle()
    driven.controller.abort()
    with pytest.raises(
        BackendError, match="the controller's Stream Motion program is not running, or has ended"
    ):
        driven.cycles(3)
    driven.controller.call()
    with pytest.raises(BackendError, match="program is not running"):
        driven.cycles(50)  # it moves no more by itself


def test_each_cycle_after_an_ended_motion_reports_that_the_arm_does_not_follow(
    made: Made, arm: RobotDescription
) -> None:
    """Also the cycles of lost packets, which have no answer. Otherwise rtloop waits for measured values that
    change, and rejects each reset of an arm that rests.
    """
    driven = Driven(made(), arm).open().enable()
    driven.command[1, 0] = 0.1
    driven.cycle()
    driven.controller.abort()
    with pytest.raises(BackendError, match="program is not running"):
        driven.cycles(3)
    driven.channel.network.drop = 5
    for _ in range(6):
        with pytest.raises(BackendError, match="program is not running"):
            driven.cycle()
    assert driven.backend.status().packets_lost == 5


def test_a_controller_that_begins_with_an_emergency_stop(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm)
    driven.controller.press(E_STOP)
    driven.open()
    driven.backend.enable()  # it does not end the start
    with pytest.raises(BackendError, match="does not accept commands: an emergency stop is pressed"):
        driven.cycle()
    driven.controller.release(E_STOP)
    for _ in range(3):
        driven.backend.wait(0.1)
    driven.enable().move(0, 0.1)


def test_a_reset_connects_again(made: Made, arm: RobotDescription) -> None:
    """The controller was off: no session, another sequence, the alarms of a start."""
    driven = Driven(made(), arm).open().enable()
    driven.move(0, 0.1)
    driven.channel.off = True
    driven.controller.abort()
    driven.controller.streams = False
    with pytest.raises(BackendError, match=r"no packet from the controller for 0.\d+ s: it is off"):
        driven.listen(50)
    driven.channel.off = False
    driven.channel.kill_client()
    driven.enable().move(0, -0.1)
    np.testing.assert_allclose(driven.controller.arm.setpoint, driven.command[0], atol=1e-6)


def test_packets_that_come_twice_or_late_are_counted(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.cycle()
    sent = len(commands(driven))
    state = decode_received(driven.controller.step())
    assert isinstance(state, StatusPacket)
    newer = encode_status(replace(state, sequence=state.sequence + 1))
    driven.channel.injected = [newer, newer, encode_status(state)]
    driven.cycle()
    driven.cycle()
    assert len(commands(driven)) - sent <= 2
    assert "3 packets arrived twice or too late" in driven.backend.status().text


def test_a_command_far_from_the_arm_is_refused(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(), arm).open().enable()
    driven.command[0, 3] += 0.1
    with pytest.raises(
        BackendError, match=r"the first command of joint4 is 0.1000 rad from its position, allowed: 0.02"
    ):
        driven.cycles(2000)


# Requests


def test_what_is_asked_for_before_motion(made: Made, arm: RobotDescription) -> None:
    driven = Driven(made(override=60, payload_schedule=3), arm).open().enable()
    assert driven.controller.override == 60
    driven.channel.sleep(1.5)
    driven.backend.status()
    assert "speed override is 60 %, Stream Motion needs 100 %" in driven.backend.status().text
    with pytest.raises(BackendError, match="select payload schedule 20: this payload schedule does"):
        Driven(made(payload_schedule=20), arm).open().enable()
    with pytest.raises(
        BackendError,
        match=r"the controller's Stream Motion program is not running, or has ended; .*within 10 s",
    ):
        Driven(made(program="OTHER"), arm).open().enable()


def test_outputs_keep_their_values_and_are_set(made: Made, arm: RobotDescription) -> None:
    io = {"DO[1]": 1, "DO[2]": 0, "DI[1]": 1, "AO[1]": 500}
    driven = Driven(made(io=list(io)), arm, FanucControllerOptions(io=io)).open()
    with pytest.raises(BackendError, match=r"DO\[2\] cannot be set: the arm is not enabled"):
        driven.backend.set_output("DO[2]", 1.0)
    driven.enable()
    driven.cycle()
    assert driven.controller.io == io
    assert {each.name: each.value for each in driven.backend.io()} == io
    driven.backend.set_output("DO[2]", 1.0)
    driven.backend.set_output("AO[1]", 501.0)
    driven.cycle()
    driven.cycle()
    assert driven.controller.io == {**io, "DO[2]": 1, "AO[1]": 501}
    assert {each.name: each.value for each in driven.backend.io()} == {**io, "DO[2]": 1, "AO[1]": 501}
    with pytest.raises(BackendError, match=r"DI\[1\] is not one of the outputs"):
        driven.backend.set_output("DI[1]", 0.0)


def test_points_that_do_not_exist_are_named(made: Made, arm: RobotDescription) -> None:
    with pytest.raises(BackendError, match=r"does not report DO\[7\]: this number of an input or output"):
        Driven(made(io=["DO[7]"]), arm).open()
    with pytest.raises(BackendError, match=r"does not accept these inputs and outputs \(error 2\)"):
        Driven(made(io=["DI[7]"]), arm).open()


def test_an_address_is_needed(made: Made, arm: RobotDescription) -> None:
    with pytest.raises(BackendError, match=r"robot.backend.address is missing"):
        FanucBackend(made(), arm.limits).open(np.zeros(6))


def test_nothing_is_there(made: Made, arm: RobotDescription, crx: Settings) -> None:
    driven = Driven(made(), arm)
    driven.channel.off = True
    with pytest.raises(BackendError, match="no Remote Motion Interface on TCP"):
        driven.open()
    driven.channel.off = False
    driven.controller.hear = lambda data: b""
    with pytest.raises(BackendError, match="no Stream Motion on UDP None:60015: is option J519 installed"):
        driven.open()


def test_the_example_has_valid_settings() -> None:
    settings = load_settings(ROOT / "examples" / "fanuc" / "cobot-setting.yaml")
    options = settings.backend_options(FanucOptions)
    assert options is not None
    assert options.address == "127.0.0.1"
    assert settings.rt.period_s in FanucBackend.capabilities.periods_s


def test_requests_are_not_as_urgent_as_the_cycle() -> None:
    """Oracle: the kernel's word. SCHED_BATCH is inherited as SCHED_FIFO is, and any process may have it."""
    worker, seen = RmiWorker(), list[int]()

    def cycle() -> None:
        os.sched_setscheduler(0, os.SCHED_BATCH, os.sched_param(0))
        seen.append(worker.begin(lambda: os.sched_getscheduler(0)).result())

    thread = threading.Thread(target=cycle)
    thread.start()
    thread.join()
    worker.close()
    assert seen == [os.SCHED_OTHER]
