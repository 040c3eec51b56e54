"""The quick-start scripts of libpyflexiv's README, run as they stand there but for the import and the name.

The oracle is that text itself, beside the project in `../shared/spec`; a clone without it skips the test.
Two things the scripts leave to their reader: the first uses `math`, and the last has a `home_pose`.
"""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from cobot_run import Run, answering

pytestmark = pytest.mark.thorough

SPEC = Path(__file__).parents[4] / "shared/spec/002_c6979c3efec4c83c.txt"
HEADINGS = (
    "Joint Impedance Control",
    "Cartesian Motion+Force Control",
    "Non-Blocking Trajectory (Reset to Home)",
    "API Reference",
)
LEFT_TO_THE_READER = "import math", "home_pose = init_pose"


@pytest.mark.skipif(not SPEC.exists(), reason="the specification does not lie beside this clone")
def test_the_three_scripts_run_with_the_import_line_changed(tmp_path: Path) -> None:
    text = SPEC.read_text(encoding="utf-8").partition("\nQuick Start\n")[2]
    first, second, third = (
        text.partition(f"\n{heading}\n")[2].partition(f"\n{following}\n")[0]
        for heading, following in pairwise(HEADINGS)
    )
    math, home = LEFT_TO_THE_READER
    with answering(Run(tmp_path, clock="realtime")) as run:
        first = first.replace("from flexiv_rt import", "from cobot import").replace(
            "Rizon4s-XXXXXX", run.name
        )
        script = tmp_path / "quick_start.py"
        script.write_text("\n".join([math, first, second, home, third, "robot.close()"]), encoding="utf-8")
        done = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120)
        assert done.returncode == 0, done.stderr
        assert run.healthy()
        assert "FAULT" not in run.output
