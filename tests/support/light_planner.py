"""`python -m light_planner --fd N`: a planning worker without a robot, which starts in a tenth of the time.

For tests of how workers are started, kept and ended, and of nothing that they compute. What such a worker
can be asked is here as well: it would import no test, which needs all that it does without.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from pathlib import Path
from socket import socket

from app.services.motion.planning_worker import _work
from cobot.launch.process import die_with_parent


def pid(robot: object) -> int:
    return os.getpid()


def sleep_until(robot: object, mark: Path) -> str:
    while not mark.exists():
        time.sleep(0.01)
    return "slept"


def end(robot: object) -> None:
    os.kill(os.getpid(), signal.SIGSEGV)


def end_once(robot: object, mark: Path) -> str:
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "planned"


def note(robot: object, file: Path) -> None:
    with file.open("a", encoding="utf-8") as notes:
        notes.write(f"{os.getpid()}\n")


def main() -> int:
    parser = argparse.ArgumentParser()
    parser.add_argument("--fd", type=int, required=True)
    with socket(fileno=parser.parse_args().fd) as connection:
        _work(connection, None)
    return 0


if __name__ == "__main__":
    die_with_parent(signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(main())
