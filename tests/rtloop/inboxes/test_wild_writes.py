"""Random bytes in every block while compiled code reads: it counts and goes on.

Oracle: the exit status of the process that reads.
"""

from __future__ import annotations

import subprocess
import sys
import time

import pytest
from cobot_run import HELPER_ENVIRONMENT, unique_name
from wild_writer import READS, all_blocks

from cobot.ipc.shm import MemoryRole, RobotMemory

LIMIT_S = 240.0


@pytest.mark.parametrize("dof", [1, 7, 16])
def test_no_bytes_in_shared_memory_can_crash_what_reads_them(dof: int) -> None:
    memory = RobotMemory.create(unique_name(), dof, 1e-3, 2)
    command = [sys.executable, "-P", "-m", "wild_writer", memory.robot]
    writer = subprocess.Popen([*command, "write"], env=HELPER_ENVIRONMENT)
    try:
        begun_s = time.monotonic()
        blocks = all_blocks(RobotMemory.attach(memory.robot, MemoryRole.READER))
        while not all(block.sequence for block in blocks):
            assert writer.poll() is None, "the writer has ended"
            assert time.monotonic() - begun_s < LIMIT_S, "the writer has reached every block"
            time.sleep(0.01)
        reader = subprocess.run(
            [*command, "read"],
            env=HELPER_ENVIRONMENT,
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT_S,
        )
        assert reader.returncode == 0, reader.stderr
        accepted, torn = map(int, reader.stdout.split())
        assert accepted + torn >= READS
        assert accepted > READS // 10
        assert torn > READS // 10
        assert writer.poll() is None
    finally:
        writer.kill()
        writer.wait()
        memory.unlink()
        memory.close()
