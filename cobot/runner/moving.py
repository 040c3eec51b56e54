"""Targets as requests: one alone, or several that are gone through without a stop."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from cobot.client import Client
from cobot.runner.schema import AnyTarget, ArcTarget, JointTarget, NamedTarget


def go(client: Client, chain: Sequence[AnyTarget]) -> dict[str, Any]:
    """Go to the last target of a chain, through the others without a stop; returns on arrival.

    Raises:
        CobotError: the service's, see `Client`.
    """
    bodies = [target.body() for target in chain]
    if len(chain) > 1:
        return client.move_sequence(bodies, [target.radius for target in chain[:-1]])
    (target,), (body,) = chain, bodies
    answer: dict[str, Any]
    if isinstance(target, JointTarget):
        answer = client.move_joints(**body)
    elif isinstance(target, NamedTarget):
        answer = client.move_named(**body)
    elif isinstance(target, ArcTarget):
        answer = client.move_arc(**body)
    else:
        answer = client.move_pose(**body)
    return answer
