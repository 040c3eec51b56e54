"""`python -m app`: the web service of one robot, as `cobot run` starts it."""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import signal
import sys
from pathlib import Path

from cobot.access.authentication import FLEET_TOKEN_VARIABLE, ROS_TOKEN_VARIABLE
from cobot.launch.process import Niceness, die_with_parent, in_words, set_niceness


def start() -> int:
    # These imports take several seconds. The supervisor could die meanwhile without being noticed.
    from app.memory import share_arenas

    share_arenas()
    from app.services.motion.planning_blanks import planning_blanks

    arguments = _read_arguments()
    ros_token = os.environ.pop(ROS_TOKEN_VARIABLE, None)  # child processes must not inherit it
    fleet_token = os.environ.pop(FLEET_TOKEN_VARIABLE, None)
    blanks = planning_blanks(arguments.config)
    from app.server import main

    return main(arguments, ros_token, fleet_token, blanks)


def _read_arguments() -> argparse.Namespace:
    """Read the arguments that `cobot run` passes to the service."""
    parser = argparse.ArgumentParser(prog="python -m app", description="The web service.")
    parser.add_argument("--config", type=Path, help="settings file (default: the one that comes with cobot)")
    parser.add_argument(
        "--source", type=Path, help="the user's own file, if the settings file is a copy of it"
    )
    parser.add_argument("--host", required=True, help="address that the socket listens on")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--fd", type=int, required=True, help="descriptor of the listening socket")
    parser.add_argument("--losses-fd", type=int, help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    atexit.register(gc.freeze)  # same reason as in `cobot.__main__`
    die_with_parent(signal.SIGTERM)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # until the service can read its configuration again
    set_niceness(Niceness.PROMPT, session=True)
    gc.disable()  # until all permanent objects exist: see `app.lifetime`
    sys.exit(in_words(start))
