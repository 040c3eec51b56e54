"""The mapped file of a robot's recording, see `cobot.ipc.records`."""

from __future__ import annotations

import mmap
import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cobot.errors import LayoutError, SharedMemoryError, UnavailableError
from cobot.ipc.layout import text
from cobot.ipc.memory_file import FOLDER, REMEDIES
from cobot.ipc.records import (
    FRESH_BYTES,
    HEADER,
    HISTORY_BYTES,
    MAGIC,
    NOTE,
    NOTES,
    RECORDER,
    record_dtype,
)
from cobot.ipc.ring import Ring
from cobot.ipc.seqlock import Block, checksum
from cobot.ipc.shm import MAX_DOF, encoded
from cobot.ipc.state_fields import LAYOUT_VERSION

_PAGE = 4096
_STATUS = _PAGE
_NOTES = 2 * _PAGE


def ring_path(robot: str) -> Path:
    """The file of a robot's recording."""
    return FOLDER / f"cobot-{robot}.ring"


def history_places(dof: int, period_s: float, ring_s: float) -> int:
    """Number of cycles in the history: all cycles of `ring_s`, or as many as HISTORY_BYTES permits."""
    return max(1, min(round(ring_s / period_s), HISTORY_BYTES // record_dtype(dof).itemsize))


def ring_bytes(dof: int, period_s: float, ring_s: float) -> int:
    """Bytes that a robot's recording needs in /dev/shm."""
    places = FRESH_BYTES // record_dtype(dof).itemsize
    return _Places(dof, places, history_places(dof, period_s, ring_s)).end


class _Places:
    """Offsets in the file, in bytes, each at the start of a page."""

    def __init__(self, dof: int, fresh: int, history: int) -> None:
        record = record_dtype(dof)
        self.fresh = _aligned(_NOTES + Ring.size(NOTE, NOTES))
        self.history = _aligned(self.fresh + Ring.size(record, fresh))
        self.end = _aligned(self.history + Ring.size(record, history))


class RecordingMemory:
    """A mapped recording. Make it with `create` or `attach`. The mapping ends when the last array that uses
    it ends.

    Attributes:
        dof, period_s, robot, joint_names: properties of the robot.
        created_ns: CLOCK_MONOTONIC at which the supervisor created the memory.
        status: the block that the recorder writes.
        notes, fresh, history: the rings; history is None if it was not requested.
    """

    def __init__(self, path: Path, descriptor: int, raw: bytes, *, history: bool) -> None:
        """
        Args:
            raw: the header, which has been checked. The object becomes the owner of the descriptor.
        """
        self.path = path
        header = np.frombuffer(raw, HEADER)[0]
        self.dof = int(header["dof"])
        self.period_s = float(header["period_s"])
        self.created_ns = int(header["created_ns"])
        self.robot = text(header["robot"])
        self.joint_names = [text(name) for name in header["joint_names"][: self.dof]]
        record = record_dtype(self.dof)
        fresh, places = int(header["fresh"]), int(header["history"])
        offsets = _Places(self.dof, fresh, places)
        try:
            mapped = mmap.mmap(descriptor, offsets.end if history else offsets.history)
        finally:
            os.close(descriptor)
        self.status = Block(mapped, _STATUS, RECORDER, "recorder status", "the recorder")
        self.notes = Ring(mapped, _NOTES, NOTE, NOTES)
        self.fresh = Ring(mapped, offsets.fresh, record, fresh)
        self.history = Ring(mapped, offsets.history, record, places) if history else None

    @classmethod
    def create(
        cls, robot: str, dof: int, period_s: float, ring_s: float, joint_names: Sequence[str]
    ) -> RecordingMemory:
        """Create the file. A file that a killed run has left is removed first. Only the owner of the robot's
        memory may call this.

        Raises:
            SharedMemoryError: there is no space in /dev/shm, or no permission.
        """
        path, record = ring_path(robot), record_dtype(dof)
        header = np.zeros((), HEADER)
        header["magic"], header["layout"], header["dof"] = MAGIC, LAYOUT_VERSION, dof
        header["fresh"] = FRESH_BYTES // record.itemsize
        header["history"] = history_places(dof, period_s, ring_s)
        header["period_s"], header["created_ns"] = period_s, time.monotonic_ns()
        header["robot"] = robot.encode()
        header["joint_names"][:dof] = [encoded(name, 64) for name in joint_names]
        header["checksum"] = _checksum(header.tobytes())
        size = ring_bytes(dof, period_s, ring_s)
        try:
            path.unlink(missing_ok=True)
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
            try:
                os.posix_fallocate(descriptor, 0, size)  # a full /dev/shm fails here, not in a cycle
                os.pwrite(descriptor, header.tobytes(), 0)
            except OSError:
                os.close(descriptor)
                path.unlink(missing_ok=True)
                raise
        except OSError as exc:
            remedy = REMEDIES.get(exc.errno or 0, "").replace("rt.trajectory_capacity", "recording.ring_s")
            raise SharedMemoryError(f"{path}: cannot allocate {size} bytes: {exc.strerror}{remedy}") from exc
        return cls(path, descriptor, header.tobytes(), history=True)

    @classmethod
    def attach(cls, robot: str, *, history: bool) -> RecordingMemory:
        """Map the file that the supervisor has created.

        Args:
            history: whether to map the history too. It is many times larger than everything else.

        Raises:
            UnavailableError: there is no file.
            LayoutError: the file is damaged, is not a recording, or was made by a different version of cobot.
            SharedMemoryError: the file cannot be opened or mapped.
        """
        path = ring_path(robot)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError as exc:
            raise UnavailableError(f"robot {robot!r} is not recorded: there is no {path}") from exc
        except OSError as exc:
            raise SharedMemoryError(f"{path}: {exc.strerror}") from exc
        raw = os.pread(descriptor, HEADER.itemsize, 0)
        try:
            _require_layout(path, descriptor, raw)
        except LayoutError:
            os.close(descriptor)
            raise
        try:
            return cls(path, descriptor, raw, history=history)
        except OSError as exc:
            raise SharedMemoryError(f"{path}: cannot be mapped: {exc.strerror}") from exc

    def unlink(self) -> None:
        """Remove the file. Existing mappings stay valid."""
        self.path.unlink(missing_ok=True)


def _require_layout(path: Path, descriptor: int, raw: bytes) -> None:
    if len(raw) < HEADER.itemsize or not raw.startswith(MAGIC):
        raise LayoutError(f"{path}: is not the recording of a robot")
    header = np.frombuffer(raw, HEADER)[0]
    if header["layout"] != LAYOUT_VERSION:
        raise LayoutError(
            f"{path}: has layout version {header['layout']}, but this program has {LAYOUT_VERSION}; "
            "stop the cobot that created the file, or use its version"
        )
    if header["checksum"] != _checksum(raw) or not 0 < header["dof"] <= MAX_DOF:
        raise LayoutError(f"{path}: its header is damaged; restart the cobot that created the file")
    places = _Places(int(header["dof"]), int(header["fresh"]), int(header["history"]))
    if os.fstat(descriptor).st_size < places.end:
        raise LayoutError(f"{path}: is shorter than its header states")


def _checksum(raw: bytes) -> int:
    return checksum(bytearray(raw[: HEADER.itemsize - 8]))


def _aligned(size: int) -> int:
    return -(-size // _PAGE) * _PAGE
