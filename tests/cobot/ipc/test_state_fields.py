"""The table of state fields. Oracles: a digest of the record before the table; numpy; the checked-in text."""

from __future__ import annotations

import hashlib
import struct
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cobot.errors import ConfigError
from cobot.ipc import generate, layout
from cobot.ipc.shm import MAX_DOF
from cobot.ipc.state_fields import (
    LAYOUT_VERSION,
    MEASURED,
    MEASURED_NAMES,
    PER_JOINT,
    RECORDED,
    SCALARS,
    STATE_FIELDS,
    STATE_SCALARS,
    STATE_STRUCT,
    StateField,
    state_dtype,
)
from cobot.robot.device import DEFAULT_MEASURED

ROOT = Path(__file__).parents[3]
DOFS = range(1, 17)
LAYOUT_15 = "d055022a16a4dfd8e39d39d6dce58eb70ffe203f1ff906a031a5782e1e5bbfb6"
"""Of `state_dtype(dof).descr` for 1 to 16 joints, before the table."""
FILES = (generate.DECLARATIONS, generate.STUB)
NEW = StateField("added", "u8", "", "Added by a test")
ROW = StateField("added_row", "f8", "°C", "Row of a test", PER_JOINT, measured=True)


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A copy of the files that are generated."""
    for path in FILES:
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text((ROOT / path).read_text())
    return tmp_path


def add_a_field(monkeypatch: pytest.MonkeyPatch) -> None:
    """To the struct and to the records, as a new row of the table would."""
    monkeypatch.setattr(generate, "SCALARS", (*SCALARS, NEW))
    monkeypatch.setattr(generate, "STATE_FIELDS", (*STATE_FIELDS, NEW))
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


def test_the_generated_files_are_those_of_the_table() -> None:
    """If this fails, run `python -m cobot.ipc.generate`, and compile."""
    assert (ROOT / generate.DECLARATIONS).read_text() == generate.declarations()
    stub = (ROOT / generate.STUB).read_text()
    assert generate.with_attributes(stub) == stub


def test_a_changed_record_without_a_new_version_is_refused(
    monkeypatch: pytest.MonkeyPatch, checkout: Path
) -> None:
    add_a_field(monkeypatch)
    before = (checkout / generate.DECLARATIONS).read_text()
    with pytest.raises(ConfigError, match=f"LAYOUT_VERSION is still {LAYOUT_VERSION}: raise it"):
        generate.write(checkout)
    assert (checkout / generate.DECLARATIONS).read_text() == before, "nothing is written"


def test_a_new_field_with_a_new_version_gets_into_the_struct(
    monkeypatch: pytest.MonkeyPatch, checkout: Path
) -> None:
    add_a_field(monkeypatch)
    monkeypatch.setattr(generate, "LAYOUT_VERSION", LAYOUT_VERSION + 1)
    assert generate.write(checkout) == [generate.DECLARATIONS]
    assert "    uint64_t added\n" in (checkout / generate.DECLARATIONS).read_text()
    assert generate.write(checkout) == [], "a second time there is nothing to do"


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


def test_a_stub_without_a_place_for_the_attributes_is_refused(checkout: Path) -> None:
    declared = (checkout / generate.DECLARATIONS).read_text()
    (checkout / generate.STUB).write_text("class Measured: ...\n")
    with pytest.raises(ConfigError, match="put them where the attributes go"):
        generate.write(checkout)
    assert (checkout / generate.DECLARATIONS).read_text() == declared


def with_a_measured_field(
    monkeypatch: pytest.MonkeyPatch, before: str, kind: str = "f8", *, measured: bool = True
) -> None:
    """As if the table had another row."""
    row = replace(ROW, kind=kind, measured=measured)
    place = [field.name for field in STATE_FIELDS].index(before)
    fields = (*STATE_FIELDS[:place], row, *STATE_FIELDS[place:])
    monkeypatch.setattr(generate, "STATE_FIELDS", fields)
    monkeypatch.setattr(generate, "MEASURED", tuple(field for field in fields if field.measured))
    monkeypatch.setattr(generate, "LAYOUT_VERSION", LAYOUT_VERSION + 1)


def test_a_new_measured_row_is_counted_and_gets_its_number_and_its_attribute(
    monkeypatch: pytest.MonkeyPatch, checkout: Path
) -> None:
    with_a_measured_field(monkeypatch, "external_effort")
    assert generate.write(checkout) == [*FILES]
    declared = (checkout / generate.DECLARATIONS).read_text()
    rows = sum(field.length == PER_JOINT for field in MEASURED) + 1
    assert f"    ADDED_ROW_ROW = {rows - 2}\n    EXTERNAL_EFFORT_ROW = {rows - 1}\n" in declared
    assert f"    MEASURED_ROWS = {rows}\n" in declared
    assert f"    return {rows} * dof + 12\n" in declared
    stub = (checkout / generate.STUB).read_text()
    assert "    # Row of a test; °C.\n    added_row: Array\n" in stub


@pytest.mark.parametrize(
    ("before", "kind", "measured"),
    [
        ("wrench", "f8", True),  # external_effort is no longer next to wrench
        ("sensor", "f8", True),
        ("commanded_position", "f8", True),
        ("reason", "f8", True),  # apart from the others
        ("velocity", "f8", False),  # between them, but not measured
        ("velocity", "u8", True),
    ],
)
def test_a_measured_row_in_the_wrong_place_is_refused(
    monkeypatch: pytest.MonkeyPatch, checkout: Path, before: str, kind: str, measured: bool
) -> None:
    texts = {path: (checkout / path).read_text() for path in FILES}
    with_a_measured_field(monkeypatch, before, kind, measured=measured)
    with pytest.raises(ConfigError, match=r"the measured fields are position, .*: list them together in"):
        generate.write(checkout)
    assert {path: (checkout / path).read_text() for path in FILES} == texts


def test_what_a_device_measures_without_saying_so_is_in_the_table() -> None:
    assert set(MEASURED_NAMES) >= DEFAULT_MEASURED
    assert len(MEASURED_NAMES) <= 64, "bits of a field of `cobot.ipc.layout.DEVICE`"
