"""Shared memory that one side writes, and two readers read that have to agree."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from cobot_run import unique_name

from cobot.ipc.shm import MemoryRole, RobotMemory

DOF = 7


@pytest.fixture
def memories() -> Iterator[list[RobotMemory]]:
    """One file, mapped three times: for a writer, for compiled code and for its oracle."""
    robot = unique_name()
    memories = [RobotMemory.create(robot, DOF, 1e-3, 2)]
    try:
        memories += [RobotMemory.attach(robot, MemoryRole.READER) for _ in range(2)]
        yield memories
    finally:
        memories[0].unlink()
        for memory in memories:
            memory.close()
