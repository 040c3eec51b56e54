"""What the arm does when something breaks: the device, the memory, the client; stepped on the virtual clock.

Oracle: `faults.Record`, which reads the state block as anybody can, and compares numpy's finite differences
of what was commanded in consecutive cycles with joint_limits.yaml.
"""

from __future__ import annotations

import datetime
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from faults import BLOCKS, KINDS, Task, WatchedRig, spoil
from rig import Rig
from thorough import few

from benchmarks.soak import Soak
from cobot.config import Settings
from cobot.errors import SharedMemoryError
from cobot.ipc import memory_file
from cobot.ipc.layout import RING, Command, Interpolation, Intervention
from cobot.ipc.shm import RobotMemory
from cobot.ipc.stream_writer import StreamWriter
from cobot.robot.description import RobotDescription
from cobot.types import Array, LoopMode
from rtloop.backends.mujoco import MujocoBackend
from rtloop.modes import STREAMING
from rtloop.streaming import collision_monitor

UNDER_WAY = 500
BOTH = KINDS[:2]


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription) -> Iterator[WatchedRig]:
    made = WatchedRig(settings, robot)
    yield made
    made.close()


def require_recovery(rig: WatchedRig, kind: str) -> None:
    """All limits were kept, and the same can be done again, to its end, without a restart."""
    if rig.mode in STREAMING:
        rig.end_stream()
    rig.run()
    if rig.mode in (LoopMode.ESTOP, LoopMode.FAULT):
        assert rig.reset() == ""
    assert rig.mode is LoopMode.HOLD
    again = Task(rig, kind)
    again.step(UNDER_WAY)
    assert again.running, rig.reason
    assert rig.record.moved_rad(UNDER_WAY) > 0.01
    again.end()
    assert rig.mode is LoopMode.HOLD
    assert rig.record.violations() == []
    assert rig.record.fastest() < 1.1


# The device

Break = Callable[[MujocoBackend], None]


def set_to(name: str, value: object) -> Break:
    return lambda device: setattr(device, name, value)


def jump(by: float) -> Break:
    def break_it(device: MujocoBackend) -> None:
        device.jump[3] = by

    return break_it


DEVICE_FAULTS: dict[str, tuple[Break, Break, str]] = {
    "read": (set_to("fail_read", "no answer"), set_to("fail_read", ""), "reading from the robot failed"),
    "write": (set_to("fail_write", "no answer"), set_to("fail_write", ""), "writing to the robot failed"),
    "stale": (set_to("stale", True), set_to("stale", False), "has reported the same values in 20 cycles"),
    "sensor": (set_to("not_finite", True), set_to("not_finite", False), "a value that is not finite"),
    "drive": (set_to("drive_fault", "drive 3 hot"), set_to("drive_fault", ""), "drive 3 hot"),
    "jump": (jump(0.05), jump(0.0), "has jumped by 0.050 rad within a cycle"),
    "far jump": (jump(0.6), jump(0.0), "joint4 is 0."),
}


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("cycles", [1, 700])
@pytest.mark.parametrize("fault", DEVICE_FAULTS)
def test_a_device_that_fails_ends_what_the_arm_does_and_nothing_jumps_afterwards(
    rig: WatchedRig, fault: str, cycles: int, kind: str
) -> None:
    break_it, mend, reason = DEVICE_FAULTS[fault]
    task = Task(rig, kind)
    task.step(UNDER_WAY)
    break_it(rig.simulation)
    task.step(cycles)
    mend(rig.simulation)
    if fault == "stale" and cycles < 20:
        assert task.running, "nobody has noticed"
    else:
        assert rig.mode is LoopMode.FAULT
        assert reason in rig.reason
    require_recovery(rig, kind)


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("fault", ["read", "stale", "sensor", "drive"])
def test_no_reset_while_nobody_knows_where_the_arm_is(rig: WatchedRig, fault: str, kind: str) -> None:
    break_it, mend, _ = DEVICE_FAULTS[fault]
    task = Task(rig, kind)
    task.step(UNDER_WAY)
    break_it(rig.simulation)
    task.step(3000)
    assert rig.reset() != ""
    assert rig.mode is LoopMode.FAULT
    mend(rig.simulation)
    rig.step()
    require_recovery(rig, kind)


def test_an_arm_that_holds_still_is_not_taken_for_a_frozen_one(rig: WatchedRig) -> None:
    rig.simulation.stale = True
    rig.step(500)
    assert rig.mode is LoopMode.HOLD
    assert sum(rig.interventions) == 0


@pytest.mark.parametrize("kind", KINDS)
def test_an_arm_that_takes_no_commands_is_not_pulled_to_where_it_should_have_been(
    rig: WatchedRig, kind: str
) -> None:
    task = Task(rig, kind)
    task.step(UNDER_WAY)
    rig.simulation.fail_write = "no answer"
    there = rig.simulation._data.qpos.copy()
    rig.step(1000)
    assert rig.memory.state.read()["settled"]
    rig.simulation.fail_write = ""
    rig.step(100)
    np.testing.assert_allclose(rig.simulation._data.qpos, there, atol=5e-3)
    require_recovery(rig, kind)


