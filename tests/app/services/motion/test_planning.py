"""Planning processes that are killed, stopped and kept busy: what was asked for is answered all the same.

Oracles: the operating system's process table, and what the planner makes of the same request in this process.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
import pickle
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Coroutine, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import light_planner
import numpy as np
import psutil
import pytest
from cobot_run import HELPER_ENVIRONMENT

from app.services.motion import planning_pool
from app.services.motion.planning import PlanningService
from app.services.motion.planning_pool import PlanningPool, Preparation
from app.services.motion.planning_tasks import dry_run, plan_motion
from app.services.motion.planning_worker import HEAD, TooLargeError, message
from cobot.config import Settings
from cobot.errors import InputError, PlanningError, PlanningTimeout, UnavailableError
from cobot.launch.process import Niceness, is_stopped
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription
from cobot.robot.scene import Scene, SceneObject
from cobot.types import PlannerName, Scaling

WAIT_S = 60.0
LIGHT = light_planner.__name__
# One of three has ended before it is needed: the pool takes the others, and what replaces one begins anew.
FORKED = """
import asyncio, light_planner
from app.services.motion import planning_pool
from cobot.launch.forked import fork_processes
planning_pool.WORKER = light_planner.__name__
blanks = fork_processes(3)
pids = [each.pid for each in blanks]
blanks[2].kill()
blanks[2].wait()

async def usable(pool):
    while pool.usable < 2:
        await asyncio.sleep(0.01)
    return {worker.process.pid for worker in pool._workers}

async def check():
    pool = planning_pool.PlanningPool([], 2, blanks)
    pool.start()
    assert await usable(pool) == set(pids[:2])
    planned_in = await pool.run(light_planner.pid, 60.0)
    assert planned_in in pids
    try:
        await pool.run(light_planner.end, 60.0)
    except planning_pool.WorkerLost as exc:
        assert "was ended by SIGSEGV" in str(exc), exc
    assert len(await usable(pool) - set(pids)) == 1
    pool.close()

