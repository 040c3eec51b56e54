"""Sends targets as requests: a single target, or several targets without a stop between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from cobot.client import Client
from cobot.client.pallets import PalletPlace
from cobot.runner.targets import ArcTarget, JointTarget, NamedTarget, Target


def go(
    client: Client, chain: Sequence[Target], frames: Mapping[str, PalletPlace] | None = None
) -> dict[str, Any]:
    """Move to the last target of a chain. The arm passes the other targets without a stop. Returns when the
    last target is reached.

    Args:
        frames: places of pallets by `frame_id`. Targets may be relative to these places.

    Raises:
        CobotError: the service's error, see `Client`.
    """
    bodies = [resolve(target.body(), frames or {}) for target in chain]
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


def resolve(body: dict[str, Any], frames: Mapping[str, PalletPlace]) -> dict[str, Any]:
    """The body of a motion request, with poses in a frame that the service knows. If the body's `frame_id` is
    a place of a pallet, its poses are converted from the frame of this place.
    """
    place = frames.get(body.get("frame_id", ""))
    return body if place is None else place.resolve(body)
