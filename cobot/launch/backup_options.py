"""Options of `cobot backup`, `cobot restore` and `cobot support`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cobot.commands import options

COMMANDS = ("backup", "restore", "support")


def add_parsers(commands: Any, config: argparse.ArgumentParser) -> None:
    """Add the commands `cobot backup`, `restore` and `support`. `config` is a parser with the option
    --config.
    """
    backup = commands.add_parser(
        "backup", parents=[config], help="write settings, tool, scene, positions and programs to one file"
    )
    restore = commands.add_parser(
        "restore",
        parents=[config],
        help="check a backup, and restore it now, or at the next start if cobot is running",
    )
    support = commands.add_parser(
        "support", parents=[config], help="write configuration, versions, health and logs to one file"
    )
    for each in (backup, support):
        each.add_argument("file", type=Path, metavar="FILE", help="the ZIP archive to write")
    restore.add_argument(
        "file", type=Path, metavar="FILE", help="a backup written by cobot backup or by the panel"
    )
    options.add_service_options(support, robot=False)
