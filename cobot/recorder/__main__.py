"""`python -m cobot.recorder`: keeps and writes recordings, as `cobot run` starts it."""

from __future__ import annotations

import atexit
import gc
import signal
import sys

from cobot.launch.process import die_with_parent, in_words


def start() -> int:
    from cobot.recorder.process import (
        main,  # takes half a second; the supervisor might end unnoticed meanwhile
    )

    return main()


if __name__ == "__main__":
    atexit.register(gc.freeze)  # same reason as in `cobot.__main__`
    die_with_parent(signal.SIGTERM)
    sys.exit(in_words(start))
