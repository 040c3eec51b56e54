"""The options of `cobot record`, `cobot plot` and `cobot replay`, which are in `cobot.launch.recordings`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cobot.commands.options import URL_HELP, default_url

COMMANDS = ("record", "plot", "replay")


def add_parsers(commands: Any) -> None:
    """Add the commands."""
    service = argparse.ArgumentParser(add_help=False)
    service.add_argument("--url", metavar="URL", default=default_url(), help=URL_HELP)
    service.add_argument("--robot", metavar="NAME", help="instead of the default one")
    service.add_argument("--token", metavar="TOKEN", help="for a service that asks for one; else COBOT_TOKEN")
    service.add_argument("--certificate", type=Path, metavar="FILE", help="of a service with https")
    record = commands.add_parser("record", help="write down what the robot did or does")
    actions = record.add_subparsers(dest="action", metavar="ACTION", required=True)
    dump = actions.add_parser("dump", parents=[service], help="the last seconds, which are in memory")
    dump.add_argument("--seconds", type=float, metavar="S", help="without it recording.before_s")
    actions.add_parser("start", parents=[service], help="begin a continuous recording")
    stop = actions.add_parser("stop", parents=[service], help="end it")
    for parser in (dump, stop):
        parser.add_argument("--output", type=Path, metavar="FOLDER", help="fetch the files to there too")
    actions.add_parser("list", parents=[service], help="print what there is")
    get = actions.add_parser("get", parents=[service], help="fetch a recording")
    get.add_argument("name", metavar="NAME")
    get.add_argument(
        "--output", type=Path, metavar="FOLDER", default=Path(), help="without it the current one"
    )
    plot = commands.add_parser("plot", help="draw a recording, as SVG")
    plot.add_argument("file", type=Path, metavar="FILE", help="an MCAP file of cobot's")
    plot.add_argument("--output", type=Path, metavar="FILE", help="without it that of FILE with .svg")
    replay = commands.add_parser("replay", parents=[service], help="have the arm do again what was recorded")
    replay.add_argument("file", type=Path, metavar="FILE", help="an MCAP file of cobot's")
    replay.add_argument("--move-to-start", action="store_true", help="go to where it begins first")
    replay.add_argument(
        "--measured", action="store_true", help="where the arm was, not where it was told to be"
    )
    replay.add_argument(
        "--smoothing-rad", type=float, metavar="RAD", help="instead of planning.smoothing_rad"
    )
    replay.add_argument("--csv", type=Path, metavar="FILE", help="only write the points there; nothing moves")
