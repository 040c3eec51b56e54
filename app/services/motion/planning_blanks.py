"""Starts the first planning processes, which are forked before the service imports modules that they do not
need.
"""

from __future__ import annotations

from pathlib import Path

from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.launch.forked import Forked, fork_processes


def planning_blanks(config: Path | None) -> list[Forked]:
    """Fork as many processes as the settings require, while this process has no threads yet.

    Returns an empty list if this fails. The pool then starts the processes later, and reports the cause if
    that fails, too.
    """
    try:
        return fork_processes(sum(each.planning.workers for each in load_settings(config).each.values()))
    except (CobotError, OSError):
        return []
