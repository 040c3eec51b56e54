"""Arms behind ros2_control, with real ROS 2.

Oracles: controllers made with rclpy (Jazzy, rmw_fastrtps) in a process of their own, which do what the
documentation of the joint trajectory controller says; rclpy's action client for our simulated controllers.
The real controller has not run here.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
import rest_tour
from arm_activities import robot_health
from cobot_run import HELPER_ENVIRONMENT, WAIT_S, Run, answering, require_quick, until
from dds_peers import own_domain
from jazzy_controllers import (
    ACTION,
    JOINTS,
    NAMESPACE,
    PEERS,
    Double,
    RunAtDouble,
    acknowledge,
    motion,
    rclpy_follows,
)
from real_ros import PYTHON, built_packages, controller_packages, environment
from streaming_client import StreamClient

from cobot.config import SETTINGS_FILE, load_settings
from cobot.robot.description import load_robot
from cobot.trajectory import Trajectory
from cobot.types import Array
from rtloop.backends import BackendError, Measured
from rtloop.backends.ros2_control import Ros2ControlArm

pytestmark = [pytest.mark.thorough, pytest.mark.timeout(600)]
REACHED_RAD = 2e-3


@pytest.fixture(scope="module")
def double() -> Iterator[Double]:
    prefix = built_packages(controller_packages())
    with own_domain() as domain:
        made = Double(domain, prefix)
        try:
            yield made
        finally:
            made.kill()


@pytest.fixture
def arm(double: Double) -> Iterator[Ros2ControlArm]:
    """Open and enabled, at controllers that are good."""
    double.be("good")
    double.be("speed 1")
    made = double.arm(result_timeout_s=2.0, connect_s=20.0)
    made.open(np.zeros(7))
    made.stop()
    made.enable()
    yield made
    made.close()


def measured(arm: Ros2ControlArm) -> Array:
    found = Measured(7)
    arm.state(found)
    return found.position.copy()


def begin(arm: Ros2ControlArm, change: float = 0.1, duration_s: float = 1.5) -> Trajectory:
    path, times_s, rows = motion(measured(arm), change, duration_s)
    arm.load(times_s, rows)
    arm.start()
    return path


def follow(arm: Ros2ControlArm, path: Trajectory) -> list[float]:
    """Until it has arrived; the progress of each look. The arm is where the progress says that it is, or was
    there when its last joint state came.
    """
    seen = [0.0]
    while seen[-1] < path.duration_s:
        time.sleep(0.05)
        position = measured(arm)
        seen.append(arm.progress())
        stated_s = max(0.0, seen[-1] - (arm._facts.age_s or 0.0))
        places = path.sample(np.linspace(stated_s, seen[-1], 50))
        assert np.abs(places - position).max(axis=1).min() < 0.05
    return seen


def fails(arm: Ros2ControlArm) -> str:
    """The reason for which it soon cannot be driven."""

    def looked() -> str:
        try:
            measured(arm)
        except BackendError as exc:
            return str(exc)
        time.sleep(0.02)
        return ""

    return str(until(looked))


def recover(arm: Ros2ControlArm, double: Double) -> float:
    """Reset, and a motion that arrives; how long the reset took."""
    begun_s = time.monotonic()
    double.be("good")

    def enabled() -> bool:
        try:
            arm.enable()
        except BackendError:
            return False
        return True

    until(enabled)
    took_s = time.monotonic() - begun_s
    measured(arm)
    follow(arm, begin(arm, -0.05, 1.0))
    return took_s


def test_a_motion_is_followed_as_its_joints_are_named_and_ordered(
    arm: Ros2ControlArm, double: Double
) -> None:
    """Joint states have another order, another joint, and stamps of 1970; then stamps five hours ahead."""
    changes = itertools.cycle((0.2, -0.2))

    def moved() -> float:
        path = begin(arm, next(changes), 2.5)
        begun_s = time.monotonic()
        progress = follow(arm, path)
        took_s = time.monotonic() - begun_s
        assert progress == sorted(progress)
        seen = double.seen()
        assert seen["joints"] == JOINTS
        assert seen["times"] == pytest.approx([0.0, 2.5])
        np.testing.assert_allclose(seen["position"], path.end, atol=1e-6)
        np.testing.assert_allclose(measured(arm), path.end, atol=REACHED_RAD)
        looks = sum(0.0 < each < 2.5 for each in progress)
        return took_s if looks > 10 else math.inf

    require_quick(moved, 2.5 + 1.0)
    double.be("ahead")
    follow(arm, begin(arm, next(changes), 2.5))


def test_a_stop_cancels_and_the_next_motion_begins_there(arm: Ros2ControlArm) -> None:
    begin(arm, 0.2, 3.0)
    time.sleep(1.0)
    arm.stop()
    stopped = measured(arm)
    time.sleep(0.3)
    np.testing.assert_allclose(measured(arm), stopped, atol=0.03)
    follow(arm, begin(arm, -0.1, 1.0))


def test_the_speed_slider_slows_the_progress_down(arm: Ros2ControlArm, double: Double) -> None:
    double.be("speed 0.5")
    until(lambda: measured(arm) is not None and arm.status().speed_scaling == pytest.approx(0.5))
    path = begin(arm, 0.1, 1.5)
    begun_s = time.monotonic()
    follow(arm, path)
    assert time.monotonic() - begun_s > 2.5


def test_long_motions_are_resampled_or_refused(double: Double) -> None:
    """And the tolerances of the options are in each goal."""
    double.be("good")
    tolerances = {"path_tolerance_rad": 0.3, "goal_tolerance_rad": 0.02, "goal_time_s": 1.5}
    made = double.arm(max_points=20, connect_s=20.0, **tolerances)
    made.open(np.zeros(7))
    try:
        made.enable()
        measured(made)
        path = begin(made, 0.1, 1.5)
        follow(made, path)
        seen = double.seen()
        assert seen["points"] == 20
        assert seen["tolerances"] == {
            "path": dict.fromkeys(JOINTS, 0.3),
            "goal": dict.fromkeys(JOINTS, 0.02),
            "time_s": pytest.approx(1.5),
        }
        w, times_s = 12.0, np.linspace(0.0, 10.0, 501)
        start = measured(made)
        waves = [np.cos(w * times_s) - 1.0, -w * np.sin(w * times_s), -w * w * np.cos(w * times_s)]
        rows = 0.05 * np.array(waves)[:, :, None] * np.ones(7)
        rows[0] += start
        with pytest.raises(
            BackendError, match="the motion has 501 points, but the controller accepts at most 20"
        ):
            made.load(times_s, rows)
    finally:
        made.close()


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("abort", "has aborted the motion: PATH_TOLERANCE_VIOLATED"),
        ("replace", "has aborted the motion: INVALID_GOAL.*new incoming action"),
        ("never", "has not reported a result"),
        ("inactive", "inactive|aborted"),
        ("silent", "the last joint state on /left/joint_states is"),
        ("nan", "the position of ur_joint3 is nan, not a number"),
        ("missing", "/left/joint_states has no joint ur_joint7: it has finger, ur_joint6"),
    ],
)
def test_a_fault_in_a_motion_is_named_and_a_reset_ends_it(
    arm: Ros2ControlArm, double: Double, mode: str, words: str
) -> None:
    begin(arm)
    time.sleep(0.3)
    double.be(mode)
    with pytest.raises(BackendError, match=words):
        raise BackendError(fails(arm))
    recover(arm, double)


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("degrees", "is at -?[0-9]+.* rad, but its limits are .*whether they are in degrees"),
        ("slow", "the rate of /left/joint_states is .* Hz; the minimum is 4 Hz"),
        ("inactive", "the controller joint_trajectory_controller is inactive: activate it with"),
        ("forward", "the controller joint_trajectory_controller is inactive"),
        ("missing", "has no joint ur_joint7"),
        ("nan", "not a number"),
    ],
)
def test_a_fault_at_rest_is_named_and_nothing_can_be_enabled(
    arm: Ros2ControlArm, double: Double, mode: str, words: str
) -> None:
    double.be(mode)
    with pytest.raises(BackendError, match=words):
        raise BackendError(fails(arm))
    seen = double.seen()
    quick = double.arm(connect_s=0.5)
    try:
        with pytest.raises(BackendError):
            quick.open(np.zeros(7))
    finally:
        quick.close()
    assert double.seen() == seen
    recover(arm, double)


def refused(arm: Ros2ControlArm) -> str:
    """The reason for which it cannot be opened, or soon after that not be driven."""
    try:
        arm.open(np.zeros(7))
    except BackendError as exc:
        return str(exc)
    return fails(arm)


def test_swapped_joints_are_found_at_rest(arm: Ros2ControlArm, double: Double) -> None:
    """Joint 4 stands at -1.57 rad and joint 2 at about 0: the state of the controller has them right.

    Nothing moves then, and nothing can be enabled.
    """
    place = double.seen()["position"]
    double.be("swapped")
    with pytest.raises(BackendError, match=r"ur_joint[24] at .* its controller has it at .*another order"):
        raise BackendError(fails(arm))
    new = double.arm(connect_s=20.0)
    try:
        assert "its controller has it at" in refused(new)
    finally:
        new.close()
    assert double.seen()["position"] == place
    recover(arm, double)


def test_inputs_and_outputs_of_a_gpio_controller(double: Double) -> None:
    """Oracle: the values that rclpy's node has. An output that is not set keeps the value of others."""
    double.be("good")
    made = double.arm(
        connect_s=20.0,
        inputs={"door": "cabinet/door", "vacuum_bar": "tool/pressure", "lamp": "cabinet/lamp"},
        outputs={"suction": "tool/vacuum", "blow": "tool/valve"},
        analog=["vacuum_bar"],
    )
    assert made.capabilities.io
    made.open(np.zeros(7))

    def points() -> dict[str, Any]:
        measured(made)
        return {each.name: each.shown for each in made.io()}

    try:
        expected = {"door": True, "vacuum_bar": 0.75, "lamp": None, "suction": False, "blow": False}
        until(lambda: points() == expected)
        made.set_output("suction", 1.0)
        made.set_output("blow", 1.0)
        until(lambda: points() == expected | {"suction": True, "blow": True})
        assert json.loads(double.be("gpio"))["tool"] == {"vacuum": 1.0, "valve": 1.0, "pressure": 0.75}
        made.set_output("suction", 0.0)
        until(lambda: points() == expected | {"blow": True})
        with pytest.raises(BackendError, match=r"door is not an output; .* has: suction, blow"):
            made.set_output("door", 1.0)
    finally:
        made.close()


