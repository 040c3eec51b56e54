"""Idempotency keys for requests that begin a job. A repeated request with the same key begins nothing.

A key is written to disk before its request is processed, and the answer is added afterwards. So a key without
an answer means that the client's disconnection or the service's end has interrupted the request.

The keys are stored in a SQLite file that only the user can read. It contains digests of the keys. Their
number, size and age are limited.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import sqlite3
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from cobot.clock import Clock
from cobot.errors import UnavailableError

KEPT_S = 86_400.0
"""How long an answer is kept, s."""
MAX_KEYS, MAX_BYTES = 10_000, 64_000_000
"""Maximum number of keys, and maximum number of bytes in their answers. If either is exceeded, the oldest
keys are dropped.
"""
DAMAGED = ".damaged"

log = logging.getLogger("cobot.service")
Result = TypeVar("Result")
_SCHEMA = """
CREATE TABLE IF NOT EXISTS keys (
    key BLOB PRIMARY KEY, request BLOB NOT NULL, job TEXT NOT NULL, noted_s REAL NOT NULL,
    status INTEGER, type TEXT, location TEXT, body BLOB
) WITHOUT ROWID;
CREATE INDEX IF NOT EXISTS by_age ON keys (noted_s);
"""


@dataclass(frozen=True, slots=True)
class StoredAnswer:
    """A stored answer.

    Attributes:
        type: media type.
        location: header `Location`; None if the answer does not have it.
    """

    status: int
    type: str
    location: str | None
    body: bytes


@dataclass(frozen=True, slots=True)
class Noted:
    """An earlier request with the same key.

    Attributes:
        request: digest of the request.
        job: id of the job that the request has begun, if any.
        answer: answer to the request; None if the request ended without an answer.
    """

    request: bytes
    job: str
    answer: StoredAnswer | None


class Keys:
    """The store of keys; see the module. The file is opened when the first key is used.

    Args:
        path: file path.
        clock: clock whose wall-clock time determines when keys expire.
    """

    def __init__(self, path: Path, clock: Clock) -> None:
        self._path = path
        self._clock = clock
        self._database: sqlite3.Connection | None = None
        self._lock = threading.Lock()
        self._bytes = 0
        self._turns: dict[bytes, tuple[asyncio.Lock, set[object]]] = {}

    @contextlib.asynccontextmanager
    async def turn(self, key: bytes) -> AsyncIterator[None]:
        """Context manager for processing a request with this key. Other requests with the same key wait."""
        lock, users = self._turns.setdefault(key, (asyncio.Lock(), set()))
        user = object()
        users.add(user)
        try:
            async with lock:
                yield
        finally:
            users.discard(user)
            if not users:
                self._turns.pop(key, None)

    async def note(self, key: bytes, request: bytes, job: str) -> Noted | None:
        """Store a request that is about to be processed, unless its key is known. Returns the earlier request
        in that case.

        Raises:
            UnavailableError: the key cannot be written, so the request must not be processed.
        """
        return await self._run(lambda database: self._note(database, key, request, job))

    async def answer(self, key: bytes, answer: StoredAnswer) -> None:
        """Store the answer to the request. Raises UnavailableError if it cannot be written."""
        await self._run(lambda database: self._answer(database, key, answer))

    async def forget(self, key: bytes) -> None:
        """Delete a key whose request was rejected and has begun nothing. A new request may then use the
        key.
        """
        await self._run(lambda database: self._drop(database, "key = ?", key))

    def close(self) -> None:
        """Close the file of the store."""
        with self._lock:
            if self._database is not None:
                self._database.close()
                self._database = None

    async def _run(self, work: Callable[[sqlite3.Connection], Result]) -> Result:
        return await asyncio.to_thread(self._work, work)

    def _work(self, work: Callable[[sqlite3.Connection], Result]) -> Result:
        """Run database work in a thread, because a disk may be slow."""
        with self._lock:
            try:
                if self._database is None:
                    self._database = self._open()
                with self._database:
                    return work(self._database)
            except (sqlite3.Error, OSError) as exc:
                raise UnavailableError(
                    f"{self._path}: the Idempotency-Key cannot be kept: {exc}; free disk space, correct "
                    f"the permissions of the file, or send the request without a key"
                ) from exc

    def _open(self) -> sqlite3.Connection:
        try:
            return self._connect()
        except sqlite3.DatabaseError as exc:
            # for example a full disk; the file itself is valid
            if isinstance(exc, sqlite3.OperationalError):
                raise
            damaged = self._path.with_name(self._path.name + DAMAGED)
            log.warning("%s: is not a store of keys (%s): moved to %s", self._path, exc, damaged.name)
            os.replace(self._path, damaged)
            for rest in ("-wal", "-shm"):
                self._path.with_name(self._path.name + rest).unlink(missing_ok=True)
            return self._connect()

    def _connect(self) -> sqlite3.Connection:
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        # SQLite would create the file readable for everyone. Its auxiliary files get the permissions of this
        # one.
        flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
        descriptor = os.open(self._path, flags, 0o600)
        try:
            os.fchmod(descriptor, 0o600)
        finally:
            os.close(descriptor)
        database = sqlite3.connect(self._path, check_same_thread=False)
        try:
            # In this mode, commits survive even if the process is killed, without flushing the disk.
            database.execute("PRAGMA journal_mode = WAL")
            database.execute("PRAGMA synchronous = NORMAL")
            database.executescript(_SCHEMA)
            (self._bytes,) = database.execute("SELECT COALESCE(SUM(LENGTH(body)), 0) FROM keys").fetchone()
        except sqlite3.Error:
            database.close()
            raise
        return database

    def _note(self, database: sqlite3.Connection, key: bytes, request: bytes, job: str) -> Noted | None:
        now_s = self._clock.wall_ns() * 1e-9
        self._drop(database, "noted_s < ?", now_s - KEPT_S)
        row = database.execute(
            "SELECT request, job, status, type, location, body FROM keys WHERE key = ?", (key,)
        ).fetchone()
        if row is not None:
            known, its_job, status, kind, location, body = row
            return Noted(
                known, its_job, None if status is None else StoredAnswer(status, kind, location, bytes(body))
            )
        database.execute(
            "INSERT INTO keys (key, request, job, noted_s) VALUES (?, ?, ?, ?)", (key, request, job, now_s)
        )
        return None

    def _answer(self, database: sqlite3.Connection, key: bytes, answer: StoredAnswer) -> None:
        database.execute(
            "UPDATE keys SET status = ?, type = ?, location = ?, body = ? WHERE key = ?",
            (answer.status, answer.type, answer.location, answer.body, key),
        )
        self._bytes += len(answer.body)
        (count,) = database.execute("SELECT COUNT(*) FROM keys").fetchone()
        while count > MAX_KEYS or (self._bytes > MAX_BYTES and count > 1):
            (oldest,) = database.execute("SELECT key FROM keys ORDER BY noted_s LIMIT 1").fetchone()
            self._drop(database, "key = ?", oldest)
            count -= 1

    def _drop(self, database: sqlite3.Connection, condition: str, value: object) -> None:
        rows = database.execute(
            f"DELETE FROM keys WHERE {condition} RETURNING COALESCE(LENGTH(body), 0)",
            (value,),
        ).fetchall()
        self._bytes -= sum(size for (size,) in rows)
