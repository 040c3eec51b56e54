"""Force steps. Each contains the body of a POST /robot/force/... request."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cobot.client import Client
from cobot.client.pallets import PalletPlace
from cobot.runner.moving import resolve
from cobot.runner.steps import FORCE_STEPS, ForceStep
from cobot.strict import shown


def name_of(step: ForceStep) -> str:
    """The name of a force motion: press, follow, search or insert."""
    return next(name for name, kind in FORCE_STEPS.items() if isinstance(step, kind))


def body_of(step: ForceStep) -> dict[str, Any]:
    """The body of the step's request, with the fields that the step gives."""
    body: dict[str, Any] = step.model_dump(exclude_unset=True, by_alias=True)[name_of(step)]
    return body


def describe_force(step: ForceStep) -> str:
    """A force motion as text: `press (force 10, duration_s 1)`."""
    given = ", ".join(f"{name} {shown(value)}" for name, value in body_of(step).items())
    return f"{name_of(step)} ({given})"


def run_force(
    client: Client, step: ForceStep, frames: Mapping[str, PalletPlace] | None = None
) -> dict[str, Any]:
    """Execute a force motion. Returns the answer when the arm has stopped.

    Args:
        frames: places of pallets by `frame_id`. The path of `follow` may be relative to one of these places.

    Raises:
        CobotError: the service's error, see `Client`.
    """
    body = body_of(step)
    if "motion" in body:
        body["motion"] = resolve(body["motion"], frames or {})
    answer: dict[str, Any] = getattr(client, name_of(step))(**body)
    return answer


def describe_end(answer: Mapping[str, Any]) -> str:
    """The result of a force motion as text: `duration after 2.31 s, contact at 0.030 m, 10.0 N held`."""
    words = [f"{answer['stopped_by']} after {answer['duration_s']:.2f} s"]
    contact, held_n = answer["contact"], answer["force_n"]
    words.append("no contact" if contact is None else f"contact at {contact['distance_m']:.3f} m")
    if held_n is not None:
        words.append(f"{held_n:.1f} N held")
    return ", ".join(words)