def test_inputs_and_outputs_of_the_driver_of_universal_robots(double: Double) -> None:
    """Oracle: the values that rclpy's node has, which serves ur_msgs/srv/SetIO."""
    double.be("good")
    made = double.arm(
        connect_s=20.0,
        answer_timeout_s=3.0,
        io="ur",
        inputs={"door": "digital_in/3", "light": "digital_in/4", "pressure": "analog_in/0"},
        outputs={"suction": "digital_out/16", "valve": "digital_out/8"},
        analog=["pressure"],
    )
    made.open(np.zeros(7))

    def points() -> dict[str, Any]:
        measured(made)
        return {each.name: each.shown for each in made.io()}

    def set_when_there(name: str, value: float) -> bool:
        """The service may be discovered later than the topic."""
        try:
            made.set_output(name, value)
        except BackendError as exc:
            return "has no server" not in str(exc)
        return True

    try:
        expected = {"door": True, "light": False, "pressure": 2.5, "suction": False, "valve": False}
        until(lambda: points() == expected)
        until(lambda: set_when_there("suction", 1.0))
        made.set_output("valve", 1.0)
        until(lambda: points() == expected | {"suction": True, "valve": True})
        assert json.loads(double.be("ur_io")) == [8, 16]
        double.be("refuse_io")
        made.set_output("suction", 0.0)
        until(lambda: bool(points()) and "set_io has rejected the request" in made._facts.gpio_problem)
        double.be("silent_io")
        begun_s = time.monotonic()
        made.set_output("suction", 0.0)
        made.stop()
        assert time.monotonic() - begun_s < 2.0, "a stop does not wait for the answer, which takes 3 s"
        until(lambda: bool(points()) and "set_io has not answered within 3 s" in made._facts.gpio_problem)
        double.be("good")
        until(lambda: points() == expected | {"valve": True})
        until(lambda: bool(points()) and "digital_out/16 is 0 now, " in made.status().text)
        assert "the device has set the output late" in made.status().text
    finally:
        made.close()


