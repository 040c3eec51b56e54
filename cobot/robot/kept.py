"""A document on the disk that is replaced as a whole: who is killed meanwhile leaves the old or the new."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from cobot.errors import UnavailableError, exhausted


def keep(path: Path, content: bytes, what: str) -> None:
    """Replace the file, on the disk when this returns.

    Args:
        what: for the message, as "the scene".

    Raises:
        UnavailableError: there is no room or no permission; the old one is there as it was.
    """
    new = path.with_name(f"{path.name}.new")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with new.open("wb") as file:
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


def _settle(folder: Path) -> None:
    """Have a folder's entries on the disk too."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
