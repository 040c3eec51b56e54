"""`python -m app.services.motion.planning_worker`: a process that computes tasks, one at a time.

It shares only an inherited socket with the service, so it may be killed at any time. Messages are pickles,
each with a header: whether the message is a preparation, and its length. The process first reports that the
robot is loaded. Then it receives functions to call with the robot. It sends an empty message when it begins
each. After a task it sends the answer: whether the function has returned, and its result or error. A
preparation has no answer, only another empty message at its end, so the service need not wait for it before
it sends the next task. A preparation that has failed is repeated before each task; if it fails again, its
error is the answer.
"""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import io
import pickle
import signal
import struct
import sys
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from socket import socket
from typing import Any, BinaryIO

from cobot.launch.process import Niceness, die_with_parent, in_words, set_niceness

HEAD = struct.Struct("=?Q")
BEGUN = HEAD.pack(False, 0)
"""Message that the process sends when it begins a preparation or a task."""
PREPARED = HEAD.pack(True, 0)
"""Message that the process sends at the end of a preparation."""
Task = Callable[[Any], Any]
"""A task of a worker: a picklable function of `cobot.robot.description.RobotDescription`."""


class TooLargeError(Exception):
    """Raised if a message is larger than its limit."""


class _Limited(io.BytesIO):
    """A buffer for at most `limit` bytes."""

    def __init__(self, limit: int) -> None:
        super().__init__()
        self._limit = limit

    def write(self, part: Any) -> int:
        if self.tell() + memoryview(part).nbytes > self._limit:
            raise TooLargeError
        return super().write(part)


def message(content: object, limit: int = sys.maxsize, *, ahead: bool = False) -> bytes:
    """Encode a message as bytes.

    Args:
        limit: maximum number of bytes.
        ahead: whether the message is a preparation.

    Raises:
        TooLargeError: the message is larger than the limit. Encoding stops at the limit.
    """
    packed = _Limited(limit)
    pickle.Pickler(packed, pickle.HIGHEST_PROTOCOL).dump(content)
    return HEAD.pack(ahead, packed.tell()) + packed.getvalue()


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
    # Imported before the process reports that it is ready, because nearly every task needs it.
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
        # imported in advance, because the import takes longer than a search
        if settings.planning.replan_within_s > 0.0:
            retarget.load_search()
    except CobotError as exc:
        with contextlib.suppress(OSError):
            print(exc, flush=True)
        return 2
    gc.freeze()
    gc.enable()
    # not earlier, because this would delay the start of the process on a busy computer
    set_niceness(Niceness.BACKGROUND)
    with socket(fileno=arguments.fd) as connection:
        _work(connection, robot)
    return 0


def _work(connection: socket, robot: Any) -> None:
    connection.sendall(message(None))
    failed: list[bytes] = []  # the newest preparation, if it has failed
    with connection.makefile("rb") as channel:
        while (received := _receive(channel)) is not None:
            is_ahead, packed = received
            connection.sendall(BEGUN)
            if is_ahead:
                failed = [] if _outcome([packed], robot)[0] else [packed]
                connection.sendall(PREPARED)
            else:
                connection.sendall(_answer([*failed, packed], robot))


def _answer(tasks: Sequence[bytes], robot: Any) -> bytes:
    outcome = _outcome(tasks, robot)
    try:
        return message(outcome)
    except Exception as exc:  # noqa: BLE001 - the service decides what becomes of it
        return message((False, exc))


def _outcome(tasks: Sequence[bytes], robot: Any) -> tuple[bool, Any]:
    """Compute tasks in order. Returns whether all have succeeded, and the last result or the first error."""
    found = None
    try:
        for packed in tasks:
            task: Task = pickle.loads(packed)
            found = task(robot)
    except Exception as exc:  # noqa: BLE001 - the service decides what becomes of it
        exc.add_note("".join(traceback.format_tb(exc.__traceback__)))
        return False, exc
    return True, found


def _receive(channel: BinaryIO) -> tuple[bool, bytes] | None:
    """Read the next message. Returns whether it is a preparation, and the message's pickle; None if the
    channel was closed.
    """
    head = channel.read(HEAD.size)
    if len(head) < HEAD.size:
        return None
    is_ahead, size = HEAD.unpack(head)
    packed = channel.read(size)
    return (is_ahead, packed) if len(packed) == size else None


if __name__ == "__main__":
    die_with_parent(signal.SIGKILL)
    # Registered by the parent process. OMPL would report the objects that are not collected as leaks.
    atexit.unregister(gc.freeze)
    set_niceness(Niceness.ORDINARY)  # lower priority than the service, but not yet in the background
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    sys.exit(in_words(main))
