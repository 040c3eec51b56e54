"""The benchmarks, which the tests do not run and the type checker does not read."""

from __future__ import annotations

import subprocess
import sys

from folders import ROOT


def test_all_benchmarks_can_be_imported() -> None:
    told = subprocess.run(
        [sys.executable, "-m", "benchmarks", "--help"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert told.returncode == 0, told.stderr
    assert "problem_sets" in told.stdout
