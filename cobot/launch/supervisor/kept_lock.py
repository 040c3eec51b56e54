"""Locks that let only one `cobot run` write the files of a robot: tool, scene, positions, jobs, log,
recordings.

Shared memory shows whether the same robot is already running on this computer. It does not show a run in a
container or on another computer that shares only the folder. Nor does it show a run that shares only
`recording.folder` and records another robot of the same name there. So each run locks a file next to the
files that it writes. The lock ends with the process.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from cobot.config import Settings
from cobot.errors import ConflictError

NOWHERE = (errno.EROFS, errno.EACCES, errno.EPERM, errno.ENOSPC, errno.ENOLCK)
"""Errors after which a run continues without a lock. In these cases it cannot write to the folder either, or
the file system does not support locks.
"""

log = logging.getLogger("cobot")


@contextmanager
def locking_kept_files(settings: Settings) -> Iterator[None]:
    """Context manager that locks the kept files. The locks are held until it ends.

    Raises:
        ConflictError: another process is holding one of the locks; the message names the file and the
            process.
    """
    with ExitStack() as held:
        for path in sorted(lock_files(settings)):
            try:
                held.callback(os.close, _lock(path))
            except OSError as exc:
                if exc.errno not in NOWHERE:
                    raise ConflictError(f"{path}: cannot be locked: {exc.strerror}") from exc
                log.warning(
                    "%s: cannot be locked: %s; no other cobot may use this folder", path, exc.strerror
                )
        yield


def lock_files(settings: Settings) -> set[Path]:
    """The files that must be locked: one in each folder that contains files of a robot."""
    found: set[Path] = set()
    for name, each in settings.each.items():
        folders = (each.logs, each.kept or each.logs, each.recording_folder.parent)
        found.update(folder.resolve() / f"{name}.lock" for folder in folders)
    return found


def _lock(path: Path) -> int:
    """Lock a file. Returns the descriptor that holds the lock."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    try:
        fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"pid {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
    except OSError as exc:
        holder = os.pread(descriptor, 200, 0).decode("ascii", "replace").strip()
        os.close(descriptor)
        if exc.errno in (errno.EACCES, errno.EAGAIN):
            raise ConflictError(
                f"{path.parent}: another cobot ({holder or 'pid unknown'}) uses the files of robot "
                f"{path.stem!r} in this folder; stop it, or set another robot.name, logs, kept or "
                "recording.folder"
            ) from exc
        raise
    return descriptor
