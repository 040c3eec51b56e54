"""Runs the process of a simulated controller."""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Callable
from types import FrameType
from typing import Protocol, TypeVar

from cobot.errors import CobotError
from rtloop.realtime import freeze_garbage, prepare


class SimulatorServer(Protocol):
    """A simulated controller on a network."""

    def run(self, ending: list[str]) -> None:
        """Run until `ending` is not empty."""
        ...

    def close(self) -> None: ...


S = TypeVar("S", bound=SimulatorServer)


def serve(
    device: str,
    chosen: argparse.Namespace,
    made: Callable[[argparse.Namespace], S],
    said: Callable[[S], str],
) -> int:
    """Run a simulated controller until SIGTERM or Ctrl-C.

    Args:
        device: device name, as given to `cobot simulate`.
        chosen: command-line arguments, including `priority`.
        made: function that creates the server.
        said: the printed line with the address of the server.

    Returns:
        The exit status: 0, or 2 if it could not start.
    """
    ending: list[str] = []

    def end(number: int, frame: FrameType | None) -> None:
        ending.append("asked to")

    signal.signal(signal.SIGTERM, end)
    signal.signal(signal.SIGINT, end)
    try:
        server = made(chosen)
    except (CobotError, ValueError, OSError) as exc:
        print(f"cobot simulate {device}: {exc}", file=sys.stderr)
        return 2
    print(f"cobot simulate {device}: {said(server)}", flush=True)
    if chosen.priority is not None:
        refused = prepare(chosen.priority, None, None).refused
        freeze_garbage()
        if refused:
            print(f"cobot simulate {device}: {refused}", file=sys.stderr, flush=True)
    try:
        server.run(ending)
    finally:
        server.close()
    return 0
