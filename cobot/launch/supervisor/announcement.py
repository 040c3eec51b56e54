"""Announces everything that the supervisor has started."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Mapping
from importlib.metadata import version

from cobot.config import Settings
from cobot.errors import TornReadError
from cobot.ipc.layout import text
from cobot.ipc.shm import RobotMemory

log = logging.getLogger("cobot")


def announce(settings: Settings, url: str, access: str, memories: Mapping[str, RobotMemory]) -> None:
    """Log the service address, the clients that may use it, and the robots that are running.

    Args:
        url: service URL; "" if no service is running.
        access: the clients that may use the service, as human-readable text.
        memories: shared memory of the robots whose cycles have begun.
    """
    log.info("cobot %s (pid %d)", version("cobot"), os.getpid())
    log.info("  address    %s", f"{url}/" if url else "none: web.enabled is false")
    log.info("  access     %s", access)
    for name, memory in memories.items():
        own = settings.of(name)
        log.info("  robot      %s, %d joints", name, memory.dof)
        log.info("  backend    %s, clock %s", own.robot.backend.type, own.rt.clock)
        log.info("  real time  %s", _permissions(memory))
    log.info("  logs       %s", settings.log_file)
    log.info("  Ctrl-C stops: the arm first, then the service")


def _permissions(memory: RobotMemory) -> str:
    for _ in range(50):
        try:
            record = memory.statistics.read()
        except TornReadError as exc:
            return str(exc)
        if record["pid"]:
            granted = [("SCHED_FIFO", record["sched_fifo"]), ("locked memory", record["memory_locked"])]
            words = ", ".join(f"{name} {'granted' if yes else 'NOT granted'}" for name, yes in granted)
            refused = text(record["permissions"])
            return f"{words} ({refused})" if refused else words
        time.sleep(0.02)
    return "unknown: rtloop has published no statistics"
