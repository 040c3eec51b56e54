"""What the recorder writes, and when.

Oracles: the readers of `mcap` and of `rosbags`, the values that the cycles were written with.
"""

from __future__ import annotations

import errno
import json
import os
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S
from mcap.reader import make_reader
from recorded_cycles import Cycles, stepped
from rosbags.highlevel import AnyReader

from cobot.errors import ConflictError, UnavailableError
from cobot.ipc.layout import GripperObject, MotionResult, text
from cobot.ipc.recording_memory import RecordingMemory
from cobot.recorder import files
from cobot.recorder.robot import BATCH, RobotRecorder
from cobot.recording.store import TRIAL_BYTES, RecordingStore
from cobot.types import LoopMode

TOPICS = {"/joint_states", "/commanded", "/wrench", "/cycle", "/events"}


def messages(path: Path) -> dict[str, list[Any]]:
    """By topic, as `rosbags` reads them with what the file itself says of its types."""
    found: dict[str, list[Any]] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    return found


def cycles_in(path: Path) -> list[int]:
    return [message.cycle for message in messages(path)["/cycle"]]


def ask(recorder: RobotRecorder, action: str, **more: object) -> list[str]:
    answer = recorder.ask({"action": action, **more})
    stepped(recorder)
    names = answer.result(timeout=0)["names"]
    assert isinstance(names, list)
    return names


def test_two_readers_find_the_numbers_that_the_cycles_had(cycles: Cycles) -> None:
    recorder = cycles.recorder()
    cycles.write(700)
    cycles.write(300, LoopMode.TRAJECTORY)
    (name,) = ask(recorder, "dump", seconds=0.8)
    path, dof = cycles.folder / name, cycles.dof
    read = messages(path)
    assert set(read) == TOPICS
    assert cycles_in(path) == list(range(201, 1001))
    for index in (0, 333, 799):
        written = cycles.written[200 + index]
        rows = written["measured"][: 5 * dof].reshape(5, dof)
        state, commanded = read["/joint_states"][index], read["/commanded"][index]
        assert list(state.name) == list(cycles.robot.limits.names)
        np.testing.assert_array_equal(state.position, rows[0])
        np.testing.assert_array_equal(state.velocity, rows[1].astype(np.float32))
        np.testing.assert_array_equal(state.effort, rows[2].astype(np.float32))
        np.testing.assert_array_equal(commanded.position, written["command"][0])
        np.testing.assert_array_equal(commanded.velocity, written["command"][1].astype(np.float32))
        np.testing.assert_array_equal(commanded.effort, rows[3].astype(np.float32))
        force, torque = read["/wrench"][index].wrench.force, read["/wrench"][index].wrench.torque
        wrench = written["measured"][5 * dof :][:6].astype(np.float32)
        np.testing.assert_array_equal([force.x, force.y, force.z, torque.x, torque.y, torque.z], wrench)
        cycle = read["/cycle"][index]
        np.testing.assert_array_equal(cycle.external_effort, rows[4].astype(np.float32))
        tcp, at, turn = written["tcp"].astype(np.float32), cycle.tcp.position, cycle.tcp.orientation
        np.testing.assert_array_equal([at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z], tcp)
        times = [cycle.wakeup_ns, cycle.read_ns, cycle.update_ns, cycle.write_ns]
        assert times == written["phases"].tolist()
        assert cycle.robot_time_s == pytest.approx(0.001 * (201 + index))
        assert cycle.mode == (LoopMode.TRAJECTORY if index >= 500 else LoopMode.HOLD)
        assert state.header.frame_id == "base_link"
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        counted = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        assert counted == dict.fromkeys(TOPICS - {"/events"}, 800) | {"/events": 2}
        about = {each.name: each.metadata for each in reader.iter_metadata()}["cobot"]
        assert json.loads(about["joint_names"]) == list(cycles.robot.limits.names)
        assert float(about["period_s"]) == 0.001
        assert about["reason"] == "request"
        stamps = [message.log_time for _, _, message in reader.iter_messages(topics="/cycle")]
    assert np.diff(stamps).tolist() == [1_000_000] * 799


