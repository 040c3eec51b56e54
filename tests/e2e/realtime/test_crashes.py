"""Every process is killed or stopped in what the service does for others: the table in docs/architecture.md.

What test_faults.py has is not here again: a planned motion and a local client's stream. There is one `cobot
run` for all, and nothing is restarted by hand. Oracles: `faults.Record`, which reads the state block as
anybody can and takes numpy's differences of consecutive cycles; the process table.
"""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial

import httpx
import numpy as np
import psutil
import pytest
from arm_activities import BUSY, HOME, child, doing, left_alone, name, reset, robot_health
from cobot_run import WAIT_S, Run, again, answering, until
from dds_peers import own_domain
from faults import Record, watched
from flange_tools import loaded
from independent_models import second_robot
from service_activities import ACTIVITIES, AWAY, active, goal_asked
from thorough import few

from cobot.config import load_settings
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.robot import description as robots
from cobot.robot.tool import Tool


@pytest.fixture(scope="module")
def crashing(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    with own_domain() as domain:
        run = Run(tmp_path_factory.mktemp("crashes"), clock="realtime", ros_domain=domain)
        with answering(run):
            yield run


@pytest.fixture
def record(crashing: Run) -> Iterator[Record]:
    limits = robots.load_robot(load_settings()).limits
    with watched(name(crashing), limits, 0.001) as made:
        yield made


def workers(run: Run) -> list[psutil.Process]:
    service = child(run, "app", None)
    found = service.children()
    return [each for each in found if "app.services.motion.planning_worker" in each.cmdline()]


def runners(run: Run) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter(["cmdline"]):
        line = process.info["cmdline"] or []
        if "cobot.runner" in line and any(run.url.rsplit(":", 1)[1] in part for part in line):
            found.append(process)
    return found


def move(run: Run, goal: list[float], speed: float = 1.0) -> httpx.Response:
    body = {"joints": goal, "speed": speed}
    return httpx.post(f"{run.url}/robot/move/joints", json=body, timeout=WAIT_S)


def require_arrival(run: Run, goal: list[float], speed: float = 1.0) -> None:
    """What a busy computer has stopped is asked for again."""

    def asked() -> tuple[bool, str]:
        answer = move(run, goal, speed).json()
        return answer.get("success", False), answer.get("message") or answer.get("detail")

    again(asked)


def require_able(run: Run, record: Record) -> None:
    """The arm rests, can be moved, and no limit was violated."""
    run.until(lambda: robot_health(run).get("mode") in ("HOLD", "ESTOP", "FAULT"))
    run.until(lambda: reset(run) and run.healthy())
    run.until(lambda: move(run, HOME).json().get("success"))
    assert record.violations() == []


class NewGoals:
    """A motion whose goal a client changes again and again.

    Attributes:
        asking: set while a request waits for its answer.
        statuses: of the answers; 0 is a connection that broke.
    """

    ANGLES = (2.4, 0.4, 1.8, 0.8)

    def __init__(self, run: Run) -> None:
        self._url = run.url
        self.asking = threading.Event()
        self.statuses: list[int] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._talk, daemon=True)
        self._thread.start()
        run.until(lambda: self.statuses.count(200) > 1)

    def _talk(self) -> None:
        with httpx.Client(base_url=self._url, timeout=WAIT_S) as http:
            body = {"joints": AWAY, "speed": 0.1}
            job = http.post("/robot/move/joints?wait=false", json=body).json()["id"]
            until(lambda: http.get(f"/jobs/{job}").json()["motion_id"])
            for angle in itertools.cycle(self.ANGLES):
                goal = {"joints": [angle, *AWAY[1:]], "speed": 0.1, "planner": "ompl"}
                self.asking.set()
                try:
                    self.statuses.append(http.post(f"/jobs/{job}/retarget", json=goal).status_code)
                except httpx.HTTPError:
                    self.statuses.append(0)
                self.asking.clear()
                if self._over.is_set() or self.statuses[-1] != 200:
                    return

    def end_with(self, process: psutil.Process) -> None:
        """Kill a process during the last request."""
        self._over.set()
        process.kill()
        self._thread.join(WAIT_S)
        assert not self._thread.is_alive()


