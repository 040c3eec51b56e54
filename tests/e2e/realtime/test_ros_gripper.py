"""The gripper `ros` with real ROS 2: an action server of rclpy (Jazzy, rmw_fastrtps) is its driver.

Oracle: that server, whose finger is where its joint states say.
"""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, Run, answering
from dds_peers import own_domain
from real_ros import PYTHON, built_packages, environment, users_packages

from cobot.config import load_settings
from cobot.grippers import GripperError, GripperState, HeldObject
from cobot.grippers.contract.suite import NoPoints
from cobot.grippers.protocol import Grasp
from cobot.grippers.ros import RosGripper, RosOptions
from cobot.grippers.ros.driver import link_settings
from cobot.grippers.ros.link import ActionProcess

pytestmark = [pytest.mark.thorough, pytest.mark.timeout(600)]
DOUBLE = Path(__file__).parents[2] / "cobot" / "dds" / "jazzy_driver.py"
ANY = Grasp(None, 0.0, 0.0)


class Double:
    """The driver's process."""

    def __init__(self, kind: str, domain: int, prefix: Path) -> None:
        self.kind, self.domain = kind, domain
        self.process = subprocess.Popen(
            [str(PYTHON), str(DOUBLE), kind],
            env=environment(prefix, domain=domain),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        self._read("ready")

    def be(self, mode: str) -> None:
        assert self.process.stdin is not None
        print(mode, file=self.process.stdin, flush=True)
        self._read("done")

    def _read(self, word: str) -> None:
        assert self.process.stdout is not None
        assert self.process.stdout.readline().strip() == word

    def gripper(self, **options: Any) -> RosGripper:
        """A driver of cobot at it."""
        given = {"action": "/hand/cmd", "action_type": self.kind, "joint": "jaw", "open_position": 0.08}
        made = RosOptions.model_validate({**given, "open_width": 0.08, **options})
        ros = load_settings().ros.model_copy(update={"domain_id": self.domain, "localhost_only": True})
        gripper = RosGripper(made, NoPoints(), ActionProcess(link_settings(made, ros)))
        until(lambda: connects(gripper))
        return gripper


def connects(gripper: RosGripper) -> bool:
    try:
        gripper.connect()
    except GripperError:
        gripper.disconnect()
        return False
    return True


def until(condition: Callable[[], Any]) -> None:
    deadline_s = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


def end(gripper: RosGripper) -> GripperState:
    """The state when the fingers rest."""
    until(lambda: not gripper.state().moving)
    return gripper.state()


def close_and_look(gripper: RosGripper) -> None:
    """Close, and look at the state for some time after the end."""
    gripper.close()
    end(gripper)
    time.sleep(1.5)
    gripper.state()


@contextmanager
def driving(kind: str) -> Iterator[Double]:
    prefix = built_packages(users_packages())
    with own_domain() as domain:
        double = Double(kind, domain, prefix)
        try:
            yield double
        finally:
            with double.process:
                double.process.kill()


@pytest.fixture(scope="module", params=["GripperCommand", "ParallelGripperCommand"])
def double(request: pytest.FixtureRequest) -> Iterator[Double]:
    with driving(request.param) as made:
        yield made


@pytest.fixture
def gripper(double: Double) -> Iterator[RosGripper]:
    double.be("good")
    double.be("object 0")
    made = double.gripper(answer_timeout_s=5.0, result_timeout_s=3.0)
    made.open()
    end(made)
    yield made
    made._link.close()


def test_widths_are_reached_and_a_newer_command_replaces(gripper: RosGripper) -> None:
    gripper.move(0.02, None, None)
    assert gripper.state().moving
    state = end(gripper)
    assert (state.width, state.commanded_width) == (pytest.approx(0.02, abs=1e-3), 0.02)
    gripper.move(0.0, None, None)
    gripper.move(0.06, None, None)
    assert end(gripper).width == pytest.approx(0.06, abs=1e-3)


def test_of_two_commands_at_once_the_newer_one_is_executed(gripper: RosGripper, double: Double) -> None:
    """Though the driver, with its several threads, takes longer for the first one."""
    gripper.move(0.01, None, None)
    end(gripper)
    double.be("slow")
    gripper.close()
    gripper.move(0.07, None, None)
    assert end(gripper).width == pytest.approx(0.07, abs=1e-3)


def test_a_stop_before_the_driver_has_answered_cancels(gripper: RosGripper, double: Double) -> None:
    double.be("slow")
    gripper.close()
    gripper.stop()
    width = end(gripper).width
    assert width is not None
    assert width > 0.04


def test_a_part_is_held_found_again_and_lost(gripper: RosGripper, double: Double) -> None:
    double.be("object 0.03")
    gripper.grasp(ANY)
    state = end(gripper)
    assert (state.width, state.object) == (pytest.approx(0.03, abs=1e-3), HeldObject.HELD_INSIDE)
    gripper.stop()
    assert gripper.state().object is HeldObject.HELD_INSIDE
    again = double.gripper()
    until(lambda: again.state().object is HeldObject.HELD_INSIDE)
    again._link.close()
    double.be("object 0")
    gripper.release(None)
    assert end(gripper).object is HeldObject.NONE


def test_a_stop_cancels(gripper: RosGripper) -> None:
    gripper.close()
    until(lambda: (gripper.state().width or 0.0) < 0.07)
    gripper.stop()
    width = end(gripper).width
    assert width is not None
    assert 0.0 < width < 0.08


@pytest.mark.parametrize(
    ("mode", "words"),
    [
        ("reject", "has rejected the goal"),
        ("abort", "has aborted the goal"),
        ("never", "has not reported a result within 3 s: the result is lost"),
        ("nan", "the position of jaw is not a number"),
        ("silent", "/joint_states has had no joint jaw for"),
    ],
)
def test_a_driver_that_fails_is_an_error_in_words_and_then_works_again(
    gripper: RosGripper, double: Double, mode: str, words: str
) -> None:
    double.be(mode)
    with pytest.raises(GripperError, match=words):
        close_and_look(gripper)
    gripper.disconnect()
    double.be("good")
    until(lambda: connects(gripper))
    gripper.open()
    assert end(gripper).width == pytest.approx(0.08, abs=1e-3)


def test_the_service_grasps_with_it_and_tells_that_it_is_gone(tmp_path: Path) -> None:
    """Oracle: the double, and REST."""
    options = "type: ros, action: /hand/cmd, joint: jaw, open_position: 0.08, open_width: 0.08"
    with driving("GripperCommand") as double:
        double.be("object 0.03")
        backend = f"mujoco, gripper: {{{options}}}"
        with answering(Run(tmp_path, backend=backend, clock="realtime", ros_domain=double.domain)) as run:

            def report() -> dict[str, Any]:
                found: dict[str, Any] = httpx.get(f"{run.url}/robot/gripper", timeout=WAIT_S).json()
                return found

            until(lambda: report()["connected"])
            answer = httpx.post(f"{run.url}/robot/gripper/grasp", json={"width": 0.03}, timeout=WAIT_S).json()
            assert (answer["success"], answer["object"]) == (True, "held_inside"), answer
            assert answer["width"] == pytest.approx(0.03, abs=1e-3)
            double.process.kill()
            until(lambda: not report()["connected"])
            assert (
                "check that its driver is running" in (problem := report()["problem"]) or "start" in problem
            )