def test_a_robot_with_a_gripper_has_a_topic_for_it_also_after_the_recorder_was_killed(cycles: Cycles) -> None:
    recorder = cycles.recorder()
    (run,) = ask(recorder, "start")
    cycles.write(BATCH)
    stepped(recorder)
    held: dict[str, Any] = {"gripper_width": 0.05, "gripper_commanded_width": 0.04, "gripper_force": 40.0}
    cycles.write(700, gripper_object=GripperObject.HELD_INSIDE, gripper_moving=1, **held)
    stepped(recorder)
    recorder = cycles.recorder()
    stepped(recorder)
    cycles.write(500, gripper_object=GripperObject.LOST, gripper_width=float("nan"))
    (name,) = ask(recorder, "stop")
    assert name.startswith(run)
    grippers = messages(cycles.folder / name)["/gripper"]
    while grippers[0].gripper_object == GripperObject.ABSENT:  # of the batch in which it begins
        grippers.pop(0)
    objects = [each.gripper_object for each in grippers]
    assert objects == [GripperObject.HELD_INSIDE] * 700 + [GripperObject.LOST] * 500
    for field, value in held.items():
        assert getattr(grippers[0], field) == np.float32(value)
    assert (grippers[0].gripper_moving, grippers[-1].gripper_moving) == (True, False)
    assert np.isnan(grippers[-1].gripper_width)
    with (cycles.folder / name).open("rb") as file:
        counted = Counter(
            channel.topic for _, channel, _ in make_reader(file, validate_crcs=True).iter_messages()
        )
    assert counted["/cycle"] == BATCH + 1200
    assert 1200 <= counted["/gripper"] < BATCH + 1200


@pytest.mark.parametrize(("mode", "reason"), [(LoopMode.FAULT, "fault"), (LoopMode.ESTOP, "estop")])
def test_a_latch_leaves_what_was_before_it_and_some_of_what_comes_after(
    cycles: Cycles, mode: LoopMode, reason: str
) -> None:
    recorder = cycles.recorder()
    cycles.write(3000)
    stepped(recorder)
    cycles.write(200, mode, "joint2 is too far away")
    stepped(recorder)
    assert cycles.names() == []
    cycles.write(400, mode, "joint2 is too far away")
    stepped(recorder)
    (name,) = cycles.names()
    assert name.endswith(f"Z-{reason}.mcap")
    path = cycles.folder / name
    assert cycles_in(path) == list(range(3001 - 2000, 3001 + 500 + 1))
    events = [(e.cycle, e.kind, e.mode, e.text) for e in messages(path)["/events"]]
    assert events == [
        (1001, "mode", "HOLD", ""),
        (3001, reason, mode.name, "joint2 is too far away"),
        (3001, "mode", mode.name, "joint2 is too far away"),
    ]
    written = path.stat()
    stepped(recorder)
    cycles.write(700, mode, "joint2 is too far away")
    stepped(recorder)
    assert cycles.names() == [name], "it stays latched, and is news once"
    assert path.stat() == written, "nor is it written again"


def test_motions_and_sessions_are_told_where_they_begin_and_end(cycles: Cycles) -> None:
    recorder = cycles.recorder()
    cycles.write(100, motion_id=6, motion_result=MotionResult.ARRIVED)
    cycles.write(100, LoopMode.TRAJECTORY, motion_id=7, motion_result=MotionResult.RUNNING)
    cycles.write(100, LoopMode.TRAJECTORY, motion_id=8, motion_result=MotionResult.RUNNING)
    cycles.write(100, motion_id=8, motion_result=MotionResult.STOPPED)
    cycles.write(100, LoopMode.CARTESIAN, motion_id=8, motion_result=MotionResult.STOPPED, session=3)
    cycles.write(100, motion_id=8, motion_result=MotionResult.STOPPED)
    (name,) = ask(recorder, "dump", seconds=10.0)
    events = [
        (e.cycle, e.kind, e.text) for e in messages(cycles.folder / name)["/events"] if e.kind != "mode"
    ]
    assert events == [
        (101, "motion", "motion 7 begun"),
        (201, "motion", "motion 8 begun"),
        (301, "motion", "motion 8 stopped on its path"),
        (401, "session", "session 3 begun"),
        (501, "session", "session 3 ended"),
    ]


def test_latches_in_a_row_are_one_recording(cycles: Cycles) -> None:
    recorder = cycles.recorder()
    cycles.write(100)
    cycles.write(300, LoopMode.FAULT, "first")
    stepped(recorder)
    cycles.write(50)
    cycles.write(600, LoopMode.ESTOP, "second")
    stepped(recorder)
    (name,) = cycles.names()
    assert cycles_in(cycles.folder / name) == list(range(1, 451 + 500 + 1))


