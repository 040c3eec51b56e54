"""Studies of the service, with their real processes.

Oracles: `run_study` of the same study in this process; Linux's list of processes; the files in the folder.
"""

from __future__ import annotations

import asyncio
import json
import os
import signal
import stat
import subprocess
import sys
import textwrap
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from app.services.programs import studies
from app.services.programs.studies import StudyService
from app.services.programs.study_files import MAP, STATUS, TABLES, StudyStatus
from app.services.rights.job import JobState
from app.services.rights.job_book import JobBook
from app.services.rights.ownership import Ownership
from cobot.config import Settings, load_settings
from cobot.errors import ConflictError, InputError, MotionStopped, NotFoundError
from cobot.launch.process import Niceness
from cobot.robot.scene import Scene, SceneFile, SceneObject
from cobot.studies import ResultsFolder, run_study, study_of

WAIT_S = 120.0
SPACE = {"box": {"low": [0.3, -0.4, 0.2], "high": [0.7, 0.4, 0.6]}, "spacing_m": 0.2}
REACH: dict[str, Any] = {"question": "What does it reach?", "kind": "reach", "space": SPACE}
LARGE = REACH | {"space": SPACE | {"spacing_m": 0.02}, "approach": 50}
"""Takes minutes."""


class Bench:
    """A `StudyService` with its jobs, in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        clock = SimpleNamespace(now_s=lambda: 1.0, wall_ns=time.time_ns)
        heartbeat = SimpleNamespace(require_awake=lambda: None)
        self.link: Any = SimpleNamespace(
            label="", stops=0, memory=SimpleNamespace(robot="iiwa"), clock=clock, heartbeat=heartbeat
        )
        self.link.events = SimpleNamespace(publish=lambda event, **data: None)
        self.settings: Settings = load_settings().model_copy(update={"kept": folder})
        self.book = JobBook(self.link)
        self.turn = asyncio.Lock()
        self.service = StudyService(self.settings, None, Ownership(self.link, self.book), self.turn)
        self.service.niceness = Niceness.ORDINARY

    async def start(self, document: dict[str, Any], stored: tuple[str, str] | None = None) -> StudyStatus:
        return await self.service.start(document, stored, 600.0, WAIT_S)

    async def wait(self, status: StudyStatus) -> StudyStatus:
        """The study at the end of its run."""
        job = self.book.live(status.job)
        if job is not None:
            await asyncio.wait_for(job.ended.wait(), WAIT_S)
        return await self.service.read(status.id)

    async def until(self, what: Callable[[], Awaitable[object]]) -> None:
        end_s = time.monotonic() + WAIT_S
        while not await what():
            assert time.monotonic() < end_s
            await asyncio.sleep(0.02)

    async def until_done(self, status: StudyStatus, tasks: int) -> None:
        async def is_done() -> bool:
            return (await self.service.read(status.id)).done >= tasks

        await self.until(is_done)


@asynccontextmanager
async def bench(folder: Path) -> AsyncIterator[Bench]:
    made = Bench(folder)
    try:
        yield made
    finally:
        await made.service.close()


def processes(folder: Path) -> list[int]:
    """The processes of studies below a session whose leader has the folder's name in its environment."""
    found = []
    for path in Path("/proc").iterdir():
        if path.name.isdecimal():
            try:
                words = (path / "cmdline").read_bytes().split(b"\0")
                environment = (path / "environ").read_bytes()
            except OSError:
                continue
            ours = {b"cobot.studies.served", b"cobot.studies.engines.worker"} & set(words)
            if ours and f"COBOT_TEST_FOLDER={folder}".encode() in environment.split(b"\0"):
                found.append(int(path.name))
    return found


@pytest.fixture(autouse=True)
def _marked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COBOT_TEST_FOLDER", str(tmp_path))