@pytest.mark.parametrize(
    ("driver", "inputs", "output", "signal"),
    [
        ("motoros2", {"there": "io/20", "unknown": "io/21"}, "io/10010", "10010"),
        ("xarm", {"there": "digital_in/8", "off": "digital_in/0"}, "digital_out/3", "out 3"),
        ("doosan", {"there": "digital_in/2", "off": "digital_in/1"}, "digital_out/1", "out 1"),
    ],
)
def test_inputs_and_outputs_of_drivers_with_services(
    double: Double, driver: str, inputs: dict[str, str], output: str, signal: str
) -> None:
    """Oracle: the values that rclpy's node has, whose services have the published definitions."""
    double.be("good")
    options: dict[str, Any] = {"io": driver, "inputs": inputs, "outputs": {"suction": output}}
    made = double.arm(connect_s=20.0, answer_timeout_s=3.0, **options)
    made.open(np.zeros(7))

    def points() -> dict[str, Any]:
        measured(made)
        return {each.name: each.shown for each in made.io()}

    def set_when_there(value: float) -> bool:
        try:
            made.set_output("suction", value)
        except BackendError as exc:
            return "has no server" not in str(exc)
        return True

    expected = {"there": True} | ({"unknown": None} if driver == "motoros2" else {"off": False})
    try:
        until(lambda: set_when_there(1.0))
        until(lambda: points() == expected | {"suction": True})
        assert json.loads(double.be("driver_io"))[driver][signal] == 1
        if driver == "motoros2":
            assert "io/21 cannot be read: the service /left/read_single_io" in made.status().text
            assert "Address cannot be read from" in made.status().text
        double.be("refuse_io")
        made.set_output("suction", 0.0)
        until(lambda: bool(points()) and "has rejected the request" in made._facts.gpio_problem)
        double.be("silent_io")
        begun_s = time.monotonic()
        made.set_output("suction", 0.0)
        made.stop()
        assert time.monotonic() - begun_s < 2.0, "a stop does not wait for the answer, which takes 3 s"
        until(lambda: bool(points()) and "has not answered within 3 s" in made._facts.gpio_problem)
        double.be("good")
        until(lambda: set_when_there(0.0))
        until(lambda: points() == expected | {"suction": False})
    finally:
        double.be("good")
        made.close()


