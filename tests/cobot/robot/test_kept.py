"""Kept files are private and replaced as a whole. Oracle: the modes that the file system reports."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from cobot.robot.kept import keep, read_kept, stage


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_only_the_owner_reads_what_is_kept_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        path = tmp_path / "new" / "tool.json"
        keep(path, b"{}", "the tool")
        assert (mode(path), mode(path.parent)) == (0o600, 0o700)
    finally:
        os.umask(before)


def test_a_file_that_others_could_read_is_private_once_it_was_read_or_replaced(tmp_path: Path) -> None:
    path = tmp_path / "tool.json"
    for again in (lambda: read_kept(path), lambda: keep(path, b"new", "the tool")):
        path.write_bytes(b"old")
        path.chmod(0o644)
        again()
        assert mode(path) == 0o600
    assert read_kept(path) == b"new"


def test_what_lies_in_the_way_of_the_new_file_is_not_followed(tmp_path: Path) -> None:
    target = tmp_path / "target"
    target.write_bytes(b"theirs")
    (tmp_path / "tool.json.new").symlink_to(target)
    keep(tmp_path / "tool.json", b"mine", "the tool")
    assert target.read_bytes() == b"theirs"
    assert not (tmp_path / "tool.json").is_symlink()


def test_what_is_staged_leaves_the_file_as_it_is_until_it_takes_its_place(tmp_path: Path) -> None:
    path = tmp_path / "tool.json"
    keep(path, b"old", "the tool")
    stage(path, b"given up", "the tool")
    put = stage(path, b"new", "the tool")
    assert read_kept(path) == b"old"
    put()
    assert read_kept(path) == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_a_pipe_in_place_of_the_file_keeps_nobody_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "tool.json")
    with pytest.raises(OSError, match="is not a regular file"):
        read_kept(tmp_path / "tool.json")
    with pytest.raises(FileNotFoundError):
        read_kept(tmp_path / "none.json")
