"""Imports what the processes of `cobot run` import, and forks for each start: see `warm_start.py`."""

from __future__ import annotations

import ctypes
import gc
import json
import os
import runpy
import socket
import sys
import time
import warnings
from importlib import import_module
from pathlib import Path
from typing import NoReturn

SUPERVISOR = "cobot.launch.cli", "cobot.launch.backups", "cobot.launch.forked", "cobot.launch.supervisor"
CHILDREN = "app.server", "app.services.motion.planning_blanks", "rtloop.main", "cobot.recorder.process"
MESSAGE_BYTES = 1 << 17
ADOPTED_S = 0.0005


def main(channel: socket.socket) -> None:
    sys.path[0] = str(Path.cwd())  # as with `python -m`
    # `runpy` warns of modules that are imported before they run. All they have done is being imported.
    warnings.filterwarnings("ignore", ".* found in sys.modules after import of package", RuntimeWarning)
    gc.disable()
    for module in (*SUPERVISOR, *CHILDREN):
        import_module(module)
    gc.freeze()
    gc.enable()
    assert len(os.listdir("/proc/self/task")) == 1, "only a process without other threads can fork"
    while True:
        message, received, _, _ = socket.recv_fds(channel, MESSAGE_BYTES, 1)
        if not message:
            return
        if os.fork() == 0:
            between = os.getpid()
            if os.fork():
                os._exit(0)
            while os.getppid() == between:
                time.sleep(ADOPTED_S)
            channel.send(str(os.getpid()).encode())
            channel.close()
            run(received[0], **json.loads(message))
        os.wait()
        os.close(received[0])


def run(
    output: int, arguments: list[str], command: list[str], environment: dict[str, str], folder: str
) -> NoReturn:
    """As `python -m cobot` does."""
    from cobot.launch.forked import _set_title

    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    for number in (1, 2):
        os.dup2(output, number)
    os.close(output)
    _set_title(command)
    sys.argv[1:] = arguments
    status: object = 0
    try:
        runpy.run_module("cobot", run_name="__main__", alter_sys=True)
    except SystemExit as exc:
        status = exc.code
    except BaseException:  # noqa: BLE001 - as the interpreter does it
        sys.excepthook(*sys.exc_info())
        status = 1
    ctypes.pythonapi.Py_Exit(status if isinstance(status, int) else int(status is not None))
    raise AssertionError("unreachable")


if __name__ == "__main__":
    main(socket.socket(fileno=int(sys.argv[1])))
