"""Checks of a controller's reports, both before the arm moves and in each cycle."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from cobot.types import Array
from rtloop.backends.ur.fields import RuntimeState, UrRobotMode
from rtloop.backends.ur.words import hindrance, mode_in_words
from rtloop.results import ACCEPTED, Accepted, Rejected

CB3_PERIOD_S = 0.008
"""A CB3 sends 125 times per second; later controllers 500 times."""
CB3 = 3
ENDED_PACKAGES = 3
"""Number of packages without cobot's program after which rtloop reports a fault. It is above 0 because the
program ends just before the first package that contains the cause, such as an emergency stop.
"""


def check_period(version: tuple[int, ...] | None, text: str, period_s: float) -> Accepted | Rejected:
    """Check that a controller sends with this period.

    Args:
        version: version of its software; None if unknown.
        text: the version as text for messages.
    """
    if version is not None and version[0] <= CB3 and period_s != CB3_PERIOD_S:
        return Rejected(
            f"the controller is a CB3 (software {text}), which sends every {CB3_PERIOD_S} s, but rt.period_s "
            f"is {period_s:g} s: set it to {CB3_PERIOD_S}"
        )
    return ACCEPTED


def check_entry(
    names: Sequence[str], here: Array, held: Array, entry_rad: float, what: str
) -> Accepted | Rejected:
    """Check that each joint is near the position at which the controller holds it.

    Args:
        here: measured or commanded positions, shape (dof,), rad.
        held: positions at which the controller holds the joints, shape (dof,), rad.
        entry_rad: maximum distance, rad.
        what: the verb for `here` in the message.
    """
    off = np.abs(here - held)
    if not np.isfinite(off).all():
        return Rejected("the controller reports a joint position that is not a number")
    joint = int(off.argmax())
    if off[joint] <= entry_rad:
        return ACCEPTED
    return Rejected(
        f"{names[joint]} {what} {off[joint]:.6g} rad away from the position at which the controller holds "
        f"it, allowed: {entry_rad} rad (robot.backend.entry_rad); check the payload, and that nothing pulls "
        "at the arm"
    )


def checks_of_state(data: Mapping[str, Any], *, is_released: bool) -> Iterator[Accepted | Rejected]:
    """Check that the controller's safety system and mode permit motion.

    Args:
        data: the values of an RTDE package.
        is_released: whether the brakes may be released for hand guiding.
    """
    if reason := hindrance(data.get("safety_status", data["safety_mode"])):
        yield Rejected(reason)
    mode = data["robot_mode"]
    if mode != UrRobotMode.RUNNING and not (is_released and mode == UrRobotMode.BACKDRIVE):
        yield Rejected(f"the robot mode: {mode_in_words(mode)}")


def checks_of_program(data: Mapping[str, Any], packages: int, cause: str) -> Iterator[Accepted | Rejected]:
    """Check that cobot's program is running on the controller.

    Args:
        packages: number of packages since the program has ended; 0 if it is connected.
        cause: possible reasons why the program has ended on its own.
    """
    if packages > ENDED_PACKAGES:
        yield Rejected(
            "cobot's program on the controller has ended: it was stopped at the teach pendant or by another "
            f"client, or {cause}"
        )
    runtime = data["runtime_state"]
    if not packages and runtime != RuntimeState.PLAYING:
        name = RuntimeState(runtime).name.lower() if runtime in set(RuntimeState) else str(runtime)
        yield Rejected(f"the program on the controller is {name}, not playing; reset the robot")
