"""Transfers recordings: a cell sends pieces of its files, and the hub assembles them.

The hub requests one piece at a time, so that a slow link does not delay commands. A file at the hub is
complete when its SHA-256 equals that of the file in the cell. Until then its name is NAME.part, and an
interrupted transfer continues where it ended.
"""

from __future__ import annotations

import contextlib
import json
import logging
import os
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from hashlib import file_digest
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, TypeAdapter, ValidationError

from cobot.errors import CobotError, InputError, NotFoundError, UnavailableError
from cobot.fleet.messages import read
from cobot.robot.kept import keep
from cobot.strict import StrictModel, sentences

PIECE_BYTES = 512 * 1024
PULL_S = 2.0
"""Interval at which the hub checks for new recordings, in seconds."""
MAX_LISTED = 10_000
SUFFIX, PART, TAKEN = ".mcap", ".part", "taken.txt"
RecordingName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]{0,150}\.mcap$")]
log = logging.getLogger("cobot.fleet")


class ListedRecording(StrictModel):
    """A complete recording of a cell: its name, and its size in bytes."""

    name: RecordingName
    size: Annotated[int, Field(ge=0)]


class RecordingPiece(StrictModel):
    """The hub's request for a piece of a recording, starting at a given byte, or for the hash of the whole
    file.
    """

    name: RecordingName
    offset: Annotated[int, Field(ge=0)] | None = None


LISTED = TypeAdapter(list[ListedRecording])


