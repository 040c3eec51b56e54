"""Sentences of errors about planners, made of the table of planners: a new planner changes no test."""

from __future__ import annotations

from cobot.motions.planners import users_of


def only(field: str, planner: str) -> str:
    """The end of the error about a field of `MotionRequest` that the planner does not use."""
    users = users_of(field)
    return f"is for {users if ',' in users else f'planner {users}'} only, not for {planner}"
