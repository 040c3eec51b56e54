"""Safe access to files that clients name and that must be below one folder, and safe creation of files in
folders that other users may write to.
"""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import BinaryIO

from cobot.errors import InputError


def below(folder: Path, name: str, field: str, folder_name: str) -> Path:
    """The resolved path of a file that a client has named. The file need not exist.

    Args:
        folder: the folder, whose path has been resolved.
        field: field of the request that contains the name, for the error.
        folder_name: name of the folder, for the error.

    Raises:
        InputError: the name is invalid, or leads out of the folder.
    """
    try:
        path = (folder / name).resolve()
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            path.stat()  # raises errors that `resolve` ignores; since Python 3.13 also for a cycle of links
    except (ValueError, OSError, RuntimeError) as exc:  # a NUL byte, a name too long, a cycle of links
        raise InputError(f"{field}: {exc}") from exc
    if path == folder or not path.is_relative_to(folder):
        raise InputError(f"{field}: {name!r} is not below the {folder_name} {folder}")
    return path


def open_new(path: Path) -> BinaryIO:
    """Create a file and open it for writing. An existing file or link is removed first, so that nothing is
    written through a link or into a file of another user.

    Raises:
        OSError: the file cannot be created, or a file with this name was created in the meantime.
    """
    path.unlink(missing_ok=True)
    return path.open("xb")  # mode x does not follow links