def test_outputs_of_a_controller_that_is_not_there_are_named(double: Double) -> None:
    double.be("good")
    made = double.arm(connect_s=20.0, gpio_controller="other", outputs={"suction": "tool/vacuum"})
    made.open(np.zeros(7))
    try:
        with pytest.raises(BackendError, match="/left/other/commands has no subscriber; activate the GPIO"):
            made.set_output("suction", 1.0)
    finally:
        made.close()


def test_a_rejected_goal_is_refused(arm: Ros2ControlArm, double: Double) -> None:
    double.be("reject")
    with pytest.raises(BackendError, match=f"{ACTION} has rejected the goal"):
        begin(arm)
    recover(arm, double)


def test_a_late_result_belongs_to_its_own_goal(arm: Ros2ControlArm, double: Double) -> None:
    """The result of the first goal comes while the second one is executed."""
    double.be("late")
    begin(arm, 0.02, 0.5)
    assert "has not reported a result" in fails(arm)
    arm.enable()
    double.be("good")
    measured(arm)
    path = begin(arm, -0.05, 3.0)
    begun_s = time.monotonic()
    follow(arm, path)
    assert time.monotonic() - begun_s > 2.5, "the result of the first goal would end it after 2 s"


def test_a_driver_that_is_killed_and_started_again(arm: Ros2ControlArm, double: Double) -> None:
    begin(arm, 0.1, 3.0)
    time.sleep(0.3)
    double.kill()
    said = fails(arm)
    assert "the last joint state" in said or "gone away" in said, said
    double.start()
    recover(arm, double)


def test_another_client_s_goal_is_named(arm: Ros2ControlArm, double: Double) -> None:
    place = measured(arm)
    goals = [{"joints": JOINTS, "points": [[20.0, (place + 0.01).tolist()]]}]
    command = [str(PYTHON), str(PEERS / "jazzy_follower.py"), ACTION, json.dumps(goals)]
    client = subprocess.Popen(
        command, env=environment(double.prefix, domain=double.domain), stdout=subprocess.PIPE, text=True
    )
    try:
        assert "another client is moving the arm with a goal of" in fails(arm)
        arm.stop()  # cancels it
        assert client.stdout is not None
        assert json.loads(client.stdout.readlines()[-1])["status"] == 5
    finally:
        with client:
            client.kill()
    recover(arm, double)