# The computer


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("pause_s", [0.05, 0.2, 2.0])
def test_a_pause_of_the_loop_ends_what_the_arm_does_if_it_is_long(
    rig: WatchedRig, kind: str, pause_s: float
) -> None:
    task = Task(rig, kind)
    task.step(UNDER_WAY)
    rig.step(late_ns=int(pause_s * 1e9))
    if pause_s < rig.settings.rt.pause_to_stop_s:
        assert task.running
    else:
        assert rig.mode is LoopMode.STOPPING
        assert rig.reason.startswith(f"a cycle began {pause_s:.2f} s late")
        assert rig.interventions[Intervention.OVERRUN] == 1
    require_recovery(rig, kind)


def commanded_under(settings: Settings, robot: RobotDescription, kind: str) -> Array:
    rig = WatchedRig(settings, robot)
    try:
        task = Task(rig, kind)
        task.step(UNDER_WAY)
        return np.array(rig.commanded)
    finally:
        rig.close()


@pytest.mark.parametrize("kind", KINDS)
def test_the_clock_on_the_wall_may_jump(
    settings: Settings, robot: RobotDescription, kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = commanded_under(settings, robot, kind)
    random = np.random.default_rng(1)

    def jumping_ns() -> int:
        return int(random.integers(0, 2**62))

    class Wild(datetime.datetime):
        @classmethod
        def now(cls, tz: datetime.tzinfo | None = None) -> Wild:
            return cls(int(random.integers(1, 9999)), 1, 1, tzinfo=tz)

    monkeypatch.setattr(time, "time_ns", jumping_ns)
    monkeypatch.setattr(time, "time", lambda: jumping_ns() * 1e-9)
    monkeypatch.setattr(datetime, "datetime", Wild)
    np.testing.assert_array_equal(commanded_under(settings, robot, kind), expected)


def test_memory_that_was_made_needs_no_more_room(rig: WatchedRig) -> None:
    """Each page is there (stat's blocks are of 512 bytes): a /dev/shm that is full later hits no motion."""
    stat = rig.memory.path.stat()
    assert stat.st_blocks * 512 >= stat.st_size > 0


def test_a_shared_memory_without_room_is_refused_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(memory_file, "FOLDER", tmp_path)
    with pytest.raises(SharedMemoryError, match="cannot allocate"):
        RobotMemory.create("huge", 7, 0.001, 10**12)  # more than any disk holds
    assert list(tmp_path.iterdir()) == []


# The memory


@pytest.mark.parametrize("kind", BOTH)
@pytest.mark.parametrize("block", BLOCKS)
def test_a_writer_gone_wild_does_not_harm_the_arm(rig: WatchedRig, block: str, kind: str) -> None:
    random = np.random.default_rng(BLOCKS.index(block))
    task = Task(rig, kind)
    task.step(UNDER_WAY)
    for _ in range(20):
        spoil(rig.memory, block, random)
        task.step(20)
    assert task.running, rig.reason
    require_recovery(rig, kind)


@pytest.mark.parametrize("block", ["requests", "stream_requests", "session"])
def test_what_is_asked_for_in_a_spoilt_block_still_arrives(rig: WatchedRig, block: str) -> None:
    task = Task(rig, "joint")
    task.step(UNDER_WAY)
    spoil(rig.memory, block, np.random.default_rng(1))
    task.step(20)
    if block == "session":
        rig.end_stream()
    else:
        rig.memory.stream_requests.data["estops"] += 1
        getattr(rig.memory, block).data["estops"] = 1
        getattr(rig.memory, block).publish()
    rig.step()
    assert rig.mode is (LoopMode.STOPPING if block == "session" else LoopMode.ESTOP)


@pytest.mark.parametrize("left", [0x00, 0xFF])
def test_a_session_is_answered_although_the_count_of_sessions_was_lost(rig: WatchedRig, left: int) -> None:
    assert rig.stream() == ""
    wish = rig.memory.session.data.copy()
    rig.end_stream()
    rig.run()
    rig.memory.session._shared[:] = bytes([left]) * len(rig.memory.session._shared)
    writer = StreamWriter(rig.memory)
    number = writer.begin(wish, rig.loop.controller.commands.stops)
    rig.step()
    assert writer.answer(number) == ""


def test_what_robot_this_is_is_written_again(rig: WatchedRig) -> None:
    rig.memory.info.salvage()
    spoil(rig.memory, "info", np.random.default_rng(1))
    assert not rig.memory.info.try_read()
    rig.step(500)
    assert rig.memory.info.try_read()


def test_after_a_spoilt_state_the_next_rtloop_begins_with_an_estop(
    rig: WatchedRig, settings: Settings, robot: RobotDescription
) -> None:
    Task(rig, "motion").step(UNDER_WAY)
    rig.request("stops")
    rig.run()
    spoil(rig.memory, "state", np.random.default_rng(2))
    next_one = WatchedRig(settings, robot, memory=rig._own)
    next_one.step()
    assert next_one.mode is LoopMode.ESTOP
    assert "damaged" in next_one.reason
    assert next_one.reset() == ""
    require_recovery(next_one, "motion")
    next_one.memory.close()


# The client

FIELDS = ("joints", "joint_velocity", "pose", "wrench", "twist", "move_pose", "move_duration_s")


def strange(random: np.random.Generator, usual: Array) -> Array:
    """Numbers near what was there, or far from it, or none at all."""
    shape = np.shape(usual)
    match random.integers(6):
        case 0:
            return usual + random.normal(0.0, 1e-3, shape)
        case 1:
            return usual + random.normal(0.0, 0.1, shape)
        case 2:
            return np.asarray(random.choice([0.0, 1e300, -1e300, 1e-300, 10.0], shape))
        case 3:
            return random.normal(0.0, 1.0, shape)
        case 4:
            return usual
        case _:
            bits = random.integers(0, 2**64, shape, np.uint64)
            return bits.view(np.float64) if shape else np.float64(bits)


@pytest.mark.parametrize("seed", few(range(3)))
@pytest.mark.parametrize("kind", KINDS[1:])
def test_whatever_a_client_streams_the_arm_keeps_its_limits(rig: WatchedRig, kind: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    task = Task(rig, kind, interval=1, interpolation=int(random.integers(4)))
    for _ in range(600):
        if not task.running:
            if rig.mode in (LoopMode.ESTOP, LoopMode.FAULT):
                assert rig.reset() == ""
            rig.run()
            task = Task(rig, kind, interval=1, interpolation=int(random.integers(4)))
        usual = task.target()
        wish = {"feed_forward": random.integers(2), **usual}
        for name in random.choice(FIELDS, 2, replace=False):
            near = usual.get(name, rig.memory.setpoint.data[name])
            wish[str(name)] = strange(random, np.asarray(near, np.float64))
        if random.random() < 0.1:
            wish["move"] = int(random.integers(2**63))
        rig.aim(**wish)
        task.step(int(random.integers(1, 5)))
    task.end()
    assert rig.record.violations() == []


@pytest.mark.parametrize("seed", [4, 10, 16, 20, 25, 36, 45, 56])
def test_no_stream_leads_beyond_a_position_limit(
    settings: Settings, robot: RobotDescription, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Swings and noise across the limits of joints that start near them."""
    # Near its limits this arm is near itself too: the monitor gets nothing to look at.
    monkeypatch.setattr(collision_monitor, "geom_pairs", lambda _: [])
    random, limits = np.random.default_rng(seed), robot.limits
    side, near = random.choice([-1, 1], 7), random.random(7) < 0.6
    edge = np.where(side > 0, limits.max_position, limits.min_position)
    home = np.array(robot.positions["home"].joints)
    start = np.where(near, edge - side * random.uniform(0.0, 0.3, 7), home)
    rig = Rig(settings, robot, start=start)
    every = int(random.choice([1, 2, 5, 10, 20, 33, 100]))
    assert rig.stream(interpolation=int(random.choice(list(Interpolation))), decimation=every) == ""
    size, rate_hz = random.uniform(0.0, 0.5, 7), random.uniform(0.1, 1.5, 7)
    noise = random.choice([0.0, 0.003, 0.02])
    for cycle in range(3000):
        if cycle % every == 0:
            swing = size * np.sin(2.0 * np.pi * rate_hz * cycle * 1e-3)
            rig.aim(joints=start + swing + random.normal(0.0, noise, 7))
        rig.step()
    positions = np.array(rig.commanded)
    assert (positions <= limits.max_position + 1.1e-5).all()
    assert (positions >= limits.min_position - 1.1e-5).all()
    for share in rig.rates():
        assert share.max() <= 1.011
    rig.close()


@pytest.mark.parametrize("kind", KINDS[1:])
def test_ten_times_as_many_setpoints_as_cycles_change_nothing(rig: WatchedRig, kind: str) -> None:
    task = Task(rig, kind, interval=1)
    for _ in range(1500):
        for _ in range(9):
            rig.aim(**task.target())
        task.step()
    assert task.running
    require_recovery(rig, kind)


@pytest.mark.parametrize("kind", BOTH)
def test_a_flood_of_commands_changes_nothing_about_a_motion(rig: WatchedRig, kind: str) -> None:
    task = Task(rig, kind)
    for _ in range(UNDER_WAY):
        for _ in range(10):
            rig.send(Command.START, slot=1, motion_id=99)
        task.step()
    assert task.running
    rig.step(2 * RING)
    require_recovery(rig, kind)


@pytest.mark.parametrize("kind", BOTH)
def test_a_flood_of_stops_is_one_stop(rig: WatchedRig, kind: str) -> None:
    task = Task(rig, kind)
    task.step(UNDER_WAY)
    for _ in range(100):
        for _ in range(10):
            rig.request("stops")
        task.step()
    assert not task.running
    require_recovery(rig, kind)


# Everything at once


@pytest.mark.parametrize("seed", few(range(3)))
def test_twenty_seconds_of_everything_violate_no_limit(
    settings: Settings, robot: RobotDescription, seed: int
) -> None:
    soak = Soak(settings, robot, seed)
    soak.run(20_000)
    assert soak.violations == [], f"seed {seed}"
    soak.close()
