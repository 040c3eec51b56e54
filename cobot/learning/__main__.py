"""`python -m cobot.learning record FILE.mcap`: records an episode of an arm that a service runs, with cameras
in the arm's scene.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from cobot.addresses import DEFAULT_URL
from cobot.client import Robot
from cobot.config import load_settings
from cobot.errors import CobotError, InputError
from cobot.learning.cameras import CAMERAS, Renderer
from cobot.learning.record import record
from cobot.robot.description import load_robot

EXIT_OK, EXIT_FAILED = 0, 1


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Returns the exit status: 0 if an episode was recorded, 1 if not, 2 for wrong usage."""
    parser = argparse.ArgumentParser("python -m cobot.learning", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="record an episode, until Ctrl-C or the end of the time")
    recording.add_argument("file", type=Path, metavar="FILE.mcap")
    recording.add_argument("--url", default=DEFAULT_URL, help="URL of the service (%(default)s)")
    recording.add_argument(
        "--config", type=Path, help="settings file of the robot, for the scene of the cameras"
    )
    recording.add_argument("--seconds", type=float, default=60.0, help="maximum duration, s (%(default)s)")
    recording.add_argument("--rate", type=float, default=30.0, help="frames per second (%(default)s)")
    recording.add_argument(
        "--task", default="", help="description of the task, for the policy that learns from it"
    )
    recording.add_argument(
        "--cameras",
        nargs="*",
        default=[],
        metavar="NAME",
        help=f"cameras to record: {', '.join(CAMERAS)}; by default none",
    )
    chosen = parser.parse_args(arguments)
    try:
        frames = _record(chosen)
    except CobotError as exc:
        print(f"learning: {exc}", file=sys.stderr)
        return EXIT_FAILED
    except OSError as exc:
        print(f"learning: {chosen.file}: {exc.strerror or exc}", file=sys.stderr)
        return EXIT_FAILED
    print(f"{chosen.file}: {frames} frames")
    return EXIT_OK


def _record(chosen: argparse.Namespace) -> int:
    if unknown := [name for name in chosen.cameras if name not in CAMERAS]:
        raise InputError(f"there is no camera {unknown[0]!r}; valid names: {', '.join(CAMERAS)}")
    description = load_robot(load_settings(chosen.config))
    renderer = Renderer(description, [CAMERAS[name] for name in chosen.cameras]) if chosen.cameras else None
    ended: list[bool] = []

    def end(number: int, frame: object) -> None:
        ended.append(True)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, end)
    with Robot(chosen.url, verbose=False) as robot:
        return record(
            robot,
            list(description.limits.names),
            chosen.file,
            seconds=chosen.seconds,
            rate_hz=chosen.rate,
            task=chosen.task,
            renderer=renderer,
            ended=lambda: bool(ended),
        )


if __name__ == "__main__":
    sys.exit(main())
