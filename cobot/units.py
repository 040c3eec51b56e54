"""Detection of numbers in the wrong unit: degrees for radians, millimetres for metres."""

from __future__ import annotations

import math

DEGREES_FROM_RAD = 9.5
"""Largest plausible angle in rad: one and a half turns. A larger value is probably in degrees."""
MAX_POSE_ANGLE_RAD = DEGREES_FROM_RAD
DEGREES_TO_RAD = 720.0
"""Largest plausible angle in degrees: two turns. A larger number is not an angle in any unit."""
MILLIMETRES_FROM_M = 50.0
"""Largest plausible position of a linear joint, m. A larger value is probably in millimetres."""
MAX_TIP_M = 10.0
"""Largest plausible coordinate of a tool's tip, m. A larger value is probably in millimetres."""
MILLIMETRES_TO_M = 1e4
FAR_M = 10.0
"""Largest plausible reach of a TCP, m. An unreachable coordinate beyond this is probably in millimetres."""
DEGREES = "these look like degrees; angles are in rad"


def require_angle(value: float, most: float = MAX_POSE_ANGLE_RAD) -> float:
    """Return an angle in rad, after checking its size.

    Raises:
        ValueError: the angle is beyond `most`. The message converts it from degrees if it looks like
            degrees.
    """
    if abs(value) <= most:
        return value
    advice = ""
    if abs(value) <= DEGREES_TO_RAD:
        advice = f"; this looks like degrees: {value:g} degrees are {math.radians(value):.6g} rad"
    raise ValueError(f"is {value:g} rad, allowed: -{most:g} to {most:g} rad{advice}")


def require_way(value: float, most: float) -> float:
    """Return a coordinate in m, after checking its size.

    Raises:
        ValueError: the coordinate is beyond `most`. If the value looks like millimetres, the message
            converts it.
    """
    if abs(value) <= most:
        return value
    advice = ""
    if abs(value) <= MILLIMETRES_TO_M:
        advice = f"; this looks like millimetres: {value:g} mm are {1e-3 * value:g} m"
    raise ValueError(f"is {value:g} m, allowed: -{most:g} to {most:g} m{advice}")
