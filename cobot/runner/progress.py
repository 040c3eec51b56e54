"""The runner's progress reports to the service before each motion, and the service's answers."""

from __future__ import annotations

import json
import os
import sys
from typing import Any


class Progress:
    """The pipes to the service that started the runner. A runner started by hand has none and never waits.

    Args:
        told: descriptor to which each step is reported as a line of JSON.
        answers: descriptor from which answers are read; None if the runner must not wait for answers.

    Attributes:
        behind: waypoint that was reached last, 0 for none.
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
        except BrokenPipeError:  # the service has ended, and the next request will report that
            print("the service no longer reads the progress", file=sys.stderr)

    def ask(self, place: dict[str, int]) -> int | None:
        """Report a step and wait until it is permitted. Returns the waypoint to move to instead, if any."""
        self.tell(place, asking=self._answers is not None)
        if self._answers is None:
            return None
        line = self._answers.readline()  # empty if the service has ended
        answer: dict[str, Any] = json.loads(line) if line else {}
        waypoint: int | None = answer.get("waypoint")
        return waypoint
