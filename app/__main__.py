"""`python -m app`: the web service of one robot, as `cobot run` starts it."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys

from cobot.access.authentication import FLEET_TOKEN_VARIABLE, ROS_TOKEN_VARIABLE
from cobot.launch.process import Niceness, die_with_parent, in_words, set_niceness


def start() -> int:
    # These imports take some seconds, during which the supervisor might die unnoticed.
    from app.memory import share_arenas

    share_arenas()
    from app.arguments import read_arguments
    from app.services.motion.planning_blanks import planning_blanks

    arguments = read_arguments()
    ros_token = os.environ.pop(ROS_TOKEN_VARIABLE, None)  # not inherited by processes that start here
    fleet_token = os.environ.pop(FLEET_TOKEN_VARIABLE, None)
    blanks = planning_blanks(arguments.config)
    from app.server import main

    return main(arguments, ros_token, fleet_token, blanks)


if __name__ == "__main__":
    atexit.register(gc.freeze)  # same reason as in `cobot.__main__`
    die_with_parent(signal.SIGTERM)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # until the service can read its configuration again
    set_niceness(Niceness.PROMPT, session=True)
    gc.disable()  # until all permanent objects exist: see `app.lifetime`
    sys.exit(in_words(start))
