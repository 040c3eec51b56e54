"""`python -m app.services.motion.planning_worker`: a process that computes one task after the other.

It shares only an inherited socket with the service, so it may be killed at any moment. Messages are pickles,
each preceded by its length in 8 bytes. The process first reports that the robot is loaded. Then it receives
functions of the robot. For each, it sends an empty message when it begins, and then the answer: whether the
function has returned, and its result or its error.
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import pickle
import signal
import struct
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from socket import socket
from typing import Any, BinaryIO

from cobot.launch.process import Niceness, die_with_parent, in_words, set_niceness

LENGTH = struct.Struct("=Q")
Task = Callable[[Any], Any]
"""A task of a worker: a picklable function of `cobot.robot.description.RobotDescription`."""


def message(content: object) -> bytes:
    """Encode a message as bytes."""
    packed = pickle.dumps(content, pickle.HIGHEST_PROTOCOL)
    return LENGTH.pack(len(packed)) + packed


def main() -> int:
    """Process tasks until the service closes the socket. Returns the exit status: 0, or 2 if the robot cannot
    be loaded.
    """
    parser = argparse.ArgumentParser(prog="python -m app.services.motion.planning_worker")
    parser.add_argument("--config", type=Path)
    parser.add_argument("--robot")
    parser.add_argument("--fd", type=int, required=True, help="descriptor of the socket")
    arguments = parser.parse_args()
    gc.disable()  # until all permanent objects exist
    # Nearly every task needs this, and a worker that reports ready must be ready.
    from app.services.motion import planning_tasks  # noqa: F401
    from cobot.config import load_settings
    from cobot.errors import CobotError
    from cobot.logs import start_logging
    from cobot.planners import retarget
    from cobot.planners.blending import prolonged  # noqa: F401
    from cobot.robot.description import load_robot

    try:
        settings = load_settings(arguments.config).of(arguments.robot)
        start_logging("planning", settings.logging)
        robot = load_robot(settings)
        robot.collision.clearance.enclose()
        if settings.planning.replan_within_s > 0.0:  # importing takes longer than a search
            retarget.load_search()
    except CobotError as exc:
        with contextlib.suppress(OSError):
            print(exc, flush=True)
        return 2
    gc.freeze()
    gc.enable()
    # not earlier, because a busy computer would delay the start of this process
    set_niceness(Niceness.BACKGROUND)
    with socket(fileno=arguments.fd) as connection, connection.makefile("rwb") as channel:
        _work(channel, robot)
    return 0


def _work(channel: Any, robot: Any) -> None:
    _send(channel, message(None))
    while (task := _receive(channel)) is not None:
        _send(channel, LENGTH.pack(0))
        _send(channel, _outcome(task, robot))


def _outcome(packed: bytes, robot: Any) -> bytes:
    try:
        task: Task = pickle.loads(packed)
        return message((True, task(robot)))
    except Exception as exc:  # noqa: BLE001 - the service decides what becomes of it
        exc.add_note("".join(traceback.format_tb(exc.__traceback__)))
        return message((False, exc))


def _send(channel: BinaryIO, content: bytes) -> None:
    channel.write(content)
    channel.flush()


def _receive(channel: BinaryIO) -> bytes | None:
    """Read the pickle of the next message; None if the channel was closed."""
    head = channel.read(LENGTH.size)
    if len(head) < LENGTH.size:
        return None
    size = LENGTH.unpack(head)[0]
    packed = channel.read(size)
    return packed if len(packed) == size else None


if __name__ == "__main__":
    die_with_parent(signal.SIGKILL)
    # The parent process has registered it. OMPL reports objects that are not collected as leaks.
    atexit.unregister(gc.freeze)
    set_niceness(
        Niceness.ORDINARY
    )  # lower priority than the service that starts it, but not yet in the background
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(in_words(main))
