"""Runs a command on a computer that pauses: `python pausing_computer.py [--busy N] COMMAND ...`.

All processes of the command stand still together for 50 ms, at random moments, as on a virtual machine that
its host keeps waiting; `--busy` has so many loops compete with it for the processors. A test that passes on a
quiet computer and not so depends on luck. Processes that a test has stopped itself stay as they are.
"""

from __future__ import annotations

import argparse
import contextlib
import random
import subprocess
import sys
import time

import psutil

PAUSE_S = 0.05
BETWEEN_S = (0.2, 2.0)


def pause(family: list[psutil.Process]) -> None:
    """Have them all stand still for a moment."""
    paused = []
    for process in family:
        with contextlib.suppress(psutil.Error):
            if process.status() != psutil.STATUS_STOPPED:
                process.suspend()
                paused.append(process)
    time.sleep(PAUSE_S)
    for process in paused:
        with contextlib.suppress(psutil.Error):
            process.resume()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--busy", type=int, default=0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("command", nargs=argparse.REMAINDER)
    arguments = parser.parse_args()
    moments = random.Random(arguments.seed)
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(arguments.busy)]
    try:
        command = psutil.Popen(arguments.command)
        while command.poll() is None:
            time.sleep(moments.uniform(*BETWEEN_S))
            with contextlib.suppress(psutil.Error):
                pause([*command.children(recursive=True), command])
        return int(command.returncode)
    finally:
        for loop in busy:
            loop.kill()
            loop.wait()


if __name__ == "__main__":
    sys.exit(main())
