"""The `cobot` command."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

from cobot.addresses import address
from cobot.client.rest import DEFAULT_URL
from cobot.config import Settings, load_settings
from cobot.errors import CobotError
from cobot.launch.process import RUN_MODULE
from cobot.launch.supervisor import Supervisor

DESCRIPTION = """\
A robot arm behind a REST service.

  cobot run      start the simulated (or real) robot and the service, and watch over both
  cobot check    validate the whole configuration, without starting anything
  cobot moveit-config   write a package with which MoveIt 2 plans for the robot, see docs/ros2.md
  cobot lua      run a Lua program at a running service, see docs/lua.md

The first run needs no configuration: open http://localhost:8007/docs and move the arm."""

EXIT_OK, EXIT_FAILED, EXIT_USAGE = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit status: 0 good, 1 failed, 2 wrong usage."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    if chosen.command is None:
        parser.print_help()
        return EXIT_USAGE
    if chosen.command == "lua":
        return _lua(chosen)
    try:
        settings = load_settings(chosen.config)
        if chosen.command == "check":
            from cobot.launch.check import check  # imports what planning needs

            return EXIT_OK if check(settings, chosen.config, sys.stdout) else EXIT_FAILED
        if chosen.command == "moveit-config":
            from cobot.launch.moveit import write_moveit_config

            print(write_moveit_config(settings, chosen.folder))
            return EXIT_OK
        return Supervisor(_overridden(settings, chosen), chosen.config).run()
    except CobotError as exc:
        print(f"cobot: {exc}", file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"cobot {version('cobot')}")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND")
    config = argparse.ArgumentParser(add_help=False)
    config.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="settings that differ from the shipped cobot-setting.yaml; other keys keep their shipped values",
    )
    run = commands.add_parser(
        "run", parents=[config], help="start the robot and the service; Ctrl-C stops both"
    )
    run.add_argument(
        "--host", metavar="H", help="address to listen on instead of web.host; 0.0.0.0 for all interfaces"
    )
    run.add_argument(
        "--port", type=_port, metavar="P", help="port to listen on instead of web.port; 0 picks a free one"
    )
    run.add_argument(
        "--clock",
        choices=["realtime", "fast"],
        help="instead of rt.clock; fast simulates motions as fast as the machine can",
    )
    lua = commands.add_parser("lua", help="run a Lua program at a running service")
    lua.add_argument("file", type=Path, metavar="FILE", help="- for standard input")
    lua.add_argument("--url", metavar="URL", default=DEFAULT_URL, help="of the service (%(default)s)")
    lua.add_argument("--robot", metavar="NAME", help="the robot to move, instead of the default one")
    commands.add_parser(
        "check", parents=[config], help="validate files, folders, model, limits, named positions"
    )
    moveit = commands.add_parser("moveit-config", parents=[config], help="write a package for MoveIt 2")
    moveit.add_argument("folder", type=Path, metavar="FOLDER", help="where the package is made, as a folder")
    return parser


def _lua(chosen: argparse.Namespace) -> int:
    """Become the runner: it is a client like any other, and this library knows nothing of it."""
    url = address(chosen.url, chosen.robot) if chosen.robot else chosen.url
    command = [*RUN_MODULE, "sequences", "run", "--lua", "--url", url, "--", str(chosen.file)]
    os.execv(command[0], command)


def _port(argument: str) -> int:
    if argument.isdecimal() and int(argument) <= 65535:
        return int(argument)
    raise argparse.ArgumentTypeError(f"{argument!r} is no port: give a number from 0 to 65535")


def _overridden(settings: Settings, chosen: argparse.Namespace) -> Settings:
    web = {key: getattr(chosen, key) for key in ("host", "port") if getattr(chosen, key) is not None}
    rt = {"clock": chosen.clock} if chosen.clock else {}
    return settings.model_copy(
        update={
            "web": settings.web.model_copy(update=web),
            "rt": settings.rt.model_copy(update=rt),
            "robots": tuple(_overridden(each, chosen) for each in settings.robots),
        }
    )
