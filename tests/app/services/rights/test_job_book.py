"""Jobs and their records by themselves, beside a link of the test's.

Oracle: the table of states in docs/jobs.md, written out by hand.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import math
import os
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from cobot_run import WAIT_S, until
from hypothesis import given
from hypothesis import strategies as st

from app.services.rights import job_book as books
from app.services.rights.claims import Caller
from app.services.rights.job import ENDS, Job, JobKind, JobRecord
from app.services.rights.job_book import KEPT, JobBook
from app.services.rights.ownership import Ownership
from app.services.rights.signal_results import ActionOutcome, SignalResults
from cobot.errors import CollisionError, ExecutionError, MotionStopped, UnavailableError
from cobot.findings import Finding

NEXT = {
    "planning": {"running", "paused", "finished", "failed", "cancelled", "interrupted"},
    "running": {"running", "paused", "finished", "failed", "cancelled", "interrupted"},
    "paused": {"planning", "running", "paused", "finished", "failed", "cancelled", "interrupted"},
}
"""Which states may follow; what is not here is an end."""
STOPPED = MotionStopped("stopped by POST /stop")
BEGUN_S = 1e9
"""2001-09-09 01:46:40 UTC."""
TRAJECTORY: Any = SimpleNamespace(duration_s=10.0, note="")


class Link:
    """As much of a `RobotLink` as jobs and ownership need."""

    def __init__(self, wall_s: float) -> None:
        self.label, self.stops = "", 0
        self.memory = SimpleNamespace(robot="arm")
        self.clock = SimpleNamespace(now_s=lambda: 1.0, wall_ns=lambda: round(wall_s * 1e9))
        self.heartbeat = SimpleNamespace(require_awake=lambda: None)
        self.motion = 0
        self.path_time_s, self.time_factor = 0.0, 1.0

    def streamer(self) -> None:
        return None

    def state(self) -> Any:
        return SimpleNamespace(motion_id=self.motion, path_time_s=self.path_time_s, session=0)


class Bench:
    """Ownership and its jobs."""

    def __init__(self, file: Path | None = None, wall_s: float = BEGUN_S) -> None:
        self.link: Any = Link(wall_s)
        self.book = JobBook(self.link, file)
        self.heard: list[dict[str, Any]] = []
        self.link.events = SimpleNamespace(publish=lambda event, **data: self.heard.append(data))
        self.ownership = Ownership(self.link, self.book)

    @contextlib.contextmanager
    def motion(self) -> Iterator[Any]:
        job = self.ownership.new_job(JobKind.MOVE, "somewhere")
        with self.ownership.claim(Caller("a test", None, 0, math.inf, asyncio.Event(), job)) as claim:
            yield claim

    def done(self) -> Job:
        with self.motion() as claim:
            assert claim.job is not None
        return claim.job


def states(records: list[JobRecord]) -> list[str]:
    return [str(record.state) for record in records]


STEPS = ("start", "pause", "go on", "slow to 0", "fast", "cancel", "time up", "fail", "sequence")


@given(st.lists(st.lists(st.sampled_from(STEPS), max_size=8), max_size=6), st.booleans())
def test_no_job_goes_from_one_state_to_another_that_cannot_follow(
    motions: list[list[str]], ending: bool
) -> None:
    bench = Bench()
    override = bench.ownership.speed_override
    for steps in motions:
        with contextlib.suppress(UnavailableError), bench.motion() as claim:
            for number, step in enumerate(steps, start=1):
                match step:
                    case "start":
                        claim.job.start(number, TRAJECTORY)
                    case "pause":
                        override._asked = True
                        override._settle()
                    case "go on":
                        override.reset()
                    case "slow to 0" | "fast":
                        override._fraction = float(step == "fast")
                        override._settle()
                    case "cancel":
                        bench.ownership.interrupt(STOPPED)
                    case "time up":
                        claim.time_out()
                    case "fail":
                        raise UnavailableError("rtloop is gone")
            bench.book.ending = ending
            with contextlib.suppress(ExecutionError):
                if claim.interruption is not None:
                    claim.fail(claim.interruption)
        override._fraction = 1.0
        override.reset()
        bench.book.ending = False
    for _, group in itertools.groupby(bench.heard, lambda data: data["job"]):
        found = list(group)
        passed = [data["state"] for data in found]
        for one, other in itertools.pairwise(passed):
            assert other in NEXT[one], passed
        assert [state for state in passed if state in ENDS] == passed[-1:]
        assert (found[-1]["error"] is None) == (passed[-1] == "finished")
    assert len({data["job"] for data in bench.heard}) == len(motions)
    assert not [record for record in bench.book.records(1000) if record.state not in ENDS]


@pytest.mark.parametrize(
    ("error", "state"), [(None, "finished"), (STOPPED, "cancelled"), (ExecutionError("no"), "failed")]
)
def test_a_sequence_is_a_job_and_its_motions_belong_to_it(error: Any, state: str) -> None:
    bench = Bench()
    bench.ownership.claim_for_sequence("sequence 1", "token")
    job = bench.ownership.sequence_job
    assert job is not None
    job.start()
    job.at_waypoint(3, 4)
    assert job.record().progress == 0.75
    bench.ownership.release_sequence(error)
    assert states(bench.book.records(9)) == [state]
    assert bench.ownership.sequence_job is None


def test_records_survive_and_what_was_under_way_was_interrupted(tmp_path: Path) -> None:
    file = tmp_path / "arm.jobs.jsonl"
    bench = Bench(file)
    done = bench.done()
    infinite = CollisionError("too near", findings=[Finding("collision", "distance", -math.inf, 0.0, "m")])
    with contextlib.suppress(CollisionError), bench.motion():
        raise infinite
    with bench.motion() as claim:
        claim.job.start(7, TRAJECTORY)
        bench.book.close()  # as a service that is killed: the end of this one is never written
        os.utime(file, (BEGUN_S + 20.0, BEGUN_S + 20.0))
        after = Bench(file, BEGUN_S + 3600.0).book
    found = {record.id: record for record in after.records(9)}
    assert len(found) == 3
    assert found[done.id] == done.end_record
    assert states(list(found.values())) == ["interrupted", "failed", "finished"]
    interrupted = found[claim.job.id]
    assert interrupted.error is not None
    assert (interrupted.error.code, interrupted.motion_id) == ("interrupted", 7)
    assert interrupted.ended_at == datetime.fromtimestamp(BEGUN_S + 20.0, UTC)
    assert "during this job, after 2001-09-09 01:47:00 UTC; its next" in interrupted.error.detail
    assert "noticed this at 2001-09-09 02:46:40 UTC" in interrupted.error.detail
    (failed,) = (record for record in found.values() if record.state == "failed")
    assert failed.error is not None
    assert failed.error.findings == infinite.findings
    after.close()
    assert states(Bench(file).book.records(9)) == ["interrupted", "failed", "finished"]


def test_of_a_motion_whose_end_was_not_seen_the_actions_are_told_as_far_as_they_were_known(
    tmp_path: Path,
) -> None:
    file = tmp_path / "arm.jobs.jsonl"
    bench = Bench(file)
    known = ActionOutcome("actions[0]", "set glue to 1", "0 s after the start", 0.0)
    rejected = replace(known, action="actions[1]", path_time_s=0.1, problem="the valve block is off")
    actions = (replace(known, fired=True, path_time_s=0.0), rejected, replace(known, action="actions[2]"))
    with bench.motion() as claim:
        claim.job.follow_signals(lambda: SignalResults(actions, waits_for="pause_while: input part is true"))
        claim.job.start(7, TRAJECTORY)
        bench.book.close()  # as a service that is killed
    for _ in range(2):  # each start tells it as the one before
        book = Bench(file).book
        (found,) = book.records(9)
        book.close()
        assert found.state == "interrupted"
        assert found.actions == (*actions[:2], replace(actions[2], fired=None)), "the last may have fired"
        assert found.waits_for == "", "nothing waits any more"


def test_what_is_no_record_in_the_file_is_passed_over(tmp_path: Path) -> None:
    file = tmp_path / "arm.jobs.jsonl"
    bench = Bench(file)
    bench.done()
    bench.book.close()
    good = file.read_bytes()
    torn = good[: len(good) // 3] + b"\n"
    odd = json.dumps({**json.loads(good.splitlines()[-1]), "state": "flying"}).encode() + b"\n"
    file.write_bytes(b"\xff\x00\n" + torn + b"{}\n[1]\n" + odd + good + torn)
    assert states(Bench(file).book.records(9)) == ["finished"]


def test_ten_thousand_jobs_are_bounded_in_memory_and_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(books, "MAX_BYTES", 200_000)
    monkeypatch.setattr(books, "END_S", WAIT_S)
    file = tmp_path / "arm.jobs.jsonl"
    bench = Bench(file)
    with bench.motion() as outer:  # goes on while all the others come and go
        bench.ownership._claim = None
        newest = [bench.done().id for _ in range(10_000)][-1]
        until(lambda: not bench.book._outlet._waiting)  # type: ignore[union-attr]
        assert len(bench.book.records(100_000)) == KEPT + 1
        assert bench.book.find(newest) is not None
        assert bench.book.find(outer.job.id) is not None
        sizes = [path.stat().st_size for path in tmp_path.iterdir()]
        assert len(sizes) == 2
        assert max(sizes) <= 200_000
        bench.book.close()
        after = {record.id: str(record.state) for record in Bench(file).book.records(100_000)}
    assert after[outer.job.id] == "interrupted"
    assert after[newest] == "finished"


def test_a_full_disk_costs_no_motion_and_the_records_are_there_once_there_is_room(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "arm.jobs.jsonl"
    bench = Bench(file)
    bench.done()
    until(lambda: not bench.book._outlet._waiting)  # type: ignore[union-attr]
    write = os.write

    def full(descriptor: int, piece: bytes) -> int:
        if os.readlink(f"/proc/self/fd/{descriptor}") == str(file):
            raise OSError(28, "No space left on device")
        return write(descriptor, piece)

    monkeypatch.setattr(os, "write", full)
    lost = [bench.done().id for _ in range(5)]
    until(lambda: bench.book.problem)
    assert "jobs cannot be recorded" in bench.book.problem
    assert "No space left" in bench.book.problem
    assert states(bench.book.records(9)) == ["finished"] * 6
    monkeypatch.undo()
    until(lambda: not bench.book.problem)
    bench.book.close()
    found = {record.id for record in Bench(file).book.records(9)}
    assert found >= set(lost)
    assert len(found) == 6


def test_a_book_that_cannot_be_read_is_begun_anew(tmp_path: Path) -> None:
    (tmp_path / "arm.jobs.jsonl").mkdir()
    bench = Bench(tmp_path / "arm.jobs.jsonl")
    bench.done()
    assert states(bench.book.records(9)) == ["finished"]
    until(lambda: bench.book.problem)


def test_what_waited_while_all_was_written_anew_does_not_come_after_it(tmp_path: Path) -> None:
    """More changes than the way to the disk has room for, while the disk stands still: no job that has ended
    is said to go on, and the newest ones are there."""
    file = tmp_path / "arm.jobs.jsonl"
    bench = Bench(file)
    append, gate = bench.book._file.append, threading.Event()  # type: ignore[union-attr]

    def slow(piece: bytes) -> None:
        gate.wait(WAIT_S)
        append(piece)

    bench.book._file.append = slow  # type: ignore[method-assign, union-attr]
    ids = [bench.done().id for _ in range(2 * KEPT)][-KEPT:]
    assert bench.book._outlet is not None
    assert bench.book._outlet.dropped > 0
    gate.set()
    bench.book._outlet.wait(WAIT_S)
    bench.book.close()
    after = {record.id: str(record.state) for record in Bench(file).book.records(KEPT)}
    assert after == dict.fromkeys(ids, "finished")
