"""Whatever waits or decides goes by CLOCK_MONOTONIC: the clock on the wall jumps when it is set.

The contract: who looks at the wall is in this list, with what for, and none of that is a decision. A running
robot under a wild clock is in tests/e2e/realtime/test_faults.py.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("cobot", "rtloop", "app")
WALL = {
    "app/api/routers/backups.py": "names of archives",
    "app/aubo/system_info.py": "what time it is, for who asks",
    "app/services/devices/traces.py": "time stamps of messages",
    "app/services/motion/trajectories.py": "time stamps of lines",
    "app/services/programs/sequences.py": "time stamps of lines and of the status",
    "cobot/access/tokens.py": "when a token was made, and the date on which it ends",
    "cobot/audit.py": "time stamps of entries",
    "cobot/clock.py": "the one place that services ask",
    "cobot/fleet/certificates.py": "when a certificate begins and ends",
    "cobot/ipc/shm.py": "when the memory was made",
    "cobot/launch/backup/backup.py": "when a backup was made",
    "cobot/launch/backup/support.py": "when a support bundle was made",
    "cobot/learning/record.py": "time stamps of episodes",
    "cobot/learning/simulation.py": "time stamps of episodes",
    "cobot/logs/lines.py": "time stamps of lines",
    "cobot/logs/process.py": "time stamps of lines",
    "cobot/logs/supervision.py": "time stamps of lines",
    "cobot/recorder/robot.py": "names and time stamps of recordings",
    "cobot/dds/gateway.py": "time stamps of ROS",
    "cobot/dds/parameters.py": "time stamps of ROS",
    "cobot/dds/rtps/discovery.py": "time stamps of RTPS",
    "cobot/dds/rtps/writer.py": "time stamps of RTPS",
    "rtloop/backends/simulators/arrivals.py": "how long ago the kernel got a packet, by its stamp",
    "rtloop/main.py": "when it was started",
    "cobot/runner/recorder.py": "time stamps in recordings",
    "cobot/runner/runner.py": "time stamps of lines",
}
"""Who looks at the clock on the wall, and what for."""
ASKS = {("time", "time"), ("time", "time_ns"), ("datetime", "now"), ("datetime", "utcnow"), ("date", "today")}


def wall_readings(source: str) -> Iterator[ast.Call]:
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            value = node.func.value
            if isinstance(value, ast.Name) and (value.id, node.func.attr) in ASKS:
                yield node


def test_the_contract_sees_what_it_is_about() -> None:
    source = "import time\nwhile time.time() < 5: time.monotonic(); datetime.now(UTC)"
    assert len(list(wall_readings(source))) == 2


@pytest.mark.parametrize("package", PACKAGES)
def test_only_who_writes_time_stamps_looks_at_the_clock_on_the_wall(package: str) -> None:
    found = {
        str(path.relative_to(ROOT))
        for path in (ROOT / package).rglob("*.py")
        if any(wall_readings(path.read_text(encoding="utf-8")))
    }
    assert found == {name for name in WALL if name.startswith(f"{package}/")}


def test_nothing_that_is_compiled_looks_at_the_clock_on_the_wall() -> None:
    asks = re.compile(r"time\.time|time_ns\(\)|datetime|CLOCK_REALTIME|gettimeofday")
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.pyx"):
            source = path.read_text(encoding="utf-8").replace("monotonic_ns()", "")
            assert not asks.search(source), path


def test_nobody_imports_the_functions_by_name_past_this_contract() -> None:
    for package in PACKAGES:
        for path in (ROOT / package).rglob("*.py"):
            assert "from time import" not in path.read_text(encoding="utf-8"), path
