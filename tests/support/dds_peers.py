"""What tests against foreign DDS stacks share: programs in C++, and domains of their own."""

from __future__ import annotations

import fcntl
import hashlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

DOMAINS = range(100, 200)


def scratch_folder() -> Path:
    """What is built for tests stays here for the next run."""
    folder = Path(tempfile.gettempdir()) / f"cobot-peers-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    return folder


def built(source: Path) -> Path:
    """A program on Fast DDS, compiled; anew when its source has changed. Without Fast DDS: skips the test.

    Raises:
        subprocess.CalledProcessError: the compiler refuses.
    """
    if shutil.which("g++") is None or not Path("/usr/include/fastdds").is_dir():
        pytest.skip("needs Fast DDS and a compiler: apt-get install libfastrtps-dev g++")
    folder = scratch_folder()
    made = folder / f"{source.stem}-{hashlib.sha256(source.read_bytes()).hexdigest()[:16]}"
    with (folder / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            partial = made.with_suffix(".partial")
            command = ["g++", "-std=c++17", "-O0", "-o", str(partial), str(source), "-lfastrtps", "-lfastcdr"]
            subprocess.run(command, check=True)
            partial.rename(made)
    return made


@contextmanager
def own_domain() -> Iterator[int]:
    """A domain of DDS that no other test on this computer uses meanwhile."""
    for offset in range(len(DOMAINS)):
        domain = DOMAINS[(os.getpid() + offset) % len(DOMAINS)]
        with (scratch_folder() / f"domain-{domain}").open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                continue
            yield domain
            return
    raise AssertionError(f"all domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use")