def test_a_study_answers_as_the_library_does_and_is_private_to_the_user(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            status = await made.start(REACH)
            assert (status.state, status.tasks, status.maps) == ("running", 45, True)
            found = await made.wait(status)
            expected = run_study(study_of(REACH), tmp_path / "library", workers=1)
            assert (found.state, found.reason, found.done) == ("finished", "", 45)
            assert found.answer == json.loads(json.dumps(expected.answer))
            record = made.book.find(status.job)
            assert record is not None
            assert (record.state, record.progress) == (JobState.FINISHED, 1.0)
            assert (await made.service.all()) == [found]
            table = await made.service.file(status.id, *TABLES)
            assert table.stat().st_size > 0
            shown = json.loads((await made.service.file(status.id, MAP)).read_text())
            columns = ResultsFolder(tmp_path / "library").columns()
            assert shown["x"] == pytest.approx(columns["x"].tolist())
            assert shown["values"]["share"] == [each or None for each in columns["share"].tolist()]
            for path in made.service.files.folder.rglob("*"):
                assert stat.S_IMODE(path.stat().st_mode) & 0o077 == 0, path
            again = await made.start(REACH)
            assert again.id == status.id
            assert (await made.wait(again)).answer == found.answer
            await made.service.delete(status.id)
            with pytest.raises(NotFoundError, match="there is no study"):
                await made.service.read(status.id)
        assert processes(tmp_path) == []

    asyncio.run(scenario())


@pytest.mark.thorough
def test_the_scene_and_the_tool_of_the_service_belong_to_a_study(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            first = await made.wait(await made.start(REACH))
            block = SceneObject("box", (0.5, 1.0, 0.5), (0.5, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0))
            SceneFile(made.settings.scene_file).write(Scene(version=3, objects={"block": block}))
            second = await made.wait(await made.start(REACH))
            assert second.id != first.id
            assert second.answer["places reached"] < first.answer["places reached"]
            SceneFile(made.settings.scene_file).write(Scene(version=4))
            third = await made.wait(await made.start(REACH))
            assert third.answer == first.answer

    asyncio.run(scenario())


def test_a_stored_program_is_the_program_of_a_study(tmp_path: Path) -> None:
    text = json.dumps({"waypoints": [{"named": "home"}, {"named": "work", "speed": 1.0}]})
    cycle = {"question": "How short?", "kind": "cycle", "space": {"speed": {"values": [0.5, 1.0]}}}

    async def scenario() -> None:
        async with bench(tmp_path) as made:
            status = await made.start(cycle | {"program": {"stored": "kiste"}}, (text, "kiste.json"))
            found = await made.wait(status)
            assert found.state == "finished"
            assert found.answer["best duration_s"] < found.answer["mean duration_s"]

    asyncio.run(scenario())


@pytest.mark.thorough
def test_killed_workers_and_processes_lose_nothing(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            status = await made.start(LARGE)
            await made.until_done(status, 1)
            (process,) = [pid for pid in processes(tmp_path) if os.getsid(pid) == pid]
            workers = [pid for pid in processes(tmp_path) if pid != process]
            os.kill(workers[0], signal.SIGKILL)
            done = (await made.service.read(status.id)).done
            await made.until_done(status, done + 1)  # it has another worker
            os.kill(process, signal.SIGKILL)

            async def is_replaced() -> bool:
                leaders = [pid for pid in processes(tmp_path) if os.getsid(pid) == pid]
                return bool(leaders) and process not in leaders

            await made.until(is_replaced)
            await made.until_done(status, (await made.service.read(status.id)).done + 1)
            job = made.book.live(status.job)
            assert job is not None
            assert made.service.cancel(job, MotionStopped("cancelled by a test"))
            found = await made.wait(status)
            assert (found.state, found.reason) == ("partial", "cancelled by a test")
            assert found.answer["done"] == found.done > done
            record = made.book.find(status.job)
            assert record is not None
            assert record.state is JobState.CANCELLED
            assert not made.turn.locked()
        assert processes(tmp_path) == []

    asyncio.run(scenario())


def test_one_study_runs_at_a_time_and_the_end_of_the_service_keeps_its_results(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            status = await made.start(LARGE)
            with pytest.raises(ConflictError, match="another study is running"):
                await made.start(REACH)
            with pytest.raises(ConflictError, match="is running: cancel its job first"):
                await made.service.delete(status.id)
            await made.until_done(status, 1)
        assert processes(tmp_path) == []
        async with bench(tmp_path) as made:
            found = await made.service.read(status.id)
            assert found.state == "partial"
            assert found.reason == "the service ended before the study did"
            assert ResultsFolder(made.service.files.folder / status.id).chunks()

    asyncio.run(scenario())


SERVICE = """
    import asyncio, sys
    from pathlib import Path
    sys.path[:0] = {paths!r}
    from test_studies import LARGE, Bench

    async def main():
        made = Bench(Path(sys.argv[1]))
        status = await made.start(LARGE)
        await made.until_done(status, 1)
        print("running", flush=True)
        await asyncio.sleep(600)

    asyncio.run(main())
"""


@pytest.mark.thorough
def test_a_killed_service_leaves_no_process_behind_and_the_study_can_go_on(tmp_path: Path) -> None:
    script = textwrap.dedent(SERVICE).format(paths=[str(Path(__file__).parent), *sys.path])
    service = subprocess.Popen([sys.executable, "-c", script, tmp_path], stdout=subprocess.PIPE, text=True)
    try:
        assert service.stdout is not None
        assert service.stdout.readline() == "running\n"
        assert len(processes(tmp_path)) >= 2
    finally:
        service.kill()
        service.wait()
        assert service.stdout is not None
        service.stdout.close()
    end_s = time.monotonic() + WAIT_S
    while processes(tmp_path):
        assert time.monotonic() < end_s
        time.sleep(0.02)

    async def scenario() -> None:
        async with bench(tmp_path) as made:
            (left,) = await made.service.all()
            assert (left.state, left.reason) == ("partial", "the service ended before the study did")
            status = await made.start(LARGE)
            assert status.id == left.id
            assert status.done > 0

    asyncio.run(scenario())


def test_what_a_study_may_not_ask_for_is_rejected_and_leaves_nothing(tmp_path: Path) -> None:
    """All of it is in tests/cobot/studies/test_served.py."""

    async def scenario() -> None:
        async with bench(tmp_path) as made:
            with pytest.raises(InputError, match="study: unknown key 'metrik'") as caught:
                await made.start(REACH | {"metrik": "share"})
            assert str(tmp_path) not in str(caught.value)
            await made.until(lambda: asyncio.sleep(0, not made.turn.locked()))
            assert list(made.service.files.folder.iterdir()) == []

    asyncio.run(scenario())


@pytest.mark.thorough
def test_another_study_can_be_started_once_one_is_rejected_or_finished(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            with pytest.raises(InputError, match="spacing"):
                await made.start(REACH | {"space": SPACE | {"spacing_m": -1.0}})
            status = await made.start(REACH)

            async def is_finished() -> bool:
                return (await made.service.read(status.id)).state == "finished"

            await made.until(is_finished)
            await made.wait(await made.start(REACH | {"seed": 5}))

    asyncio.run(scenario())


@pytest.mark.thorough
def test_studies_are_bounded_in_number_and_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            monkeypatch.setattr(studies, "MAX_STUDIES", 1)
            status = await made.wait(await made.start(REACH))
            with pytest.raises(ConflictError, match="too many studies; delete one"):
                await made.start(REACH | {"seed": 5})
            assert (await made.wait(await made.start(REACH))).id == status.id
            monkeypatch.setattr(studies, "MAX_TOTAL_BYTES", studies.MIN_BYTES)
            with pytest.raises(ConflictError, match=r"allowed: .*; delete some"):
                await made.start(REACH)

    asyncio.run(scenario())


def test_a_damaged_status_hides_no_other_study(tmp_path: Path) -> None:
    async def scenario() -> None:
        async with bench(tmp_path) as made:
            status = await made.wait(await made.start(REACH))
            damaged = made.service.files.folder / "0123456789ab"
            damaged.mkdir()
            (damaged / STATUS).write_text("{")
            assert [each.id for each in await made.service.all()] == [status.id]
            for name in ("../../etc", "0123456789ab", "x" * 200):
                with pytest.raises(NotFoundError, match="there is no study"):
                    await made.service.read(name)

    asyncio.run(scenario())
