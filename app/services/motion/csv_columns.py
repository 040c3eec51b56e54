"""Finds the columns of a CSV file with timed joint waypoints by the names in its header."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from cobot.errors import InputError
from cobot.strict import unknown_key

SHOWN_CHARACTERS = 40
TIME_NAMES = ("t", "time", "time_from_start")
_JOINT_NAME = re.compile(r"(joint|velocity|acceleration)_?([0-9]{1,3})")


@dataclass(frozen=True, slots=True)
class Columns:
    """The indices of the columns in a row."""

    names: list[str]
    time: int
    positions: list[int]
    velocities: list[int] | None
    accelerations: list[int] | None


def columns_of(header: list[str], joints: Sequence[str]) -> Columns:
    """Find the columns of a header.

    Args:
        joints: the robot's joint names, from the base to the flange.

    Raises:
        InputError: a column is unknown, occurs twice or is missing. The error gives its name.
    """
    names = [cell.strip() for cell in header]
    keys = _keys(names, joints)
    valid = [*keys.positions, TIME_NAMES[0]]
    optional = [*keys.velocities, *keys.accelerations]
    places: dict[str, int] = {}
    for index, name in enumerate(names):
        key = keys.of(name)
        if key not in valid and key not in optional:
            raise InputError(f"row 1, column {index + 1}: {unknown_key(name, [*valid, *optional])}")
        if key in places:
            raise InputError(
                f"row 1, column {index + 1}: {name!r} means the same as {names[places[key]]!r} in column "
                f"{places[key] + 1}"
            )
        places[key] = index
    missing = [key for key in valid if key not in places]
    for family in (keys.velocities, keys.accelerations):
        if any(key in places for key in family):
            missing += [key for key in family if key not in places]
    if missing:
        raise InputError(f"row 1: missing column {', '.join(missing)}; the row has {brief(', '.join(names))}")

    def group(family: list[str]) -> list[int] | None:
        return [places[key] for key in family] if family[0] in places else None

    positions = [places[key] for key in keys.positions]
    return Columns(names, places[TIME_NAMES[0]], positions, group(keys.velocities), group(keys.accelerations))


@dataclass(frozen=True, slots=True)
class _Keys:
    """The column names of a header, in joint order."""

    positions: list[str]
    velocities: list[str]
    accelerations: list[str]
    numbered: bool

    def of(self, name: str) -> str:
        """Return the key for a column's name; for an unknown name, the name itself."""
        if name.lower() in TIME_NAMES:
            return TIME_NAMES[0]
        if self.numbered:
            match = _JOINT_NAME.fullmatch(name.lower())
            return f"{match[1]}{int(match[2])}" if match else name.lower()
        known = [*self.positions, *self.velocities, *self.accelerations]
        return next((key for key in known if key.lower() == name.lower()), name)


def _keys(header: list[str], joints: Sequence[str]) -> _Keys:
    """Return the valid column names. They contain the robot's own joint names if the header contains one of
    these; otherwise they contain joint numbers.

    This way, if the robot's joints are joint_0 to joint_5, `joint_1` is not mistaken for the first joint.
    """
    own = [name.lower() for name in joints]
    numbered = own == [f"joint{n}" for n in range(1, len(own) + 1)] or not any(
        name.lower() in own for name in header
    )
    names = [str(n) for n in range(1, len(own) + 1)] if numbered else list(joints)
    rates = ("velocity", "acceleration") if numbered else ("velocity_", "acceleration_")
    positions = [f"joint{name}" if numbered else name for name in names]
    velocities, accelerations = ([f"{rate}{name}" for name in names] for rate in rates)
    return _Keys(positions, velocities, accelerations, numbered)


def brief(text: str) -> str:
    """Cut a text from the file to a readable length."""
    return text if len(text) <= SHOWN_CHARACTERS else text[:SHOWN_CHARACTERS] + "..."
