"""What the commands for a running service take."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from cobot.addresses import DEFAULT_URL
from cobot.motions.planners import GOAL_ALONE, in_words

URL_VARIABLE = "COBOT_URL"
URL_HELP = f"of the service; {URL_VARIABLE}, or {DEFAULT_URL}, without it"
COMMANDS = ("state", "move", "send", "jobs", "watch", "teleop", "acknowledge", "completion")
SHELLS = ("bash", "zsh", "fish")
EPILOG = "exit status: 0 done, 1 the service says why not, 2 wrong usage, 3 nobody answers, 130 interrupted"
HELD, OFF = 2, 1
"""Stop categories."""
Commands = Any
"""What argparse gives for subcommands."""


def service_options() -> argparse.ArgumentParser:
    """Which service, which robot, and how to print; for the parsers of commands."""
    options = argparse.ArgumentParser(add_help=False)
    add_service_options(options.add_argument_group("service"))
    return options


def add_service_options(group: argparse._ArgumentGroup, *, robot: bool = True) -> None:
    """The same for a parser that is there already.

    Args:
        robot: whether `--robot` is missing there.
    """
    group.add_argument("--url", metavar="URL", help=URL_HELP)
    group.add_argument("--token", metavar="TOKEN", help="COBOT_TOKEN tells it to fewer people")
    group.add_argument("--certificate", type=Path, metavar="FILE", help="of a service with its own https")
    if robot:
        group.add_argument("--robot", metavar="NAME", help="instead of the default one")
    group.add_argument("--json", action="store_true", help="JSON, for programs")


def url_of(chosen: argparse.Namespace) -> str:
    """The service that is meant."""
    return str(chosen.url or default_url())


def default_url() -> str:
    """The service of who names none."""
    return os.environ.get(URL_VARIABLE) or DEFAULT_URL


def for_service(chosen: argparse.Namespace, parser: argparse.ArgumentParser) -> bool:
    """Whether a command is for a service that runs already; ends the program where it says two things."""
    if chosen.command == "stop":
        if chosen.url is None and (chosen.token or chosen.certificate or chosen.json):
            parser.error("stop: --token, --certificate and --json go with --url")
        if chosen.url is None and chosen.category != HELD:
            parser.error("stop: --category goes with --url")
        if chosen.url is not None and (chosen.estop or chosen.config):
            parser.error("stop: --estop and --config do not go with --url: they are for this computer")
        return chosen.url is not None
    if chosen.command == "run":
        own = {name: getattr(chosen, name) for name in ("config", "host", "port", "clock")}
        remote = {name: getattr(chosen, name) for name in ("url", "token", "certificate", "robot", "json")}
        wrong = remote if chosen.sequence is None else own
        for name, value in wrong.items():
            if value not in (None, False):
                why = "is for a SEQUENCE" if chosen.sequence is None else "does not go with a SEQUENCE"
                parser.error(f"run: --{name} {why}")
        return chosen.sequence is not None
    return chosen.command in COMMANDS


def add_parsers(commands: Commands) -> None:
    """All of `COMMANDS`."""
    service = service_options()

    def parser(name: str, text: str) -> argparse.ArgumentParser:
        made: argparse.ArgumentParser = commands.add_parser(
            name, parents=[service], help=text, description=text, epilog=EPILOG
        )
        return made

    parser("state", "joints, TCP, mode and who has the control")
    _add_move(parser("move", "move the arm and wait until it has arrived; Ctrl-C stops it"))
    send = parser("send", "run a trajectory (.csv, .json) and wait for its end; Ctrl-C stops it")
    send.add_argument("file", type=Path, metavar="FILE")
    send.add_argument("--no-wait", action="store_true", help="return when the motion has begun")
    send.add_argument("--move-to-start", action="store_true", help="go there first")
    jobs = parser("jobs", "the jobs of a service, or what becomes of one")
    jobs.add_argument("id", nargs="?", metavar="ID", help="one job; without it all")
    change = jobs.add_mutually_exclusive_group()
    for what in ("cancel", "pause", "resume"):
        change.add_argument(f"--{what}", action="store_true", help=f"{what} it")
    watch = parser("watch", "what happens, as it happens, until Ctrl-C")
    watch.add_argument("--types", metavar="TYPE,...", help="some of docs/events.md; all without it")
    watch.add_argument(
        "--state-hz", type=float, metavar="HZ", help="the state too, 0.1 to 100 times a second"
    )
    watch.add_argument(
        "--after", metavar="EPOCH-ID", help="begin after this event; 0: with all that are kept"
    )
    watch.add_argument("--count", type=_count, metavar="N", help="end after so many events")
    hand = parser("teleop", "move the arm by the keyboard or a gamepad, for as long as something is held")
    hand.add_argument(
        "--gamepad",
        nargs="?",
        type=Path,
        const=Path(),
        metavar="DEVICE",
        help="in place of the keyboard; without DEVICE the first one of /dev/input/js*",
    )
    hand.add_argument("--speed", type=float, default=0.5, metavar="SHARE", help="above 0 to 1 (%(default)s)")
    seen = parser("acknowledge", "say what the first contact with a robot has found, and that it is so")
    seen.add_argument(
        "--payload-checked",
        action="store_true",
        help="tool and load are those of the model; not needed where POST /robot/tool has set them",
    )
    completion = commands.add_parser("completion", help="print what makes a shell complete commands")
    completion.add_argument("shell", choices=SHELLS)


def add_sequence_options(run: argparse.ArgumentParser) -> None:
    """Of `cobot run FILE`, which runs a sequence at a service."""
    run.add_argument(
        "sequence",
        nargs="?",
        type=Path,
        metavar="SEQUENCE",
        help="a sequence (.json) or program (.lua), to be run by the service that runs already; the options "
        "of the group service are for this. Without it, run is the service",
    )
    group = run.add_argument_group("service")
    add_service_options(group)
    group.add_argument("--iterations", type=_count, default=1, metavar="N", help="how often (%(default)s)")
    group.add_argument("--delay", type=float, default=0.0, metavar="S", help="between two of them, s")


def _add_move(move: argparse.ArgumentParser) -> None:
    move.add_argument(
        "goal",
        nargs="+",
        metavar="GOAL",
        help="the name of a position; or the joints' angles, rad; or `pose X Y Z [A B C]`, m and KUKA's "
        "angles, rad. Negative numbers need no quotes",
    )
    move.add_argument("--speed", type=float, default=0.1, metavar="SHARE", help="of the limits (%(default)s)")
    move.add_argument("--planner", metavar="NAME", help=in_words(GOAL_ALONE, "or"))
    move.add_argument(
        "--queue",
        action="store_true",
        help="have it done in its turn, after those that are queued; do not wait",
    )
    move.add_argument(
        "--blend-radius",
        type=float,
        default=0.0,
        metavar="M",
        help="with --queue: so far from its end, m, the arm may go on into the next one; 0: it stops",
    )


def _count(text: str) -> int:
    if text.isdecimal() and 0 < int(text) <= 1_000_000:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is no number from 1 to 1000000")
