"""Command-line options of the commands for a running service."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
from typing import Any

from cobot.addresses import DEFAULT_URL
from cobot.motions.planners import GOAL_ALONE, in_words

URL_VARIABLE = "COBOT_URL"
COMMANDS = ("state", "move", "send", "jobs", "program", "watch", "teleop", "acknowledge", "completion")
SHELLS = ("bash", "zsh", "fish")
EPILOG = "exit status: 0 done, 1 rejected with a reason, 2 wrong usage, 3 no answer, 130 interrupted"
HELD, OFF = 2, 1
"""Stop categories: the drives stay on (2), or are switched off (1)."""
Commands = Any
"""The object that argparse returns for subcommands."""


def service_options(*, robot: bool = True, as_json: bool = True) -> argparse.ArgumentParser:
    """Options that all commands share: the service, the robot and the output format. The parsers of the
    commands use this parser as a parent. See `add_service_options`.
    """
    options = argparse.ArgumentParser(add_help=False)
    add_service_options(options.add_argument_group("service"), robot=robot, as_json=as_json)
    return options


def add_service_options(group: argparse._ArgumentGroup, *, robot: bool = True, as_json: bool = True) -> None:
    """Add the service options to an existing parser.

    Args:
        robot, as_json: whether to add the options `--robot` and `--json`.
    """
    url_help = f"URL of the service (default: {URL_VARIABLE}, or {DEFAULT_URL})"
    group.add_argument("--url", metavar="URL", help=url_help)
    group.add_argument(
        "--token",
        metavar="TOKEN",
        help="access token; COBOT_TOKEN is safer, because others can see a command line",
    )
    group.add_argument(
        "--certificate",
        type=Path,
        metavar="FILE",
        help="certificate to trust, for an https service with its own certificate",
    )
    if robot:
        group.add_argument("--robot", metavar="NAME", help="name of the robot (default: the default robot)")
    if as_json:
        group.add_argument("--json", action="store_true", help="print JSON instead of text, for programs")


def url_of(chosen: argparse.Namespace) -> str:
    """URL of the service that the command uses."""
    return str(chosen.url or os.environ.get(URL_VARIABLE) or DEFAULT_URL)


def for_service(chosen: argparse.Namespace, parser: argparse.ArgumentParser) -> bool:
    """Whether a command needs a running service. If the options contradict each other, this ends the
    program.
    """
    if chosen.command == "stop":
        if chosen.url is None and (chosen.token or chosen.certificate or chosen.json):
            parser.error("stop: --token, --certificate and --json need --url")
        if chosen.url is None and chosen.category != HELD:
            parser.error("stop: --category needs --url")
        if chosen.url is not None and (chosen.estop or chosen.config):
            parser.error(
                "stop: --estop and --config cannot be used with --url, because they are for this computer"
            )
        return chosen.url is not None
    if chosen.command == "run":
        own = {name: getattr(chosen, name) for name in ("config", "host", "port", "clock", "cell")}
        remote = {name: getattr(chosen, name) for name in ("url", "token", "certificate", "robot", "json")}
        wrong = remote if chosen.sequence is None else own
        for name, value in wrong.items():
            if value not in (None, False):
                why = "needs a SEQUENCE" if chosen.sequence is None else "cannot be used with a SEQUENCE"
                parser.error(f"run: --{name} {why}")
        return chosen.sequence is not None
    return chosen.command in COMMANDS


def add_parsers(commands: Commands) -> None:
    """Add all of `COMMANDS`."""
    service = service_options()

    def parser(name: str, text: str) -> argparse.ArgumentParser:
        made: argparse.ArgumentParser = commands.add_parser(
            name, parents=[service], help=text, description=text, epilog=EPILOG
        )
        return made

    parser("state", "print joints, TCP, mode and the client that has control")
    _add_move(parser("move", "move the arm and wait until it reaches the goal; Ctrl-C stops the arm"))
    send = parser("send", "run a trajectory (.csv, .json) and wait for its end; Ctrl-C stops the arm")
    send.add_argument("file", type=Path, metavar="FILE")
    send.add_argument("--no-wait", action="store_true", help="return when the motion has begun")
    send.add_argument("--move-to-start", action="store_true", help="first move to the first point")
    jobs = parser("jobs", "list the jobs of a service, or change one")
    jobs.add_argument("id", nargs="?", metavar="ID", help="ID of a job; by default all jobs")
    change = jobs.add_mutually_exclusive_group()
    for what in ("cancel", "pause", "resume"):
        change.add_argument(f"--{what}", action="store_true", help=f"{what} the job")
    program = parser("program", "list, print, save or run the programs that the service stores")
    program.add_argument("action", choices=("list", "show", "save", "run"), metavar="list|show|save|run")
    program.add_argument(
        "id", nargs="?", metavar="ID", help="ID of a program; required for all actions except list"
    )
    program.add_argument("file", nargs="?", type=Path, metavar="FILE", help="save: a .json or .lua file")
    program.add_argument("--label", metavar="TEXT", help="save: the display name (default: the ID)")
    program.add_argument(
        "--base",
        type=_count,
        metavar="N",
        help="save: number of the version that was changed; by default the program is new",
    )
    program.add_argument("--version", type=_count, metavar="N", help="show, run: an older version")
    program.add_argument("--repeat", type=_count, default=1, metavar="N", help="run: number of runs")
    watch = parser("watch", "print events as they happen, until Ctrl-C")
    watch.add_argument("--types", metavar="TYPE,...", help="event types, see docs/events.md; by default all")
    watch.add_argument(
        "--state-hz", type=float, metavar="HZ", help="print the state too, 0.1 to 100 times per second"
    )
    watch.add_argument(
        "--after", metavar="EPOCH-ID", help="start after this event; 0 starts with all stored events"
    )
    watch.add_argument("--count", type=_count, metavar="N", help="stop after this number of events")
    hand = parser(
        "teleop", "move the arm with the keyboard or a gamepad, while a key or the dead-man button is held"
    )
    hand.add_argument(
        "--gamepad",
        nargs="?",
        type=Path,
        const=Path(),
        metavar="DEVICE",
        help="use a gamepad instead of the keyboard; by default the first one of /dev/input/js*",
    )
    hand.add_argument(
        "--speed",
        type=float,
        default=0.5,
        metavar="SHARE",
        help="share of the maximum speed, above 0 to 1 (%(default)s)",
    )
    seen = parser("acknowledge", "print the findings of the first contact with a robot, and confirm them")
    seen.add_argument(
        "--payload-checked",
        action="store_true",
        help="confirm that tool and load are those of the model; not needed if POST /robot/tool has set them",
    )
    completion = commands.add_parser("completion", help="print a shell completion script")
    completion.add_argument("shell", choices=SHELLS)


def add_sequence_options(run: argparse.ArgumentParser) -> None:
    """Add the options of `cobot run FILE`, which runs a sequence in a service."""
    run.add_argument(
        "sequence",
        nargs="?",
        type=Path,
        metavar="SEQUENCE",
        help="a sequence (.json) or program (.lua) that a running service executes, with the options "
        "of the group service. Without it, run starts the service",
    )
    group = run.add_argument_group("service")
    add_service_options(group)
    group.add_argument(
        "--iterations", type=_count, default=1, metavar="N", help="number of runs (%(default)s)"
    )
    group.add_argument("--delay", type=float, default=0.0, metavar="S", help="pause between two runs, s")


def _add_move(move: argparse.ArgumentParser) -> None:
    move.add_argument(
        "goal",
        nargs="+",
        metavar="GOAL",
        help="name of a position; or joint angles, rad; or `pose X Y Z [A B C]`, m and KUKA angles in rad. "
        "Negative numbers need no quotes",
    )
    move.add_argument(
        "--speed", type=float, default=0.1, metavar="SHARE", help="fraction of the limits (%(default)s)"
    )
    move.add_argument("--planner", metavar="NAME", help=in_words(GOAL_ALONE, "or"))
    move.add_argument(
        "--fields",
        default="{}",
        metavar="JSON",
        help="more fields of the motion, as in the REST API: actions, start_when, pause_while, until",
    )
    move.add_argument(
        "--queue",
        action="store_true",
        help="add the motion to the queue and do not wait",
    )
    move.add_argument(
        "--blend-radius",
        type=float,
        default=0.0,
        metavar="M",
        help="with --queue: distance from the end of the motion, m, at which the arm may blend into the "
        "next motion; with 0, the arm stops",
    )


def _count(text: str) -> int:
    if text.isdecimal() and 0 < int(text) <= 1_000_000:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not a number from 1 to 1000000")
