"""Names of files that clients give, of which only those below one folder are touched, and new files in
folders that other users may write to.
"""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

from cobot.errors import InputError


def below(folder: Path, name: str, field: str, folder_name: str) -> Path:
    """The resolved path of what a client has named, whether it is there or not.

    Args:
        folder: resolved.
        field: of the request that has the name, for the sentence.
        folder_name: for people.

    Raises:
        InputError: no possible name, or one that leads elsewhere.
    """
    try:
        path = (folder / name).resolve()
        path.exists()  # raises what `resolve` passes over
    except (ValueError, OSError, RuntimeError) as exc:  # NUL bytes, names too long, circular links
        raise InputError(f"{field}: {exc}") from exc
    if path == folder or not path.is_relative_to(folder):
        raise InputError(f"{field}: {name!r} is not below the {folder_name} {folder}")
    return path


def open_new(path: Path) -> BinaryIO:
    """Create a file and open it for writing. What has its name is removed first, so that neither a link nor
    another user's file is written through.

    Raises:
        OSError: it cannot be created, or something else has got its name in the meantime.
    """
    path.unlink(missing_ok=True)
    return path.open("xb")  # O_EXCL follows no link
