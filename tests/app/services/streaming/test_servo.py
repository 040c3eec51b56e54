"""Servo sessions in the service, on the stepped cycle: messages in, motion out, who owns the arm meanwhile.

Oracle: the manual's client script (its messages, in its order); the arm's commanded position on the virtual
clock; pinocchio's forward kinematics for Cartesian points.
"""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from independent_models import second_robot
from rig import Rig
from servo_bench import Bench, Run, runner

from app.services.rights.claims import Caller
from cobot.config import Settings
from cobot.errors import ConflictError, InputError, LimitError, UnreachableError
from cobot.robot.description import RobotDescription
from cobot.types import Array, LoopMode


@pytest.fixture
def run(rig: Rig, robot: RobotDescription, settings: Settings) -> Run:
    return runner(rig, robot, settings)


@pytest.mark.parametrize("mode", range(1, 8))
def test_the_manuals_client_brings_the_arm_to_its_end_in_every_mode(run: Run, mode: int) -> None:
    async def test(bench: Bench) -> None:
        start = bench.rig.home
        goal = start + 0.1
        steps = 20
        points = (
            [start] * 10 + [start + (goal - start) * k / steps for k in range(1, steps + 1)] + [goal] * 10
        )
        bench.set_mode(mode, send_period=0.02)
        await bench.active()
        for point in points:
            bench.point(point, time=0.02, lookahead_time=0.1, gain=200.0, point_type="joint")
            await bench.cycles(20)
        await bench.cycles(200)
        values = bench.servo.feedback()
        bench.stop()
        assert (values["points_accepted"], values["points_refused"]) == (40, 0)
        await bench.idle()
        np.testing.assert_allclose(bench.rig.commanded[-1], goal, atol=3e-3)
        assert bench.servo.reason == "stopped by servo_control"
        for share in bench.rig.rates():
            assert share.max() <= 1.011

    run(test)


