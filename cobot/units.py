"""Detection of numbers in the wrong unit: degrees for radians, millimetres for metres."""

from __future__ import annotations

import math

DEGREES_FROM_RAD = 9.5
"""No angle is more than one and a half turns: a larger one is likely to be in degrees."""
MAX_POSE_ANGLE_RAD = DEGREES_FROM_RAD
DEGREES_TO_RAD = 720.0
"""Limit of an angle in degrees: two turns. A larger number is not an angle in any unit."""
MILLIMETRES_FROM_M = 50.0
"""No slide of an arm is that long: a larger position is likely to be in millimetres."""
MAX_TIP_M = 10.0
"""No tool is longer: a larger coordinate of its tip is likely to be in millimetres."""
MILLIMETRES_TO_M = 1e4
FAR_M = 10.0
"""Largest reach of a TCP, m. A coordinate beyond it that is out of reach is likely to be in millimetres."""
DEGREES = "these look like degrees, angles are in rad"


def require_angle(value: float, most_rad: float = MAX_POSE_ANGLE_RAD) -> float:
    """Return an angle in rad, after checking its size.

    Raises:
        ValueError: It is beyond `most_rad`. The error gives the angle that it would be if meant in degrees.
    """
    if abs(value) <= most_rad:
        return value
    advice = ""
    if abs(value) <= DEGREES_TO_RAD:
        advice = f"; this looks like degrees, {value:g} degrees are {math.radians(value):.6g} rad"
    raise ValueError(f"is {value:g} rad, allowed is -{most_rad:g} to {most_rad:g} rad{advice}")


def require_way(value: float, most_m: float) -> float:
    """The value, which is a coordinate, m.

    Raises:
        ValueError: it is beyond `most_m`, with what it is from millimetres.
    """
    if abs(value) <= most_m:
        return value
    advice = ""
    if abs(value) <= MILLIMETRES_TO_M:
        advice = f"; this looks like millimetres, {value:g} mm are {1e-3 * value:g} m"
    raise ValueError(f"is {value:g} m, allowed is -{most_m:g} to {most_m:g} m{advice}")
