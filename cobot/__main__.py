"""`cobot`, and `python -m cobot`."""

from __future__ import annotations

import atexit
import gc
import os
import sys

INTERRUPTED = 130
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Of numpy, in each process. More than one solve no equations of a robot sooner, but spin for milliseconds
after each, on the processors that the cycle and the service want."""


def main() -> int:
    """The exit status. What is imported takes long enough to be interrupted too."""
    os.environ.setdefault(BLAS_THREADS, "1")  # numpy looks when it is imported
    # What is imported stays to the end: the collector walks through it neither meanwhile nor when the process
    # ends, which would take a tenth of a second.
    gc.disable()
    atexit.register(gc.freeze)
    try:
        from cobot.launch.cli import main as run

        gc.freeze()
        gc.enable()
        return run()
    except KeyboardInterrupt:
        print("cobot: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    raise SystemExit(main())