def test_points_that_come_while_the_session_begins_are_not_lost(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(3, watchdog_timeout=5.0)
        for number in range(50):
            bench.point(bench.rig.home + 1e-4 * number)
        values = bench.servo.feedback()
        assert (values["state"], values["points_accepted"], values["buffered"]) == ("opening", 50, 50)
        await bench.active()
        await bench.cycles(1500)
        values = bench.servo.feedback()
        assert (values["points_taken"], values["buffered"], values["underruns"]) == (50, 0, 1)
        np.testing.assert_allclose(bench.rig.commanded[-1], bench.rig.home + 49e-4, atol=1e-6)

    run(test)


def test_a_session_owns_the_arm_until_it_rests(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1)
        await bench.active()
        caller = Caller("somebody", None, bench.ownership.stops, 1.0, asyncio.Event())
        with pytest.raises(ConflictError, match="in use by a servo session"), bench.ownership.claim(caller):
            pass
        bench.stop()
        await bench.idle()
        with bench.ownership.claim(caller):
            bench.set_mode(1)
            await bench.until(lambda: not bench.servo.active)
            values = bench.servo.feedback()
            assert values["refused"] == {"rejected": 1}
            assert "in use by somebody" in values["reason"]

    run(test)


def test_who_lets_go_of_the_arm_within_a_moment_is_waited_for(run: Run) -> None:
    async def test(bench: Bench) -> None:
        caller = Caller("a motion", None, bench.ownership.stops, 1.0, asyncio.Event())
        with bench.ownership.claim(caller):
            bench.set_mode(2)
            await bench.cycles(20)
            assert bench.servo.feedback()["state"] == "opening"
        await bench.active()

    run(test)


def test_a_stop_ends_the_session_and_the_feedback_says_so(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1)
        await bench.active()
        bench.point(bench.rig.home + 0.2)
        await bench.cycles(300)
        stopped = await bench.done(bench.stopping.stop(5.0))
        assert stopped.at_rest
        await bench.idle()
        assert bench.servo.reason == "stop requested"
        bench.point(bench.rig.home)
        assert bench.servo.feedback()["refused"] == {"not_active": 1}

    run(test)


def test_the_watchdog_ends_the_session(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1, watchdog_timeout=0.1)
        await bench.active()
        await bench.cycles(50)
        assert bench.servo.active
        await bench.idle()
        assert bench.servo.reason == "servo watchdog: no point for 0.1 s"

    run(test)


def test_a_stop_while_the_session_begins_leaves_none(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(3)
        bench.point(bench.rig.home)
        await asyncio.sleep(0)
        bench.stop()
        await bench.idle()
        await bench.cycles(100)
        assert bench.rig.mode is LoopMode.HOLD
        assert not bench.servo.active

    run(test)


def test_set_mode_in_a_session_begins_another_one_and_its_points_wait_for_it(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1)
        await bench.active()
        bench.point(bench.rig.home + 0.05)
        await bench.cycles(100)
        first = bench.streams.session
        bench.set_mode(5, watchdog_timeout=5.0)
        bench.point(bench.rig.home, session_id=3)
        bench.point(bench.rig.home + 0.01, session_id=3)
        assert bench.servo.feedback()["state"] == "opening"
        await bench.active()
        assert bench.streams.session is not first
        await bench.until(lambda: bench.servo.feedback()["points_taken"] == 2)
        await bench.cycles(2000)
        np.testing.assert_allclose(bench.rig.commanded[-1], bench.rig.home + 0.01, atol=1e-6)
        assert bench.servo.feedback()["session_id"] == 3

    run(test)


def test_a_stop_before_the_next_session_has_begun_is_for_that_too(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1)
        await bench.active()
        bench.point(bench.rig.home + 0.3)
        await bench.cycles(200)
        bench.set_mode(5)
        bench.point(bench.rig.home + 0.3)
        await bench.cycles(10)
        assert bench.rig.loop.controller.moving  # the first one comes to rest
        stopped = asyncio.ensure_future(bench.stopping.stop(3.0))
        await bench.until(stopped.done)
        at = bench.rig.commanded[-1]
        await bench.cycles(500)
        assert (bench.rig.mode, bench.servo.active) == (LoopMode.HOLD, False)
        assert "a stop has been requested in the meantime" in bench.servo.reason
        np.testing.assert_array_equal(bench.rig.commanded[-1], at)

    run(test)


def test_force_control_goes_on_after_a_session_that_followed_one_of_mode_6(run: Run) -> None:
    async def test(bench: Bench) -> None:
        await bench.done(bench.force.enable())
        bench.set_mode(6)
        await bench.active()
        bench.set_mode(5)
        await bench.active()
        assert bench.rig.mode is LoopMode.JOINT_IMPEDANCE
        bench.set_mode(0)
        await bench.until(lambda: bench.rig.mode is LoopMode.CARTESIAN)
        await bench.done(bench.force.disable())

    run(test)


def test_force_control_is_not_enabled_any_more_after_an_estop_of_its_session_and_a_reset(run: Run) -> None:
    async def test(bench: Bench) -> None:
        await bench.done(bench.force.enable())
        bench.set_mode(6)
        await bench.active()
        bench.link.request_estop()
        await bench.until(lambda: bench.servo.feedback()["state"] == "idle")
        await bench.done(bench.link.commands.reset(1.0))
        await bench.until(lambda: not bench.force.settings.enabled)
        assert bench.force.reason == "a stop was requested"
        await bench.cycles(300)
        assert bench.rig.mode is LoopMode.HOLD

    run(test)


def test_mode_0_leaves(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(4)
        await bench.active()
        bench.set_mode(0)
        await bench.idle()
        assert bench.servo.reason == "ended by mode 0"
        assert bench.servo.feedback()["mode"] == 0

    run(test)


def test_more_points_than_the_buffer_holds_are_refused_and_counted(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(3)
        await bench.active()
        for _ in range(1100):
            bench.point(bench.rig.home, time=0.1)
        values = bench.servo.feedback()
        assert (values["points_accepted"], values["overruns"]) == (1024, 76)
        assert values["last_refusal"] == "the buffer is full, because 1024 points wait in it"
        await bench.cycles(300)
        bench.point(bench.rig.home)  # the numbers of the refused ones do not count
        assert bench.servo.feedback()["points_accepted"] == 1025

    run(test)


@pytest.mark.parametrize("mode", [2, 3])
def test_a_first_point_that_is_too_far_away_is_the_last_refusal(run: Run, mode: int) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(mode)
        await bench.active()
        for _ in range(20):
            bench.point(bench.rig.home + 0.8 * np.eye(7)[0], time=0.01)
            await bench.cycles(10)
        values = bench.servo.feedback()
        assert (values["points_taken"], values["jumps"] > 0) == (0, True)
        assert values["last_refusal"].startswith("the first point of the session is too far from the arm")
        bench.point(bench.rig.home, time=0.01)
        await bench.cycles(100)
        assert bench.servo.feedback()["last_refusal"] == "", "once one is taken it is over"

    run(test)


def pose_numbers(robot: RobotDescription, joints: Array, offset: Array) -> list[float]:
    pose = robot.model.forward(joints)
    rz, ry, rx = pose.abc
    return [*(pose.position + offset), rx, ry, rz]


def test_cartesian_points_are_followed_on_one_branch(run: Run, robot: RobotDescription) -> None:
    async def test(bench: Bench) -> None:
        other = second_robot()
        bench.set_mode(3)
        await bench.active()
        for number in range(200):
            phase = 2.0 * np.pi * number / 200
            ease = 0.5 - 0.5 * np.cos(phase)
            offset = 0.05 * ease * np.array([np.sin(phase), np.cos(phase), 0.5])
            bench.point(pose_numbers(robot, bench.rig.home, offset), point_type="cartesian")
            await bench.cycles(10)
            at = other.forward(bench.rig.commanded[-1])[0]
            assert np.linalg.norm(at - robot.model.forward(bench.rig.home).position) < 0.12
        values = bench.servo.feedback()
        assert (values["points_refused"], values["jumps"]) == (0, 0)
        joints = np.array(bench.rig.commanded)
        assert np.abs(joints - bench.rig.home).max() < 0.5  # never to another branch and back

    run(test)


def test_a_pose_out_of_reach_is_refused_and_the_next_one_is_followed(
    run: Run, robot: RobotDescription
) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1)
        await bench.active()
        bench.point([5.0, 0.0, 0.5, 0.0, 0.0, 0.0], point_type=1)
        await asyncio.sleep(0.1)
        bench.point([*pose_numbers(robot, bench.rig.home, np.array([0.0, 0.0, 0.02]))], point_type=1)
        values = bench.servo.feedback()
        assert (values["refused"], values["points_accepted"]) == ({"inverse_kinematics": 1}, 1)
        await bench.cycles(450)
        ends = bench.rig.home, bench.rig.commanded[-1]
        rise = np.diff([robot.model.forward(joints).position for joints in ends], axis=0)[0]
        np.testing.assert_allclose(rise, [0.0, 0.0, 0.02], atol=1e-6)

    run(test)


def test_points_out_of_reach_do_not_keep_the_service_busy(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.set_mode(1)
        await bench.active()
        for _ in range(500):
            bench.point([0.5, 0.0, 1.7, 0.0, 0.0, 0.0], point_type=1)
        values = bench.servo.feedback()
        assert values["refused"] == {"inverse_kinematics": 500}
        assert values["last_refusal"].startswith("the inverse kinematics of this point was not tried")

    run(test)


def test_a_program_gets_the_refusal_as_an_error(run: Run, robot: RobotDescription) -> None:
    async def test(bench: Bench) -> None:
        servo, home = bench.servo, bench.rig.home.tolist()
        with pytest.raises(ConflictError, match="no servo session"):
            await servo.point(home)
        with pytest.raises(InputError, match="from 0 to 7"):
            await servo.begin(9)
        with pytest.raises(InputError, match="watchdog_timeout"):
            await servo.begin(1, 1e9)
        await bench.done(servo.begin(1, 0.5, 0.005))
        assert servo.active
        await servo.point(home, time_s=0.02)
        with pytest.raises(InputError, match="7 numbers"):
            await servo.point(home[:6])
        with pytest.raises(LimitError, match="joint 1"):
            await servo.point([9.0, *home[1:]])
        with pytest.raises(UnreachableError):
            await servo.point([9.0, 0.0, 0.0, 0.0, 0.0, 0.0], cartesian=True)
        await bench.done(servo.begin(0))
        assert not servo.active
        assert bench.rig.mode is LoopMode.HOLD
        bench.rig.request("estops")
        bench.rig.step(5)
        with pytest.raises(Exception, match="ESTOP"):
            await bench.done(servo.begin(1))

    run(test)


def test_fjt_control_is_kept_for_the_action(run: Run) -> None:
    async def test(bench: Bench) -> None:
        bench.send(type="fjt_control", enable=True, fjt_mode=5, fjt_time=0.01)
        fjt = bench.servo.rules.fjt
        assert (fjt.enable, fjt.mode, fjt.time_s, fjt.send_period_s) == (True, 5, 0.01, None)

    run(test)
