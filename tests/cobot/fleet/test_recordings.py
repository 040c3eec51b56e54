"""Recordings on their way from a cell to the hub's disk. Oracles: the files of the cell, byte by byte."""

from __future__ import annotations

import json
import os
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from cobot.errors import InputError, NotFoundError, UnavailableError
from cobot.fleet.recordings import PIECE_BYTES, FleetRecordingStore, GivenRecordings, RecordingPiece

Ask = Callable[[RecordingPiece], bytes | None]


class Cell:
    """A folder with recordings; the connection breaks after some answers."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir()
        self.folder = folder
        self.given = GivenRecordings(folder)
        self.answers = 10**9
        self.asked: list[int | None] = []

    def record(self, name: str, size: int, age: int = 0) -> bytes:
        content = random.Random(name).randbytes(size)
        (self.folder / name).write_bytes(content)
        os.utime(self.folder / name, (1000 - age, 1000 - age))
        return content

    def ask(self, question: RecordingPiece) -> bytes | None:
        if self.answers == 0:
            return None
        self.answers -= 1
        self.asked.append(question.offset)
        return self.given.answer(question.model_dump_json().encode())

    def into(self, store: FleetRecordingStore) -> int:
        return store.take("one", "arm", self.given.listing(), self.ask)


@pytest.fixture
def cell(tmp_path: Path) -> Cell:
    return Cell(tmp_path / "cell")


@pytest.fixture
def store(tmp_path: Path) -> FleetRecordingStore:
    return FleetRecordingStore(tmp_path / "hub", 10**9)


def names(store: FleetRecordingStore) -> list[str]:
    return [each.name for each in store.all()]


def test_a_recording_arrives_byte_by_byte_and_once(cell: Cell, store: FleetRecordingStore) -> None:
    content = cell.record("a.mcap", 3 * PIECE_BYTES + 7)
    cell.record("empty.mcap", 0)
    (cell.folder / "b.mcap.part").write_bytes(b"not complete")
    assert cell.into(store) == 2
    assert store.path("one", "arm", "a.mcap").read_bytes() == content
    assert sorted(names(store)) == ["a.mcap", "empty.mcap"]
    cell.asked.clear()
    assert (cell.into(store), cell.asked) == (0, [])


def test_what_was_cut_goes_on_where_it_ended(cell: Cell, tmp_path: Path) -> None:
    content = cell.record("a.mcap", 5 * PIECE_BYTES)
    for _ in range(2):
        cell.answers = 2
        with pytest.raises(UnavailableError, match="the copy continues later"):
            cell.into(FleetRecordingStore(tmp_path / "hub", 10**9))  # a hub that was killed begins anew
    store = FleetRecordingStore(tmp_path / "hub", 10**9)
    assert not names(store)
    cell.answers = 10
    assert cell.into(store) == 1
    assert store.path("one", "arm", "a.mcap").read_bytes() == content
    pieces = [offset for offset in cell.asked if offset is not None]
    assert pieces == [number * PIECE_BYTES for number in range(5)], "no piece was asked for twice"


def test_a_wrong_byte_is_found_and_the_file_is_fetched_again(
    cell: Cell, store: FleetRecordingStore, tmp_path: Path
) -> None:
    content = cell.record("a.mcap", 2 * PIECE_BYTES)
    part = tmp_path / "hub" / "one" / "arm" / "a.mcap.part"
    part.parent.mkdir(parents=True)
    part.write_bytes(b"x" * PIECE_BYTES)
    assert cell.into(store) == 0
    assert not names(store)
    assert cell.into(store) == 1
    assert store.path("one", "arm", "a.mcap").read_bytes() == content


def test_the_oldest_are_deleted_for_new_ones_and_do_not_come_again(cell: Cell, tmp_path: Path) -> None:
    store = FleetRecordingStore(tmp_path / "hub", 2500)
    for number in range(4):
        cell.record(f"{number}.mcap", 1000, age=10 - number)
        cell.into(store)
    assert sum(each.size for each in store.all()) <= 2500
    assert sorted(names(store)) == ["2.mcap", "3.mcap"]
    assert cell.into(store) == 0
    cell.record("large.mcap", 3000)
    assert cell.into(store) == 0
    assert sorted(names(store)) == ["2.mcap", "3.mcap"], "nothing is deleted for what does not fit anyway"


def test_unfinished_files_of_a_cell_that_is_gone_count_and_make_room(cell: Cell, tmp_path: Path) -> None:
    store = FleetRecordingStore(tmp_path / "hub", 2500)
    left = tmp_path / "hub" / "gone" / "arm" / "old.mcap.part"
    left.parent.mkdir(parents=True)
    left.write_bytes(b"x" * 1000)
    os.utime(left, (0.0, 0.0))
    for number in range(2):
        cell.record(f"{number}.mcap", 1000, age=10 - number)
        cell.into(store)
    assert sorted(names(store)) == ["0.mcap", "1.mcap"]
    assert not left.exists()
    files = [path for path in (tmp_path / "hub").rglob("*.mcap*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) <= 2500


def test_nothing_is_left_of_what_the_cell_has_no_more(
    cell: Cell, store: FleetRecordingStore, tmp_path: Path
) -> None:
    for name in ("a.mcap", "b.mcap"):
        cell.record(name, 2 * PIECE_BYTES)
    cell.answers = 4  # a is complete, and of b the first piece is here
    with pytest.raises(UnavailableError):
        cell.into(store)
    folder = tmp_path / "hub" / "one" / "arm"
    assert sorted(path.name for path in folder.iterdir()) == ["a.mcap", "b.mcap.part", "taken.txt"]
    for path in cell.folder.iterdir():
        path.unlink()
    cell.record("c.mcap", 1)
    cell.answers = 10
    assert cell.into(store) == 1
    assert sorted(path.name for path in folder.iterdir()) == ["a.mcap", "c.mcap", "taken.txt"]
    assert (folder / "taken.txt").read_text() == "c.mcap\n"


def test_a_full_disk_is_said_and_leaves_the_rest(
    cell: Cell, store: FleetRecordingStore, tmp_path: Path
) -> None:
    cell.record("a.mcap", 10)
    (tmp_path / "hub" / "one").write_text("a file where a folder has to be")
    with pytest.raises(UnavailableError, match="recordings stay in their cells"):
        cell.into(store)


def test_nothing_is_written_through_a_link(cell: Cell, store: FleetRecordingStore, tmp_path: Path) -> None:
    cell.record("a.mcap", 10)
    folder = tmp_path / "hub" / "one" / "arm"
    folder.mkdir(parents=True)
    (folder / "a.mcap.part").symlink_to(tmp_path / "target")
    with pytest.raises(UnavailableError):
        cell.into(store)
    assert not (tmp_path / "target").exists()


@pytest.mark.parametrize(
    "listing",
    [
        b"",
        b"{}",
        b"[" * 100_000,
        json.dumps([{"name": "../../x.mcap", "size": 1}]).encode(),
        json.dumps([{"name": "x.txt", "size": 1}]).encode(),
        json.dumps([{"name": "x.mcap", "size": -1}]).encode(),
    ],
)
def test_a_listing_that_leads_elsewhere_is_invalid(
    cell: Cell, store: FleetRecordingStore, listing: bytes
) -> None:
    with pytest.raises(InputError, match="recordings of one/arm"):
        store.take("one", "arm", listing, cell.ask)


@pytest.mark.parametrize(
    ("question", "error"),
    [
        (b"", InputError),
        (b'{"name": "../cell/a.mcap", "offset": 0}', InputError),
        (b'{"name": "a.mcap", "offset": -1}', InputError),
        (b'{"name": "none.mcap", "offset": 0}', NotFoundError),
    ],
)
def test_a_cell_gives_nothing_but_its_recordings(cell: Cell, question: bytes, error: type[Exception]) -> None:
    cell.record("a.mcap", 10)
    with pytest.raises(error):
        cell.given.answer(question)
    assert cell.given.answer(b'{"name": "a.mcap", "offset": 1000000}') == b""


def test_a_piece_that_is_too_long_does_not_make_the_file_longer(
    cell: Cell, store: FleetRecordingStore
) -> None:
    content = cell.record("a.mcap", 10)
    ask = cell.ask

    def too_much(question: RecordingPiece) -> bytes | None:
        answer = ask(question)
        return answer if question.offset is None or answer is None else answer + b"more"

    assert store.take("one", "arm", cell.given.listing(), too_much) == 1
    assert store.path("one", "arm", "a.mcap").read_bytes() == content


def test_only_recordings_of_the_hub_have_a_path(cell: Cell, store: FleetRecordingStore) -> None:
    cell.record("a.mcap", 10)
    cell.into(store)
    for wrong in (("one", "arm", "taken.txt"), ("..", "hub", "one"), ("one", "arm", "../arm/a.mcap")):
        with pytest.raises(NotFoundError):
            store.path(*wrong)
