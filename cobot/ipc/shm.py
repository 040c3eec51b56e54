"""The shared memory of one robot. Only this module and `cobot.ipc.layout` know the position of the blocks.

It is a file in /dev/shm, which the supervisor creates and rtloop and the service map:

    header      constant: magic, layout version, dof, period, names; the supervisor repairs a damaged one
    state       rtloop writes, every cycle
    statistics  rtloop writes, some times a second
    acks        rtloop writes, one entry per command
    heartbeat   the service writes, from its event loop
    requests    the service writes: counters of stops and e-stops, which no other request can displace
    outside_stops, outside_estops   any process may increment them: stops that do not need the service
    head        the service writes: the newest command's number
    commands    the service writes: a ring
    tool, output, pull   the service writes: data of a TOOL, an OUTPUT or a PULL command
    gripper     the service writes: each reading of the gripper, which rtloop publishes in its state
    slots       the service writes: two trajectories
    info        rtloop writes, at its start and with a new tool: properties of the robot
    device, io  rtloop writes, some times a second: the device's capabilities and status; inputs and outputs
    cell        rtloop writes, 50 times a second: parts of a simulated cell
    session_ack rtloop writes: its answer to a session
    signals     rtloop writes: which actions of the motion have fired, and the state of its conditions
    session, setpoint, chunk, stream_requests   the streaming client writes
    point_head, points  the streaming client writes: a ring of servo points; points that rtloop has not read
                are not overwritten

Every block has one writer (`cobot.ipc.seqlock`), which locks on the file ensure (`cobot.ipc.memory_file`).
Only the outside counters have several writers.
"""

from __future__ import annotations

import mmap
import os
import time
import zlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cobot.errors import ConflictError, InputError, LayoutError, SharedMemoryError, UnavailableError
from cobot.ipc.layout import (
    ACK,
    CELL,
    COMMAND,
    DEVICE,
    HEAD,
    HEADER,
    HEARTBEAT,
    IO,
    MAGIC,
    OUTPUT,
    POINT_HEAD,
    POINTS,
    PULL,
    REQUESTS,
    RING,
    SESSION_ACK,
    SIGNAL_REPORT,
    SLOT,
    SLOTS,
    STATISTICS,
    STREAM_REQUESTS,
    TEXT,
    TOOL,
    chunk_dtype,
    info_dtype,
    point_dtype,
    session_dtype,
    setpoint_dtype,
    text,
)
from cobot.ipc.memory_file import (
    REMEDIES,
    MemoryRole,
    add_user,
    close_file,
    create_file,
    holder,
    lock,
    path_of,
    remove_user,
    unlock,
)
from cobot.ipc.seqlock import Block, SharedCounter, checksum
from cobot.ipc.signal_record import fill_signals
from cobot.ipc.state_fields import GRIPPER_RECORD, LAYOUT_VERSION, state_dtype
from cobot.motions.fence import Fence
from cobot.motions.signals import NO_PLACED, Placed
from cobot.trajectory import ORDER, Trajectory
from cobot.types import Array

__all__ = ["MAX_DOF", "MemoryRole", "RobotMemory", "Slot", "encoded", "memory_bytes"]

MAX_DOF = 16
MEND_S = 1.0
"""Time in which a running supervisor repairs a damaged header, s."""
_RTLOOP, _SERVICE, _STREAM = "rtloop", "the service", "the streaming client"
"""Names of the writers of blocks, for error messages."""

_PAGE = 4096


