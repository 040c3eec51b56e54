"""`cobot fleet`: the hub of a fleet, and commands that use it."""

from __future__ import annotations

import argparse
import math
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cobot.addresses import NAME, NAME_RULE
from cobot.client.tls import TOKEN_VARIABLE
from cobot.errors import CobotError
from cobot.fleet.asking import DEFAULT_URL, URL_VARIABLE
from cobot.fleet.looking import list_robots, show, watch
from cobot.fleet.messages import DEADLINE_S
from cobot.fleet.ordering import command, forget, roll_out
from cobot.fleet.pulling import pull
from cobot.fleet.serving import add_certificate, add_serve
from cobot.foreign import plain_lines
from cobot.launch.process import as_command

EXIT_FAILED, EXIT_USAGE = 1, 2
DESCRIPTION = """\
All cells of a plant in one place: docs/fleet.md.

  cobot fleet serve      run the hub: the cells connect to it, people open its page
  cobot fleet list       show all robots with their states
  cobot fleet show CELL  show everything that the hub knows about a cell, and its last events
  cobot fleet watch      print each change as a line
  cobot fleet stop CELL ...   stop the robots of these cells, of a zone (--zone Z), or of all cells (--all)
  cobot fleet run CELL ... --program ID   start a stored program of the cells
  cobot fleet pause|resume|speed|control CELL ...
  cobot fleet roll-out FOLDER CELL ...    install programs and settings: on one cell first, then in waves
  cobot fleet forget CELL ...    remove cells that are gone, for example after a change of their names
  cobot fleet pull FOLDER    copy recordings from the hub, which has fetched them from the cells
  cobot fleet certificate FOLDER hub|cell NAME ...   make certificates: TLS, and commands other than stops"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit status."""
    parser = _parser()
    chosen = parser.parse_args(arguments)
    if chosen.action is None:
        parser.print_help()
        return EXIT_USAGE
    if "zone" in chosen and sum(map(bool, (chosen.cells, chosen.all, chosen.zone))) != 1:
        parser.error(f"{chosen.action}: give the names of cells, --zone, or --all")
    try:
        return int(chosen.run(chosen))
    except CobotError as exc:
        print(f"cobot: {plain_lines(exc)}", file=sys.stderr)
        return EXIT_FAILED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "cobot fleet", description=DESCRIPTION, formatter_class=argparse.RawTextHelpFormatter
    )
    actions = parser.add_subparsers(dest="action", metavar="ACTION")
    add_serve(actions)
    url = _url_options()
    _add_looking(actions, url)
    _add_commands(actions, url)
    _add_changes(actions, url)
    add_certificate(actions)
    return parser


def _url_options() -> argparse.ArgumentParser:
    url = argparse.ArgumentParser(add_help=False)
    url.add_argument(
        "--url",
        default=os.environ.get(URL_VARIABLE, DEFAULT_URL),
        metavar="URL",
        help=f"URL of the hub; default: {URL_VARIABLE}, or {DEFAULT_URL}",
    )
    url.add_argument(
        "--token", default=os.environ.get(TOKEN_VARIABLE), help=f"access token; default: {TOKEN_VARIABLE}"
    )
    url.add_argument("--json", action="store_true", help="print the answers of the hub as JSON")
    return url


def _add_looking(actions: Any, url: argparse.ArgumentParser) -> None:
    listing = actions.add_parser("list", parents=[url], help="all robots with their states")
    listing.set_defaults(run=list_robots)
    one = actions.add_parser("show", parents=[url], help="one cell with its last events")
    one.add_argument("cell", metavar="CELL")
    one.add_argument(
        "--picture", type=Path, metavar="FILE", help="also write a picture of the arm to this file, as PNG"
    )
    one.set_defaults(run=show)
    watching = actions.add_parser("watch", parents=[url], help="print changes until Ctrl-C")
    watching.set_defaults(run=watch)


