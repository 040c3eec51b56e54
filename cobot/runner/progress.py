"""The reports about the progress that the runner sends to the service before each step, and the service's
answers.
"""

from __future__ import annotations

import json
import os
import sys
from typing import Any

from cobot.errors import CobotError

Report = dict[str, Any]


class Progress:
    """The pipes to the service that has started the runner. A runner that was started by hand has no pipes
    and never waits.

    Args:
        told: descriptor that receives each step as a line of JSON.
        answers: descriptor from which answers are read; None if the runner must not wait for answers.

    Attributes:
        behind: number of the latest step of the outermost list that was completed; 0 before the first one.
    """

    def __init__(self, told: int | None, answers: int | None) -> None:
        self._told = told
        self._answers = None if answers is None else os.fdopen(answers, "rb")
        self._place: Report = {}
        self.behind = 0

    def tell(self, place: Report, *, asking: bool = False, within: bool = False) -> None:
        """Report a step.

        Args:
            place: `iteration`, `n_iterations`, `waypoint`, `n_waypoints`; `step` and `share` of a sequence.
            within: whether the report is made by `ask_paused_s`, which is called during a step.
        """
        self._place = place
        self._write({**place, "behind": self.behind, "asking": asking, "within": within})

    def _write(self, line: Report) -> None:
        if self._told is None:
            return
        try:
            os.write(self._told, json.dumps(line).encode() + b"\n")
        except BrokenPipeError:  # the service has ended, which the next request will report
            print("the service no longer reads the progress", file=sys.stderr)

    def fail(self, error: CobotError) -> None:
        """Report the error that ends the run: its code, details and findings."""
        failed = {"code": error.code, **error.details}
        self._write({"failed": failed, "checks": (error.explain or {}).get("checks", [])})

    def ask(self, place: Report) -> int | None:
        """Report a step, and wait until the service permits it. If the program must continue at a different
        step, returns that step.
        """
        self.tell(place, asking=self._answers is not None)
        waypoint: int | None = self._answer().get("waypoint")
        return waypoint

    def ask_paused_s(self) -> float:
        """The total time that the program has been paused, in seconds. If it is paused now, this waits until
        it continues.
        """
        self.tell(self._place, asking=self._answers is not None, within=True)
        return float(self._answer().get("paused_s", 0.0))

    def _answer(self) -> Report:
        line = self._answers.readline() if self._answers is not None else b""  # empty: the service has ended
        answer: Report = json.loads(line) if line else {}
        return answer