asyncio.run(check())
"""


@pytest.fixture(scope="module")
def runner() -> Iterator[asyncio.Runner]:
    with asyncio.Runner() as made:
        yield made


@pytest.fixture(scope="module", autouse=True)
def helpers_for_workers() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", HELPER_ENVIRONMENT["PYTHONPATH"])
        yield


@pytest.fixture(scope="module")
def shared(runner: asyncio.Runner) -> Iterator[PlanningService]:
    """Two workers without a robot, for what is not about what they compute: a real one starts slowly."""
    with pytest.MonkeyPatch.context() as patch:  # other pools have real workers
        patch.setattr(planning_pool, "WORKER", LIGHT)
        made = PlanningService(None, 2)
    runner.run(all_usable(made))
    yield made
    made.close()
    runner.run(until(lambda: not workers(LIGHT)))


@pytest.fixture
def planning(runner: asyncio.Runner, shared: PlanningService) -> PlanningService:
    """All its workers are there, whatever the test before has left."""
    runner.run(all_usable(shared))
    return shared


@pytest.fixture(scope="module")
def real(runner: asyncio.Runner) -> Iterator[PlanningService]:
    """One worker, as in the service."""
    made = PlanningService(None, 1)
    runner.run(all_usable(made))
    yield made
    made.close()
    runner.run(until(lambda: not workers(planning_pool.WORKER)))


async def until(condition: Callable[[], object], asked: asyncio.Task[Any] | None = None) -> None:
    """Wait, but not for what cannot come any more: `asked` has failed."""
    async with asyncio.timeout(WAIT_S):
        while not condition():
            if asked is not None and asked.done():
                asked.result()
            await asyncio.sleep(0.01)


async def all_usable(planning: PlanningService) -> None:
    planning.warm_up()
    await until(lambda: planning.warm)


TOGETHER_S = 2.0


def workers(module: str = LIGHT) -> list[psutil.Process]:
    """Those that have not ended."""
    found = []
    for child in psutil.Process().children():
        with contextlib.suppress(psutil.NoSuchProcess):  # a zombie is none any more either
            if module in child.cmdline():
                found.append(child)
    return found


def test_who_is_ready_takes_the_time_that_nobody_else_wants(real: PlanningService) -> None:
    (worker,) = workers(planning_pool.WORKER)
    assert worker.nice() == Niceness.BACKGROUND


def _exhaust(robot: RobotDescription) -> int:
    return len(bytearray(2**62))


def _refuse(robot: RobotDescription) -> None:
    raise InputError("no")


def _tell(robot: RobotDescription) -> bytes:
    print("a library of somebody else's is chatty")
    return b"x" * 30_000_000


class _Unpicklable(Exception):
    def __init__(self, first: int, second: int) -> None:
        super().__init__("two numbers")


def _raise_what_cannot_be_told(robot: RobotDescription) -> None:
    raise _Unpicklable(1, 2)


Check = Callable[[], Coroutine[Any, Any, None]]


def test_a_motion_is_rehearsed_there_as_it_is_here(
    runner: asyncio.Runner, real: PlanningService, robot: RobotDescription, settings: Settings
) -> None:
    home = np.array(robot.positions["home"].joints)
    motion = plan(robot, MotionRequest(home, home + 0.1, PlannerName.PTP, Scaling(1.0)))
    assert motion is not None
    work = partial(dry_run, settings=settings, start=home, trajectory=motion)
    there, here = runner.run(real.compute(work, WAIT_S)), work(robot)
    assert there.flaw is None
    np.testing.assert_array_equal(there.run.positions, here.run.positions)


def test_a_plan_is_what_the_planner_makes_of_it_here(
    runner: asyncio.Runner, real: PlanningService, robot: RobotDescription
) -> None:
    home = np.array(robot.positions["home"].joints)
    request = MotionRequest(home, home + 0.2, PlannerName.PTP, Scaling(0.5))
    made = runner.run(real.compute(partial(plan_motion, request=request), WAIT_S))
    known = plan(robot, request)
    assert made is not None
    assert known is not None
    np.testing.assert_array_equal(made.coefficients, known.coefficients)


def test_idle_workers_that_are_killed_are_replaced_and_nobody_notices(
    runner: asyncio.Runner, planning: PlanningService
) -> None:
    """All of them, so that whoever comes next must wait for a new one."""
    replaced = planning.status.replaced

    async def check() -> None:
        old = workers()
        for worker in old:
            worker.kill()
        found = await planning.compute(light_planner.pid, WAIT_S)
        assert found not in [worker.pid for worker in old]
        await until(lambda: planning.warm)

    runner.run(check())
    assert planning.status.replaced == replaced + 2
    assert planning.status.state == "ready"


def test_a_task_that_nobody_has_begun_outlives_as_many_workers_as_die_before(
    runner: asyncio.Runner, planning: PlanningService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They die as the task is on its way to them, which is no fault of the task."""
    free, killed = planning._pool._wait_for_worker, []

    async def dying() -> Any:
        worker = await free()
        if len(killed) < 3:
            killed.append(worker.process.pid)
            worker.process.kill()
        return worker

    monkeypatch.setattr(planning._pool, "_wait_for_worker", dying)
    found = runner.run(planning.compute(light_planner.pid, WAIT_S))
    assert len(killed) == 3
    assert found not in killed
    runner.run(until(lambda: planning.warm))


def test_what_was_being_planned_when_a_worker_died_is_planned_by_another(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path
) -> None:
    work = partial(light_planner.end_once, mark=tmp_path / "mark")
    assert runner.run(planning.compute(work, WAIT_S)) == "planned"


def test_what_ends_every_worker_is_given_up_after_two(
    runner: asyncio.Runner, planning: PlanningService
) -> None:
    replaced = planning.status.replaced

    async def check() -> None:
        with pytest.raises(PlanningError, match=r"SIGSEGV, like the previous one"):
            await planning.compute(light_planner.end, WAIT_S)
        await until(lambda: planning.warm)

    runner.run(check())
    assert planning.status.replaced == replaced + 2


