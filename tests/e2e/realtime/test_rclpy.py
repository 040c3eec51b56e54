"""A running cobot, used with real ROS 2: rclpy of Jazzy over rmw_fastrtps, and interfaces built by colcon."""

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
from real_ros import PYTHON, built_packages, environment, users_packages

# Who comes first builds what all need.
pytestmark = pytest.mark.timeout(600)
SESSION = Path(__file__).parents[2] / "cobot" / "dds" / "jazzy_session.py"


class Jazzy:
    """A running cobot, and ROS 2 beside it.

    Attributes:
        prefix: where the interfaces are installed.
    """

    def __init__(self, run: Run, domain: int, prefix: Path) -> None:
        self.run = run
        self.prefix = prefix
        self.domain = domain

    def session(self) -> dict[str, Any]:
        """What a user's session saw."""
        ended = subprocess.run(
            [str(PYTHON), str(SESSION), self.run.name],
            env=environment(self.prefix, domain=self.domain),
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        assert ended.returncode == 0, f"{ended.stderr[-3000:]}\n{self.run.output[-2000:]}"
        report: dict[str, Any] = json.loads(ended.stdout.splitlines()[-1])
        return report


@pytest.fixture(scope="module")
def jazzy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Jazzy]:
    prefix = built_packages(users_packages())
    with own_domain() as domain:
        folder = tmp_path_factory.mktemp("jazzy")
        with answering(Run(folder, clock="realtime", ros_domain=domain)) as run:
            yield Jazzy(run, domain, prefix)


@pytest.fixture(scope="module")
def report(jazzy: Jazzy) -> dict[str, Any]:
    return jazzy.session()


def test_the_graph_shows_the_node_and_all_that_it_offers(jazzy: Jazzy, report: dict[str, Any]) -> None:
    name = jazzy.run.name
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


def test_a_service_answers(report: dict[str, Any]) -> None:
    assert report["dof"] == [0, 7]


def test_an_action_client_follows_a_trajectory(jazzy: Jazzy, report: dict[str, Any]) -> None:
    goal = report["goal"]
    assert (goal["accepted"], goal["status"], goal["error_code"]) == (True, 4, 0)
    assert goal["feedback"] > 1
    expected = [value + 0.1 for value in report["position"]]
    assert jazzy.run.joints() == pytest.approx(expected, abs=0.01)


@pytest.mark.skipif(script() is None, reason="the manual is not here")
def test_the_manual_s_client_ends_well(jazzy: Jazzy, tmp_path: Path) -> None:
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