def test_a_latch_whose_rtloop_dies_is_recorded_as_far_as_there_is_something(
    cycles: Cycles, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = cycles.recorder()
    cycles.write(300)
    cycles.write(20, LoopMode.FAULT, "the last words")
    stepped(recorder)
    monkeypatch.setattr("cobot.recorder.robot.GRACE_S", -1.0)
    stepped(recorder)
    (name,) = cycles.names()
    assert cycles_in(cycles.folder / name) == list(range(1, 321))


def test_a_recorder_that_is_killed_during_a_latch_is_followed_by_one_that_records_it(cycles: Cycles) -> None:
    killed = cycles.recorder()
    cycles.write(1000)
    cycles.write(100, LoopMode.ESTOP, "stop")
    stepped(killed)
    assert list(cycles.folder.glob("*.part")), "it is being written"
    assert RecordingStore(cycles.folder, 10**9).all() == [], "and not offered"
    following = cycles.recorder()
    cycles.write(600, LoopMode.ESTOP, "stop")
    stepped(following)
    (name,) = cycles.names()
    assert cycles_in(cycles.folder / name) == list(range(1, 1502))
    assert not list(cycles.folder.glob("*.part"))


def test_a_continuous_recording_loses_nothing_when_recorder_and_rtloop_are_killed(cycles: Cycles) -> None:
    recorder = cycles.recorder()
    cycles.write(10)
    (run,) = ask(recorder, "start")
    for round_ in range(2):
        cycles.write(1400 + 100 * round_)
        stepped(recorder)
        cycles.write(150)
        recorder = cycles.recorder()  # the one before has no chance to say anything
        cycles.restart_rtloop()
        cycles.write(75)
    with pytest.raises(ConflictError, match="already"):
        ask(recorder, "start")
    (name,) = ask(recorder, "stop")
    assert name.startswith(run)
    assert cycles_in(cycles.folder / name) == list(range(11, cycles.number + 1))
    assert recorder._status["lost"] == 0
    with pytest.raises(ConflictError, match="is not being recorded"):
        ask(recorder, "stop")


def test_a_recorder_that_ends_leaves_its_continuous_recording_to_the_next(cycles: Cycles) -> None:
    cycles.write(5)
    recorder = RobotRecorder(cycles.settings, RecordingMemory.attach(cycles.memory.robot, history=True))
    recorder.start()
    recorder.ask({"action": "start"}).result(WAIT_S)
    cycles.write(400)
    recorder.close()
    following = cycles.recorder()
    cycles.write(100)
    names = ask(following, "stop")
    numbers = [number for name in names for number in cycles_in(cycles.folder / name)]
    assert numbers == list(range(6, 506))


def test_a_recorder_that_comes_too_late_counts_what_it_lost(cycles: Cycles) -> None:
    recorder = cycles.recorder()
    cycles.write(100)
    stepped(recorder)
    capacity = cycles.memory.fresh.capacity
    cycles.write(capacity + 50)
    stepped(recorder)
    assert recorder._status["lost"] == 50


def test_parts_follow_each_other_and_the_oldest_go(cycles: Cycles, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cobot.recorder.writing.GROWTH_BYTES", 50_000)
    recorder = cycles.recorder()
    recorder._store.max_bytes = 1_500_000
    ask(recorder, "start")
    for _ in range(6):
        cycles.write(1200)
        stepped(recorder)
    ask(recorder, "stop")
    recordings = recorder._store.all()
    assert len(recordings) >= 3
    assert sum(each.size for each in recordings) <= 1_500_000
    numbers = [number for each in reversed(recordings) for number in cycles_in(cycles.folder / each.name)]
    assert numbers == list(range(numbers[0], cycles.number + 1))
    assert numbers[0] > 1


class FullDisk:
    """A file of a disk that has room for so many bytes."""

    room = 0

    def __init__(self, file: Any) -> None:
        self._file = file

    def write(self, data: bytes) -> int:
        FullDisk.room -= len(data)
        if FullDisk.room < 0:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return int(self._file.write(data))

    def __enter__(self) -> FullDisk:
        return self

    def __exit__(self, *how: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


@pytest.mark.parametrize("wall_s", [-1e9, 10.0, 2.5e9, 9e9])
def test_a_clock_that_is_set_anywhere_keeps_nothing_from_being_recorded(
    cycles: Cycles, monkeypatch: pytest.MonkeyPatch, wall_s: float
) -> None:
    """ROS counts seconds in 32 bits, MCAP from 1970: the recorder tried for ever. Oracle: both readers."""
    recorder = cycles.recorder()
    cycles.write(1500, LoopMode.FAULT, "in between")
    monkeypatch.setattr("time.time_ns", lambda: int(wall_s * 1e9))
    (name,) = ask(recorder, "dump", seconds=1.0)
    with (cycles.folder / name).open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages("/cycle")]
    assert len(times) == 1000
    stamps = [message.header.stamp for message in messages(cycles.folder / name)["/cycle"]]
    assert [stamp.sec * 10**9 + stamp.nanosec for stamp in stamps] == times


def test_what_cannot_be_put_into_words_keeps_nobody_waiting(
    cycles: Cycles, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = cycles.recorder()
    cycles.write(1500)
    with monkeypatch.context() as broken:
        broken.setattr(files.RecordingFile, "write", lambda *records: 1 // 0)
        with pytest.raises(UnavailableError, match="the recorder failed: integer division"):
            ask(recorder, "dump", seconds=1.0)
        assert list(cycles.folder.iterdir()) == []
    assert ask(recorder, "dump", seconds=1.0)


def test_what_was_asked_for_too_long_ago_is_not_done(cycles: Cycles) -> None:
    """Who asked a recorder that stood still has been told that it did, and asks again."""
    recorder = cycles.recorder()
    cycles.write(1500)
    with pytest.raises(UnavailableError, match=r"the recorder read the request .* after its deadline"):
        ask(recorder, "start", until_ns=time.monotonic_ns())
    assert not recorder._status["recording"]
    assert ask(recorder, "start", until_ns=time.monotonic_ns() + 10**12)


def look_again(recorder: RobotRecorder) -> None:
    """As it does once a second."""
    recorder._listed_s = float("-inf")
    stepped(recorder)


@pytest.mark.parametrize("room", [0, 2000, 300_000])
def test_a_full_disk_is_said_and_over_when_there_is_room(
    cycles: Cycles, monkeypatch: pytest.MonkeyPatch, room: int
) -> None:
    real = Path.open
    recorder = cycles.recorder()
    cycles.write(1500)
    with monkeypatch.context() as full:
        FullDisk.room = room

        def opened(path: Path, *how: Any, **more: Any) -> Any:
            file = real(path, *how, **more)
            return FullDisk(file) if path.suffix == ".part" else file

        full.setattr(Path, "open", opened)
        answers = [recorder.ask({"action": action}) for action in ("dump", "start")]
        stepped(recorder)
        cycles.write(600, LoopMode.FAULT, "in the middle of it")
        stepped(recorder)
        with pytest.raises(UnavailableError, match="a disk is full: make room"):
            answers[0].result(timeout=0)
        assert "a disk is full" in text(recorder._status["problem"])
        if recorder._status["recording"]:  # little of it has reached the disk so far
            with pytest.raises(UnavailableError, match="a disk is full"):
                ask(recorder, "stop")
        assert not recorder._status["recording"]
        FullDisk.room = room
        look_again(recorder)
        assert ("a disk is full" in text(recorder._status["problem"])) == (room < TRIAL_BYTES)
        assert list(cycles.folder.iterdir()) == []
    look_again(recorder)
    assert text(recorder._status["problem"]) == "", "though nobody records anything"
    (name,) = ask(recorder, "dump", seconds=1.0)
    assert len(cycles_in(cycles.folder / name)) == 1000


def test_what_is_written_beyond_the_bound_is_given_up_and_said(
    cycles: Cycles, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = cycles.recorder()
    monkeypatch.setattr("cobot.recorder.writing.GROWTH_BYTES", 50_000)
    recorder._store.max_bytes = 300_000
    cycles.write(2500)
    answer = recorder.ask({"action": "dump", "seconds": 4.0})
    stepped(recorder)
    with pytest.raises(UnavailableError, match=r"recording\.max_mb"):
        answer.result(timeout=0)
    assert cycles.names() == []


def test_a_crash_inside_mcap_s_chunk_keeps_the_chunks_before(cycles: Cycles, tmp_path: Path) -> None:
    recorder = cycles.recorder()
    ask(recorder, "start")
    cycles.write(2500)
    stepped(recorder)
    (part,) = cycles.folder.glob("*.part")
    content = part.read_bytes()
    messages_of, memory = recorder._messages, recorder._memory
    random = np.random.default_rng(9)
    for cut in random.integers(0, len(content), 5).tolist():
        left = tmp_path / "left"
        left.write_bytes(content[:cut])
        made = files.RecordingFile(tmp_path / "made.mcap", memory, messages_of, 0, {})
        last = made.take_over(left)
        made.finish()
        with (tmp_path / "made.mcap").open("rb") as file:
            found = [m.sequence for _, _, m in make_reader(file).iter_messages(topics="/cycle")]
        assert found == list(range(1, last + 1))
