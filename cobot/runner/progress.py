"""What the runner tells the service before each motion, and what it is answered."""

from __future__ import annotations

import json
import os
import sys
from typing import Any


class Progress:
    """The pipes to the service that has started the runner; by hand there are none, and it just goes on.

    Args:
        told: descriptor to which each step is reported as a line of JSON.
        answers: descriptor from which the answers to questions come; None: nobody answers.

    Attributes:
        behind: the waypoint that was reached last, 0 for none.
    """

    def __init__(self, told: int | None, answers: int | None) -> None:
        self._told = told
        self._answers = None if answers is None else os.fdopen(answers, "rb")
        self.behind = 0

    def tell(self, place: dict[str, int], *, asking: bool = False) -> None:
        """Report a step.

        Args:
            place: `iteration`, `n_iterations`, `waypoint`, `n_waypoints`.
        """
        if self._told is None:
            return
        line = {**place, "behind": self.behind, "asking": asking}
        try:
            os.write(self._told, json.dumps(line).encode() + b"\n")
        except BrokenPipeError:  # the service is gone, and the next request will say so
            print("nobody reads the progress any more", file=sys.stderr)

    def ask(self, place: dict[str, int]) -> int | None:
        """Report a step, and wait until it may be taken; the waypoint to go to instead, if there is one."""
        self.tell(place, asking=self._answers is not None)
        if self._answers is None:
            return None
        line = self._answers.readline()  # nothing, if the service is gone
        answer: dict[str, Any] = json.loads(line) if line else {}
        waypoint: int | None = answer.get("waypoint")
        return waypoint
