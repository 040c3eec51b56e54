"""The store of keys.

Oracles: SQLite itself, read by a second connection; the permissions of the files; a killed process.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sqlite3
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from folders import ROOT

from app.services import keys as module
from app.services.keys import KEPT_S, Keys, StoredAnswer
from cobot.clock import SYSTEM
from cobot.errors import UnavailableError

DONE = StoredAnswer(200, "application/json", None, b'{"success":true}')


class Wall:
    """A wall clock that a test sets."""

    def __init__(self) -> None:
        self.now_s = 1e9

    def wall_ns(self) -> int:
        return int(self.now_s * 1e9)


@pytest.fixture
def wall() -> Any:
    return Wall()


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "state" / "arm.keys.sqlite"


def count(file: Path) -> int:
    with sqlite3.connect(file) as database:
        found = int(database.execute("SELECT COUNT(*) FROM keys").fetchone()[0])
    database.close()
    return found


def test_an_answer_is_kept_over_restarts_for_a_day(file: Path, wall: Any) -> None:
    async def first() -> None:
        keys = Keys(file, wall)
        assert await keys.note(b"k", b"r", "job_1") is None
        await keys.answer(b"k", DONE)
        keys.close()

    async def later() -> Any:
        keys = Keys(file, wall)
        found = await keys.note(b"k", b"other", "job_2")
        keys.close()
        return found

    asyncio.run(first())
    wall.now_s += KEPT_S - 1.0
    found = asyncio.run(later())
    assert (found.request, found.job, found.answer) == (b"r", "job_1", DONE)
    wall.now_s += 2.0
    assert asyncio.run(later()) is None


def test_its_files_are_private_whatever_the_mask(file: Path, wall: Any) -> None:
    old = os.umask(0)
    try:
        keys = Keys(file, wall)
        asyncio.run(keys.note(b"k", b"r", "job_1"))
        assert {each.stat().st_mode & 0o777 for each in file.parent.iterdir()} == {0o600}
        assert file.parent.stat().st_mode & 0o077 == 0
        keys.close()
    finally:
        os.umask(old)


def test_a_hundred_thousand_keys_leave_a_bounded_store(file: Path, wall: Any, monkeypatch: Any) -> None:
    monkeypatch.setattr(module, "MAX_KEYS", 50)
    monkeypatch.setattr(module, "MAX_BYTES", 100_000)

    async def flood() -> None:
        keys = Keys(file, wall)
        for number in range(300):
            wall.now_s += 1e-3
            await keys.note(b"%d" % number, b"r", "job")
            await keys.answer(
                b"%d" % number, StoredAnswer(200, "t", None, bytes(1000 if number < 200 else 5000))
            )
        assert await keys.note(b"299", b"r", "job") is not None, "the newest is there"
        assert await keys.note(b"0", b"r", "job") is None, "the oldest is not"
        keys.close()

    asyncio.run(flood())
    assert count(file) <= 21
    with sqlite3.connect(file) as database:
        assert database.execute("SELECT SUM(LENGTH(body)) FROM keys").fetchone()[0] <= 100_000
    database.close()


def test_requests_with_one_key_have_turns_and_leave_nothing(file: Path, wall: Any) -> None:
    keys = Keys(file, wall)
    inside: list[int] = []

    async def use(number: int) -> None:
        async with keys.turn(b"k"):
            inside.append(number)
            assert len(inside) == 1
            await asyncio.sleep(0)
            inside.remove(number)

    async def all_at_once() -> None:
        await asyncio.gather(*(use(number) for number in range(200)))

    asyncio.run(all_at_once())
    assert keys._turns == {}


def test_a_damaged_file_is_moved_aside_and_another_begun(file: Path, wall: Any) -> None:
    file.parent.mkdir()
    file.write_bytes(b"no database, " * 1000)
    keys = Keys(file, wall)
    assert asyncio.run(keys.note(b"k", b"r", "job_1")) is None
    assert (file.parent / "arm.keys.sqlite.damaged").read_bytes().startswith(b"no database")
    keys.close()


def test_what_cannot_be_written_is_said_with_the_remedy(tmp_path: Path, wall: Any) -> None:
    (tmp_path / "taken").write_text("a file")
    for path in (tmp_path / "taken" / "keys", tmp_path):
        with pytest.raises(UnavailableError, match=r"the Idempotency-Key cannot be kept: .*without a key"):
            asyncio.run(Keys(path, wall).note(b"k", b"r", "job_1"))
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UnavailableError):
        asyncio.run(Keys(tmp_path / "link", wall).note(b"k", b"r", "job_1"))
    assert not (tmp_path / "elsewhere").exists()


KILLED = """
import asyncio, os, signal, sys
from pathlib import Path
from app.services.keys import Keys
from cobot.clock import SYSTEM
asyncio.run(Keys(Path(sys.argv[1]), SYSTEM).note(b"k", b"r", "job_1"))
os.kill(os.getpid(), signal.SIGKILL)
"""


def test_a_key_whose_process_is_killed_is_known_without_an_answer(file: Path) -> None:
    run = subprocess.run([sys.executable, "-c", KILLED, str(file)], check=False, cwd=ROOT)
    assert run.returncode == -signal.SIGKILL
    keys = Keys(file, SYSTEM)
    found = asyncio.run(keys.note(b"k", b"r", "job_2"))
    assert found is not None
    assert (found.job, found.answer) == ("job_1", None)
    keys.close()
