"""FollowJointTrajectory over rosbridge, against a running simulation in real time.

Oracles: roslibpy, a client that others have written; what REST says about the same arm; numpy.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from running import WAIT_S, Run

SCRIPT = Path(__file__).parents[2] / "roslibpy_client.py"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
HOME = np.array([0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0])
NAMES = [f"joint{number}" for number in range(1, 8)]


@pytest.fixture(autouse=True)
def run(service: Run) -> Run:
    """The service with its arm at home."""
    service.go_home()
    return service


def test_roslibpy_follows_and_cancels_trajectories(run: Run) -> None:
    command = [sys.executable, str(SCRIPT), run.url.replace("http", "ws") + "/rosbridge", run.name, "follow"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=2 * WAIT_S, check=False)
    assert done.returncode == 0, done.stderr[-4000:]
    found = json.loads(done.stdout)
    followed, cancelled, strange = found["followed"], found["cancelled"], found["strange"]
    assert (followed["status"], followed["values"]["error_code"]) == (SUCCEEDED, 0)
    turned = [told["actual"]["positions"][0] for told in followed["feedback"]]
    assert len(turned) > 10
    np.testing.assert_allclose(turned[-1], 0.2, atol=2e-3)
    assert cancelled["status"] == CANCELED
    assert "cancelled: the arm came to rest on its path" in cancelled["values"]["error_string"]
    assert (strange["status"], strange["values"]["error_code"]) == (ABORTED, -2)
    at_rest = run.joints()
    assert 0.2 < at_rest[0] < 0.8
    np.testing.assert_allclose(at_rest[1:], HOME[1:], atol=2e-3)
