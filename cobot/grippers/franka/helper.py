"""A process with a connection to the hand: `python helper.py`. It imports nothing from cobot.

Each line of its input is a library call, [NAME, ARGUMENT, ...]. The first call is ["connect", ADDRESS]. Each
line of its output is an answer: {"ok": RESULT}, {"failed": TEXT} for a command that the hand rejects, or
{"lost": TEXT}, after which the process ends. The process also ends when its input ends.
"""

from __future__ import annotations

import json
import sys
from typing import Any


def main() -> None:
    """Serve calls until the input ends."""
    import pylibfranka

    errors = pylibfranka.FrankaException, RuntimeError, OSError, ValueError, TypeError
    hand: Any = None
    found: Any
    for line in sys.stdin:
        name, *arguments = json.loads(line)
        try:
            if name == "connect":
                hand, found = pylibfranka.Gripper(*arguments), True
            else:
                found = getattr(hand, name)(*arguments)
            if name == "read_once":
                found = [found.width, found.max_width, bool(found.is_grasped), found.temperature]
            tell(ok=found)
        except pylibfranka.CommandException as exc:
            tell(failed=str(exc))
        except errors as exc:
            tell(lost=str(exc))
            return


def tell(**answer: Any) -> None:
    """Print a line."""
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
