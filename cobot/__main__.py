"""`cobot`, and `python -m cobot`."""

from __future__ import annotations

import atexit
import gc
import os
import sys

INTERRUPTED = 130
BLAS_THREADS = "OPENBLAS_NUM_THREADS"
"""Environment variable that limits numpy's threads in each process. Additional threads do not solve a robot's
equations faster, and would afterwards spin for milliseconds on processors that the real-time loop and the
service need.
"""


def main() -> int:
    """Run the command line and return its exit status. It also handles an interrupt during the imports."""
    os.environ.setdefault(BLAS_THREADS, "1")  # numpy reads it when it is imported
    # Imported modules live until the process ends. The garbage collector skips them during the imports and at
    # exit, which saves a tenth of a second.
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
