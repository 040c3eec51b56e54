"""Temporary files are new files, so nothing is written through a link in their place.

Oracle: the other user's file that the link leads to.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot.folders import open_new
from cobot.launch.backup.backup import _require_settings
from cobot.learning.episodes import EpisodeWriter
from cobot.recording.store import RecordingStore
from cobot.studies.results.folder import ResultsFolder

THEIRS = b"theirs"


def write_new(path: Path) -> None:
    with open_new(path) as file:
        file.write(b"mine")
    assert path.read_bytes() == b"mine"


def try_out(path: Path) -> None:
    RecordingStore(path.parent, 1).try_out()


def keep_chunk(path: Path) -> None:
    ResultsFolder(path.parents[1]).add(0, 1, b"chunk")


def begin_episode(path: Path) -> None:
    EpisodeWriter(path.with_suffix(""), ["joint1"], 10.0).abandon()


def restore(path: Path) -> None:
    _require_settings(b"robot: {name: iiwa}", path.with_name("own.yaml"), ["iiwa"])


@pytest.mark.parametrize("link", [os.symlink, os.link])
@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("anything", write_new),
        ("trial.part", try_out),
        ("chunks/next.new", keep_chunk),
        ("episode.mcap.part", begin_episode),
        (".own.yaml.restore", restore),
    ],
)
def test_nothing_is_written_through_a_link(
    tmp_path: Path, link: Callable[[Path, Path], None], name: str, write: Callable[[Path], None]
) -> None:
    target, path = tmp_path / "target", tmp_path / "folder" / name
    path.parent.mkdir(parents=True)
    target.write_bytes(THEIRS)
    link(target, path)
    write(path)
    assert target.read_bytes() == THEIRS


def test_a_name_that_is_taken_in_the_meantime_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(OSError, match="folder"):
        open_new(tmp_path / "folder")
