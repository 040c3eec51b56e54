"""Options of `cobot record`, `cobot plot` and `cobot replay`. The commands are in
`cobot.launch.recordings`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from cobot.commands.options import service_options

COMMANDS = ("record", "plot", "replay")


def add_parsers(commands: Any) -> None:
    """Add the commands `cobot record`, `plot` and `replay`."""
    service = service_options(as_json=False)
    record = commands.add_parser("record", help="record the motion of the robot")
    actions = record.add_subparsers(dest="action", metavar="ACTION", required=True)
    dump = actions.add_parser("dump", parents=[service], help="save the newest seconds in memory")
    dump.add_argument(
        "--seconds", type=float, metavar="S", help="number of seconds to save; by default recording.before_s"
    )
    actions.add_parser("start", parents=[service], help="begin a continuous recording")
    stop = actions.add_parser("stop", parents=[service], help="end a continuous recording")
    for parser in (dump, stop):
        parser.add_argument(
            "--output", type=Path, metavar="FOLDER", help="folder into which the files are also copied"
        )
    actions.add_parser("list", parents=[service], help="list the recordings")
    get = actions.add_parser("get", parents=[service], help="fetch a recording")
    get.add_argument("name", metavar="NAME")
    get.add_argument(
        "--output",
        type=Path,
        metavar="FOLDER",
        default=Path(),
        help="target folder; by default the current one",
    )
    plot = commands.add_parser("plot", help="draw a recording as an SVG file")
    plot.add_argument("file", type=Path, metavar="FILE", help="an MCAP file from cobot")
    plot.add_argument(
        "--output", type=Path, metavar="FILE", help="SVG file to write; by default FILE with the ending .svg"
    )
    replay = commands.add_parser("replay", parents=[service], help="repeat a recorded motion")
    replay.add_argument("file", type=Path, metavar="FILE", help="an MCAP file from cobot")
    replay.add_argument(
        "--move-to-start", action="store_true", help="first move to the start of the recording"
    )
    replay.add_argument(
        "--measured", action="store_true", help="use the measured positions instead of the commanded ones"
    )
    replay.add_argument(
        "--smoothing-rad",
        type=float,
        metavar="RAD",
        help="smoothing to use instead of planning.smoothing_rad",
    )
    replay.add_argument(
        "--csv", type=Path, metavar="FILE", help="only write the points to this file; nothing moves"
    )
