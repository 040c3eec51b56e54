"""`cobot`, and `python -m cobot`."""

from __future__ import annotations

import sys

INTERRUPTED = 130


def main() -> int:
    """The exit status. What is imported takes long enough to be interrupted too."""
    try:
        from cobot.launch.cli import main as run

        return run()
    except KeyboardInterrupt:
        print("cobot: interrupted", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    raise SystemExit(main())