def _add_commands(actions: Any, url: argparse.ArgumentParser) -> None:
    target = argparse.ArgumentParser(add_help=False, parents=[url])
    target.add_argument("cells", nargs="*", metavar="CELL")
    target.add_argument("--all", action="store_true", help="all cells of the fleet")
    target.add_argument("--zone", type=_name, help="all cells of this zone")
    target.add_argument("--robot", metavar="NAME", help="only this robot of the cells")
    target.add_argument(
        "--deadline",
        type=_number,
        default=DEADLINE_S,
        metavar="S",
        help="time in which the cells must receive the command, s",
    )

    def add(
        name: str, text: str, action_of: Callable[[argparse.Namespace], dict[str, Any] | None]
    ) -> argparse.ArgumentParser:
        made: argparse.ArgumentParser = actions.add_parser(name, parents=[target], help=text)
        made.set_defaults(run=command, action_of=action_of)
        return made

    add("stop", "stop robots and wait until they are at rest", lambda _: None)
    run = add("run", "start a stored program of the cells", _start)
    run.add_argument("--program", required=True, metavar="ID")
    run.add_argument("--version", type=int, metavar="N", help="version of the program; default: the latest")
    add("pause", "pause the running program", lambda _: {"kind": "pause"})
    add("resume", "resume the paused program or motion", lambda _: {"kind": "resume"})
    speed = add("speed", "set the speed override", lambda it: {"kind": "speed", "fraction": it.fraction})
    speed.add_argument(
        "--fraction", type=_number, required=True, metavar="F", help="share of the planned speed, 0 to 1"
    )
    control = add("control", "take control, or give it back", _control)
    which = control.add_mutually_exclusive_group(required=True)
    which.add_argument("--take", action="store_true")
    which.add_argument("--release", action="store_true")
    control.add_argument("--force", action="store_true", help="take control even if another client has it")


def _start(chosen: argparse.Namespace) -> dict[str, Any]:
    version = {} if chosen.version is None else {"version": chosen.version}
    return {"kind": "start", "program": chosen.program} | version


def _control(chosen: argparse.Namespace) -> dict[str, Any]:
    return {"kind": "take_control", "force": chosen.force} if chosen.take else {"kind": "release_control"}


def _add_changes(actions: Any, url: argparse.ArgumentParser) -> None:
    out = actions.add_parser(
        "roll-out", parents=[url], help="install programs and settings: on one cell first, then in waves"
    )
    out.add_argument("folder", type=Path, metavar="FOLDER", help="with programs/, positions.json, settings/")
    out.add_argument("cells", nargs="+", metavar="CELL[/ROBOT]")
    out.add_argument("--name", type=_name, help="name of the bundle; default: the folder's name")
    out.add_argument("--version", required=True, metavar="V", help="version of the bundle, such as 1.4")
    out.add_argument("--wave", type=int, default=5, metavar="N", help="number of cells in a wave; default: 5")
    out.add_argument(
        "--watch",
        type=_number,
        default=5.0,
        metavar="S",
        help="time to watch the robots after each wave, s; default: 5",
    )
    out.set_defaults(run=roll_out)
    removal = actions.add_parser("forget", parents=[url], help="remove cells that are gone")
    removal.add_argument("cells", nargs="+", metavar="CELL")
    removal.set_defaults(run=forget)
    copy = actions.add_parser("pull", parents=[url], help="copy recordings from the hub to this computer")
    copy.add_argument("folder", type=Path, metavar="FOLDER")
    copy.add_argument("cells", nargs="*", metavar="CELL", help="default: all")
    copy.set_defaults(run=pull)


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
    return value


def _name(text: str) -> str:
    if not re.fullmatch(NAME, text):
        raise argparse.ArgumentTypeError(f"{text!r} is not valid: {NAME_RULE}")
    return text


if __name__ == "__main__":
    sys.exit(as_command(main))
