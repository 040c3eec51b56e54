"""Chains: moves in the queue that are joined into one motion."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from app.services.motion.queue.moves import QueuedMove
from cobot.motions.stretches import Leg
from cobot.types import MAX_ACTIONS


def to_go(chain: Sequence[QueuedMove]) -> tuple[list[QueuedMove], list[Leg], list[float]]:
    """Return the moves, legs and blend radii of a chain, one of each per leg. The arm stops at a move without
    legs.
    """
    moves: list[QueuedMove] = []
    legs: list[Leg] = []
    radii: list[float] = []
    for move in chain:
        if move.stops_before and radii:
            radii[-1] = 0.0
        moves += [move] * len(move.legs)
        legs += move.legs
        radii += move.radii_m
        if move.ends_motion and radii:
            radii[-1] = 0.0
    return moves, legs, radii


def head(waiting: Iterable[QueuedMove], most: int) -> list[QueuedMove]:
    """Return the first moves that can be joined into one motion with at most `most` legs.

    A move with more legs is executed alone.
    """
    found: list[QueuedMove] = []
    for move in waiting:
        most -= max(len(move.legs), 1)
        if found and (most < 0 or not may_follow(found, move)):
            break
        found.append(move)
    return found


def may_follow(before: Sequence[QueuedMove], move: QueuedMove) -> bool:
    """Whether a motion that consists of the moves `before` may continue with `move`.

    rtloop supports one condition of each kind and a limited number of actions in one motion.
    """
    if not before:
        return True
    if before[-1].ends_motion or move.begins_motion:
        return False
    if sum(each.signals.pending for each in (*before, move)) > MAX_ACTIONS:
        return False
    pausing = [each.signals for each in before if each.signals.placed.pause_while is not None]
    if move.signals.placed.pause_while is None or not pausing:
        return True
    return pausing[-1] is before[-1].signals and pausing[-1].pauses_as(move.signals)


def joinable(before: Sequence[QueuedMove], chain: Sequence[QueuedMove]) -> list[QueuedMove]:
    """Return the first moves of a chain that can be joined to a motion that consists of the moves
    `before`.
    """
    found: list[QueuedMove] = []
    for move in chain:
        if not may_follow([*before, *found], move):
            break
        found.append(move)
    return found