@pytest.mark.parametrize("busy", [False, True])
def test_a_worker_that_is_stopped_is_replaced(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path, busy: bool
) -> None:
    mark = tmp_path / "mark"
    work = partial(light_planner.sleep_until, mark=mark)

    async def check() -> None:
        old = workers()
        asked = None
        if busy:
            asked = asyncio.create_task(planning.compute(work, WAIT_S))
            await until(lambda: planning.status.busy == 1, asked)
        for worker in old:
            os.kill(worker.pid, signal.SIGSTOP)
        await until(lambda: all(is_stopped(worker.pid) for worker in old))
        mark.touch()
        if asked is None:
            asked = asyncio.create_task(planning.compute(work, WAIT_S))
        assert await asked == "slept"
        await until(lambda: not {each.pid for each in old} & {each.pid for each in workers()})

    runner.run(check())


def test_an_interruption_ends_the_worker_and_is_no_accident(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path
) -> None:
    work = partial(light_planner.sleep_until, mark=tmp_path / "never")

    async def check() -> None:
        replaced, old = planning.status.replaced, {worker.pid for worker in workers()}
        asked = asyncio.create_task(planning.compute(work, WAIT_S))
        await until(lambda: planning.status.busy == 1, asked)
        asked.cancel()
        with pytest.raises(asyncio.CancelledError):
            await asked
        with pytest.raises(
            PlanningTimeout,
            match=r"longer than 0.2 s and was cancelled; 0.0 s of this passed until a process was free",
        ):
            await planning.compute(work, 0.2)
        await until(lambda: planning.warm)
        assert not old & {worker.pid for worker in workers()}
        assert planning.status.replaced == replaced

    runner.run(check())


def test_nobody_waits_for_ever_for_a_process(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path
) -> None:
    mark = tmp_path / "mark"
    work = partial(light_planner.sleep_until, mark=mark)

    async def check() -> None:
        busy = [asyncio.create_task(planning.compute(work, WAIT_S)) for _ in range(2)]
        await until(lambda: planning.status.busy == 2)
        with pytest.raises(
            UnavailableError, match=r"no planning process was free within 0.2 s: all 2 have other tasks"
        ):
            await asyncio.wait_for(planning.compute(light_planner.pid, 0.2), WAIT_S)
        mark.touch()
        assert await asyncio.gather(*busy) == ["slept", "slept"]
        assert await planning.compute(light_planner.pid, WAIT_S)

    runner.run(check())


def test_waiting_for_a_process_and_its_work_have_one_time_together(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path
) -> None:
    """The time goes by in the pool's own clock: half of it before a process is free."""
    first, never = tmp_path / "first", tmp_path / "never"

    async def check() -> None:
        await until(lambda: planning.warm)
        loop = asyncio.get_running_loop()
        busy = [
            asyncio.create_task(planning.compute(partial(light_planner.sleep_until, mark=first), WAIT_S))
            for _ in range(2)
        ]
        await until(lambda: planning.status.busy == 2)
        asked_s = loop.time()
        late = asyncio.create_task(
            planning.compute(partial(light_planner.sleep_until, mark=never), TOGETHER_S)
        )
        await asyncio.sleep(0.6 * TOGETHER_S)
        first.touch()
        with pytest.raises(PlanningTimeout, match=r"than 2.0 s and was cancelled; 1\.\d s of this passed"):
            await late
        assert loop.time() - asked_s < 1.5 * TOGETHER_S
        assert await asyncio.gather(*busy) == ["slept", "slept"]

    runner.run(check())