def test_a_killed_rtloop_leaves_no_motion(double: Double) -> None:
    """The process that speaks DDS cancels the goal when rtloop is gone."""
    double.be("good")
    code = (
        "import sys, time, numpy as np; sys.path.insert(0, sys.argv[1]); import test_ros2_control as t\n"
        "arm = t.Double.arm(type('D', (), {'settings': t.Double.settings, 'domain': int(sys.argv[2])})(), "
        "connect_s=20.0)\n"
        "arm.open(np.zeros(7)); arm.enable(); start = t.measured(arm).tolist(); t.begin(arm, 0.2, 10.0)\n"
        "print(start, flush=True)\n"
        "time.sleep(60)"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", code, str(Path(__file__).parent), str(double.domain)],
        env=HELPER_ENVIRONMENT,
        stdout=subprocess.PIPE,
        text=True,
    )
    with process:
        assert process.stdout is not None
        start = json.loads(process.stdout.readline())
        os.kill(process.pid, signal.SIGKILL)

    def rests() -> bool:
        before = double.seen()["position"]
        time.sleep(0.1)
        return bool(before == double.seen()["position"])

    until(rests)
    assert np.abs(np.subtract(double.seen()["position"], start) - 0.2).min() > 0.02, "not at the goal"


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory, double: Double) -> Iterator[Run]:
    double.be("good")
    double.be("speed 1")
    with answering(RunAtDouble(tmp_path_factory.mktemp("ros2_control"), double)) as started:
        acknowledge(started)
        yield started


def reset(run: Run) -> None:
    """Until the robot accepts it; otherwise the failure has the last answer."""
    answers: list[httpx.Response] = []

    def accepted() -> bool:
        answers.append(httpx.post(f"{run.url}/robot/reset", timeout=WAIT_S))
        return answers[-1].is_success

    until(accepted, lambda: answers[-1].text)


def test_the_rest_tour_with_a_sequence_and_a_recording(service: Run, double: Double) -> None:
    rest_tour.tour(service, "motions", "plans", "trajectories", "programs", "everything_else")
    np.testing.assert_allclose(double.seen()["position"], service.joints(), atol=REACHED_RAD)


def test_follow_joint_trajectory_through_cobot_s_own_node(service: Run, double: Double) -> None:
    """rclpy's client, cobot's node, the planner, the backend, rclpy's server."""
    joints = [f"joint{number}" for number in range(1, 8)]
    place = np.array(service.joints())
    goals = [{"joints": joints, "points": [[2.0, (place - 0.05).tolist()], [4.0, place.tolist()]]}]
    (told,) = rclpy_follows(double, f"/{service.name}/follow_joint_trajectory", goals)
    assert (told["status"], told["error_code"]) == (4, 0), told
    np.testing.assert_allclose(double.seen()["position"], place, atol=REACHED_RAD)


def test_the_service_tells_of_an_abort_and_moves_again_after_a_reset(service: Run, double: Double) -> None:
    home = {"name": "home", "speed": 0.3}
    here = list(service.joints())
    double.be("abort")
    away = {"joints": (np.array(here) + 0.2).tolist(), "speed": 0.2}
    answer = httpx.post(f"{service.url}/robot/move/joints", json=away, timeout=WAIT_S)
    assert "PATH_TOLERANCE_VIOLATED" in answer.text, answer.text
    assert robot_health(service)["mode"] == "FAULT"
    double.be("good")
    reset(service)
    until(
        lambda: httpx.post(f"{service.url}/robot/move/named", json=home, timeout=WAIT_S).is_success,
        lambda: service.output[-1000:],
    )


@pytest.mark.parametrize("mode", ["nan", "swapped", "silent"])
def test_a_fault_of_the_joint_states_stops_the_arm(service: Run, double: Double, mode: str) -> None:
    """Oracle: where rclpy's controllers have the arm."""
    double.be("good")
    reset(service)
    until(lambda: robot_health(service).get("mode") == "HOLD")
    begun = np.array(double.seen()["position"])
    way = np.where(begun > 0.0, -0.4, 0.4)
    far = {"joints": (begun + way).tolist(), "speed": 0.05}
    httpx.post(f"{service.url}/robot/move/joints?wait=false", json=far, timeout=WAIT_S).raise_for_status()
    until(lambda: np.abs(np.array(double.seen()["position"]) - begun).max() > 0.01)
    double.be(mode)
    until(lambda: robot_health(service).get("mode") == "FAULT")

    def rests() -> bool:
        before = double.seen()["position"]
        time.sleep(0.1)
        return bool(before == double.seen()["position"])

    until(rests)
    assert np.abs(np.array(double.seen()["position"]) - begun).max() < 0.35
    double.be("good")
    reset(service)


