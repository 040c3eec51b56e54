"""What the processes that wait for nobody's plan import: a start takes as long as its imports."""

from __future__ import annotations

import subprocess
import sys

PROCESSES = ("rtloop.main", "ros2.process", "cobot.launch.cli", "cobot.launch.supervisor", "app.server")
SLOW = {"cobot.planners", "httpx", "ompl", "rich", "ruckig", "scipy"}
"""What only planning processes and clients need."""


def test_no_process_imports_what_only_planners_and_clients_need() -> None:
    code = f"import sys, {', '.join(PROCESSES)}; print(*sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    imported = set(done.stdout.splitlines())
    assert imported >= set(PROCESSES)
    assert not imported & SLOW
