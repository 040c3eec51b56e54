"""What the processes that wait for nobody's plan import: a start takes as long as its imports."""

from __future__ import annotations

import subprocess
import sys

PROCESSES = ("rtloop.main", "ros2.process", "cobot.launch.cli", "cobot.launch.supervisor", "app.server")
SLOW = {"cobot.planners", "httpx", "ompl", "rich", "ruckig", "scipy"}
"""What only planning processes and clients need."""


PLANNING = (
    "app.services.motion.planning_worker",
    "app.services.motion.planning_tasks",
    "cobot.planners.prolonged",
)


def test_a_planning_process_is_ready_without_what_only_some_planners_need() -> None:
    imported = _imported(PLANNING)
    assert "cobot.planners.ptp" in imported
    assert not imported & {"scipy", "ompl"}


def test_no_process_imports_what_only_planners_and_clients_need() -> None:
    assert not _imported(PROCESSES) & SLOW


def _imported(modules: tuple[str, ...]) -> set[str]:
    code = f"import sys, {', '.join(modules)}; print(*sys.modules, sep='\\n')"
    done = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, text=True, check=True)
    imported = set(done.stdout.splitlines())
    assert imported >= set(modules)
    return imported