def cycle(run: Run) -> int:
    return int(httpx.get(f"{run.url}/robot/state", timeout=WAIT_S).json()["cycle"])


def device_text(run: Run) -> str:
    (robot,) = httpx.get(f"{run.url}/robots", timeout=WAIT_S).json()
    return str(robot["device"]["status"]["text"])


@pytest.mark.parametrize("frozen", ["driver", "process"])
def test_the_cycle_goes_on_and_a_stop_is_obeyed_while_another_process_hangs(
    service: Run, double: Double, frozen: str
) -> None:
    """The driver, or the process that speaks DDS. A motion that it can no longer be told to stop is cancelled
    by a new process. Oracle: where rclpy's controllers have the arm. The motion takes 80 s, because it goes
    on in the meantime: the controllers' clock does, and a busy computer needs long for the new process.
    """
    double.be("good")
    reset(service)
    begun = np.array(double.seen()["position"])
    way = np.array([1.2 if begun[0] < 0.5 else -1.2, *[0.0] * 6])
    far = {"joints": (begun + way).tolist(), "speed": 0.01}
    httpx.post(f"{service.url}/robot/move/joints?wait=false", json=far, timeout=WAIT_S).raise_for_status()
    until(lambda: np.abs(np.array(double.seen()["position"]) - begun).max() > 0.01)
    rtloop = service.child("rtloop")
    assert rtloop is not None
    (speaker,) = (each for each in rtloop.children() if "cobot.dds.arm_client" in each.cmdline())
    victim = double.process.pid if frozen == "driver" else speaker.pid

    def rests() -> bool:
        before = double.seen()["position"]
        time.sleep(0.1)
        return bool(before == double.seen()["position"])

    os.kill(victim, signal.SIGSTOP)
    try:
        until(lambda: robot_health(service).get("mode") == "FAULT")
        with ThreadPoolExecutor(1) as pool:

            def waiting() -> Future[httpx.Response] | None:
                """A reset that is not answered yet after some cycles. At first the arm is not at rest."""
                asked = pool.submit(httpx.post, f"{service.url}/robot/reset", timeout=WAIT_S)
                first = cycle(service)
                until(lambda: cycle(service) > first + 50)
                return None if asked.done() else asked

            def stopped() -> bool:
                """A stop ends a waiting reset."""
                waits = waiting()
                if waits is None:
                    return False
                until(lambda: waits.done() or "a reset is enabling the robot" in device_text(service))
                httpx.post(f"{service.url}/stop", timeout=WAIT_S).raise_for_status()
                return "a stop has been requested in the meantime" in waits.result().text

            if frozen == "driver":
                until(stopped)
            else:
                first = cycle(service)
                until(lambda: not speaker.is_running())
                until(rests)  # the old process could cancel the motion too, if it went on
                assert cycle(service) > first + 50
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.kill(victim, signal.SIGCONT)

    until(rests)
    assert np.abs(np.array(double.seen()["position"]) - begun - way).max() > 0.1, "not at the goal"
    reset(service)
    assert robot_health(service)["mode"] == "HOLD"


@pytest.fixture(scope="module")
def simulator() -> Iterator[Double]:
    """Our simulated controllers, in a domain of their own."""
    prefix = built_packages(controller_packages())
    with own_domain() as domain:
        made = SimulatedDouble(domain, prefix)
        try:
            yield made
        finally:
            made.kill()


class SimulatedDouble(Double):
    """`cobot simulate ros2_control`."""

    def start(self) -> None:
        command = [sys.executable, "-m", "cobot", "simulate", "ros2_control", "--domain", str(self.domain)]
        self.process = subprocess.Popen(
            [*command, "--namespace", NAMESPACE, "--prefix", "ur_", "--gpio", "tool/vacuum"],
            stdout=subprocess.PIPE,
            text=True,
        )
        assert f"domain {self.domain}" in self._line()


