"""Whatever bytes come into shared memory, the whole compiled cycle bears it, in every mode.

Oracle: the exit status of the process that steps it (`wild_memory`), and numpy's finite differences of all
that was commanded, against joint_limits.yaml (`faults.Record`). After each thing that it did the arm is in
HOLD again.
"""

from __future__ import annotations

import subprocess
import sys

import pytest
from cobot_run import HELPER_ENVIRONMENT
from sample_counts import ENOUGH, samples
from thorough import few
from wild_memory import KINDS

from rtloop.modes import STREAMING

LIMIT_S = 280.0


@pytest.mark.parametrize(
    ("cycles", "seed", "writer", "backend"),
    few(
        [
            (90_000, 1, "between", "loopback"),
            (80_000, 2, "between", "loopback"),
            (120_000, 5, "between", "simulated"),
            (80_000, 4, "beside", "loopback"),
        ]
    ),
)
def test_no_bytes_crash_the_loop_or_lead_it_beyond_the_limits(
    cycles: int, seed: int, writer: str, backend: str
) -> None:
    wanted = samples(cycles)
    command = [sys.executable, "-P", "-m", "wild_memory", str(wanted), str(seed), writer, backend]
    result = subprocess.run(
        command, env=HELPER_ENVIRONMENT, capture_output=True, text=True, check=False, timeout=LIMIT_S
    )
    assert result.returncode == 0, (result.stdout + result.stderr)[-5000:]
    seen, *violations = result.stdout.splitlines()
    assert violations == []
    stepped, kinds, *modes = seen.split()
    assert int(stepped) >= wanted
    if ENOUGH:
        assert int(kinds) == len(KINDS)
        assert {"HOLD", "TRAJECTORY", *(mode.name for mode in STREAMING)} <= set(modes)