def _aligned(size: int) -> int:
    return -(-size // _PAGE) * _PAGE


@dataclass(frozen=True, slots=True)
class Slot:
    """Storage for one trajectory. The arrays are views of the whole capacity in shared memory."""

    head: Block
    breakpoints_s: Array
    coefficients: Array

    def write(
        self,
        motion_id: int,
        trajectory: Trajectory,
        fence: Fence | None = None,
        signals: Placed = NO_PLACED,
    ) -> None:
        """Write a trajectory. The caller ensures that rtloop is not following this slot.

        Args:
            fence: the space that the TCP must not leave, and its maximum speed.
            signals: actions and conditions of the motion.

        Raises:
            InputError: the motion has more segments than the slot's capacity.
            SharedMemoryError: the motion has the wrong number of joints.
        """
        n, capacity = trajectory.segments, len(self.coefficients)
        if n > capacity:
            raise InputError(f"the motion has {n} segments, allowed: {capacity} (rt.trajectory_capacity)")
        if trajectory.dof != self.coefficients.shape[1]:
            raise SharedMemoryError(
                f"the motion has {trajectory.dof} joints, but the robot has {self.coefficients.shape[1]}"
            )
        self.breakpoints_s[: n + 1] = trajectory.breakpoints_s
        self.coefficients[:n] = trajectory.coefficients
        self.head.data["motion_id"] = motion_id
        self.head.data["segments"] = n
        self.head.data["fence"] = np.nan if fence is None else fence.values()
        fill_signals(self.head.data["signals"], signals)
        self.head.data["checksum"] = zlib.crc32(
            trajectory.coefficients.data, zlib.crc32(trajectory.breakpoints_s.data)
        )
        self.head.publish()


class RobotMemory:
    """A robot's mapped memory. Create it with `create` or `attach`, and release it with `close`."""

    def __init__(self, path: Path, descriptor: int, role: MemoryRole, raw: bytes) -> None:
        """
        Args:
            raw: the header, which has been checked.
        """
        self.path = path
        self.role = role
        self._descriptor = descriptor
        self._roles: set[MemoryRole] = set() if role is MemoryRole.READER else {role}
        header = np.frombuffer(raw, HEADER)[0]
        self._header_page = raw.ljust(_PAGE, b"\0")
        self.dof = int(header["dof"])
        self.period_s = float(header["period_s"])
        self.created_ns = int(header["created_ns"])
        self.robot = text(header["robot"])
        self.url = text(header["url"])
        capacity = int(header["capacity"])
        self._map = mmap.mmap(descriptor, _file_size(self.dof, capacity))
        add_user(path)
        self._offset = _PAGE
        self.state = self._block(state_dtype(self.dof), "state", _RTLOOP)
        self.statistics = self._block(STATISTICS, "statistics", _RTLOOP)
        self.acks = [self._block(ACK, "acknowledgement", _RTLOOP) for _ in range(RING)]
        self._next_page()
        self.heartbeat = self._block(HEARTBEAT, "heartbeat", _SERVICE)
        self.requests = self._block(REQUESTS, "requests", _SERVICE)
        self.outside_stops, self.outside_estops = self._counter(), self._counter()
        self.head = self._block(HEAD, "command head", _SERVICE)
        self.commands = [self._block(COMMAND, "command", _SERVICE) for _ in range(RING)]
        self.tool = self._block(TOOL, "tool", _SERVICE)
        self.output = self._block(OUTPUT, "output", _SERVICE)
        self.pull = self._block(PULL, "pull", _SERVICE)
        self.gripper = self._block(GRIPPER_RECORD, "gripper", _SERVICE)
        self._next_page()
        self.slots = [self._slot(capacity) for _ in range(SLOTS)]
        self.info = self._block(info_dtype(self.dof), "robot information", _RTLOOP)
        self.device = self._block(DEVICE, "device", _RTLOOP)
        self.io = self._block(IO, "inputs and outputs", _RTLOOP)
        self.cell = self._block(CELL, "cell", _RTLOOP)
        self.session_ack = self._block(SESSION_ACK, "session acknowledgement", _RTLOOP)
        self.signals = self._block(SIGNAL_REPORT, "signals of the motion", _RTLOOP)
        self._next_page()
        self.session = self._block(session_dtype(self.dof), "session", _STREAM)
        self.stream_requests = self._block(STREAM_REQUESTS, "requests of the stream", _STREAM)
        self.setpoint = self._block(setpoint_dtype(self.dof), "setpoint", _STREAM)
        self.chunk = self._block(chunk_dtype(self.dof), "chunk", _STREAM)
        self.point_head = self._block(POINT_HEAD, "point head", _STREAM)
        point = point_dtype(self.dof)
        self.points = [self._block(point, "servo point", _STREAM) for _ in range(POINTS)]

    @classmethod
    def create(cls, robot: str, dof: int, period_s: float, capacity: int, url: str = "") -> RobotMemory:
        """Create the memory file of a robot. A file that a killed run has left is removed first.

        Args:
            url: address of the robot's service, for local clients; "" if there is no service.

        Raises:
            ConflictError: another supervisor, or a process that remains from one, is using the file; the
                message gives its pid.
            SharedMemoryError: there is no space in /dev/shm, or no permission.
        """
        path, size = path_of(robot), _file_size(dof, capacity)
        try:
            descriptor = create_file(path, robot)
        except OSError as exc:
            raise SharedMemoryError(
                f"{path}: {exc.strerror}; if another user owns the file, stop that user's cobot and "
                "remove the file, or set another robot.name"
            ) from exc
        except ConflictError as exc:
            raise ConflictError(f"{exc}; stop it, or set another robot.name") from exc
        try:
            # A full /dev/shm causes an error here and not during a motion.
            os.posix_fallocate(descriptor, 0, size)
            header = np.zeros((), HEADER)
            header["magic"], header["layout"], header["dof"] = MAGIC, LAYOUT_VERSION, dof
            header["capacity"], header["ring"], header["period_s"] = capacity, RING, period_s
            header["created_ns"], header["robot"] = time.time_ns(), robot.encode()
            header["url"] = url.encode()
            header["checksum"] = _header_checksum(header.tobytes())
            os.pwrite(descriptor, header.tobytes(), 0)
            return cls(path, descriptor, MemoryRole.SUPERVISOR, header.tobytes())
        except OSError as exc:
            os.close(descriptor)
            path.unlink(missing_ok=True)
            remedy = REMEDIES.get(exc.errno or 0, "")
            raise SharedMemoryError(f"{path}: cannot allocate {size} bytes: {exc.strerror}{remedy}") from exc

    @classmethod
    def attach(cls, robot: str, role: MemoryRole) -> RobotMemory:
        """Map the file that the supervisor has created.

        Raises:
            UnavailableError: there is no file.
            LayoutError: the file is damaged, is not a robot's memory, or was made by a different version of
                cobot.
            ConflictError: the role is taken.
        """
        path = path_of(robot)
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except FileNotFoundError as exc:
            raise UnavailableError(f"robot {robot!r} is not running: there is no {path}") from exc
        except OSError as exc:
            raise SharedMemoryError(f"{path}: {exc.strerror}") from exc
        try:
            raw = _checked_header(path, descriptor)
            if role is not MemoryRole.READER:
                lock(descriptor, role, robot)
            return cls(path, descriptor, role, raw)
        except OSError as exc:
            os.close(descriptor)
            remedy = REMEDIES.get(exc.errno or 0, "")
            raise SharedMemoryError(f"{path}: cannot be mapped: {exc.strerror}{remedy}") from exc
        except (LayoutError, ConflictError):
            close_file(path, descriptor)
            raise

    def mend_header(self) -> bool:
        """Restore the header if it is damaged. Returns whether it was damaged.

        Only its creator may call this. A damaged header would prevent other processes from mapping the
        memory.
        """
        if self._map[:_PAGE] == self._header_page:
            return False
        self._map[:_PAGE] = self._header_page
        return True

    def take(self, role: MemoryRole) -> None:
        """Become the writer of the blocks of an additional role, until `release` is called or the process
        ends.

        Raises:
            ConflictError: another process has the role; the message gives its pid.
        """
        lock(self._descriptor, role, self.robot)
        self._roles.add(role)

    def release(self, role: MemoryRole) -> None:
        self._roles.discard(role)
        unlock(self._descriptor, role)

    def close(self) -> None:
        """Release the locks. The mapping itself ends when the last array that uses it ends."""
        if self._descriptor < 0:
            return
        for role in tuple(self._roles):
            self.release(role)
        remove_user(self.path)
        close_file(self.path, self._descriptor)
        self._descriptor = -1

    def unlink(self) -> None:
        """Remove the file. Existing mappings stay valid."""
        self.path.unlink(missing_ok=True)

    def _block(self, dtype: np.dtype, name: str, writer: str) -> Block:
        block = Block(self._map, self._offset, dtype, name, writer)
        self._offset += -(-Block.size(dtype) // 64) * 64  # each block begins on a new cache line
        return block

    def _counter(self) -> SharedCounter:
        counter = SharedCounter(self._map, self._offset)
        self._offset += 64
        return counter

    def _next_page(self) -> None:
        self._offset = _aligned(self._offset)

    def _slot(self, capacity: int) -> Slot:
        head = self._block(SLOT, "trajectory slot", _SERVICE)
        times = np.ndarray(capacity + 1, np.float64, self._map, self._offset)
        self._offset += times.nbytes
        coefficients = np.ndarray((capacity, self.dof, ORDER), np.float64, self._map, self._offset)
        self._offset += coefficients.nbytes
        self._next_page()
        return Slot(head, times, coefficients)


def memory_bytes(dof: int, capacity: int) -> int:
    """Number of bytes that a robot needs in /dev/shm."""
    return _file_size(dof, capacity)


def encoded(message: str, size: int = np.dtype(TEXT).itemsize) -> bytes:
    """Encode a message for a text field. Long messages are cut between characters, and characters that cannot
    be encoded are escaped.
    """
    return message.encode("utf-8", "backslashreplace")[:size].decode("utf-8", "ignore").encode()


def _file_size(dof: int, capacity: int) -> int:
    slot = 64 + Block.size(SLOT) + 8 * (capacity + 1) + 8 * capacity * dof * ORDER
    dtypes = (state_dtype, info_dtype, session_dtype, setpoint_dtype, chunk_dtype)
    blocks = (
        sum(Block.size(dtype(dof)) for dtype in dtypes)
        + Block.size(STATISTICS)
        + Block.size(TOOL)
        + Block.size(DEVICE)
        + Block.size(IO)
        + Block.size(CELL)
        + Block.size(OUTPUT)
        + Block.size(PULL)
        + Block.size(SIGNAL_REPORT)
        + RING * (Block.size(ACK) + Block.size(COMMAND) + 128)
        + POINTS * (Block.size(point_dtype(dof)) + 64)
    )
    return 8 * _PAGE + _aligned(blocks) + SLOTS * _aligned(slot)


def _checked_header(path: Path, descriptor: int) -> bytes:
    """Read and check the header. If it is damaged, it is read again until a supervisor has had time to repair
    it.

    Raises:
        LayoutError: the file is damaged, is not a robot's memory, or was made by a different version of
            cobot.
    """
    deadline_s = time.monotonic() + MEND_S
    while True:
        raw = os.pread(descriptor, HEADER.itemsize, 0)
        try:
            _require_layout(path, descriptor, raw)
            return raw
        except LayoutError:
            if time.monotonic() > deadline_s or not holder(descriptor, MemoryRole.SUPERVISOR):
                raise
        time.sleep(0.02)


def _require_layout(path: Path, descriptor: int, raw: bytes) -> None:
    if len(raw) < HEADER.itemsize or not raw.startswith(MAGIC.rstrip(b"\0")):
        raise LayoutError(f"{path}: is not the shared memory of a robot")
    header = np.frombuffer(raw, HEADER)[0]
    if header["layout"] != LAYOUT_VERSION:
        raise LayoutError(
            f"{path}: has layout version {header['layout']}, but this program has {LAYOUT_VERSION}; "
            "stop the cobot that created the file, or use its version"
        )
    dof, capacity = int(header["dof"]), int(header["capacity"])
    if dof <= MAX_DOF and os.fstat(descriptor).st_size < _file_size(dof, capacity):
        raise LayoutError(f"{path}: is shorter than its header states")
    if header["checksum"] != _header_checksum(raw):
        raise LayoutError(f"{path}: its header is damaged; restart the cobot that created the file")


def _header_checksum(raw: bytes) -> int:
    return checksum(bytearray(raw[: HEADER.itemsize - 8]))
