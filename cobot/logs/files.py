"""A file that is rotated at a maximum size. A limited number of older files is kept next to it."""

from __future__ import annotations

import contextlib
import errno
import os
import stat
from pathlib import Path


class RotatingFile:
    """Appends data to a file in whole pieces. If a call fails, the caller gets an error, and the next call
    tries again.

    Only the owner may read the files, including existing ones. A folder created here is private as well.

    Args:
        count: maximum number of older files; NAME.1 is the newest of them.
        strict: whether to reject a path that is a symbolic link or a device.
    """

    def __init__(self, path: Path, max_bytes: int, count: int, *, strict: bool = False) -> None:
        self._path = path
        self._max_bytes = max_bytes
        self._count = count
        self._strict = strict
        self._descriptor = -1
        self._torn = False

    def append(self, piece: bytes) -> None:
        """Append a piece to the file.

        Raises:
            OSError: the piece was written in part or not at all. The next piece then starts on a new line.
        """
        self.open()
        if os.fstat(self._descriptor).st_size + len(piece) > self._max_bytes:
            self._rotate()
        if self._torn:
            piece = b"\n" + piece
        written = os.write(self._descriptor, piece)
        self._torn = 0 < written < len(piece)
        if written < len(piece):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    def sync(self) -> None:
        """Flush the file to the disk, so that its content survives a power cut.

        Raises:
            OSError: the flush failed.
        """
        if self._descriptor >= 0:
            os.fdatasync(self._descriptor)

    def close(self) -> None:
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def open(self) -> None:
        """Open the file if needed. A file that was moved or deleted in the meantime is created again.

        Raises:
            OSError: the file cannot be opened or created.
        """
        if self._descriptor >= 0:
            with contextlib.suppress(FileNotFoundError):
                there, ours = os.stat(self._path), os.fstat(self._descriptor)
                if (there.st_ino, there.st_dev) == (ours.st_ino, ours.st_dev):
                    return
            self.close()
        self._path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_CLOEXEC
        if self._strict:
            flags |= os.O_NOFOLLOW
        self._descriptor = os.open(self._path, flags, 0o600)
        if stat.S_ISREG(os.fstat(self._descriptor).st_mode):
            self._make_private()
        elif self._strict:
            self.close()
            raise OSError(errno.EINVAL, "not a regular file")

    def _make_private(self) -> None:
        make_private(self._descriptor)
        if self._strict and os.geteuid() == 0:  # a command that root runs may create a file of the service
            folder = os.stat(self._path.parent)
            os.fchown(self._descriptor, folder.st_uid, folder.st_gid)
        for older in aside(self._path, self._count)[1:]:
            with contextlib.suppress(OSError):  # the file does not exist or belongs to another user
                descriptor = os.open(older, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
                try:
                    make_private(descriptor)
                finally:
                    os.close(descriptor)

    def _rotate(self) -> None:
        if os.fstat(self._descriptor).st_size == 0:
            return
        self.close()
        files = aside(self._path, self._count)
        for number in range(self._count, 0, -1):
            with contextlib.suppress(FileNotFoundError):
                os.replace(files[number - 1], files[number])
        self.open()


def make_private(descriptor: int) -> None:
    """Restrict an open regular file to its owner. A file that belongs to another user is not changed."""
    status = os.fstat(descriptor)
    mine = status.st_uid == os.geteuid() or os.geteuid() == 0
    if mine and stat.S_ISREG(status.st_mode) and stat.S_IMODE(status.st_mode) & 0o077:
        os.fchmod(descriptor, 0o600)


def aside(path: Path, count: int) -> list[Path]:
    """Paths of the file and of its older files, newest first. They need not exist."""
    return [path, *(path.with_name(f"{path.name}.{number}") for number in range(1, count + 1))]