@pytest.mark.parametrize("after_s", few([0.01, 0.0]))
@pytest.mark.parametrize("which", ["app", "rtloop"])
def test_what_is_killed_while_a_goal_changes_leaves_an_arm_at_rest(
    crashing: Run, record: Record, which: str, after_s: float
) -> None:
    run = crashing
    goals = NewGoals(run)
    old = child(run, which, None)
    assert goals.asking.wait(WAIT_S)
    time.sleep(after_s)
    goals.end_with(old)
    run.until(lambda: run.restarted(which, old.pid) and run.healthy())
    run.until(lambda: robot_health(run).get("mode") == "HOLD")
    jobs = httpx.get(f"{run.url}/jobs", timeout=WAIT_S).json()["jobs"]
    assert not [job for job in jobs if job["ended_at"] is None]
    require_able(run, record)


def test_a_recording_of_a_motion_with_a_new_goal_has_the_way_to_it(crashing: Run, record: Record) -> None:
    """Oracles: the path that the service has for the motion after the change; the joints that are measured in
    the end."""
    run = crashing
    require_arrival(run, HOME)
    with httpx.Client(base_url=run.url, timeout=WAIT_S) as http:
        body = {"joints": [1.5, *HOME[1:]], "speed": 0.5}
        job = http.post("/robot/move/joints?wait=false", json=body).json()["id"]
        run.until(lambda: http.get(f"/jobs/{job}").json()["progress"] > 0.2)
        goal = {"joints": [-0.5, 0.3, *HOME[2:]], "speed": 0.5}
        changed = http.post(f"/jobs/{job}/retarget", json=goal)
        assert changed.status_code == 200, changed.text
        planned = np.array([each["joints"] for each in http.get("/robot/motion").json()["path"]])
        assert http.get(f"/jobs/{job}?wait_s=60").json()["state"] == "finished"
        dumped = http.post("/recordings", json={"action": "dump", "seconds": 30}).json()
        found = http.get(f"/recordings/{dumped['names'][0]}/path?samples=1000").json()
        http.delete(f"/recordings/{dumped['names'][0]}")
    rows = np.array([each["joints"] for each in found["path"]])
    np.testing.assert_allclose(rows[-1], goal["joints"], atol=5e-3)
    off = np.abs(planned[:, None] - rows).max(axis=2).min(axis=1)
    assert off.max() < 0.05, "the recorded arm was near each place of the new path"
    number = changed.json()["motion_id"]
    texts = [each["text"] for each in found["events"]]
    assert [text for text in texts if f"motion {number} " in text] == [
        f"motion {number} begun",
        f"motion {number} arrived",
    ]
    assert record.violations() == []


@pytest.mark.parametrize("activity", few(["servo", "goal", "sequence", "lua"]))
def test_a_service_that_is_killed_leaves_an_arm_at_rest_and_no_runner(
    crashing: Run, record: Record, activity: str
) -> None:
    run = crashing
    with active(run, activity):
        old = child(run, "app", None)
        old.kill()
        run.until(lambda: run.restarted("app", old.pid) and run.healthy())
        run.until(lambda: robot_health(run).get("mode") == "HOLD")
        robot = robot_health(run)
        assert left_alone(robot["reason"]) or robot["reason"] == "the streaming client has died"
        run.until(lambda: not runners(run))
        health = run.health()
        assert health is not None
        assert health["service"]["motion"] is None  # type: ignore[index]
        jobs = httpx.get(f"{run.url}/jobs", timeout=WAIT_S).json()["jobs"]
        assert not [job for job in jobs if job["ended_at"] is None]
        lost = [job["kind"] for job in jobs if job["state"] == "interrupted"]
        known = {"goal": "follow_joint_trajectory", "sequence": "sequence", "lua": "program"}
        assert activity == "servo" or known[activity] in lost
    require_able(run, record)


@pytest.mark.parametrize("activity", few(["servo", "goal", "sequence", "lua"]))
def test_an_rtloop_that_is_killed_ends_what_it_did_and_everybody_is_told(
    crashing: Run, record: Record, activity: str
) -> None:
    run = crashing
    with active(run, activity) as doing:
        old = child(run, "rtloop", None)
        old.kill()
        run.until(lambda: run.restarted("rtloop", old.pid) and run.healthy())
        run.until(lambda: (run.health() or {"service": {"motion": ""}})["service"]["motion"] is None)  # type: ignore[index]
        run.until(doing.error)
    require_able(run, record)


