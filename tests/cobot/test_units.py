"""Numbers in other units. Oracle: the conversion, by hand."""

from __future__ import annotations

import math

import pytest

from cobot.units import require_angle, require_way


@pytest.mark.parametrize("value", [0.0, 1.5, -math.pi, 2 * math.pi, 3 * math.pi, -9.5])
def test_an_angle_of_up_to_one_and_a_half_turns_is_taken_as_it_is(value: float) -> None:
    assert require_angle(value) == value


@pytest.mark.parametrize(("value", "radians"), [(180.0, "3.14159"), (-90.0, "-1.5708"), (10.0, "0.174533")])
def test_degrees_are_recognised_and_converted(value: float, radians: str) -> None:
    with pytest.raises(ValueError, match=f"{value:g} degrees are {radians} rad$"):
        require_angle(value)


def test_what_is_no_angle_in_any_unit_is_not_called_degrees() -> None:
    with pytest.raises(ValueError, match=r"is 1e\+06 rad, allowed: -9.5 to 9.5 rad$"):
        require_angle(1e6)


def test_millimetres_are_recognised_and_converted() -> None:
    assert require_way(-100.0, 100.0) == -100.0
    with pytest.raises(
        ValueError,
        match=r"is 450 m, allowed: -100 to 100 m; this looks like millimetres: 450 mm are 0.45 m$",
    ):
        require_way(450.0, 100.0)
    with pytest.raises(ValueError, match=r"allowed: -100 to 100 m$"):
        require_way(1e9, 100.0)
