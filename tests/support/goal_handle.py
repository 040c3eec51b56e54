"""What an action sees of its goal, without a graph."""

from __future__ import annotations

import asyncio
from typing import Any

from app.graph.actions import GoalStatus


class ToldHandle:
    """In the place of `app.graph.actions.GoalHandle`; remembers what the client was told."""

    def __init__(self) -> None:
        self.goal_id = "0" * 32
        self.cancel_requested = asyncio.Event()
        self.status = GoalStatus.UNKNOWN
        self.accepted = False
        self.told: list[dict[str, Any]] = []

    def accept(self) -> None:
        self.accepted = True

    def feedback(self, values: dict[str, Any]) -> None:
        self.told.append(values)
