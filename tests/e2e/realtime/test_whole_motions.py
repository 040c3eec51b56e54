"""The service with a device that takes whole motions and moves along them by itself: the toy of
`cobot backend new --trajectory`, in real time, asked by its own thread.

Oracle: where the service says that the arm is afterwards.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import httpx
import pytest
import rest_tour
import yaml
from arm_activities import Motion, robot_health
from cobot_run import WAIT_S, Run, answering


class SlowRun(Run):
    """The shipped iiwa with another backend."""

    def start(self) -> subprocess.Popen[str]:
        settings = yaml.safe_load(self.config.read_text(encoding="utf-8"))
        settings["robot"]["backend"] = "rtloop.contract.toy_trajectory:ToyArm"
        self.config.write_text(yaml.safe_dump(settings), encoding="utf-8")
        return super().start()


@pytest.fixture(scope="module")
def slow(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    with answering(SlowRun(tmp_path_factory.mktemp("slow"), clock="realtime")) as started:
        yield started


def test_the_rest_tour(slow: Run) -> None:
    rest_tour.tour(slow, "motions", "plans", "trajectories", "programs")


def test_what_it_can_is_shown_and_what_not_is_refused(slow: Run) -> None:
    (shown,) = httpx.get(f"{slow.url}/robots", timeout=WAIT_S).json()
    assert "trajectories" in shown["device"]["able"]
    assert shown["device"]["status"]["operation_mode"] == "AUT"
    refused = httpx.post(f"{slow.url}/robot/speed_override", json={"fraction": 0.5}, timeout=WAIT_S)
    assert "executes whole motions itself" in refused.json()["detail"]


def test_a_stop_lets_it_rest(slow: Run) -> None:
    motion = Motion(slow)
    motion.end()  # by POST /stop
    assert isinstance(motion.answer, httpx.Response)
    slow.until(lambda: robot_health(slow).get("mode") == "HOLD")
    assert "stopped by POST /stop" in motion.answer.text