class GivenRecordings:
    """The recordings of one robot, in its cell."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def listing(self, _: bytes = b"") -> bytes:
        """All complete recordings as JSON, oldest first."""
        found = []
        for path in sorted(self._folder.glob(f"*{SUFFIX}"), key=_age):
            with contextlib.suppress(OSError, ValidationError):
                found.append(ListedRecording(name=path.name, size=path.stat().st_size).model_dump())
        return json.dumps(found[-MAX_LISTED:]).encode()

    def answer(self, content: bytes) -> bytes:
        """Answer with a piece, or with the SHA-256 of the file as hexadecimal text.

        Raises:
            InputError: the request is invalid.
            NotFoundError: there is no such recording.
        """
        asked = read(RecordingPiece, content)
        try:
            with (self._folder / asked.name).open("rb") as file:
                if asked.offset is None:
                    return file_digest(file, "sha256").hexdigest().encode()
                file.seek(asked.offset)
                return file.read(PIECE_BYTES)
        except OSError as exc:
            raise NotFoundError(f"there is no recording {asked.name}: {exc.strerror}") from exc


@dataclass(frozen=True, slots=True)
class TakenRecording:
    """A recording that is stored at the hub."""

    cell: str
    robot: str
    name: str
    size: int


class FleetRecordingStore:
    """The recordings of a fleet on the hub's disk: FOLDER/CELL/ROBOT/NAME.

    Args:
        max_bytes: maximum size of all files together, including unfinished ones. The oldest files are deleted
            to make room.

    Raises (constructor):
        UnavailableError: the folder cannot be written.
    """

    def __init__(self, folder: Path, max_bytes: int) -> None:
        self._folder, self._max_bytes = folder, max_bytes
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        except OSError as exc:
            raise UnavailableError(f"--recordings: {folder}: {exc.strerror}") from exc

    def all(self) -> list[TakenRecording]:
        """All complete recordings, oldest first."""
        found = []
        for path in sorted(self._folder.glob(f"*/*/*{SUFFIX}"), key=_age):
            with contextlib.suppress(OSError):
                cell, robot = path.parts[-3:-1]
                found.append(TakenRecording(cell, robot, path.name, path.stat().st_size))
        return found

    def path(self, cell: str, robot: str, name: str) -> Path:
        """The file of a recording.

        Raises:
            NotFoundError: there is no such recording.
        """
        for each in self.all():
            if (each.cell, each.robot, each.name) == (cell, robot, name):
                return self._folder / cell / robot / name
        raise NotFoundError(f"the hub has no recording {cell}/{robot}/{name}")

    def take(
        self, cell: str, robot: str, listing: bytes, ask: Callable[[RecordingPiece], bytes | None]
    ) -> int:
        """Fetch new recordings. Returns the number of recordings that were completed.

        Args:
            ask: asks the cell; returns None if it does not answer.

        Raises:
            InputError: the listing is not valid.
            UnavailableError: the disk is full, or the connection was lost. The next call continues the
                transfer.
        """
        try:
            found = LISTED.validate_json(listing)
        except ValidationError as exc:
            raise InputError(f"the recordings of {cell}/{robot}: {sentences(exc.errors())}") from exc
        folder = self._folder / cell / robot
        completed = 0
        try:
            folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            self._forget(folder, {each.name for each in found})
            known = self._known(folder)
            for each in found:
                part = folder / f"{each.name}{PART}"
                if each.name not in known and self._make_room(part, each.size):
                    completed += self._fetch(part, each, ask)
        except OSError as exc:
            raise UnavailableError(f"{folder}: {exc.strerror}; recordings stay in their cells") from exc
        return completed

    def _fetch(
        self, part: Path, recording: ListedRecording, ask: Callable[[RecordingPiece], bytes | None]
    ) -> bool:
        folder = part.parent
        flags = os.O_RDWR | os.O_CREAT | os.O_APPEND | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(part, flags, 0o600), "r+b") as file:
            while (offset := file.seek(0, os.SEEK_END)) < recording.size:
                piece = ask(RecordingPiece(name=recording.name, offset=offset))
                if not piece:
                    raise UnavailableError(
                        f"{recording.name}: the cell does not answer; the copy continues later"
                    )
                file.write(piece[: recording.size - offset])
                file.flush()
            expected = ask(RecordingPiece(name=recording.name))
            if expected is None:
                raise UnavailableError(
                    f"{recording.name}: the cell does not answer; the copy continues later"
                )
            file.seek(0)
            right = file_digest(file, "sha256").hexdigest().encode() == expected
            os.fsync(file.fileno())
        if not right:
            part.unlink()  # the file in the cell was replaced, or the disk has changed a byte
            log.warning("%s: the hash differs; fetching it again", part)
            return False
        part.rename(folder / recording.name)
        with (folder / TAKEN).open("a", encoding="ascii") as taken:
            taken.write(f"{recording.name}\n")
        return True

    @staticmethod
    def _known(folder: Path) -> set[str]:
        """Names of the recordings that were fetched, including recordings that were deleted to make room."""
        return {path.name for path in folder.glob(f"*{SUFFIX}")} | _taken(folder)

    @staticmethod
    def _forget(folder: Path, listed: set[str]) -> None:
        """Remove unfinished files and the names of fetched recordings that no longer exist in the cell."""
        for part in folder.glob(f"*{SUFFIX}{PART}"):
            if part.name.removesuffix(PART) not in listed:
                part.unlink(missing_ok=True)
        taken = _taken(folder)
        if taken - listed:
            lines = "".join(f"{name}\n" for name in sorted(taken & listed))
            keep(folder / TAKEN, lines.encode(), "the list of recordings")

    def _make_room(self, part: Path, size: int) -> bool:
        """Delete the oldest files to make room. Returns False if the new file alone is too large.

        Args:
            part: the unfinished file of the new recording. Unfinished files from other cells may be deleted,
                because these cells may be gone and never complete them.
            size: final size of the new one.
        """
        if size > self._max_bytes:
            return False
        found = [path for path in self._folder.glob("*/*/*") if path.suffix in (SUFFIX, PART)]
        sizes = {path: _size(path) for path in sorted(found, key=_age) if path != part}
        total = sum(sizes.values())
        for path, freed in sizes.items():
            if total + size <= self._max_bytes:
                break
            path.unlink(missing_ok=True)
            log.info("deleted %s to make room", path)
            total -= freed
        return True


class RecordingPuller:
    """Fetches recordings in a thread, one robot after the other.

    Args:
        robots: returns the cells and robots that currently provide recordings.
        ask: sends a request to the key of a robot; returns None if there is no answer.
    """

    def __init__(
        self,
        store: FleetRecordingStore,
        robots: Callable[[], Iterable[tuple[str, str]]],
        ask: Callable[[str, str, str, bytes | None], bytes | None],
    ) -> None:
        self.store = store
        self._robots, self._ask = robots, ask
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="recordings", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._ended.set()
        self._thread.join(5.0)

    def _run(self) -> None:
        while not self._ended.wait(PULL_S):
            for cell, robot in self._robots():
                try:
                    self._pull(cell, robot)
                except CobotError as exc:
                    log.warning("the recordings of %s/%s cannot be fetched: %s", cell, robot, exc)
                except Exception:
                    log.exception("the recordings of %s/%s cannot be fetched", cell, robot)

    def _pull(self, cell: str, robot: str) -> None:
        listing = self._ask(cell, robot, "recordings", None)
        if listing is None:
            return

        def ask(question: RecordingPiece) -> bytes | None:
            if self._ended.is_set():
                return None
            return self._ask(cell, robot, "recording", question.model_dump_json().encode())

        completed = self.store.take(cell, robot, listing, ask)
        if completed:
            log.info("%d recordings of %s/%s have been fetched", completed, cell, robot)


def _taken(folder: Path) -> set[str]:
    try:
        return set((folder / TAKEN).read_text(encoding="ascii", errors="replace").split())
    except FileNotFoundError:
        return set()


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def _age(path: Path) -> Any:
    try:
        return path.stat().st_mtime_ns, path.name
    except OSError:
        return 0, path.name
