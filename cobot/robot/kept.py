"""A document on disk that is replaced atomically. If the process is killed during the write, either the old
or the new document remains. Only the owner of the file may read it.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from collections.abc import Callable
from functools import partial
from pathlib import Path

from cobot.errors import UnavailableError, exhausted
from cobot.logs.files import make_private


def keep(path: Path, content: bytes, what: str) -> None:
    """Replace the file. The new content is on disk when this returns.

    Args:
        what: name of the content for the message, such as "the scene".

    Raises:
        UnavailableError: there is no space or no permission; the old file is unchanged.
    """
    stage(path, content, what)()


def stage(path: Path, content: bytes, what: str) -> Callable[[], None]:
    """Write the content to a second file on disk, and return the function that replaces the file with it.

    If that function is not called, the next content replaces this one.

    Raises:
        UnavailableError: see `keep`. The returned function may raise it, too.
    """
    new = path.with_name(f"{path.name}.new")

    def write() -> None:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        new.unlink(missing_ok=True)  # left by a killed process, or a file of another user
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
        with os.fdopen(os.open(new, flags, 0o600), "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())

    def put_in_place() -> None:
        os.replace(new, path)
        _settle(path.parent)

    def attempt(step: Callable[[], None]) -> None:
        try:
            step()
        except OSError as exc:
            with contextlib.suppress(OSError):
                new.unlink(missing_ok=True)
            raise exhausted(exc) or UnavailableError(
                f"{path}: cannot be written: {exc.strerror}; {what} is unchanged"
            ) from exc

    attempt(write)
    return partial(attempt, put_in_place)


def read_kept(path: Path) -> bytes:
    """Read a document that `keep` has written, and make the file readable by its owner only.

    Raises:
        FileNotFoundError: there is no file.
        OSError: the file cannot be read, or is not a regular file.
    """
    # Reading a pipe or a device could block forever.
    descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    with os.fdopen(descriptor, "rb") as file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, "is not a regular file")
        with contextlib.suppress(OSError):  # the disk may be read-only
            make_private(descriptor)
        return file.read()


def _settle(folder: Path) -> None:
    """Flush the entries of a folder to disk."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def size_of(folder: Path) -> int:
    """Total size of all files in a folder, in bytes. Files that disappear meanwhile are ignored."""
    found = 0
    for path in folder.rglob("*"):
        with contextlib.suppress(OSError):
            found += path.lstat().st_size
    return found
