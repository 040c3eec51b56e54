"""The motions with force of the REST client."""

from __future__ import annotations

from typing import Any

from cobot.client.connection import Json
from cobot.client.jobs import JobHandle
from cobot.client.moves import Moves


class ForceMoves(Moves):
    """Motions with force.

    Their arguments are the fields of POST /robot/force/...: `direction`, `frame`, `force`, `max_force`,
    `speed`, `max_distance`, `max_time_s`, `retract`, `if_not_met`, and the fields of each motion. They return
    when the arm has stopped. The answer contains `stopped_by` and `contact`. With `wait=False`, they return a
    `JobHandle` immediately.
    """

    def press(self, force: float, *, wait: bool = True, **how: Any) -> Json | JobHandle:
        """Approach until contact, then hold a force (N) for `duration_s`."""
        return self._force("press", wait, force=force, **how)

    def follow(self, force: float, motion: Json, *, wait: bool = True, **how: Any) -> Json | JobHandle:
        """Approach until contact, then move along a path and hold the force, N.

        Args:
            motion: a body of POST /robot/move/pose with planner lin, circ or polyline.
            how: `max_deviation`, m, and the fields that all motions with force have.
        """
        return self._force("follow", wait, force=force, motion=motion, **how)

    def search(self, force: float, *, wait: bool = True, **how: Any) -> Json | JobHandle:
        """Approach until contact, then search for a hole or an edge with a force, N.

        Args:
            how: `pattern`, `radius`, `pitch`, `angle`, `search_speed`, `drop`, `target`, `tolerance`,
                `until`, and the fields that all motions with force have.
        """
        return self._force("search", wait, force=force, **how)

    def insert(self, force: float, depth: float, *, wait: bool = True, **how: Any) -> Json | JobHandle:
        """Search for a hole with a force (N), then push into the hole to a depth (m).

        Args:
            how: `compliance`, and the fields of `search`.
        """
        return self._force("insert", wait, force=force, depth=depth, **how)

    def _force(self, kind: str, wait: bool, **body: Any) -> Json | JobHandle:
        return self._motion(f"/robot/force/{kind}", body, wait)
