"""A running cobot, used with real ROS 2: rclpy of Jazzy and of Kilted (Fast DDS 3) over rmw_fastrtps, and
interfaces built by colcon.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cobot_run import WAIT_S, Run, answering
from dds_peers import own_domain
from manual_programs import run_script, script
from real_ros import (
    JAZZY,
    KILTED,
    PYTHON,
    Release,
    built_packages,
    environment,
    session_packages,
    users_packages,
)

# The first test builds the packages of all.
pytestmark = [pytest.mark.thorough, pytest.mark.timeout(600)]
SESSION = Path(__file__).parents[2] / "cobot" / "dds" / "rclpy_session.py"
SUCCEEDED, CANCELED = 4, 5


class RosUser:
    """A person who uses a running cobot from one release of ROS 2.

    Attributes:
        prefix: where the interfaces are installed.
    """

    def __init__(self, run: Run, domain: int, release: Release) -> None:
        self.run = run
        self.domain, self.release = domain, release
        packages = users_packages() if release is JAZZY else session_packages()
        self.prefix = built_packages(packages, release)

    def session(self) -> dict[str, Any]:
        """A report of everything that the session saw."""
        ended = subprocess.run(
            [str(self.release.python), str(SESSION), self.run.name],
            env=environment(self.prefix, domain=self.domain, release=self.release),
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        assert ended.returncode == 0, f"{ended.stderr[-3000:]}\n{self.run.output[-2000:]}"
        report: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
        return report


@pytest.fixture(scope="module")
def ros_run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Run, int]]:
    """A running cobot with its ROS domain."""
    with own_domain() as domain:
        folder = tmp_path_factory.mktemp("ros")
        with answering(Run(folder, clock="realtime", ros_domain=domain)) as run:
            yield run, domain


@pytest.fixture(scope="module")
def jazzy(ros_run: tuple[Run, int]) -> RosUser:
    return RosUser(*ros_run, JAZZY)


@pytest.fixture(scope="module", params=[JAZZY, KILTED], ids=lambda release: release.name)
def user(request: pytest.FixtureRequest, ros_run: tuple[Run, int]) -> RosUser:
    return RosUser(*ros_run, request.param)


@pytest.fixture(scope="module")
def report(user: RosUser) -> dict[str, Any]:
    return user.session()


def test_the_graph_shows_the_node_and_all_that_it_offers(user: RosUser, report: dict[str, Any]) -> None:
    name = user.run.name
    assert sorted(report["nodes"]) == ["/cobot", "/user"]
    assert report["publishers"][f"/{name}/joint_states"] == ["sensor_msgs/msg/JointState"]
    assert report["services"][f"/{name}/RobotConfig/getDof"] == ["aubo_interfaces/srv/GetDof"]
    assert report["topics"]["/tf"] == ["tf2_msgs/msg/TFMessage"]


def test_states_frames_and_the_description_are_read(report: dict[str, Any]) -> None:
    joints = [f"joint{number}" for number in range(1, 8)]
    assert report["joints"] == joints
    assert report["stamps_rise"]
    assert report["frames"] == sorted(
        ["base_link", "tcp", *(each.replace("joint", "link") for each in joints)]
    )
    assert "<robot" in report["description"]


def test_a_service_answers_every_request(report: dict[str, Any]) -> None:
    assert report["dof"] == 100 * [[0, 7]]


def test_an_action_client_follows_a_trajectory(report: dict[str, Any]) -> None:
    goal = report["goal"]
    assert (goal["accepted"], goal["status"], goal["error_code"]) == (True, SUCCEEDED, 0)
    assert goal["feedback"] > 1
    assert goal["off"] < 0.01


def test_an_action_client_cancels_a_motion(user: RosUser, report: dict[str, Any]) -> None:
    assert report["cancelled"] == [1, CANCELED]
    assert user.run.health()["robot"]["settled"]


@pytest.mark.skipif(script() is None, reason="the manual is not here")
def test_the_manual_s_client_ends_well(jazzy: RosUser, tmp_path: Path) -> None:
    jazzy.run.go_home()
    arguments = ("--mode", "current", "--servo-mode", "4", "--period", "0.02", "--time", "0.02")
    ended = run_script(
        tmp_path,
        jazzy.run.name,
        *arguments,
        "--watchdog",
        "5",
        python=str(PYTHON),
        environment=environment(jazzy.prefix, domain=jazzy.domain),
    )
    assert ended.returncode == 0, f"{ended.stderr[-3000:]}\n{jazzy.run.output[-2000:]}"
