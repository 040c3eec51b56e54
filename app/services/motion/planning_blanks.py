"""The first planning processes: forked by the service before it has imported what they do not need."""

from __future__ import annotations

from pathlib import Path

from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.launch.forked import Forked, fork_processes


def planning_blanks(config: Path | None) -> list[Forked]:
    """As many as the settings want, while this process has no threads; none where that is not possible: what
    is wrong is found, and said, by who starts planning processes.
    """
    try:
        return fork_processes(sum(each.planning.workers for each in load_settings(config).each.values()))
    except (CobotError, OSError):
        return []