@pytest.mark.thorough
@pytest.mark.parametrize("activity", ["servo", "goal", "sequence", "lua"])
@pytest.mark.parametrize(
    ("which", "reason"), [("app", "the service has been silent for"), ("rtloop", "a cycle began")]
)
def test_a_process_that_is_stopped_for_a_while_goes_on_with_an_arm_at_rest_and_everybody_is_told(
    crashing: Run, record: Record, activity: str, which: str, reason: str
) -> None:
    run = crashing
    with active(run, activity) as doing:
        stopped = child(run, which, None)
        stopped.suspend()
        time.sleep(1.5)
        stopped.resume()
        run.until(lambda: reason in " ".join(record.reasons))
        run.until(lambda: reason in doing.error())
        run.until(run.healthy)
        assert child(run, which, None) == stopped
    require_able(run, record)


@pytest.mark.parametrize("activity", few([*ACTIVITIES, "stream"]))
def test_processes_beside_the_motion_that_are_stopped_and_killed_leave_it_alone(
    crashing: Run, record: Record, activity: str
) -> None:
    """The ROS 2 process, the recorder and the planning process, all at once."""
    run = crashing
    with doing(run, activity) if activity == "stream" else active(run, activity):
        (worker,) = run.until(lambda: workers(run))
        beside = {which: child(run, which, None) for which in ("cobot.dds", "cobot.recorder")}
        for signal in ("suspend", "kill"):
            for each in (worker, *beside.values()):
                getattr(each, signal)()
            so_far, here = len(record.modes), record.commanded[-1]
            run.until(lambda here=here: np.abs(record.commanded[-1] - here).max() > 0.01)
            assert set(record.modes[so_far:]) <= BUSY
        for which, old in beside.items():
            run.until(partial(run.restarted, which, old.pid))
        run.until(lambda: worker.pid not in [each.pid for each in workers(run)])
    require_able(run, record)


@pytest.mark.parametrize("signal", few(["kill", "suspend"]))
def test_a_ros_process_that_fails_is_no_business_of_the_arm(
    crashing: Run, record: Record, signal: str
) -> None:
    run = crashing
    move(run, HOME)
    old = run.until(lambda: run.child("cobot.dds"))
    getattr(old, signal)()
    try:
        require_arrival(run, AWAY, 0.5)
    finally:
        if signal == "suspend":
            old.resume()
    run.until(lambda: signal == "suspend" or run.restarted("cobot.dds", old.pid))
    require_able(run, record)


GOAL_CLIENT = """
import sys, time
from websockets.sync.client import connect
with connect(sys.argv[1]) as socket:
    socket.send(sys.argv[2])
    time.sleep(600)
"""


def test_a_client_of_rosbridge_that_is_killed_loses_its_goal(crashing: Run, record: Record) -> None:
    run = crashing
    run.go_home()
    url = run.url.replace("http", "ws") + "/rosbridge"
    client = subprocess.Popen([sys.executable, "-c", GOAL_CLIENT, url, goal_asked(run, AWAY, 20)])
    try:
        run.until(lambda: robot_health(run).get("mode") == "TRAJECTORY")
    finally:
        client.kill()
        client.wait()
    run.until(lambda: robot_health(run).get("mode") == "HOLD")
    job = httpx.get(f"{run.url}/jobs", timeout=WAIT_S).json()["jobs"][0]
    assert (job["kind"], job["state"]) == ("follow_joint_trajectory", "cancelled")
    require_able(run, record)


def test_a_kept_file_that_is_spoilt_is_set_aside_or_said_and_the_arm_is_held_meanwhile(
    crashing: Run, record: Record
) -> None:
    """Taught positions can be done without, what the arm carries cannot."""
    run = crashing
    positions, tool = (
        run.config.parent / "logs" / f"{run.name}.{what}.json" for what in ("positions", "tool")
    )
    positions.write_text("{", encoding="utf-8")
    tool.write_text("{", encoding="utf-8")
    with active(run, "motion") as doing:
        child(run, "app", None).kill()
        run.until(lambda: f"{tool}: is not a tool: invalid JSON" in run.output)
        run.until(lambda: any(map(left_alone, list(record.reasons))))
        tool.unlink()
        run.until(lambda: (run.health() or {}).get("problems"))
    assert isinstance(doing.answer, httpx.TransportError)
    aside = positions.with_name(f"{positions.name}.spoilt-1")
    problems = (run.health() or {})["problems"]
    assert [str(aside) in each for each in problems] == [True], problems  # type: ignore[attr-defined]
    aside.unlink()
    require_able(run, record)


