"""The actions of a running cobot's gripper, used with real ROS 2: rclpy of Jazzy over rmw_fastrtps.

Oracles: what rclpy hears; GET /robot/gripper.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, Run, answering
from dds_peers import own_domain
from physical_cell import EXAMPLE
from real_ros import PYTHON, built_packages, environment, users_packages

# Who comes first builds what all need.
pytestmark = [pytest.mark.thorough, pytest.mark.timeout(600)]
SESSION = Path(__file__).parents[2] / "cobot" / "dds" / "jazzy_gripper.py"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What a session saw, and the gripper at its end."""
    prefix = built_packages(users_packages())
    with own_domain() as domain:
        backend = f"mujoco, cell: {EXAMPLE}"
        folder = tmp_path_factory.mktemp("jazzy")
        with answering(Run(folder, backend=backend, clock="realtime", ros_domain=domain)) as run:
            ended = subprocess.run(
                [str(PYTHON), str(SESSION), run.name],
                env=environment(prefix, domain=domain),
                capture_output=True,
                text=True,
                timeout=WAIT_S,
                check=False,
            )
            assert ended.returncode == 0, f"{ended.stderr[-3000:]}\n{run.output[-2000:]}"
            seen = json.loads(ended.stdout.splitlines()[-1])
            seen["state"] = httpx.get(f"{run.url}/robot/gripper", timeout=WAIT_S).json()["state"]
            yield seen


def test_a_goal_is_a_width_and_the_fingers_are_joints(report: dict[str, Any]) -> None:
    gap = report["gap"]
    assert (gap["status"], gap["verdict"]) == (SUCCEEDED, [False, True])
    assert gap["position"] == pytest.approx(0.03, abs=1e-3)
    assert len(gap["feedback"]) > 1
    assert gap["feedback"][0] > gap["feedback"][-1]
    joints = [f"joint{number}" for number in range(1, 8)]
    assert gap["names"] == [*joints, "gripper_finger_1", "gripper_finger_2"]
    assert gap["fingers"] == pytest.approx([0.015, 0.015], abs=5e-4)
    assert gap["lengths"] == [9, 9, 9, 9]


def test_finger_joints_are_commanded(report: dict[str, Any]) -> None:
    joints = report["joints"]
    assert (joints["status"], joints["verdict"]) == (SUCCEEDED, [False, True])
    assert joints["names"] == ["gripper_finger_1", "gripper_finger_2"]
    assert joints["position"] == pytest.approx([0.035, 0.035], abs=5e-4)
    assert joints["feedback"] > 0


def test_a_cancel_stops_and_a_newer_goal_replaces(report: dict[str, Any]) -> None:
    cancelled = report["cancelled"]
    assert cancelled["status"] == CANCELED
    assert 0.005 < cancelled["position"][0] < 0.035
    assert report["preempted"] == [ABORTED, SUCCEEDED]
    assert report["state"]["width"] == pytest.approx(0.08, abs=1e-3)


def test_nonsense_is_refused_and_its_reason_is_on_rosout(report: dict[str, Any]) -> None:
    assert report["accepted"] == [False] * 6
    for words in ("width is 0.5 m", "position is nan", "effort is", "got 0", "thumb"):
        assert any(words in each for each in report["reasons"]), words