def test_a_clock_on_the_wall_that_jumps_ends_no_planning(
    runner: asyncio.Runner, planning: PlanningService, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    real_time, mark = time.time, tmp_path / "mark"

    async def check() -> None:
        work = partial(light_planner.sleep_until, mark=mark)
        asked = asyncio.create_task(planning.compute(work, WAIT_S))
        await until(lambda: planning.status.busy == 1, asked)
        monkeypatch.setattr(time, "time", lambda: real_time() + 1e6)
        await asyncio.sleep(planning_pool.LOOK_S)  # it looks at its worker meanwhile
        assert not asked.done()
        mark.touch()
        assert await asked == "slept"

    runner.run(check())


def test_errors_come_as_they_are_and_output_does_not_disturb(
    runner: asyncio.Runner, real: PlanningService
) -> None:
    async def check() -> None:
        with pytest.raises(InputError, match="no"):
            await real.compute(_refuse, WAIT_S)
        with pytest.raises(PlanningError, match="no memory left"):
            await real.compute(_exhaust, WAIT_S)
        with pytest.raises(TypeError):
            await real.compute(_raise_what_cannot_be_told, WAIT_S)
        assert len(await real.compute(_tell, WAIT_S)) == 30_000_000

    runner.run(check())


def test_new_workers_take_over_from_the_old_ones(runner: asyncio.Runner, real: PlanningService) -> None:
    old = {worker.pid for worker in workers(planning_pool.WORKER)}

    async def check() -> None:
        await real.renew()
        assert real.warm
        assert await real.compute(light_planner.pid, WAIT_S) not in old
        await until(lambda: not old & {worker.pid for worker in workers(planning_pool.WORKER)})

    runner.run(check())


def _objects(robot: RobotDescription) -> list[str]:
    return [name for name in robot.collision.scene.objects if robot.collision.scene.version]


def test_a_process_plans_in_the_scene_that_counts_when_it_answers(
    runner: asyncio.Runner, real: PlanningService
) -> None:
    ball = SceneObject("sphere", (0.1,), (0.5, 0.4, 0.3, 1.0, 0.0, 0.0, 0.0))

    async def check() -> None:
        real.scene = Scene(1, {"ball": ball})
        assert await real.compute(_objects, WAIT_S) == ["ball"]
        task = asyncio.create_task(real.compute(_objects, WAIT_S))
        await asyncio.sleep(0)
        real.scene = Scene(2, {"ball": ball, "other": ball})
        assert await task == ["ball", "other"]
        real.scene = Scene(3)
        assert await real.compute(_objects, WAIT_S) == []

    runner.run(check())
    real.scene = Scene()


def test_a_free_process_takes_over_the_scene_before_it_has_a_task(
    runner: asyncio.Runner, real: PlanningService
) -> None:
    """Oracle: a task that is sent without a scene finds the scene there."""
    ball = SceneObject("sphere", (0.1,), (0.5, 0.4, 0.3, 1.0, 0.0, 0.0, 0.0))

    async def check() -> None:
        await real.prepare(Scene(7, {"ball": ball}))
        assert await real._pool.run(_objects, WAIT_S) == ["ball"]
        assert await real.compute(_objects, WAIT_S) == [], "that scene is not in force"

    runner.run(check())


def test_a_process_prepares_once_before_its_tasks_and_so_does_the_one_that_replaces_it(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: what the preparation itself writes."""
    notes, mark = tmp_path / "notes", tmp_path / "mark"
    ahead = Preparation(partial(light_planner.note, file=notes))
    monkeypatch.setattr(planning, "_preparation", lambda *_: ahead)

    async def check() -> None:
        await planning.prepare()
        both = {await planning.compute(light_planner.pid, WAIT_S) for _ in range(3)}
        assert len(both) == 1, "the process that was busy last gets the next task"
        busy = asyncio.create_task(planning.compute(partial(light_planner.sleep_until, mark=mark), WAIT_S))
        await until(lambda: planning.status.busy == 1)
        both.add(await planning.compute(light_planner.pid, WAIT_S))
        mark.touch()
        await busy
        assert sorted(notes.read_text().split()) == sorted(map(str, both))
        for worker in workers():
            worker.kill()
        third = await planning.compute(light_planner.pid, WAIT_S)
        assert notes.read_text().split()[2:] == [str(third)]
        await until(lambda: planning.warm)

    runner.run(check())


def test_preparations_do_not_pile_up_before_a_process_that_is_slow(
    runner: asyncio.Runner, planning: PlanningService, tmp_path: Path
) -> None:
    """Oracle: what the preparations themselves write."""
    notes, mark = tmp_path / "notes", tmp_path / "mark"
    slow = Preparation(partial(light_planner.sleep_until, mark=mark))
    later = [Preparation(partial(light_planner.note, file=notes)) for _ in range(3)]

    async def check() -> None:
        await planning._pool.prepare(slow, 1)
        for each in later:
            await planning._pool.prepare(each, 1)
        mark.touch()
        await planning._pool.run(light_planner.pid, WAIT_S, None, later[-1])
        assert len(notes.read_text().split()) == 1

    runner.run(check())


def test_the_error_of_a_preparation_is_that_of_each_task_until_another_succeeds(
    runner: asyncio.Runner, real: PlanningService
) -> None:
    async def check() -> None:
        refused, fine = Preparation(_refuse), Preparation(light_planner.pid)
        await real._pool.prepare(refused, 1)
        for _ in range(2):
            with pytest.raises(InputError, match="no"):
                await real._pool.run(light_planner.pid, WAIT_S, None, refused)
        assert await real._pool.run(light_planner.pid, WAIT_S, None, fine)

    runner.run(check())


def test_what_ends_every_worker_as_it_prepares_is_given_up_after_two(
    runner: asyncio.Runner, planning: PlanningService, monkeypatch: pytest.MonkeyPatch
) -> None:
    ahead = Preparation(light_planner.end)
    monkeypatch.setattr(planning, "_preparation", lambda *_: ahead)

    async def check() -> None:
        with pytest.raises(PlanningError, match=r"SIGSEGV, like the previous one"):
            await planning.compute(light_planner.pid, WAIT_S)
        await until(lambda: planning.warm)

    runner.run(check())


def test_a_message_beyond_its_limit_is_noticed_before_all_of_it_is_encoded() -> None:
    """Oracle: pickle alone."""
    numbers = np.arange(4000.0)
    packed = message(numbers)
    assert packed == HEAD.pack(False, len(packed) - HEAD.size) + pickle.dumps(
        numbers, pickle.HIGHEST_PROTOCOL
    )
    assert message(numbers, len(packed)) == packed
    endless = (each for each in [b"x" * 70_000, b"x" * 70_000, _Unpicklable])
    with pytest.raises(TooLargeError):
        message(_Reading(endless), 100_000)


class _Reading:
    """Pickles as the list of what an iterator gives."""

    def __init__(self, given: Iterator[Any]) -> None:
        self._given = given

    def __reduce__(self) -> tuple[Any, ...]:
        return list, (), None, self._given


def test_a_task_can_be_computed_in_a_scene_that_is_not_in_force_yet(
    runner: asyncio.Runner, real: PlanningService
) -> None:
    """Oracle: the objects that the process itself has."""
    ball = SceneObject("sphere", (0.1,), (0.5, 0.4, 0.3, 1.0, 0.0, 0.0, 0.0))
    coming = Scene(9, {"ball": ball})

    async def check() -> None:
        task = asyncio.create_task(real.compute(_objects, WAIT_S, coming))
        await asyncio.sleep(0)
        real.scene = coming
        assert await task == ["ball"]
        real.scene = Scene(8)
        assert await real.compute(_objects, WAIT_S, coming) == ["ball"]
        assert await real.compute(_objects, WAIT_S) == []

    runner.run(check())
    real.scene = Scene()


def test_workers_that_cannot_be_started_are_an_error_that_says_so(tmp_path: Path) -> None:
    """And not one for ever: a start that succeeds ends it."""
    config = tmp_path / "settings.yaml"
    config.write_text("nonsense: 1\n", encoding="utf-8")

    async def check() -> None:
        planning = PlanningService(config, 1)
        with pytest.raises(UnavailableError, match="a planning process ended with status 2 at its start"):
            await planning.compute(light_planner.pid, WAIT_S)
        assert planning.status.state == "failed"
        config.write_text("{}\n", encoding="utf-8")
        await until(lambda: planning.status.state == "ready")
        assert planning.status.problem == ""
        planning.close()

    asyncio.run(check())


def test_a_program_that_is_not_there_is_an_error_that_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    async def check() -> None:
        pool = PlanningPool([], 1)
        pool._command[0] = os.fspath(Path(sys.executable).with_name("nothing"))
        with pytest.raises(UnavailableError, match="cannot be started: No such file"):
            await pool.run(light_planner.pid, WAIT_S)
        pool.close()

    asyncio.run(check())


def test_the_first_workers_are_those_that_were_forked() -> None:
    command = [sys.executable, "-c", FORKED]
    done = subprocess.run(
        command, env=HELPER_ENVIRONMENT, capture_output=True, text=True, check=False, timeout=WAIT_S
    )
    assert done.returncode == 0, done.stderr
