"""A robot's shared memory: who may map it, and what a wrong file gets. Oracle: the kernel's file locks,
held by real processes that are really killed."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import threading
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from cobot_run import unique_name
from hypothesis import given
from hypothesis import strategies as st

from cobot.errors import ConflictError, InputError, LayoutError, SharedMemoryError, UnavailableError
from cobot.ipc.layout import HEADER, POINTS, RING
from cobot.ipc.memory_file import robots_running
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import MemoryRole, RobotMemory, encoded
from cobot.ipc.state_fields import LAYOUT_VERSION
from cobot.trajectory import from_hermite

DOF, PERIOD_S, CAPACITY = 7, 0.001, 50

HOLDER = """
import sys
from cobot.ipc.shm import MemoryRole, RobotMemory
robot, role = sys.argv[1:]
if role == "SUPERVISOR":
    memory = RobotMemory.create(robot, 7, 0.001, 50)
    memory.head.data["id"] = 77
    memory.head.publish()
else:
    memory = RobotMemory.attach(robot, MemoryRole[role])
print("held", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def robot() -> Iterator[str]:
    name = unique_name()
    yield name
    Path(f"/dev/shm/cobot-{name}").unlink(missing_ok=True)


@pytest.fixture
def holding(robot: str) -> Iterator[Callable[[MemoryRole], subprocess.Popen[str]]]:
    """Start a process that holds a role of the robot."""
    holders: list[subprocess.Popen[str]] = []

    def start(role: MemoryRole) -> subprocess.Popen[str]:
        arguments = [sys.executable, "-c", HOLDER, robot, role.name]
        holder = subprocess.Popen(arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        holders.append(holder)
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        return holder

    yield start
    for holder in holders:
        holder.kill()
        holder.communicate()


def create(robot: str) -> RobotMemory:
    return RobotMemory.create(robot, DOF, PERIOD_S, CAPACITY)


def changed(robot: str, place: int, raw: bytes) -> None:
    with Path(f"/dev/shm/cobot-{robot}").open("r+b") as file:
        file.seek(place)
        file.write(raw)


def test_robots_that_run_are_named_and_nothing_else_of_theirs(
    robot: str, holding: Callable[[MemoryRole], subprocess.Popen[str]]
) -> None:
    def of_this_one() -> list[str]:
        return [name for name in robots_running() if name.startswith(robot)]

    holder = holding(MemoryRole.SUPERVISOR)
    ring = Path(f"/dev/shm/cobot-{robot}.ring")
    ring.touch()
    try:
        assert of_this_one() == [robot]
        holder.kill()
        holder.wait()
        assert of_this_one() == []
    finally:
        ring.unlink()


def test_who_asks_what_runs_keeps_its_own_locks(
    robot: str, holding: Callable[[MemoryRole], subprocess.Popen[str]]
) -> None:
    supervisor = create(robot)
    assert robot in robots_running()
    with pytest.raises(AssertionError):  # the other process says why on its stderr
        holding(MemoryRole.SUPERVISOR)
    supervisor.close()
    holding(MemoryRole.SUPERVISOR)


def test_every_role_sees_what_the_others_write_and_no_block_overlaps_another(robot: str) -> None:
    supervisor = create(robot)
    rtloop, service = (
        RobotMemory.attach(robot, MemoryRole.RTLOOP),
        RobotMemory.attach(robot, MemoryRole.SERVICE),
    )
    assert (rtloop.dof, rtloop.period_s, rtloop.created_ns) == (DOF, PERIOD_S, supervisor.created_ns)

    def blocks(memory: RobotMemory) -> list:
        single = [value for value in vars(memory).values() if isinstance(value, Block)]
        return [*single, *memory.acks, *memory.commands, *(slot.head for slot in memory.slots)]

    random = np.random.default_rng(20261121)
    written = []
    for block in blocks(rtloop):
        block.buffer[:] = random.integers(0, 256, block.data.dtype.itemsize)
        written.append(block.buffer.copy())
        block.publish()
    for slot in rtloop.slots:
        slot.breakpoints_s[:] = 1.5
        slot.coefficients[:] = 2.5
    for block, expected in zip(blocks(service), written, strict=True):
        block.read()
        assert np.array_equal(block.buffer, expected), block.name
    for slot in service.slots:
        assert (slot.breakpoints_s == 1.5).all()
        assert (slot.coefficients == 2.5).all()


def test_no_two_blocks_share_a_cache_line(robot: str) -> None:
    """libpyflexiv's suite CacheLineAlign; 64 bytes on every computer that this runs on."""
    memory = create(robot)
    blocks = [value for value in vars(memory).values() if isinstance(value, Block)]
    blocks += [*memory.acks, *memory.commands, *memory.points]
    whole = np.frombuffer(memory._map, np.uint8).ctypes.data
    offsets = [np.frombuffer(block._head, np.uint8).ctypes.data - whole for block in blocks]
    assert len(blocks) == 2 * RING + 20 + POINTS
    assert all(offset % 64 == 0 for offset in offsets)
    assert len(set(offsets)) == len(offsets)


def test_a_trajectory_arrives_as_it_was_with_its_checksum(robot: str) -> None:
    writer = create(robot)
    reader = RobotMemory.attach(robot, MemoryRole.READER)
    values = np.random.default_rng(1).uniform(-1.0, 1.0, (3, 9, DOF))
    motion = from_hermite(np.linspace(0.0, 2.0, 9), *values)
    writer.slots[1].write(42, motion)
    head = reader.slots[1].head.read()
    assert (head["motion_id"], head["segments"]) == (42, 8)
    times, coefficients = reader.slots[1].breakpoints_s[:9], reader.slots[1].coefficients[:8]
    assert np.array_equal(times, motion.breakpoints_s)
    assert np.array_equal(coefficients, motion.coefficients)
    assert head["checksum"] == zlib.crc32(times.tobytes() + coefficients.tobytes())
    assert not reader.slots[0].coefficients.any()


def test_a_trajectory_that_does_not_fit_is_refused(robot: str) -> None:
    slot = create(robot).slots[0]
    times = np.arange(CAPACITY + 2.0)
    long = from_hermite(times, *np.zeros((3, len(times), DOF)))
    with pytest.raises(
        InputError, match=r"the motion has 51 segments, allowed: 50 \(rt\.trajectory_capacity\)"
    ):
        slot.write(1, long)
    with pytest.raises(SharedMemoryError, match="the motion has 6 joints, but the robot has 7"):
        slot.write(1, from_hermite(times[:3], *np.zeros((3, 3, DOF - 1))))
    assert slot.head.sequence == 0


def test_a_second_supervisor_is_refused_with_the_pid_of_the_first_until_that_is_dead(
    robot: str, holding: Callable[[MemoryRole], subprocess.Popen[str]]
) -> None:
    first = holding(MemoryRole.SUPERVISOR)
    with pytest.raises(
        ConflictError, match=rf"robot '{robot}' is in use: pid {first.pid} runs as its supervisor"
    ):
        create(robot)
    assert RobotMemory.attach(robot, MemoryRole.READER).head.read()["id"] == 77
    first.kill()
    first.wait()
    assert create(robot).head.read()["id"] == 0


@pytest.mark.parametrize("role", [MemoryRole.RTLOOP, MemoryRole.SERVICE])
def test_a_role_is_taken_once_and_free_when_its_process_is_killed(
    robot: str, holding: Callable[[MemoryRole], subprocess.Popen[str]], role: MemoryRole
) -> None:
    memory = create(robot)
    holder = holding(role)
    with pytest.raises(ConflictError, match=f"pid {holder.pid} runs as its {role.name.lower()}"):
        RobotMemory.attach(robot, role)
    RobotMemory.attach(robot, MemoryRole.READER)
    memory.close()
    # Its supervisor is gone, but it still moves the arm or serves it.
    with pytest.raises(ConflictError, match=f"pid {holder.pid} runs as its {role.name.lower()}"):
        create(robot)
    holder.kill()
    holder.wait()
    create(robot)
    RobotMemory.attach(robot, role)


def test_a_robot_that_does_not_run_is_named(robot: str) -> None:
    with pytest.raises(UnavailableError, match=f"robot '{robot}' is not running: there is no /dev/shm/cobot"):
        RobotMemory.attach(robot, MemoryRole.READER)


@pytest.mark.parametrize(
    ("place", "raw", "message"),
    [
        (0, b"something else", "is not the shared memory of a robot"),
        (
            8,
            (LAYOUT_VERSION + 1).to_bytes(4, sys.byteorder),
            f"has layout version {LAYOUT_VERSION + 1}, but this program has {LAYOUT_VERSION}; stop the cobot",
        ),
        (16, (10**6).to_bytes(4, sys.byteorder), "is shorter than its header states"),
    ],
)
def test_a_file_of_another_kind_is_refused(robot: str, place: int, raw: bytes, message: str) -> None:
    create(robot)
    changed(robot, place, raw)
    with pytest.raises(LayoutError, match=f"/dev/shm/cobot-{robot}: {message}"):
        RobotMemory.attach(robot, MemoryRole.READER)


@pytest.mark.parametrize("raw", [b"", b"COBOT", b"\xff" * 5000])
def test_a_file_that_somebody_else_made_is_refused_and_replaced_by_a_supervisor(
    robot: str, raw: bytes
) -> None:
    Path(f"/dev/shm/cobot-{robot}").write_bytes(raw)
    with pytest.raises(LayoutError, match="is not the shared memory of a robot"):
        RobotMemory.attach(robot, MemoryRole.READER)
    create(robot)
    assert RobotMemory.attach(robot, MemoryRole.READER).state.sequence == 0


def test_a_full_dev_shm_is_said_at_the_start_and_leaves_no_file(
    robot: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SharedMemoryError, match=r"cannot allocate \d+ bytes: No space left on device"):
        create(robot)
    assert not Path(f"/dev/shm/cobot-{robot}").exists()


def test_the_error_of_a_full_dev_shm_says_what_to_do(robot: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(SharedMemoryError, match=r"make room there, .*--shm-size.*trajectory_capacity"):
        create(robot)


def test_who_still_reads_what_a_killed_run_left_is_not_harmed_by_the_next(robot: str) -> None:
    """A mapping of a file that is cut off is SIGBUS for who looks into it: here, for the test itself."""
    left = create(robot)
    left.head.data["id"] = 5
    left.head.publish()
    reader = RobotMemory.attach(robot, MemoryRole.READER)
    create(robot)
    assert reader.head.read()["id"] == 5
    assert reader.slots[1].coefficients[-1].sum() == 0.0
    assert RobotMemory.attach(robot, MemoryRole.READER).head.read()["id"] == 0


def test_of_many_supervisors_that_take_over_what_a_killed_run_left_one_succeeds(robot: str) -> None:
    create(robot).close()
    others = [
        subprocess.Popen(
            [sys.executable, "-c", HOLDER, robot, "SUPERVISOR"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(6)
    ]
    said = []
    for other in others:
        assert other.stdout is not None
        said.append(other.stdout.readline())
    outputs = [other.communicate()[1] for other in others]
    assert sorted(said) == [""] * 5 + ["held\n"]
    assert sum("is in use: pid" in output for output in outputs) == 5


def test_a_link_in_the_place_of_the_file_is_refused_and_not_followed(robot: str) -> None:
    path = Path(f"/dev/shm/cobot-{robot}")
    path.symlink_to("/dev/shm/nothing")
    try:
        with pytest.raises(SharedMemoryError, match="Too many levels of symbolic links"):
            create(robot)
    finally:
        path.unlink()


def test_every_page_is_there_from_the_beginning(robot: str) -> None:
    """A page that had to be found when it is written first could not be, and its writer would get SIGBUS."""
    create(robot)
    about = Path(f"/dev/shm/cobot-{robot}").stat()
    assert about.st_blocks * 512 >= about.st_size


@pytest.mark.parametrize("place", range(0, 300, 13))
def test_a_spoilt_header_is_found_whatever_is_spoilt(robot: str, place: int) -> None:
    supervisor = create(robot)
    known = RobotMemory.attach(robot, MemoryRole.READER)
    before = Path(f"/dev/shm/cobot-{robot}").read_bytes()[:4096]
    changed(robot, place, bytes([before[place] ^ 0x15]))
    if place < HEADER.itemsize:
        with pytest.raises(LayoutError):
            RobotMemory.attach(robot, MemoryRole.READER)
    assert supervisor.mend_header()
    assert not supervisor.mend_header()
    assert Path(f"/dev/shm/cobot-{robot}").read_bytes()[:4096] == before
    assert RobotMemory.attach(robot, MemoryRole.READER).dof == known.dof == DOF


def test_random_headers_are_refused_in_words(robot: str) -> None:
    """Numbers of joints that no array could hold among them, below a head that is as it should be."""
    supervisor = create(robot)
    random = np.random.default_rng(3)
    for _ in range(200):
        changed(robot, 12, random.bytes(HEADER.itemsize - 12))
        with pytest.raises(LayoutError):
            RobotMemory.attach(robot, MemoryRole.READER)
    assert supervisor.mend_header()
    RobotMemory.attach(robot, MemoryRole.READER)


def test_who_comes_while_the_header_is_spoilt_waits_for_the_supervisor(
    robot: str, holding: Callable[[MemoryRole], subprocess.Popen[str]]
) -> None:
    """It lives in another process, and has mended it in a moment."""
    holding(MemoryRole.SUPERVISOR)
    known = Path(f"/dev/shm/cobot-{robot}").read_bytes()[:4096]
    changed(robot, 0, bytes(4096))
    mending = threading.Timer(0.2, changed, (robot, 0, known))
    mending.start()
    assert RobotMemory.attach(robot, MemoryRole.READER).dof == DOF
    mending.join()


def test_only_its_owner_may_read_the_file(robot: str) -> None:
    create(robot)
    assert Path(f"/dev/shm/cobot-{robot}").stat().st_mode & 0o777 == 0o600


def test_an_unlinked_memory_is_gone_for_others_and_works_for_who_has_it(robot: str) -> None:
    writer, reader = create(robot), RobotMemory.attach(robot, MemoryRole.READER)
    writer.unlink()
    writer.unlink()
    with pytest.raises(UnavailableError):
        RobotMemory.attach(robot, MemoryRole.READER)
    writer.heartbeat.data["pid"] = 5
    writer.heartbeat.publish()
    assert reader.heartbeat.read()["pid"] == 5


@given(message=st.text(), size=st.integers(0, 40))
def test_a_message_is_cut_between_characters(message: str, size: int) -> None:
    raw = encoded(message, size)
    assert len(raw) <= size
    assert message.startswith(raw.decode("utf-8"))
    assert len(message.encode()) > size or raw == message.encode()


def test_closing_one_of_two_memories_in_a_process_leaves_the_others_roles(robot: str) -> None:
    supervisor = create(robot)
    first, second = RobotMemory.attach(robot, MemoryRole.READER), RobotMemory.attach(robot, MemoryRole.READER)
    first.take(MemoryRole.STREAM)
    second.close()
    other = subprocess.run([sys.executable, "-c", HOLDER, robot, "STREAM"], capture_output=True, text=True)
    assert f"pid {os.getpid()} runs as its stream" in other.stderr
    first.close()
    supervisor.close()


ADDER = """
import sys
from cobot.ipc.shm import MemoryRole, RobotMemory
memory = RobotMemory.attach(sys.argv[1], MemoryRole.READER)
for _ in range(50_000):
    memory.outside_stops.add()
"""


def test_of_what_several_processes_add_to_a_counter_at_the_same_time_nothing_is_lost(robot: str) -> None:
    memory = create(robot)
    adders = [subprocess.Popen([sys.executable, "-c", ADDER, robot]) for _ in range(3)]
    assert [adder.wait(60.0) for adder in adders] == [0, 0, 0]
    assert (memory.outside_stops.value, memory.outside_estops.value) == (150_000, 0)