def test_a_planning_process_that_is_killed_is_replaced_and_the_next_motion_arrives(
    crashing: Run, record: Record
) -> None:
    run = crashing

    def planning() -> dict[str, int]:
        return (run.health() or {})["planning"]  # type: ignore[return-value]

    run.until(lambda: planning()["usable"] == 1)
    before = planning()["replaced"]
    (worker,) = workers(run)
    worker.kill()
    require_arrival(run, AWAY)
    run.until(lambda: planning()["usable"] == 1)
    assert planning()["replaced"] == before + 1
    assert run.healthy()
    assert f"a planning process (pid {worker.pid}) was ended by SIGKILL and is replaced" in run.output
    require_able(run, record)


def test_a_planning_process_that_is_stopped_is_replaced(crashing: Run, record: Record) -> None:
    run = crashing
    (worker,) = run.until(lambda: workers(run))
    worker.suspend()
    require_arrival(run, AWAY)
    assert worker.pid not in [each.pid for each in workers(run)]
    require_able(run, record)


@pytest.mark.thorough
def test_the_load_is_held_again_by_who_is_restarted(crashing: Run, record: Record) -> None:
    """Oracle: pinocchio, in which the load is a body of its own."""
    load = Tool(mass=10.0, centre=(0.02, -0.05, 0.12))
    expected = loaded(load).gravity(np.array(HOME)) - second_robot().gravity(np.array(HOME))
    crashing.go_home()
    before = efforts(crashing)
    tool = {"mass": load.mass, "centre": list(load.centre)}
    answer = httpx.post(f"{crashing.url}/robot/tool", json=tool, timeout=WAIT_S)
    assert answer.status_code == 200, answer.text
    crashing.until(lambda: np.abs(efforts(crashing) - before - expected).max() < 0.3)
    for which in ("rtloop", "app"):
        victim = child(crashing, which, None)
        victim.kill()
        crashing.until(partial(crashing.restarted, which, victim.pid))
        crashing.until(crashing.healthy)
        assert httpx.get(f"{crashing.url}/robot/tool", timeout=WAIT_S).json()["mass"] == load.mass
        crashing.until(lambda: np.abs(efforts(crashing) - before - expected).max() < 0.3)
    require_arrival(crashing, AWAY, 0.3)
    httpx.post(f"{crashing.url}/robot/tool", json={"clear": True}, timeout=WAIT_S).raise_for_status()


def efforts(run: Run) -> np.ndarray:
    return np.array(httpx.get(f"{run.url}/robot/joint_states", timeout=WAIT_S).json()["effort"])


@pytest.mark.thorough
def test_a_spoilt_header_is_mended_and_who_is_restarted_meanwhile_comes_back(
    crashing: Run, record: Record
) -> None:
    """Wild bytes in the whole page, again and again, while rtloop is dead."""
    run, random = crashing, np.random.default_rng(8)
    with active(run, "goal"):
        old = child(run, "rtloop", None)
        with run.memory.open("r+b", buffering=0) as file:
            file.write(random.bytes(4096))
            old.kill()
            for _ in range(10):
                file.seek(0)
                file.write(random.bytes(4096))
                time.sleep(0.03)
        run.until(lambda: run.restarted("rtloop", old.pid) and run.healthy())
    RobotMemory.attach(name(run), MemoryRole.READER).close()
    run.until(lambda: "was overwritten and has been restored" in run.output)
    require_able(run, record)


@pytest.mark.thorough
def test_a_supervisor_that_is_stopped_is_missed_by_nobody_until_something_dies(
    crashing: Run, record: Record
) -> None:
    run = crashing
    supervisor = psutil.Process(run.process.pid)
    supervisor.suspend()
    try:
        require_arrival(run, AWAY, 0.5)
        old = child(run, "rtloop", None)
        old.kill()
        run.until(lambda: move(run, HOME).status_code == 503)
    finally:
        supervisor.resume()
    run.until(lambda: run.restarted("rtloop", old.pid) and run.healthy())
    require_able(run, record)


def test_a_supervisor_that_is_killed_takes_all_with_it_and_the_arm_comes_to_rest(
    crashing: Run, record: Record
) -> None:
    """The last test here: it needs another `cobot run`."""
    run = crashing
    family = psutil.Process(run.process.pid).children(recursive=True)
    with active(run, "motion"):
        os.kill(run.process.pid, 9)
        run.process.wait(WAIT_S)
        _, left = psutil.wait_procs(family, timeout=WAIT_S)
        assert left == []
        assert record.violations() == []
        assert np.ptp(np.array(record.commanded[-3:]), axis=0).max() < 1e-9, (
            "the last commands are of an arm at rest"
        )
        run.start()
        run.until(run.healthy)
