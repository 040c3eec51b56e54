"""The folder of a robot's recordings: recording names, their list, and the removal of old ones."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Container
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from cobot.errors import InputError, NotFoundError
from cobot.folders import open_new
from cobot.strict import shown

SUFFIX = ".mcap"
UNFINISHED = ".part"
TRIAL, TRIAL_BYTES = f"trial{UNFINISHED}", 65536
REASONS = ("fault", "estop", "request", "continuous")
ASKED_FOR = ("request", "continuous")
"""Reasons of recordings that a client has requested. These recordings are removed first, because a client can
request a new one. Recordings of a fault or an e-stop cannot be repeated.
"""
_NAME = re.compile(
    rf"(?P<run>[A-Za-z0-9_-]{{1,48}}-(?P<time>\d{{8}}T\d{{6}}\.\d{{3}})Z-(?P<reason>{'|'.join(REASONS)}))"
    rf"(-(?P<part>[1-9]\d{{0,5}}))?{re.escape(SUFFIX)}"
)
_TIME = "%Y%m%dT%H%M%S.%f"


@dataclass(frozen=True, slots=True)
class Recording:
    """A finished recording.

    Attributes:
        time: time of the recorded event, or of the start of the recording, ISO 8601 in UTC.
        reason: one of `REASONS`.
        size: size of the file in bytes.
    """

    name: str
    time: str
    reason: str
    size: int


def run_name(robot: str, wall_ns: int, reason: str) -> str:
    """The name that all files of a recording share, without part and suffix."""
    moment = datetime.fromtimestamp(wall_ns * 1e-9, UTC)
    return f"{robot}-{moment.strftime(_TIME)[:-3]}Z-{reason}"


def part_name(run: str, part: int) -> str:
    """The name of one file. The parts of a continuous recording are numbered from 1."""
    return f"{run}-{part}{SUFFIX}" if part else f"{run}{SUFFIX}"


class RecordingStore:
    """The recordings of one robot. Another process may write and remove files at any time.

    Args:
        folder: folder that contains only this robot's recordings. It is created when it is needed.
        max_bytes: maximum size of all files together.
    """

    def __init__(self, folder: Path, max_bytes: int) -> None:
        self.folder = folder
        self.max_bytes = max_bytes

    def all(self) -> list[Recording]:
        """The finished recordings, newest first."""
        found = [(match, file) for file in self._files() if (match := _NAME.fullmatch(file.name))]
        recordings = []
        for match, file in found:
            with contextlib.suppress(OSError, ValueError):  # just removed, or an invalid date
                moment = datetime.strptime(match["time"], _TIME).replace(tzinfo=UTC)
                time = moment.isoformat(timespec="milliseconds")
                recordings.append(Recording(file.name, time, match["reason"], file.stat().st_size))
        return sorted(recordings, key=_order, reverse=True)

    def path(self, name: str) -> Path:
        """The path of a finished recording.

        Raises:
            InputError: the name is not valid for a recording, for example because it leads to a different
                folder.
            NotFoundError: no recording has this name.
        """
        if not _NAME.fullmatch(name):
            raise InputError(
                f"name: {shown(name)} is not the name of a recording, such as "
                f"{run_name('iiwa', 0, 'fault')}{SUFFIX}"
            )
        file = self.folder / name
        if file.is_symlink() or not file.is_file():
            raise NotFoundError(f"there is no recording {shown(name)}; GET /recordings lists them")
        return file

    def remove(self, name: str) -> None:
        """Delete a finished recording. Raises the same errors as `path`."""
        self.path(name).unlink(missing_ok=True)

    def unfinished(self) -> dict[str, Path]:
        """Unfinished files, by their final names. A recorder is writing them, or was killed while it wrote
        them.
        """
        return {
            file.name.removesuffix(UNFINISHED): file
            for file in self._files()
            if file.name.endswith(UNFINISHED) and _NAME.fullmatch(file.name.removesuffix(UNFINISHED))
        }

    def make_room(self, needed: int, kept: Container[str] = ()) -> int:
        """Remove recordings until there is room for more bytes. Requested recordings are removed first,
        oldest first.

        Args:
            needed: number of bytes that are needed in addition to the existing files.
            kept: names of recordings that must not be removed.

        Returns:
            The size of all remaining files in bytes.
        """
        recordings = sorted(self.all(), key=lambda each: each.reason in ASKED_FOR)
        total = sum(each.size for each in recordings)
        for file in self.unfinished().values():
            with contextlib.suppress(OSError):
                total += file.stat().st_size
        while recordings and total + needed > self.max_bytes:
            oldest = recordings.pop()
            if oldest.name not in kept:
                with contextlib.suppress(OSError):
                    (self.folder / oldest.name).unlink(missing_ok=True)
                    total -= oldest.size
        return total

    def try_out(self) -> None:
        """Check that a recording can be started.

        Raises:
            OSError: the folder cannot be written.
        """
        file = self.folder / TRIAL
        try:
            with open_new(file) as opened:
                opened.write(bytes(TRIAL_BYTES))
        finally:
            file.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        try:
            return [file for file in self.folder.iterdir() if file.is_file() and not file.is_symlink()]
        except OSError:
            return []


def _order(recording: Recording) -> tuple[str, int]:
    match = _NAME.fullmatch(recording.name)
    assert match is not None
    return match["time"], int(match["part"] or 0)
