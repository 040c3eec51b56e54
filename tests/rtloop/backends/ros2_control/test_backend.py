"""The backend for ros2_control beside a controller in the same process.

Oracle: the values that the test makes up, and the polynomials of the motion.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from ros2_control_settings import settings_with

from cobot.config import load_settings
from cobot.dds.recent_positions import RecentPositions
from cobot.errors import ConfigError
from cobot.robot.description import load_robot
from cobot.trajectory import Trajectory, from_hermite
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Measured
from rtloop.backends.ros2_control import Ros2ControlArm, words
from rtloop.backends.ros2_control.link import Facts, GoalFacts, facts_of
from rtloop.backends.ros2_control.options import Ros2ControlOptions
from rtloop.backends.ros2_control.path import PathProgress, resampled
from rtloop.backends.ros2_control.rig import RigLink, Ros2ControlRig


@pytest.fixture(scope="module")
def limits() -> JointLimits:
    return load_robot(load_settings()).limits


class Told(RigLink):
    """A link that tells what the test makes up."""

    change: dict[str, Any]

    def facts(self) -> Facts:
        return replace(super().facts(), **self.change)


def arm_told(limits: JointLimits, options: dict[str, Any], **change: Any) -> tuple[Ros2ControlArm, Told]:
    """An open arm, and its link, which tells something else from now on."""
    settings = settings_with(connect_s=0.1, **options)
    link = Told(Ros2ControlRig(Ros2ControlArm, settings, limits))
    link.change = {}
    arm = Ros2ControlArm(settings, limits, link)
    arm.open(np.zeros(7))
    link.change = change
    return arm, link


NAMED = {"name": "arm_controller", "state": "active", "joints": [f"joint{n}" for n in range(1, 8)]}


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"problem": "ROS 2: no network"}, "ROS 2: no network"),
        (
            {"choices": ["/a/follow", "/b/follow"], "ready": False},
            r"several actions .*: /a/follow, /b/follow; name the controller in robot.backend.controller",
        ),
        ({"ready": False}, "no server for the action /arm_controller/.*ROS_DOMAIN_ID"),
        ({"ready": False, "action": "", "controllers": None, "controller": ""}, "root namespace: start the"),
        (
            {"ready": False, "action": "", "controller": ""},
            r"no joint trajectory controller .* moves the arm's joints; controllers: arm_controller \(active",
        ),
        ({"controllers": [{**NAMED, "state": "inactive"}]}, "arm_controller is inactive: activate it with"),
        (
            {"controllers": [{**NAMED, "joints": [*NAMED["joints"][:-1], "rail"]}]},
            "moves rail, which the arm's model does not have and does not move joint7",
        ),
        ({"age_s": None}, "no joint state has arrived on /joint_states: check that the"),
        ({"age_s": 0.7}, "the last joint state on /joint_states is 0.70 s old; the maximum is 0.5 s"),
        ({"rate_hz": 4.0}, "the rate of /joint_states is 4.0 Hz; the minimum is 10 Hz"),
        ({"missing": ["joint3"], "names": ["joint1"]}, "has no joint joint3: it has joint1; correct"),
        ({"velocity": None}, "has no velocity: remove it from robot.backend.measured"),
        ({"velocity": [0.0] * 6 + [float("inf")]}, "the velocity of joint7 is inf, not a number"),
        ({"position": [0, 0, 0, -90.0, 0, 90.0, 0]}, "joint[46] is at .*90.000 rad, but its limits are"),
        ({"others": 1}, "another client is moving the arm with a goal of /arm_controller/follow"),
        (
            {"goal": GoalFacts(accepted=True, status=6, error_code=-100101)},
            "has aborted the motion: INVALID_GOAL.*code 101 of MotoROS2",
        ),
        ({"goal": GoalFacts(accepted=True, status=0)}, "does not know the goal"),
        ({"goal": GoalFacts(accepted=True, lost=True)}, "has gone away or was restarted during the motion"),
    ],
)
def test_what_is_wrong_is_named(limits: JointLimits, change: dict[str, Any], words: str) -> None:
    arm, _ = arm_told(limits, {}, **change)
    with pytest.raises(BackendError, match=words):
        arm.state(Measured(7))


def test_what_is_wrong_is_named_at_the_start_too(limits: JointLimits) -> None:
    arm, link = arm_told(limits, {}, age_s=None)
    with pytest.raises(BackendError, match="no joint state has arrived on /joint_states"):
        arm.enable()
    link.change = {}
    arm.enable()
    arm.state(Measured(7))


@pytest.mark.parametrize(
    ("options", "values", "share"),
    [
        ({}, [None], 1.0),
        ({}, [0.3], 0.3),
        ({}, [100.0, 0.5], 0.005),
        ({"speed_scaling_full": 100.0}, [0.5], 0.005),
        ({}, [120.0], 1.0),
        ({}, [float("nan")], 0.0),
    ],
)
def test_the_speed_slider_is_a_share_or_per_cent(
    limits: JointLimits, options: dict[str, Any], values: list[float | None], share: float
) -> None:
    arm, link = arm_told(limits, options)
    for value in values:
        link.change = {"scaling": value}
        arm.state(Measured(7))
        status = arm.status()
    assert status.speed_scaling == pytest.approx(share)


def test_a_stop_that_is_not_answered_says_that_the_arm_may_move(limits: JointLimits) -> None:
    arm, link = arm_told(limits, {})
    link.cancel = lambda: "/a has not answered a cancel request within 2 s"  # type: ignore[method-assign]
    with pytest.raises(BackendError, match="press the emergency stop"):
        arm.stop()


def test_inputs_and_outputs_have_the_names_of_the_settings(limits: JointLimits) -> None:
    io = {"inputs": {"door": "cabinet/door"}, "outputs": {"suction": "tool/vacuum"}, "analog": ["suction"]}
    arm, link = arm_told(limits, io)
    assert arm.capabilities.io
    arm.set_output("suction", 0.5)
    arm.state(Measured(7))
    points = {each.name: each for each in arm.io()}
    assert (points["suction"].value, points["suction"].is_output) == (0.5, True)
    assert points["door"].shown is None  # not reported
    link.change = {"gpio_age_s": 2.0}
    arm.state(Measured(7))
    assert [each.shown for each in arm.io()] == [None, None]
    with pytest.raises(BackendError, match=r"door is not an output; robot\.backend\.outputs has: suction"):
        arm.set_output("door", 1.0)
    without, _ = arm_told(limits, {})
    assert not without.capabilities.io
    assert without.io() == []


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"joints": ["a", "b"]}, "robot.backend.joints has 2 names, but the arm has 7 joints: joint1"),
        ({"joints": list("aabcdef")}, "'a' occurs twice"),
        ({"namespace": "/iiwa"}, "/iiwa is the namespace of cobot's own topics"),
        ({"action": "/iiwa/follow_joint_trajectory"}, "the robot would follow itself"),
        ({"namespace": "left"}, "robot.backend.namespace"),
        ({"max_points": 3}, "robot.backend.max_points"),
        ({"outputs": {"a": "tool"}}, "robot.backend.outputs"),
        (
            {"outputs": {"a": "tool/a"}, "inputs": {"a": "tool/b"}},
            "'a' is the name of both an input and an output",
        ),
        (
            {"io": "ur", "inputs": {"a": "digital_in/18"}},
            "'a' is digital_in/18; with io: ur the valid values are",
        ),
        (
            {"io": "ur", "outputs": {"a": "digital_in/1"}},
            "'a' is digital_in/1; with io: ur the valid values are",
        ),
        ({"io": "ur", "outputs": {"a": "analog_out/0"}}, "for outputs digital_out/0 to 17 only"),
        ({"io": "ur", "inputs": {"a": "analog_in/0"}}, "value is a number: add it to analog"),
        (
            {"io": "ur", "outputs": {"a": "digital_out/0"}, "analog": ["a"]},
            "value is true or false: remove it from analog",
        ),
        ({"io": "motoros2", "outputs": {"a": "io/10009"}}, "io/10 to 99999; for outputs io/10010 to 29999"),
        ({"io": "xarm", "inputs": {"a": "digital_in/16"}}, "digital_in/0 to 15, digital_out/0 to 15, "),
        (
            {"io": "xarm", "inputs": {"a": "digital_in/03"}},
            "'a' is digital_in/03; with io: xarm the valid values are",
        ),
        ({"io": "doosan", "outputs": {"a": "digital_out/0"}}, "'a' is digital_out/0; .*digital_out/1 to 16"),
        (
            {"io": "doosan", "outputs": {"a": "tool_digital_in/1"}},
            "for outputs digital_out/1 to 16, tool",
        ),
        ({"io": "abb"}, "robot.backend.io"),
        ({"analog": ["a"]}, "'a' is neither in inputs nor in outputs"),
    ],
)
def test_options_that_cannot_be_right(limits: JointLimits, options: dict[str, Any], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        Ros2ControlArm(settings_with(**options), limits)


@pytest.mark.parametrize(
    ("options", "begin"),
    [
        ({}, "/left/gpio_command_controller"),
        ({"io": "ur"}, "/left/io_and_status_controller"),
        ({"io": "motoros2"}, "/left"),
        ({"io": "xarm"}, "/left/xarm"),
        ({"io": "xarm", "gpio_controller": "/ufactory"}, "/ufactory"),
        ({"io": "doosan"}, "/left/io"),
    ],
)
def test_the_services_of_a_driver_are_below_its_name(options: dict[str, Any], begin: str) -> None:
    made = Ros2ControlOptions(namespace="/left", **options)
    assert made.io_names_begin == begin


def test_the_answers_of_the_process_are_read() -> None:
    found = facts_of({"action": "/a", "ready": True, "goal": {"accepted": True, "running_s": 0.5}})
    assert found.goal == GoalFacts(accepted=True, running_s=0.5)


def path(duration_s: float, change: float = 0.4) -> tuple[Trajectory, Array, Array]:
    """There and back: each position is passed twice."""
    still = np.zeros((3, 7))
    ends = np.array([np.zeros(7), np.full(7, change), np.zeros(7)])
    made = from_hermite(np.array([0.0, duration_s / 2, duration_s]), ends, still, still)
    times_s = np.linspace(0.0, duration_s, 2 + int(duration_s / 0.02))
    return made, times_s, np.array([made.sample(times_s, order) for order in range(3)])


@pytest.mark.parametrize("rate", [1.0, 0.5, 0.1])
def test_progress_follows_the_feedback_at_any_speed(rate: float) -> None:
    made, times_s, rows = path(4.0)
    progress = PathProgress(times_s, rows[0])
    clock_s = 0.0
    while rate * clock_s < 3.9:
        clock_s += 0.05
        age_s = 0.03
        done_s = max(rate * (clock_s - age_s), 0.0)
        found_s = progress.look(clock_s, made.sample([done_s])[0], rate * age_s)
        off = made.sample([found_s])[0] - made.sample([rate * clock_s])[0]
        assert np.abs(off).max() < 0.01
    assert found_s == pytest.approx(rate * clock_s, abs=0.05)


def test_progress_without_feedback_stays() -> None:
    _, times_s, rows = path(4.0)
    assert PathProgress(times_s, rows[0]).look(1.0, None, 0.0) == 0.0


def test_the_end_is_told_by_the_result_alone() -> None:
    made, times_s, rows = path(4.0)
    progress = PathProgress(times_s, rows[0])
    for clock_s in np.arange(0.0, 6.0, 0.05):
        done_s = progress.look(clock_s, made.sample([min(clock_s, 4.0)])[0], 0.0)
    assert 3.9 < done_s < 4.0


def test_fewer_points_stay_near_the_path() -> None:
    made, times_s, rows = path(4.0)
    fewer_s, fewer = resampled(times_s, rows, 50, 1e-3)
    assert fewer.shape == (3, 50, 7)
    assert (fewer_s[0], fewer_s[-1]) == (0.0, times_s[-1])
    every_s = np.linspace(0.0, 4.0, 4001)
    again = from_hermite(fewer_s, *fewer).sample(every_s)
    assert np.abs(again - made.sample(every_s)).max() <= 1e-3
    with pytest.raises(
        BackendError, match=r"202 points, but the controller accepts at most 10 .*leave its path by"
    ):
        resampled(times_s, rows, 10, 1e-5)


@pytest.mark.parametrize(
    ("stated", "held", "held_age_s", "age_s", "found"),
    [
        ([[0.0, 0.5, -1.0]], [[0.0, 0.5, -1.0]], 0.0, 0.0, ""),
        (
            [[0.0, 0.5, -1.0]],
            [[0.0, -1.0, 0.5]],
            0.0,
            0.0,
            "states has two at 0.500 rad, but its controller has it at -1",
        ),
        ([[0.0, 0.5, -1.0]], [[0.0, -1.0, 0.5]], 0.2, 0.0, ""),
        ([[0.0, 0.5, -1.0]], [[0.0, -1.0, 0.5]], 0.0, 0.2, ""),
        ([[0.0, 0.2, 0.0], [0.0, 0.5, 0.0]], [[0.0, 0.5, 0.0], [0.0, 0.9, 0.0]], 0.0, 0.0, ""),
        ([[0.0, 0.5, 0.0]], [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.9, 0.0]], 0.0, 0.0, ""),
        ([[0.0, 0.5, 0.0], [0.0, 0.9, 0.0]], [[0.0, 0.0, 0.0], [0.0, 0.3, 0.0]], 0.0, 0.0, "states has two"),
        ([[0.0, 0.5, -1.0]], [], 1e9, 0.0, ""),
    ],
    ids=["equal", "exchanged", "old", "late", "moving", "late and moving", "elsewhere", "no state"],
)
def test_the_recent_joint_states_are_compared_with_what_the_controller_reports(
    stated: list[list[float]], held: list[list[float]], held_age_s: float, age_s: float, found: str
) -> None:
    """A busy computer delays one of them, so that their newest positions are from different times."""
    ours, theirs = RecentPositions(), RecentPositions()
    for recent, all_of_them in ((ours, stated), (theirs, held)):
        for place, positions in enumerate(all_of_them):
            recent.add(positions, 0.1 * place)
    facts = Facts(
        position=ours.newest,
        position_range=ours.range(),
        age_s=age_s,
        held=theirs.newest,
        held_range=theirs.range(),
        held_age_s=held_age_s,
    )
    said = words.disagreement(facts, ["one", "two", "three"], "states")
    assert said.startswith(found)
    assert bool(said) == bool(found)


def test_an_output_that_the_driver_has_not_set_is_logged_once(
    limits: JointLimits, caplog: pytest.LogCaptureFixture
) -> None:
    """It is no fault of the arm: a motion goes on."""
    arm, _ = arm_told(limits, {}, gpio_problem="set_io has rejected it")
    for _ in range(3):
        arm.state(Measured(7))
    assert [each.getMessage() for each in caplog.records] == [
        "inputs and outputs of the device: set_io has rejected it"
    ]
