"""What the real-time process asks of Linux. A file stands for the device: it takes one number of 32 bits."""

from __future__ import annotations

import struct
import subprocess
import sys
from pathlib import Path

import pytest

ASKING = """
import sys
from rtloop import realtime
realtime._PM_QOS = sys.argv[1]
print(realtime.prepare(1, None, int(sys.argv[2]) if sys.argv[2:] else None).refused)
"""


def refused(*arguments: str) -> str:
    """What a process was not granted. One of its own: it may get locked memory and SCHED_FIFO."""
    command = [sys.executable, "-c", ASKING, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("latency_us", [0, 20])
def test_the_cores_are_asked_to_sleep_lightly(tmp_path: Path, latency_us: int) -> None:
    device = tmp_path / "cpu_dma_latency"
    device.write_bytes(b"")
    assert "cpu_latency_us" not in refused(str(device), str(latency_us))
    assert struct.unpack("=i", device.read_bytes()) == (latency_us,)


def test_nothing_is_asked_of_them_without_the_setting(tmp_path: Path) -> None:
    device = tmp_path / "cpu_dma_latency"
    device.write_bytes(b"")
    assert "cpu_latency_us" not in refused(str(device))
    assert device.read_bytes() == b""


def test_what_is_not_granted_is_said(tmp_path: Path) -> None:
    device = tmp_path / "none"
    assert f"rt.cpu_latency_us 0: {device}: No such file or directory" in refused(str(device), "0")
