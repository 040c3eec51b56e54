"""The folder of recordings: no name leads out of it, and the oldest go first. Oracle: the folder itself."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cobot.errors import InputError, NotFoundError
from cobot.recording.store import RecordingStore, part_name, run_name

SECOND_NS = 1_000_000_000


def name(second: int, reason: str = "fault", part: int = 0) -> str:
    return part_name(run_name("iiwa", second * SECOND_NS, reason), part)


def filled(folder: Path, names: list[str], size: int = 100) -> RecordingStore:
    folder.mkdir(exist_ok=True)
    for each in names:
        (folder / each).write_bytes(bytes(size))
    return RecordingStore(folder, 1000)


def test_a_name_tells_robot_time_reason_and_part() -> None:
    assert name(0) == "iiwa-19700101T000000.000Z-fault.mcap"
    assert name(86400, "continuous", 12) == "iiwa-19700102T000000.000Z-continuous-12.mcap"


def test_only_whole_recordings_are_listed_the_newest_first(tmp_path: Path) -> None:
    store = filled(tmp_path, [name(1), name(3, "continuous", 2), name(3, "continuous", 10), name(2, "estop")])
    (tmp_path / f"{name(4)}.part").write_bytes(b"x")
    (tmp_path / "notes.txt").write_bytes(b"x")
    (tmp_path / "iiwa-19701301T000000.000Z-fault.mcap").write_bytes(b"x")
    (tmp_path / name(5)).symlink_to("/etc/passwd")
    found = store.all()
    expected = [name(3, "continuous", 10), name(3, "continuous", 2), name(2, "estop"), name(1)]
    assert [each.name for each in found] == expected
    assert [each.reason for each in found] == ["continuous", "continuous", "estop", "fault"]
    assert (found[-1].time, found[-1].size) == ("1970-01-01T00:00:01.000+00:00", 100)
    assert list(store.unfinished()) == [name(4)]


def test_a_folder_that_is_not_there_has_none(tmp_path: Path) -> None:
    store = RecordingStore(tmp_path / "none", 1000)
    assert store.all() == []
    assert store.make_room(100) == 0


BAD = [
    "",
    ".",
    "..",
    "../secret",
    "/etc/passwd",
    f"../mcap/{name(1)}",
    f"{name(1)}/../../secret",
    f"%2e%2e%2f{name(1)}",
    f"{name(1)}\0",
    f"{name(1)}\n",
    f"{name(1)}.part",
    name(1).replace("iiwa", "a/b"),
    name(1).upper(),
    "secret",
]


@pytest.mark.parametrize("bad", BAD)
def test_no_name_leads_out_of_the_folder(tmp_path: Path, bad: str) -> None:
    (tmp_path / "secret").write_text("secret")
    store = filled(tmp_path / "mcap", [name(1)])
    for act in (store.path, store.remove):
        with pytest.raises(InputError, match="is not the name of a recording"):
            act(bad)
    assert (tmp_path / "secret").read_text() == "secret"
    assert [each.name for each in store.all()] == [name(1)]


@given(text=st.text(max_size=60))
def test_whatever_the_text_only_a_name_is_a_path(text: str) -> None:
    store = RecordingStore(Path("/nowhere"), 1)
    with pytest.raises((InputError, NotFoundError)):
        store.path(text)


def test_a_link_is_no_recording(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("secret")
    store = filled(tmp_path / "mcap", [])
    (tmp_path / "mcap" / name(1)).symlink_to(tmp_path / "secret")
    with pytest.raises(NotFoundError):
        store.path(name(1))


@given(sizes=st.lists(st.integers(0, 400), max_size=8), needed=st.integers(0, 1200), kept=st.integers(0, 8))
def test_room_is_made_by_removing_the_oldest_and_no_more_than_needed(
    tmp_path_factory: pytest.TempPathFactory, sizes: list[int], needed: int, kept: int
) -> None:
    folder = tmp_path_factory.mktemp("room")
    names = [name(second) for second in range(len(sizes))]
    for each, size in zip(names, sizes, strict=True):
        (folder / each).write_bytes(bytes(size))
    (folder / f"{name(99)}.part").write_bytes(bytes(50))
    store = RecordingStore(folder, 1000)
    total = store.make_room(needed, {name(kept)})
    left = {each for each in names if (folder / each).exists()}
    assert total == sum(size for each, size in zip(names, sizes, strict=True) if each in left) + 50
    gone = [each for each in names if each not in left]
    removable = [each for each in names if each != name(kept)]
    assert gone == removable[: len(gone)]
    assert total + needed <= 1000 or gone == removable
    if gone:
        assert total + needed + sizes[names.index(gone[-1])] > 1000
    assert os.path.exists(folder / f"{name(99)}.part")


def test_what_was_asked_for_goes_before_what_explains_a_fault(tmp_path: Path) -> None:
    asked = [name(3, "continuous", part) for part in (1, 2, 3)] + [name(9, "request")]
    happened = [name(1), name(2, "estop"), name(8)]
    store = filled(tmp_path, [*asked, *happened], 200)
    assert store.make_room(0, {name(9, "request")}) == 1000
    assert {each.name for each in store.all()} == {*asked[2:], *happened}
    store.make_room(400, {name(9, "request")})
    assert {each.name for each in store.all()} == {name(2, "estop"), name(8), name(9, "request")}
