"""Agents with the official client of before 2.0, by HTTP and by `cobot mcp`, at a running service.

Oracles: that client, in an environment of its own, and where the arm is.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
from cobot_run import WAIT_S, Run, answering
from folders import ROOT, SUPPORT

PYTHON = ROOT / ".venv" / "mcp1" / "bin" / "python"
NEAR, FAR = [0.0, 0.1, 0.0, -1.6, 0.0, 1.5, 0.0], [0.5, 0.1, 0.0, -1.6, 0.0, 1.5, 0.0]
FENCED = "mcp: {execution: fenced, fence: {low: [-2, -2, -2], high: [2, 2, 2], speed_m_s: 2}}\n"
pytestmark = [
    pytest.mark.thorough,
    pytest.mark.skipif(not PYTHON.exists(), reason=f"there is no {PYTHON}: make setup-dev"),
]


@pytest.fixture(scope="module")
def fenced(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """In real time: what is tested happens in the middle of a motion."""
    with answering(Run(tmp_path_factory.mktemp("fenced"), clock="realtime", more=FENCED)) as started:
        yield started


def ways(run: Run) -> dict[str, list[str]]:
    return {"HTTP": [f"{run.url}/mcp/mcp"], "stdio": [sys.executable, "-m", "cobot", "mcp", "--url", run.url]}


@contextmanager
def agent(where: list[str], *motions: tuple[list[float], float]) -> Iterator[subprocess.Popen[str]]:
    command = [str(PYTHON), str(SUPPORT / "mcp1_client.py"), *where, json.dumps(motions)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


def told(process: subprocess.Popen[str]) -> dict[str, Any]:
    assert process.stdout is not None
    found: dict[str, Any] = json.loads(process.stdout.readline())
    return found


@pytest.mark.parametrize("way", ["HTTP", "stdio"])
def test_an_older_client_looks_plans_and_moves_and_stops_the_arm_when_it_is_killed(
    fenced: Run, way: str
) -> None:
    fenced.go_home()
    with agent(ways(fenced)[way], (NEAR, 0.5), (FAR, 0.01)) as process:  # the second takes half a minute
        offered = told(process)
        assert {"plan_to_joints", "execute", "stop"} <= set(offered["tools"])
        assert set(offered["prompts"]) == {"move_safely", "diagnose"}
        assert "1. get_state reports" in offered["manual"]
        assert told(process)["success"]
        assert fenced.joints() == pytest.approx(NEAR, abs=5e-3)
        fenced.until(lambda: fenced.joints()[0] > 0.01)
    job = fenced.until(lambda: (job := newest(fenced))["state"] == "cancelled" and job)
    assert "the client has disconnected" in job["error"]["detail"]
    assert fenced.joints()[0] < 0.9 * FAR[0]


def newest(run: Run) -> dict[str, Any]:
    answer = httpx.get(f"{run.url}/jobs?n=1", timeout=WAIT_S).json()
    job: dict[str, Any] = answer["jobs"][0]
    return job
