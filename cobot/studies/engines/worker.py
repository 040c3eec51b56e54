"""A worker process of `cobot.studies.engines.local_pool`: it computes one call after the other."""

from __future__ import annotations

import os
import pickle
import signal
import sys
from multiprocessing.connection import Connection
from typing import Any

from cobot.errors import UnavailableError
from cobot.foreign import plain_error
from cobot.launch.process import die_with_parent
from cobot.studies.engines.local_pool import READY


def main() -> None:
    """Serve the connection whose number is the first argument. The second argument is the id of the parent
    process.
    """
    descriptor, parent, niceness = map(int, sys.argv[1:4])
    die_with_parent(signal.SIGKILL)
    if os.getppid() != parent:
        return  # the parent died before the call above
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is meant for the parent, which ends its workers
    os.nice(niceness)
    connection = Connection(descriptor)
    connection.send_bytes(READY)
    while True:
        try:
            content = connection.recv_bytes()
        except EOFError:
            return
        connection.send_bytes(_answer(content))


def _answer(content: bytes) -> bytes:
    try:
        function, arguments, options = pickle.loads(content)
        return pickle.dumps((True, function(*arguments, **options)))
    except BaseException as exc:  # noqa: BLE001 - the caller raises it
        return _as_bytes(exc)


def _as_bytes(exc: BaseException) -> bytes:
    """Pickle an error. If it cannot be restored from its pickle, its text is sent instead."""
    found: Any = exc
    try:
        content = pickle.dumps((False, exc))
        pickle.loads(content)
    except Exception:  # noqa: BLE001 - whatever a foreign class raises
        found = UnavailableError(plain_error(exc))
        return pickle.dumps((False, found))
    return content


if __name__ == "__main__":
    main()
