"""A document on the disk that is replaced as a whole: a process that is killed meanwhile leaves the old one
or the new one. Only its owner may read it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path

from cobot.errors import UnavailableError, exhausted
from cobot.logs.files import make_private


def keep(path: Path, content: bytes, what: str) -> None:
    """Replace the file, on the disk when this returns.

    Args:
        what: for the message, as "the scene".

    Raises:
        UnavailableError: there is no room or no permission; the old one is there as it was.
    """
    new = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        new.unlink(missing_ok=True)  # of a process that was killed; or what somebody else has put there
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(new, flags, 0o600), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.replace(new, path)
        _settle(path.parent)
    except OSError as exc:
        with contextlib.suppress(OSError):
            new.unlink(missing_ok=True)
        raise exhausted(exc) or UnavailableError(
            f"{path}: cannot be written: {exc.strerror}; {what} is as it was"
        ) from exc


def read_kept(path: Path) -> bytes:
    """What `keep` has written; from now on only its owner may read it.

    Raises:
        FileNotFoundError: there is none.
        OSError: it cannot be read, or is not a regular file.
    """
    # What is not a regular file may keep its reader waiting for ever: a pipe, a device.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "is not a regular file")
        with contextlib.suppress(OSError):  # on a read-only disk
            make_private(descriptor)
        return file.read()


def _settle(folder: Path) -> None:
    """Have a folder's entries on the disk too."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
