"""A running `cobot run` whose files are edited: POST /admin/reload and SIGHUP; and what systemd is told.

Oracles: shared memory as rtloop publishes it, process ids, Prometheus' own parser.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
import yaml
from cobot_run import WAIT_S, Run, answering
from independent_models import LIMITS, SRDF
from prometheus_client.parser import text_string_to_metric_families

from cobot.ipc.shm import MemoryRole, RobotMemory

LONG = {"points": [{"positions": [0.5, 0, 0, -1.57, 0, 1.57, 0], "time_from_start": 2000.0}]}


class Edited(Run):
    """One with files of its own, started as systemd would."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.systemd = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.systemd.bind(str(folder / "notify"))
        self.told: list[str] = []
        shutil.copy(LIMITS, folder / "limits.yaml")
        shutil.copy(SRDF, folder / "positions.srdf")
        super().__init__(folder)

    def start(self) -> Any:
        text = self.config.read_text(encoding="utf-8")
        text = text.replace(f"name: {self.name}", f"name: {self.name}, srdf: positions.srdf")
        self.config.write_text(text.replace("web: {", "web: {joint_limits: limits.yaml, "), encoding="utf-8")
        os.environ |= {"NOTIFY_SOCKET": str(self.folder / "notify"), "WATCHDOG_USEC": "1000000"}
        try:
            return super().start()
        finally:
            del os.environ["NOTIFY_SOCKET"], os.environ["WATCHDOG_USEC"]

    def notified(self, what: str) -> bool:
        """Whether systemd has been told a line."""
        self.systemd.setblocking(False)
        try:
            while True:
                self.told += self.systemd.recv(4096).decode().splitlines()
        except BlockingIOError:
            return what in self.told

    def edit(self, name: str, old: str, new: str) -> None:
        file = self.folder / name
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new, 1), encoding="utf-8")

    def limit(self, joint: str, key: str, value: float) -> None:
        file = self.folder / "limits.yaml"
        content = yaml.safe_load(file.read_text(encoding="utf-8"))
        content["joint_limits"][joint][key] = value
        file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")

    def reload(self) -> httpx.Response:
        return httpx.post(f"{self.url}/admin/reload", timeout=WAIT_S)

    def info(self) -> Any:
        """What rtloop says of its robot."""
        memory = RobotMemory.attach(self.name, MemoryRole.READER)
        try:
            return memory.info.read().copy()
        finally:
            memory.close()

    def post(self, path: str, **body: Any) -> httpx.Response:
        return httpx.post(f"{self.url}{path}", json=body, timeout=WAIT_S)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Edited]:
    with answering(Edited(tmp_path_factory.mktemp("edited"))) as started:
        started.until(lambda: httpx.get(f"{started.url}/health/ready", timeout=5.0).status_code == 200)
        yield started
        started.systemd.close()


def test_systemd_is_told_when_all_is_ready_and_then_that_it_lives(run: Edited) -> None:
    run.until(lambda: run.notified("READY=1"))
    assert any(line.startswith("STATUS=http://") for line in run.told)
    run.until(lambda: run.notified("WATCHDOG=1") and run.told.count("WATCHDOG=1") >= 2)
    assert run.told.count("READY=1") == 1


def test_what_has_changed_counts_everywhere_at_once(run: Edited) -> None:
    rtloop = run.child("rtloop")
    assert rtloop is not None
    run.edit("positions.srdf", 'name="work"', 'name="bench"')
    run.edit(run.config.name, "web: {", "web: {max_json_bytes: 4096, ")
    run.limit("joint1", "max_velocity", 1.0)
    run.limit("joint7", "max_position", 1.0)
    plan = run.post("/robot/plan/named", name="home", start=[0.1, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0]).json()
    answer = run.reload()
    assert answer.status_code == 200, answer.text
    assert answer.json() == {
        "taken_over": [
            "named positions: bench added, work removed",
            "joint7.max_position: 3.05 → 1",
            "joint1.max_velocity: 1.4835 → 1",
            "web.max_json_bytes: 2097152 → 4096",
        ],
        "needs_restart": [],
    }
    new = run.child("rtloop")
    assert new is not None
    assert new.pid != rtloop.pid
    assert run.info()["max_velocity"][0] == 1.0
    assert run.info()["max_position"][6] == 1.0
    outdated = run.post("/robot/execute", plan_id=plan["plan_id"])
    assert outdated.status_code == 409
    assert "max_position of joint7 was 3.05 when the plan was made, but is 1 now" in outdated.json()["detail"]
    assert run.post("/robot/move/named", name="bench", speed=1.0).json()["success"]
    beyond = run.post("/robot/move/joints", joints=[0.0, 0.5, 0.0, -1.57, 0.0, 1.57, 1.2])
    assert (beyond.status_code, beyond.json()["code"]) == (422, "limit")
    assert "allowed: -3.05 to 1 rad" in beyond.json()["detail"]
    large = httpx.post(f"{run.url}/trajectory/send", json={"points": ["x" * 5000]}, timeout=WAIT_S)
    assert large.status_code == 413
    schema = httpx.get(f"{run.url}/openapi.json", timeout=WAIT_S).json()
    joints = schema["components"]["schemas"]["MoveJoints"]["properties"]["joints"]["prefixItems"]
    assert joints[6]["maximum"] == 1.0


