"""A running `cobot`, and the content of its shared memory."""

from __future__ import annotations

import contextlib
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from certificates import certificate
from cobot_run import Run

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.client.tls import tls_context
from cobot.ipc.shm import MemoryRole, RobotMemory


class _Narrow(Run):
    def command(self) -> list[str]:
        return ["sh", "-c", 'ulimit -n 256; exec "$@"', "sh", *super().command()]


@contextlib.contextmanager
def service(
    clock: str = "realtime", *, tokens: int = 0, tls: bool = False, narrow: bool = False
) -> Iterator[Run]:
    """Context manager: `cobot run` on a free port, with its own robot.

    Args:
        tokens: so many there are; with any it asks for one, and its own requests show it.
        narrow: its processes may have 256 descriptors each.
        tls: with the certificate service.pem beside its settings.
    """
    with tempfile.TemporaryDirectory(prefix="cobot-bench-") as folder:
        web = ""
        asking: dict[str, Any] = {}
        if tokens:
            file = TokenFile(Path(folder) / "tokens.json")
            made = [file.create(f"number-{number}", Role.OBSERVER) for number in range(tokens)]
            web = ", authentication: required, tokens: tokens.json"
            asking = {"headers": {"Authorization": f"Bearer {made[0]}"}}
        if tls:
            trusted = certificate(Path(folder), "service")
            web += f", tls_certificate: {trusted.name}, tls_key: service.key"
            asking["verify"] = tls_context(trusted)
        run = (_Narrow if narrow else Run)(Path(folder), clock, web=web, asking=asking)
        try:
            run.until(run.healthy)
            yield run
        finally:
            run.end()


@contextlib.contextmanager
def background(module: str, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Context manager: a Python module as a process in its own session, like the processes of the service."""
    process = subprocess.Popen(
        [sys.executable, "-m", module, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,
    )
    try:
        yield process
    finally:
        process.terminate()
        process.wait()


def reader(run: Run) -> RobotMemory:
    """The robot's shared memory, opened for reading."""
    return RobotMemory.attach(run.memory.name.removeprefix("cobot-"), MemoryRole.READER)


def histograms(memory: RobotMemory) -> np.ndarray:
    """The counts of rtloop so far, shape (phases, buckets)."""
    return memory.statistics.read()["histogram"].astype(np.int64)


def from_histogram(counts: np.ndarray) -> tuple[float, float, float]:
    """p50, p99 and p99.9 in µs. The last bucket means "this value or more"."""
    total = np.cumsum(counts)
    p50, p99, p999 = (int(np.searchsorted(total, share * total[-1])) for share in (0.5, 0.99, 0.999))
    return float(p50), float(p99), float(p999)
