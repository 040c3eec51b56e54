"""The files of the robots' memories in /dev/shm, and the locks on these files.

Each process locks one byte of the file for its role, so every block of the memory has one writer. A lock ends
with its process. A process that is denied a lock learns the pid of the process that holds it.
"""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from collections import Counter, defaultdict
from enum import IntEnum
from pathlib import Path

from cobot.errors import ConflictError

FOLDER = Path("/dev/shm")
REMEDIES = {
    errno.ENOSPC: "; make room there, enlarge it (docker run --shm-size), or lower rt.trajectory_capacity",
    errno.ENOMEM: "; raise the memory limit (ulimit -v), or lower rt.trajectory_capacity",
    errno.EFBIG: "; raise the limit of the size of files (ulimit -f), or lower rt.trajectory_capacity",
}
_users: Counter[Path] = Counter()
_closed: defaultdict[Path, list[int]] = defaultdict(list)
"""For each file, the number of memories that this process has open, and the descriptors of the memories that
it has closed.
"""


class MemoryRole(IntEnum):
    """The role of a user of a memory. Its value is the number of the byte in the file that the role locks."""

    SUPERVISOR = 0
    RTLOOP = 1
    SERVICE = 2
    READER = 3  # neither locks nor writes anything
    STREAM = 4  # a client that streams targets; `take` adds this role to the role that has mapped the memory


def robots_running() -> list[str]:
    """The names of this computer's robots that have a supervisor or a real-time process, or whose memory this
    process has open.

    The last case is listed separately because the kernel does not report a process's own locks.
    """
    found = []
    for path in sorted(FOLDER.glob("cobot-*")):
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC)
        except OSError:  # a file of another user, or a file that does not belong to a robot
            continue
        roles = MemoryRole.SUPERVISOR, MemoryRole.RTLOOP
        if _users[path] or any(holder(descriptor, role) for role in roles):
            found.append(path.name.removeprefix("cobot-"))
        close_file(path, descriptor)
    return found


def user_of(robot: str, role: MemoryRole) -> int:
    """The pid of the process that has a role in a robot's memory; 0 if no process has it."""
    try:
        descriptor = os.open(path_of(robot), os.O_RDWR | os.O_CLOEXEC)
    except OSError:
        return 0
    try:
        return holder(descriptor, role)
    finally:
        os.close(descriptor)


def add_user(path: Path) -> None:
    """Record that this process has opened a memory in this file."""
    _users[path] += 1


def remove_user(path: Path) -> None:
    """Record that this process has closed a memory that it had opened in this file. Call `close_file`
    afterwards.
    """
    _users[path] -= 1


def close_file(path: Path, descriptor: int) -> None:
    """Close a descriptor, but only when this process no longer uses the file. Reason: when a process closes
    any descriptor of a file, POSIX releases all locks of the process on that file.
    """
    _closed[path].append(descriptor)
    if not _users[path]:
        for each in _closed.pop(path):
            os.close(each)


def create_file(path: Path, robot: str) -> int:
    """Create an empty file, locked for the supervisor. Returns its descriptor.

    The file of a killed run is removed and not reused. Another process may still have it mapped, and
    truncating it would kill that process by SIGBUS.

    Raises:
        ConflictError: another supervisor, or a process that remains from one, is using the file; the message
            gives its pid.
        OSError: the system denies access.
    """
    while True:
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        except FileExistsError:
            _remove_stale(path, robot)
            continue
        lock(descriptor, MemoryRole.SUPERVISOR, robot)
        if _is_at(path, descriptor):
            return descriptor
        os.close(descriptor)  # another supervisor removed it as stale before it was locked


def _remove_stale(path: Path, robot: str) -> None:
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
    except FileNotFoundError:
        return
    try:
        lock(descriptor, MemoryRole.SUPERVISOR, robot)
        for role in (MemoryRole.RTLOOP, MemoryRole.SERVICE, MemoryRole.STREAM):
            _refuse_if_locked(descriptor, role, robot)
        if _is_at(path, descriptor):
            path.unlink()
    finally:
        os.close(descriptor)


def _is_at(path: Path, descriptor: int) -> bool:
    """Whether this descriptor belongs to the file at this path."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False


def path_of(robot: str) -> Path:
    """The file of a robot's memory."""
    return FOLDER / f"cobot-{robot}"


def _flock(kind: int, role: MemoryRole) -> bytes:
    return struct.pack("hhqqi4x", kind, os.SEEK_SET, int(role), 1, 0)


def holder(descriptor: int, role: MemoryRole) -> int:
    """The pid of the process that holds a role's lock; 0 if no process holds it."""
    answer = fcntl.fcntl(descriptor, fcntl.F_GETLK, _flock(fcntl.F_WRLCK, role))
    kind, _, _, _, pid = struct.unpack("hhqqi4x", answer)
    return 0 if kind == fcntl.F_UNLCK else int(pid)


def _refuse_if_locked(descriptor: int, role: MemoryRole, robot: str) -> None:
    pid = holder(descriptor, role)
    if pid:
        raise ConflictError(f"robot {robot!r} is in use: pid {pid} runs as its {role.name.lower()}")


def lock(descriptor: int, role: MemoryRole, robot: str) -> None:
    """Take a role until `unlock` is called or the process ends.

    Raises:
        ConflictError: another process has the role; the message gives its pid.
    """
    try:
        fcntl.fcntl(descriptor, fcntl.F_SETLK, _flock(fcntl.F_WRLCK, role))
    except OSError as exc:
        pid = holder(descriptor, role)
        raise ConflictError(f"robot {robot!r} is in use: pid {pid} runs as its {role.name.lower()}") from exc


def unlock(descriptor: int, role: MemoryRole) -> None:
    fcntl.fcntl(descriptor, fcntl.F_SETLK, _flock(fcntl.F_UNLCK, role))
