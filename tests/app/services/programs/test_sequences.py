"""A sequence that is just being started: who asks for a stop meanwhile is told the truth."""

from __future__ import annotations

import asyncio
import json
import os
import sys

import pytest
from rig import Rig, no_tokens

from app.services.programs.sequences import LINE_BYTES, LINE_CHARACTERS, SequenceOrder, SequenceService
from app.services.programs.steps import RunnerInstructions
from app.services.rights.ownership import Ownership
from app.services.state.link import RobotLink
from cobot.errors import UnavailableError

ORDER = SequenceOrder(b"{}", 1, 0.0, "", "", "", "")


def test_a_stop_names_a_start_that_is_under_way_and_a_failed_start_leaves_the_arm_free(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
    ownership = Ownership(link)
    service = SequenceService(ownership, link, rig.settings.sequences, "http://robot.test", 1.0, no_tokens())

    async def start() -> None:
        go_on = asyncio.Event()

        async def spawn(*_: object) -> None:
            await go_on.wait()
            raise OSError("no more processes")

        monkeypatch.setattr(service, "_spawn", spawn)
        starting = asyncio.create_task(service.start(ORDER, ownership.stops))
        await asyncio.sleep(0)
        assert await service.stop() == "the start of a sequence"
        assert ownership.owner == "sequence 1"
        go_on.set()
        with pytest.raises(UnavailableError, match="cannot be started: no more processes"):
            await starting

    asyncio.run(start())
    assert ownership.owner is None
    assert asyncio.run(service.stop()) is None
    link.close()


def test_of_what_a_program_prints_in_one_line_little_is_kept(rig: Rig) -> None:
    """Thousands of lines are: a program that printed all it had took hundreds of megabytes."""
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
    settings = rig.settings.sequences
    service = SequenceService(Ownership(link), link, settings, "http://robot.test", 1.0, no_tokens())
    long = "x" * (LINE_BYTES // 2)

    async def read() -> None:
        printed = asyncio.StreamReader(limit=LINE_BYTES)
        printed.feed_data(f"{long}\nshort\n".encode() + b"y" * 2 * LINE_BYTES + b"\n")
        printed.feed_eof()
        await service._read_log(printed)

    asyncio.run(read())
    first, *others = service.lines(10)
    assert first == f"{long[:LINE_CHARACTERS]}... ({len(long)} characters)"
    assert others[0] == "short"
    assert "too long to keep" in others[1]
    link.close()


def test_a_runner_that_is_killed_does_not_end_with_the_error_of_the_one_before(
    rig: Rig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: what each of two processes prints and does before it ends."""
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
    ownership = Ownership(link)
    service = SequenceService(ownership, link, rig.settings.sequences, "http://robot.test", 1.0, no_tokens())
    code = ""

    async def spawn(*_: object) -> object:
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-c", code, stdout=asyncio.subprocess.PIPE
        )
        progress = asyncio.StreamReader()
        progress.feed_eof()
        return process, progress, os.open(os.devnull, os.O_WRONLY)

    async def error_after(program: str) -> str:
        nonlocal code
        code = program
        await service.start(ORDER, ownership.stops)
        job = ownership.sequence_job
        assert job is not None
        assert service._watcher is not None
        await service._watcher
        error = job.record().error
        assert error is not None
        return error.detail

    async def run() -> None:
        monkeypatch.setattr(service, "_spawn", spawn)
        failed = await error_after("print('now error: waypoint 2/2: out of reach'); raise SystemExit(3)")
        assert failed == "waypoint 2/2: out of reach"
        killed = await error_after("import os; os.kill(os.getpid(), 9)")
        assert killed == "the runner ended with return code -9"

    asyncio.run(run())
    link.close()


def test_while_a_program_is_paused_it_begins_no_step_and_its_time_does_not_count(rig: Rig) -> None:
    """Oracle: what the runner's end of the pipe has, and the clock of the link."""
    link = RobotLink(rig.memory.path.name.removeprefix("cobot-"), 60.0)
    ownership = Ownership(link)
    service = SequenceService(ownership, link, rig.settings.sequences, "http://robot.test", 1.0, no_tokens())
    place = {
        "iteration": 1,
        "waypoint": 1,
        "n_waypoints": 2,
        "step": "step 1.2 of 2",
        "share": 0.25,
        "behind": 0,
    }
    read_end, write_end = os.pipe()
    os.set_blocking(read_end, False)

    def answered() -> list[dict[str, float | None]]:
        try:
            return [json.loads(line) for line in os.read(read_end, 65536).splitlines()]
        except BlockingIOError:
            return []

    async def run() -> None:
        service._steps = RunnerInstructions(write_end, None, lambda held: None)
        reported = asyncio.StreamReader()
        reading = asyncio.create_task(service._read_progress(reported))
        ownership.speed_override._asked = True  # as `pause` does before the arm comes to rest
        ownership.speed_override._settle()
        for within in (False, True):
            reported.feed_data(json.dumps({**place, "asking": True, "within": within}).encode() + b"\n")
        await asyncio.sleep(0.05)
        assert answered() == []
        assert service.status.step == "step 1.2 of 2"
        ownership.speed_override.reset()
        while len(found := answered()) < 2:
            await asyncio.sleep(0.01)
        assert found[0] == {"waypoint": None}
        assert found[1]["paused_s"] == pytest.approx(ownership.speed_override.paused_s)
        assert ownership.speed_override.paused_s >= 0.05
        reported.feed_eof()
        await reading

    asyncio.run(run())
    service._steps = None
    os.close(read_end)
    os.close(write_end)
    link.close()