def test_rclpy_s_client_at_our_simulated_controllers(simulator: Double) -> None:
    """Goals of 2.5 s, cancelled, of an unknown joint, with times that decrease, empty, and for a part of the
    joints."""
    home = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0])
    there = (home + 0.1).tolist()
    goals: list[dict[str, Any]] = [
        {"joints": JOINTS, "points": [[2.5, there]]},
        {"joints": JOINTS[::-1], "points": [[2.5, home.tolist()[::-1]]], "cancel_s": 0.5},
        {"joints": [*JOINTS[:6], "other"], "points": [[1.0, there]]},
        {"joints": JOINTS, "points": [[2.0, there], [1.0, there]]},
        {"joints": JOINTS, "points": []},
        {"joints": JOINTS[:6], "points": [[1.0, there[:6]]]},
    ]

    def late_s() -> float:
        """By how much the client was later than 3.5 s, or 2 s for the cancelled goal."""
        first, cancelled, *rejected = rclpy_follows(simulator, ACTION, goals)
        assert (first["status"], first["error_code"]) == (4, 0)
        assert first["took_s"] >= 2.5
        assert first["feedback"] > 5
        assert cancelled["status"] == 5
        assert [each["accepted"] for each in rejected] == [False] * 4
        return float(max(first["took_s"] - 3.5, cancelled["took_s"] - 2.0))

    require_quick(late_s, 0.0)


def test_outputs_of_our_simulated_gpio_controller(simulator: Double) -> None:
    made = simulator.arm(connect_s=20.0, outputs={"suction": "tool/vacuum", "missing": "tool/nothing"})
    made.open(np.zeros(7))

    def shown() -> list[Any]:
        measured(made)
        return [each.shown for each in made.io()]

    try:
        until(lambda: shown() == [False, None])
        made.set_output("suction", 1.0)
        until(lambda: shown() == [True, None])
    finally:
        made.close()


def move_slowly(run: Run, joints: list[float]) -> None:
    """So slowly that joint states which rclpy tells late on a busy computer are no jump."""
    wish = {"joints": joints, "speed": 0.05}
    httpx.post(f"{run.url}/robot/move/joints", json=wish, timeout=WAIT_S).raise_for_status()
    np.testing.assert_allclose(run.joints(), joints, atol=5e-3)


def test_a_stream_goes_through_the_forward_controller(tmp_path: Path) -> None:
    """And planned motions too. What a deactivated controller is sent moves nothing afterwards."""
    prefix = built_packages(controller_packages())
    with own_domain() as domain:
        double = Double(domain, prefix)
        try:
            double.be("forward")
            with answering(RunAtDouble(tmp_path, double, "ros2_control_stream")) as run:
                acknowledge(run)
                place = list(run.joints())
                move_slowly(run, [*place[:1], place[1] + 0.1, *place[2:]])
                here = list(run.joints())

                def turned() -> bool:
                    with StreamClient(run.url) as client:
                        client.session()
                        for step in range(300):
                            client.target([here[0] + 0.1 - 0.1 * np.cos(0.02 * step), *here[1:]])
                            if abs(double.seen()["position"][0] - here[0]) > 0.05:
                                break
                            time.sleep(0.01)
                        client.ended()
                    return bool(abs(double.seen()["position"][0] - here[0]) > 0.05)

                until(turned)
                double.be("inactive")
                until(lambda: robot_health(run).get("mode") == "FAULT")
                reason = httpx.get(f"{run.url}/robot/state", timeout=WAIT_S).text
                assert "forward_position_controller is inactive" in reason
                time.sleep(0.2)
                commands = double.seen()["commands"]
                time.sleep(0.5)
                assert double.seen()["commands"] == commands
                double.be("forward")
                reset(run)
                move_slowly(run, place)
        finally:
            double.kill()


def test_the_arm_s_model_is_made_of_the_description_on_the_graph(double: Double, tmp_path: Path) -> None:
    """Oracle: rclpy's latched topic, written by the double."""
    given = HELPER_ENVIRONMENT | {"ROS_DOMAIN_ID": str(double.domain), "ROS_LOCALHOST_ONLY": "1"}
    command = [sys.executable, "-m", "cobot", "new-robot", "--output", str(tmp_path / "arm"), "--ros"]
    subprocess.run([*command, "left"], env=given, check=True, capture_output=True, timeout=WAIT_S)
    robot = load_robot(load_settings(tmp_path / "arm" / SETTINGS_FILE))
    assert list(robot.limits.names) == JOINTS
    again = subprocess.run(
        [*command[:5], str(tmp_path / "other"), "--ros", "right"],
        env=given,
        check=False,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
    )
    assert again.returncode == 1
    assert "topics of this name in domain" in again.stderr
    assert ": /left/robot_description" in again.stderr
    assert not (tmp_path / "other").exists()
