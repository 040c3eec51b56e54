"""`python -m sequences`: run, check, or describe sequence files."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
from pathlib import Path

from cobot.client import DEFAULT_URL, MOTION_TIMEOUT_S
from cobot.errors import InputError
from cobot.process import Niceness, be, die_with_parent
from sequences.runner import ReturnCode, Run, run
from sequences.schema import read_sequence, schema_text

TOKEN_VARIABLE = "COBOT_MOTION_TOKEN"
RETURN_CODES = (
    "return codes: 0 all done, 2 the file or an argument is wrong, 3 a motion failed, "
    "4 the service or the robot is not available, 128 + N ended by signal N"
)


def main() -> int:
    """The exit status."""
    parser = argparse.ArgumentParser(prog="python -m sequences", description=__doc__, epilog=RETURN_CODES)
    commands = parser.add_subparsers(dest="command", required=True)
    runner = commands.add_parser("run", help="run a sequence file", epilog=RETURN_CODES)
    runner.add_argument("file", type=Path, help="- for standard input")
    runner.add_argument("--url", default=DEFAULT_URL, help="of the service (%(default)s)")
    runner.add_argument("--iterations", type=_count, default=1, help="how often (%(default)s)")
    runner.add_argument("--delay", type=_seconds, default=0.0, help="between iterations, s (%(default)s)")
    runner.add_argument(
        "--motion-timeout",
        type=_seconds,
        default=MOTION_TIMEOUT_S,
        help="for the service's answer to a motion, s (%(default)s)",
    )
    runner.add_argument("--bag", type=Path, help="record to this rosbag2, which must not exist")
    runner.add_argument("--topics", default="", help="to record, comma separated; all without it")
    runner.add_argument("--progress-fd", type=int, help=argparse.SUPPRESS)
    checker = commands.add_parser("check", help="validate a sequence file")
    checker.add_argument("file", type=Path)
    commands.add_parser("schema", help="print the JSON schema of sequence files")
    arguments = parser.parse_args()
    match arguments.command:
        case "run":
            return _run(arguments)
        case "check":
            return _check(arguments.file)
    print(schema_text(), end="")
    return 0


def _count(argument: str) -> int:
    if argument.isdecimal() and int(argument) >= 1:
        return int(argument)
    raise argparse.ArgumentTypeError(f"{argument!r} is no number from 1 up")


def _seconds(argument: str) -> float:
    value = float(argument)
    if math.isfinite(value) and value >= 0.0:
        return value
    raise argparse.ArgumentTypeError(f"{argument!r} is no time from 0 s up")


def _run(arguments: argparse.Namespace) -> int:
    if arguments.progress_fd is not None:  # the service has started it, and it ends with the service
        die_with_parent(signal.SIGTERM)
        be(Niceness.ORDINARY)
    return run(
        Run(
            arguments.file,
            arguments.url,
            arguments.iterations,
            arguments.delay,
            arguments.motion_timeout,
            arguments.bag,
            arguments.topics,
            os.environ.get(TOKEN_VARIABLE),
            arguments.progress_fd,
        )
    )


def _check(file: Path) -> int:
    try:
        sequence = read_sequence(file)
    except InputError as exc:
        print(f"{file}: {exc}", file=sys.stderr)
        return ReturnCode.BAD_INPUT
    print(f"{file}: {len(sequence.waypoints)} waypoints, {'with' if sequence.home else 'without'} home")
    return 0


if __name__ == "__main__":
    sys.exit(main())
