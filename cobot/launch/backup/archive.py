"""ZIP archives, written and read in memory. No file is ever unpacked to a path that an archive names.

An archive that comes from another person may be hostile. Its files are found by their whole names, in bounded
memory. Links, folders, encrypted files, files that appear twice and wrong checksums are rejected.
"""

from __future__ import annotations

import hashlib
import io
import json
import stat
import zipfile
import zlib
from collections.abc import Mapping
from typing import Any

from cobot.errors import InputError
from cobot.strict import shown

MAX_ARCHIVE_BYTES = 32_000_000
MAX_FILE_BYTES = 20_000_000
MAX_TOTAL_BYTES = 300_000_000
MAX_FILES = 10_000
MANIFEST = "manifest.json"
_TIME = (1980, 1, 1, 0, 0, 0)
"""Modification time that is written for every file, so that equal contents give equal archives."""


def pack(files: Mapping[str, bytes], about: Mapping[str, Any]) -> bytes:
    """Create an archive with a manifest.

    Args:
        files: contents of the files by their names.
        about: further keys of the manifest.
    """
    sums = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    manifest = json.dumps({**about, "files": sums}, indent=1, ensure_ascii=False).encode()
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in ((MANIFEST, manifest), *files.items()):
            entry = zipfile.ZipInfo(name, _TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = (stat.S_IFREG | 0o600) << 16
            archive.writestr(entry, content)
    return made.getvalue()


def unpack(content: bytes) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Read an archive that `pack` has made. Returns its manifest, and the contents of its files by their
    names.

    Raises:
        InputError: the content is not such an archive, is too large, or is damaged.
    """
    if len(content) > MAX_ARCHIVE_BYTES:
        raise InputError(f"the archive has {len(content)} bytes, allowed: {MAX_ARCHIVE_BYTES}")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = archive.infolist()
            _require_plain(entries)
            files = {entry.filename: _read(archive, entry) for entry in entries}
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, NotImplementedError, ValueError) as exc:
        raise InputError(f"the file is not a ZIP archive, or it is damaged: {exc}") from exc
    return _checked(files)


def _require_plain(entries: list[zipfile.ZipInfo]) -> None:
    if len(entries) > MAX_FILES:
        raise InputError(f"the archive has {len(entries)} files, allowed: {MAX_FILES}")
    seen: set[str] = set()
    for entry in entries:
        name, kind = shown(entry.filename), stat.S_IFMT(entry.external_attr >> 16)
        if entry.is_dir() or kind not in (0, stat.S_IFREG):
            raise InputError(
                f"the archive contains {name}, which is a folder or a link; only files are allowed"
            )
        if entry.flag_bits & 1:
            raise InputError(f"the archive contains {name}, which is encrypted")
        if entry.filename in seen:
            raise InputError(f"the archive contains {name} twice")
        if entry.file_size > MAX_FILE_BYTES:
            raise InputError(f"{name} has {entry.file_size} bytes, allowed: {MAX_FILE_BYTES}")
        seen.add(entry.filename)
    total = sum(entry.file_size for entry in entries)
    if total > MAX_TOTAL_BYTES:
        raise InputError(f"the files in the archive have {total} bytes, allowed: {MAX_TOTAL_BYTES}")


def _read(archive: zipfile.ZipFile, entry: zipfile.ZipInfo) -> bytes:
    """Read a file, but do not decompress more bytes than the archive lists for it."""
    with archive.open(entry) as file:
        content = file.read(entry.file_size + 1)
    if len(content) != entry.file_size:
        raise InputError(f"{shown(entry.filename)} does not have the size that the archive lists")
    return content


def _checked(files: dict[str, bytes]) -> tuple[dict[str, Any], dict[str, bytes]]:
    try:
        manifest = json.loads(files.pop(MANIFEST))
        sums = dict(manifest["files"])
    except (KeyError, ValueError, TypeError, RecursionError) as exc:
        raise InputError(f"the archive has no valid {MANIFEST}, so it was not made by cobot") from exc
    if sums.keys() != files.keys():
        other = min(sums.keys() ^ files.keys())
        raise InputError(f"{shown(other)} is only in the archive or only in its {MANIFEST}")
    for name, content in files.items():
        if hashlib.sha256(content).hexdigest() != sums[name]:
            raise InputError(f"{shown(name)} is damaged: its checksum differs from the one in {MANIFEST}")
    return manifest, files
