"""`python -m rtloop`: the real-time process of one robot, as `cobot run` starts it."""

from __future__ import annotations

import atexit
import gc
import signal
import sys

from cobot.launch.process import die_with_parent, in_words


def start() -> int:
    from rtloop.main import main  # takes a second, during which the supervisor could die unnoticed

    return main()


if __name__ == "__main__":
    atexit.register(gc.freeze)  # for the same reason as in `cobot.__main__`
    die_with_parent(signal.SIGTERM)
    # otherwise the collector would scan permanent objects repeatedly; `rtloop.realtime` collects once
    gc.disable()
    sys.exit(in_words(start))
