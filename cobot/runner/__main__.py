"""`python -m cobot.runner`: runs or checks sequence files and Lua programs, or describes sequence files."""

from __future__ import annotations

import argparse
import math
import os
import signal
import sys
from pathlib import Path

from cobot.addresses import DEFAULT_URL
from cobot.client.connection import MOTION_TIMEOUT_S
from cobot.errors import InputError
from cobot.launch.process import Niceness, die_with_parent, set_niceness
from cobot.runner.library import Library
from cobot.runner.lua_sandbox import LuaLimits, require_lua
from cobot.runner.progress import Progress
from cobot.runner.runner import ReturnCode, RunSettings, run
from cobot.runner.schema import read_file, read_sequence, schema_text

MOTION_TOKEN_VARIABLE = "COBOT_MOTION_TOKEN"
RETURN_CODES = (
    "return codes: 0 done, 2 the file or an argument is wrong, 3 a motion failed, "
    "4 the service or the robot is not available, 128 + N ended by signal N"
)


def main() -> int:
    """Run the command line and return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m cobot.runner", description=__doc__, epilog=RETURN_CODES)
    commands = parser.add_subparsers(dest="command", required=True)
    runner = commands.add_parser("run", help="run a sequence file or a Lua program", epilog=RETURN_CODES)
    runner.add_argument("file", type=Path, help="the file; - for standard input")
    runner.add_argument(
        "--folder", type=Path, help="folder of called sequences; default: the folder of the file"
    )
    runner.add_argument(
        "--lua", action="store_true", help="treat the file as a Lua program, whatever its ending"
    )
    runner.add_argument(
        "--memory", type=_count, default=64, help="memory of a Lua program, MiB (%(default)s)"
    )
    runner.add_argument(
        "--instructions",
        type=_instructions,
        default=LuaLimits().instructions,
        help="maximum number of instructions of a Lua program between two waits, 0 for any number "
        "(%(default)s)",
    )
    runner.add_argument("--url", default=DEFAULT_URL, help="URL of the service (%(default)s)")
    runner.add_argument("--iterations", type=_count, default=1, help="number of iterations (%(default)s)")
    runner.add_argument(
        "--delay", type=_seconds, default=0.0, help="pause between iterations, s (%(default)s)"
    )
    runner.add_argument(
        "--motion-timeout",
        type=_seconds,
        default=MOTION_TIMEOUT_S,
        help="timeout for the service's answer to a motion, s (%(default)s)",
    )
    runner.add_argument("--bag", type=Path, help="record to this rosbag2, which must not exist yet")
    runner.add_argument("--topics", default="", help="topics to record, separated by commas; by default all")
    runner.add_argument("--progress-fd", type=int, help=argparse.SUPPRESS)
    runner.add_argument("--answers-fd", type=int, help=argparse.SUPPRESS)
    runner.add_argument("--name", help=argparse.SUPPRESS)  # file name for standard input
    checker = commands.add_parser("check", help="validate a sequence file, or the syntax of a Lua program")
    checker.add_argument("file", type=Path)
    checker.add_argument(
        "--folder", type=Path, help="folder of called sequences; default: the folder of the file"
    )
    commands.add_parser("schema", help="print the JSON schema of sequence files")
    arguments = parser.parse_args()
    match arguments.command:
        case "run":
            return _run(arguments)
        case "check":
            return _check(arguments.file, arguments.folder)
    print(schema_text(), end="")
    return 0


def _count(argument: str) -> int:
    if argument.isdecimal() and int(argument) >= 1:
        return int(argument)
    raise argparse.ArgumentTypeError(f"{argument!r} is not a number of 1 or more")


def _instructions(argument: str) -> int:
    return 0 if argument == "0" else _count(argument)


def _seconds(argument: str) -> float:
    value = float(argument)
    if math.isfinite(value) and value >= 0.0:
        return value
    raise argparse.ArgumentTypeError(f"{argument!r} is not a time of 0 s or more")


def _run(arguments: argparse.Namespace) -> int:
    if arguments.progress_fd is not None:  # the service has started this process, which ends with the service
        die_with_parent(signal.SIGTERM)
        set_niceness(Niceness.ORDINARY)
    name = arguments.name or arguments.file.name
    lua = arguments.lua or name.endswith(".lua")
    status = run(
        RunSettings(
            file=arguments.file,
            name=name,
            folder=arguments.folder or arguments.file.parent,
            lua=LuaLimits(arguments.memory << 20, arguments.instructions) if lua else None,
            url=arguments.url,
            iterations=arguments.iterations,
            delay_s=arguments.delay,
            motion_timeout_s=arguments.motion_timeout,
            bag=arguments.bag,
            topics=arguments.topics,
            motion_token=os.environ.get(MOTION_TOKEN_VARIABLE),
            from_service=arguments.progress_fd is not None,
            progress=Progress(arguments.progress_fd, arguments.answers_fd),
        )
    )
    if lua:  # a program that is stuck inside one of Lua's own functions still has its thread
        sys.stdout.flush()
        os._exit(status)
    return status


def _check(file: Path, folder: Path | None) -> int:
    try:
        if file.suffix == ".lua":
            require_lua(read_file(file), file.name)
            return ReturnCode.DONE
        sequence = read_sequence(file)
        Library(folder or file.parent).require(sequence, file.name)
    except InputError as exc:
        print(f"{file}: {exc}", file=sys.stderr)
        return ReturnCode.BAD_INPUT
    print(f"{file}: {len(sequence.items)} {sequence.word}s, {'with' if sequence.home else 'without'} home")
    return 0


if __name__ == "__main__":
    sys.exit(main())
