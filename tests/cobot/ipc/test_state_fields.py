"""The table of state fields. Oracles: a digest of the record before the table; numpy; the checked-in text."""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path

import numpy as np
import pytest

from cobot.errors import ConfigError
from cobot.ipc import generate, layout
from cobot.ipc.shm import MAX_DOF
from cobot.ipc.state_fields import (
    LAYOUT_VERSION,
    PER_JOINT,
    RECORDED,
    SCALARS,
    STATE_FIELDS,
    STATE_SCALARS,
    STATE_STRUCT,
    StateField,
    state_dtype,
)

ROOT = Path(__file__).parents[3]
DOFS = range(1, 17)
LAYOUT_15 = "d055022a16a4dfd8e39d39d6dce58eb70ffe203f1ff906a031a5782e1e5bbfb6"
"""Of `state_dtype(dof).descr` for 1 to 16 joints, before the table."""
NEW = StateField("added", "u8", "", "Added by a test")


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of the file that is generated."""
    (tmp_path / generate.STRUCT).parent.mkdir(parents=True)
    (tmp_path / generate.STRUCT).write_text((ROOT / generate.STRUCT).read_text())
    return tmp_path


def add_a_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the struct and to the records, as a new row of the table would."""
    monkeypatch.setattr(generate, "SCALARS", (*SCALARS, NEW))
    changed = np.dtype([*state_dtype(7).descr, ("added", "u8")])
    monkeypatch.setattr(generate, "state_dtype", lambda dof: changed)


@pytest.mark.skipif(LAYOUT_VERSION != 15, reason="the records are others by intention")
def test_the_state_block_of_layout_15_is_bit_by_bit_what_it_was() -> None:
    descriptions = repr([state_dtype(dof).descr for dof in DOFS])
    assert hashlib.sha256(descriptions.encode()).hexdigest() == LAYOUT_15


@pytest.mark.parametrize("dof", DOFS)
def test_the_record_has_every_field_of_the_table_in_its_place(dof: int) -> None:
    dtype = state_dtype(dof)
    assert set(dtype.names or ()) == {field.name for field in STATE_FIELDS}
    for field in STATE_FIELDS:
        assert dtype[field.name] == np.dtype((field.kind, field.shape(dof))), field.name
        assert dtype.fields is not None
        assert dtype.fields[field.name][1] % 8 == 0, f"{field.name} is not aligned"


def test_the_struct_reads_the_numbers_that_stand_first() -> None:
    record = np.frombuffer(np.random.default_rng(3).bytes(state_dtype(7).itemsize), state_dtype(7))[0]
    expected = [record[name] for name, _ in STATE_SCALARS]
    np.testing.assert_array_equal(STATE_STRUCT.unpack_from(record.tobytes()), expected)
    assert STATE_STRUCT.size == 8 * len(SCALARS) == struct.calcsize(STATE_STRUCT.format)


def test_names_are_unique_and_every_field_has_a_meaning() -> None:
    assert len({field.name for field in STATE_FIELDS}) == len(STATE_FIELDS)
    for field in STATE_FIELDS:
        assert field.meaning, field.name
        assert not field.meaning.endswith("."), field.name
        assert field.member is None or field.length == 0, field.name
        assert field.keys is None or field.length == len(field.keys), field.name
        assert field.length in (0, PER_JOINT) or field.length > 0, field.name


def test_places_in_a_message_are_taken_once_and_only_by_recorded_fields() -> None:
    places = [(field.topic, field.message[0]) for field in STATE_FIELDS if field.message]
    assert len(set(places)) == len(places)
    for field in STATE_FIELDS:
        assert field.message is None or field in RECORDED, field.name


def test_the_generated_file_is_that_of_the_table() -> None:
    """If this fails, run `python -m cobot.ipc.generate`, and compile."""
    assert (ROOT / generate.STRUCT).read_text() == generate.struct_text()


def test_a_changed_record_without_a_new_version_is_refused(
    monkeypatch: pytest.MonkeyPatch, checkout: Path
) -> None:
    add_a_field(monkeypatch)
    before = (checkout / generate.STRUCT).read_text()
    with pytest.raises(ConfigError, match=f"LAYOUT_VERSION is still {LAYOUT_VERSION}: raise it"):
        generate.write(checkout)
    assert (checkout / generate.STRUCT).read_text() == before, "nothing is written"


def test_a_new_field_with_a_new_version_gets_into_the_struct(
    monkeypatch: pytest.MonkeyPatch, checkout: Path
) -> None:
    add_a_field(monkeypatch)
    monkeypatch.setattr(generate, "LAYOUT_VERSION", LAYOUT_VERSION + 1)
    assert generate.write(checkout)
    assert "    uint64_t added\n" in (checkout / generate.STRUCT).read_text()
    assert not generate.write(checkout), "a second time there is nothing to do"


def test_every_record_counts_for_the_version(monkeypatch: pytest.MonkeyPatch) -> None:
    before = generate.records_digest()
    monkeypatch.setattr(layout, "HEAD", np.dtype([("id", "u8"), ("more", "u8")]))
    assert generate.records_digest() != before


@pytest.mark.parametrize("joints", [1, 6, MAX_DOF])
def test_a_record_that_has_changed_for_one_number_of_joints_only_counts_too(
    monkeypatch: pytest.MonkeyPatch, joints: int
) -> None:
    before, made = generate.records_digest(), layout.info_dtype
    longer = np.dtype([("id", "u8"), ("more", "u8")])
    monkeypatch.setattr(layout, "info_dtype", lambda dof: longer if dof == joints else made(dof))
    assert generate.records_digest() != before
