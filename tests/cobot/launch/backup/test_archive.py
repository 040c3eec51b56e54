"""Archives that are damaged or hostile. Oracle: zipfile, with which they are made."""

from __future__ import annotations

import hashlib
import io
import json
import stat
import warnings
import zipfile
from typing import Any

import pytest

from cobot.errors import InputError
from cobot.launch.backup import archive
from cobot.launch.backup.archive import MANIFEST, pack, unpack

FILES = {"a.txt": b"one", "robots/x/tool.json": b"{}"}


def manifest(files: dict[str, bytes]) -> bytes:
    return json.dumps(
        {"files": {name: hashlib.sha256(each).hexdigest() for name, each in files.items()}}
    ).encode()


def made(entries: list[tuple[str | zipfile.ZipInfo, bytes]]) -> bytes:
    out = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as file:
        warnings.simplefilter("ignore")  # of a name that is there twice
        for name, content in entries:
            file.writestr(name, content)
    return out.getvalue()


def link(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name)
    entry.external_attr = (stat.S_IFLNK | 0o777) << 16
    return entry


def test_what_is_packed_is_unpacked_and_equal_contents_make_equal_archives() -> None:
    content = pack(FILES, {"format": 1})
    about, files = unpack(content)
    assert (about["format"], files) == (1, FILES)
    assert pack(FILES, {"format": 1}) == content
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        assert file.testzip() is None
        assert set(file.namelist()) == {*FILES, MANIFEST}


@pytest.mark.parametrize(
    ("entries", "said"),
    [
        ([], "no valid manifest.json"),
        ([(MANIFEST, b"[]")], "no valid manifest.json"),
        ([(MANIFEST, b"[" * 100_000)], "no valid manifest.json"),
        ([(MANIFEST, manifest(FILES))], "'a.txt' is only in"),
        ([(MANIFEST, manifest({})), ("more", b"x")], "'more' is only in"),
        ([(MANIFEST, manifest({"a": b"1"})), ("a", b"2")], "'a' is damaged"),
        ([(MANIFEST, manifest({"a": b"1"})), ("a", b"1"), ("a", b"1")], "'a' twice"),
        ([(MANIFEST, manifest({})), ("folder/", b"")], "a folder or a link"),
        ([(MANIFEST, manifest({})), (link("a"), b"/etc/passwd")], "a folder or a link"),
    ],
)
def test_an_archive_that_is_not_one_of_ours_is_rejected(entries: Any, said: str) -> None:
    with pytest.raises(InputError, match=said):
        unpack(made(entries))


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"not a zip" * 100, pack(FILES, {})[:-30]])
def test_what_is_no_archive_is_rejected(content: bytes) -> None:
    with pytest.raises(InputError, match="is not a ZIP archive, or it is damaged"):
        unpack(content)


def test_a_changed_byte_anywhere_is_found_or_does_not_matter() -> None:
    content = pack(FILES, {})
    for index in range(len(content)):
        changed = bytearray(content)
        changed[index] ^= 0x55
        try:
            assert unpack(bytes(changed))[1] == FILES
        except InputError:
            continue


def test_a_bomb_is_not_inflated(monkeypatch: pytest.MonkeyPatch) -> None:
    zeros = b"\0" * 30_000_000
    bomb = made([(MANIFEST, manifest({"a": zeros})), ("a", zeros)])
    assert len(bomb) < 50_000
    with pytest.raises(InputError, match="'a' has 30000000 bytes, allowed: 20000000"):
        unpack(bomb)
    lying = bytearray(made([(MANIFEST, manifest({"a": zeros[:1_000_000]})), ("a", zeros[:1_000_000])]))
    size = (1_000_000).to_bytes(4, "little")
    while (at := lying.find(size)) >= 0:
        lying[at : at + 4] = (10).to_bytes(4, "little")
    with pytest.raises(InputError, match=r"another size|damaged"):
        unpack(bytes(lying))
    monkeypatch.setattr(archive, "MAX_TOTAL_BYTES", 5)
    with pytest.raises(InputError, match="the files in the archive have"):
        unpack(pack(FILES, {}))
    monkeypatch.setattr(archive, "MAX_FILES", 2)
    with pytest.raises(InputError, match="has 3 files, allowed: 2"):
        unpack(pack(FILES, {}))
    monkeypatch.setattr(archive, "MAX_ARCHIVE_BYTES", 10)
    with pytest.raises(InputError, match="allowed: 10"):
        unpack(pack(FILES, {}))