def test_planners_go_by_the_new_limits(run: Edited) -> None:
    """A turn of joint 1 by 2 rad takes two seconds at the new 1 rad/s, and 1.4 at the old limit."""
    there = run.joints()
    there[0] += 2.0
    assert run.post("/robot/move/joints", joints=there, speed=1.0).json()["success"]
    too_fast = {"positions": [there[0] - 2.0, *there[1:]], "time_from_start": 1.9}
    answer = run.post("/trajectory/send", points=[too_fast])
    assert answer.status_code == 422
    assert "joint1" in answer.json()["detail"]
    assert "1 rad/s" in answer.json()["detail"]
    run.go_home()


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("limits.yaml", "max_velocity: 1.0", "max_velocity: fast", "joint1.max_velocity: must be a number"),
        ("positions.srdf", "<group_state", "<group_stat", "not a readable SRDF"),
        ("limits.yaml", "max_position: 2.1", "max_position: 0.1", "position '"),
    ],
)
def test_a_file_that_is_not_valid_changes_nothing_and_is_named(
    run: Edited, name: str, old: str, new: str, message: str
) -> None:
    before = (run.folder / name).read_text(encoding="utf-8")
    run.edit(name, old, new)
    run.edit(run.config.name, "max_json_bytes: 4096", "max_json_bytes: 5000")
    answer = run.reload()
    assert answer.status_code == 422, answer.text
    assert (
        str(run.folder / ("positions.srdf" if message == "position '" else name)) in answer.json()["detail"]
    )
    assert message in answer.json()["detail"]
    (run.folder / name).write_text(before, encoding="utf-8")
    run.edit(run.config.name, "max_json_bytes: 5000", "max_json_bytes: 4096")
    assert run.reload().json() == {"taken_over": [], "needs_restart": []}


def test_what_restarts_by_itself_does_not_see_a_file_that_is_being_edited(run: Edited) -> None:
    before = (run.folder / "limits.yaml").read_text(encoding="utf-8")
    plan = run.post("/robot/plan/named", name="home", start=[0.1, 0.5, 0.0, -1.57, 0.0, 1.57, 0.0]).json()
    (run.folder / "limits.yaml").write_text("joint_limits: {", encoding="utf-8")
    try:
        for module in ("rtloop", "app"):
            old = run.child(module)
            assert old is not None
            old.kill()
            run.until(lambda module=module, pid=old.pid: run.restarted(module, pid) and run.healthy())
        forgotten = run.post("/robot/execute", plan_id=plan["plan_id"])
        assert forgotten.status_code == 404
        assert "until the service restarts; plan again" in forgotten.json()["detail"]
        assert run.info()["max_velocity"][0] == 1.0
        run.go_home()  # with new planning processes
    finally:
        (run.folder / "limits.yaml").write_text(before, encoding="utf-8")


def test_nothing_is_read_while_something_moves(run: Edited) -> None:
    assert run.post("/trajectory/send", **LONG).json()["status"] == "sent"
    run.edit("positions.srdf", 'name="bench"', 'name="desk"')
    try:
        answer = run.reload()
        assert answer.status_code == 409
        assert "in use by POST /trajectory/send" in answer.json()["detail"]
    finally:
        run.post("/stop")
    positions = httpx.get(f"{run.url}/robot/positions", timeout=WAIT_S).json()
    assert "bench" in [position["name"] for position in positions]


def test_an_arm_is_not_left_beyond_its_limits(run: Edited) -> None:
    run.go_home()
    there = run.joints()
    there[0] = 2.0
    assert run.post("/robot/move/joints", joints=there, speed=1.0).json()["success"]
    run.limit("joint1", "max_position", 1.5)
    answer = run.reload()
    assert answer.status_code == 409
    assert "is outside the new limits: the angle of joint1 is 2 rad" in answer.json()["detail"]
    run.limit("joint1", "max_position", 2.97)
    run.go_home()


def test_sighup_reads_the_configuration_again_and_the_log_has_the_answer(run: Edited) -> None:
    run.edit(run.config.name, "rt: {", "rt: {priority: 70, ")
    pid = run.child("rtloop")
    run.process.send_signal(signal.SIGHUP)
    run.until(lambda: "applied: named positions: desk added, bench removed" in run.output)
    run.until(lambda: "needs a restart: rt.priority: 80 → 70" in run.output)
    assert run.child("rtloop") == pid
    (run.folder / "limits.yaml").rename(run.folder / "away.yaml")
    run.process.send_signal(signal.SIGHUP)
    run.until(lambda: re.search(r"reload rejected: .*limits\.yaml: no such file", run.output))
    (run.folder / "away.yaml").rename(run.folder / "limits.yaml")
    assert run.healthy()


def test_metrics_tell_what_happened(run: Edited) -> None:
    text = httpx.get(f"{run.url}/metrics", timeout=WAIT_S).text
    samples = {
        (sample.name, *sorted(sample.labels.items())): sample.value
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    }
    assert samples["cobot_process_restarts_total", ("process", "rtloop")] == 2  # a reload, and a kill
    assert samples["cobot_process_restarts_total", ("process", "service")] == 1
    robot = ("robot", run.name)
    assert samples["cobot_motions_total", ("result", "stopped"), robot] == 1
    assert samples["cobot_motions_total", ("result", "arrived"), robot] >= 2
    assert samples["cobot_cycles_total", robot] > 0
    assert samples["cobot_cycle_seconds_count", ("phase", "total"), robot] > 0
    assert samples["cobot_ready", robot] == 1
    assert samples["process_open_fds",] > 5


def test_the_end_is_told_and_leaves_nothing(run: Edited) -> None:
    folder = Path(f"{run.memory}.run")
    assert folder.stat().st_mode & 0o777 == 0o700
    run.notified("")  # its queue is short
    run.end()
    run.until(lambda: run.notified("STOPPING=1"))
    assert not folder.exists()
