"""`python -m rtloop`: the real-time process of one robot, as `cobot run` starts it."""

from __future__ import annotations

import atexit
import gc
import signal
import sys

from cobot.launch.process import die_with_parent, in_words


def start() -> int:
    from rtloop.main import main  # takes a second; the supervisor might die unnoticed meanwhile

    return main()


if __name__ == "__main__":
    atexit.register(gc.freeze)  # for the same reason as in `cobot.__main__`
    die_with_parent(signal.SIGTERM)
    gc.disable()  # the collector would repeatedly scan permanent objects; `rtloop.realtime` collects once
    sys.exit(in_words(start))
