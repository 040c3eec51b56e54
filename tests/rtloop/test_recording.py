"""What the cycle leaves for the recorder. Oracles: the state block of the same cycle; what was given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from cobot_run import unique_name
from rig import Rig

import rtloop.recording
from cobot.config import Settings
from cobot.errors import LayoutError
from cobot.ipc.layout import Command, Intervention, text
from cobot.ipc.recording_memory import RecordingMemory, history_places
from cobot.ipc.state_fields import RECORDED, StateField
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode
from rtloop.recording import CycleRecorder

CYCLES = 400
RING_S = 5.0


@pytest.fixture
def recording(settings: Settings, robot: RobotDescription) -> Iterator[RecordingMemory]:
    made = RecordingMemory.create(
        unique_name(), robot.limits.dof, settings.rt.period_s, RING_S, robot.limits.names
    )
    yield made
    made.unlink()


def test_each_cycle_leaves_a_record_of_what_the_state_says(
    settings: Settings, robot: RobotDescription, recording: RecordingMemory
) -> None:
    rig = Rig(settings, robot, recording=recording)
    try:
        states = []
        for cycle in range(CYCLES):
            if cycle in (50, 250):
                rig.request("estops" if cycle == 50 else "stops")
            if cycle in (120, 320):
                rig.send(Command.RESET)
            rig.loopback.offset[:] = 0.5 if 200 <= cycle < 300 else 0.001 * np.sin(0.01 * cycle)
            rig.step()
            assert rig.memory.state.try_read()
            states.append(rig.memory.state.data.copy())
        reader = RecordingMemory.attach(recording.robot, history=False)
        records = reader.fresh.read(1, CYCLES)
        assert records["number"].tolist() == [int(state["cycle"]) for state in states]
        for field in RECORDED:
            expected = np.array([state[field.name] for state in states])
            np.testing.assert_array_equal(
                records[field.name], expected.astype(field.recorded), err_msg=field.name
            )
        assert (np.diff(records["monotonic_ns"]) > 0).all()
        assert records["fresh"].all()
        notes = {int(n["number"]): text(n["reason"]) for n in reader.notes.read(1, 100)}
        said = [notes[int(number)] for number in records["note"]]
        assert said == [text(state["reason"]) for state in states]
        tracked = [bool(int(bits) >> Intervention.TRACKING & 1) for bits in records["interventions"]]
        counted = [int(state["interventions"][Intervention.TRACKING]) for state in states]
        assert tracked == [now != before for now, before in zip(counted, [0, *counted], strict=False)]
        assert {LoopMode.ESTOP, LoopMode.FAULT, LoopMode.HOLD} <= set(records["mode"].tolist())
    finally:
        rig.close()


def test_a_restarted_cycle_goes_on_with_the_notes(
    settings: Settings, robot: RobotDescription, recording: RecordingMemory
) -> None:
    first = CycleRecorder(recording)
    rig = Rig(settings, robot)
    try:
        safety = rig.loop.controller.safety
        for number, reason in enumerate(["one", "two"], start=1):
            first.heed(safety, reason, 0, number, number)
        CycleRecorder(recording).heed(safety, "three", 3, 3, 3)
        notes = recording.notes.read(1, 10)
        assert [(int(note["number"]), text(note["reason"])) for note in notes] == [
            (1, "one"),
            (2, "two"),
            (3, "three"),
        ]
    finally:
        rig.close()


POSITION = next(field for field in RECORDED if field.name == "position")


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ((replace(POSITION, recorded="f2"),), "position of the state is f8, not recorded as f2"),
        ((POSITION,) * 65, "65 fields of the state are recorded, allowed: 64"),
    ],
)
def test_a_recorder_does_not_start_with_fields_that_it_cannot_copy(
    monkeypatch: pytest.MonkeyPatch,
    recording: RecordingMemory,
    fields: tuple[StateField, ...],
    said: str,
) -> None:
    monkeypatch.setattr(rtloop.recording, "RECORDED", fields)
    with pytest.raises(LayoutError, match=said):
        CycleRecorder(recording)


def test_the_history_of_seven_joints_holds_the_default_time(settings: Settings) -> None:
    """Wider records shorten the longest history without an error."""
    assert history_places(7, 0.001, settings.recording.ring_s) == 120_000


def test_the_memory_that_a_robot_needs_is_bounded(robot: RobotDescription) -> None:
    name = unique_name()
    made = RecordingMemory.create(name, robot.limits.dof, 0.0005, 600.0, robot.limits.names)
    try:
        assert made.path.stat().st_size < 62_000_000
        assert made.history is not None
        assert made.history.capacity < 600.0 / 0.0005
    finally:
        made.unlink()


@pytest.mark.parametrize(
    ("at", "written", "said"),
    [(0, b"x", "not the recording"), (8, b"\x63", "layout version 99"), (40, b"x", "damaged")],
)
def test_another_file_is_refused(recording: RecordingMemory, at: int, written: bytes, said: str) -> None:
    with recording.path.open("r+b") as file:
        file.seek(at)
        file.write(written)
    with pytest.raises(LayoutError, match=said):
        RecordingMemory.attach(recording.robot, history=True)
