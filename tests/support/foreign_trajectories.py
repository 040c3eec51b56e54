"""Timed trajectories as others make them: trapezoids, and what MoveIt's TOTG makes of waypoints.

TOTG (Kunz and Stilman, "Time-Optimal Trajectory Generation for Path Following with Bounded Acceleration and
Velocity", RSS 2012) runs along straight lines with circular blends, at all times at one of its limits of
velocity and acceleration, so that its acceleration jumps: where the limiting joint changes, and where lines
meet circles.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np

from cobot.types import Array, JointLimits

BLEND_RAD = 0.1
"""MoveIt's path_tolerance: how far a blend may be from its corner."""
BISECTIONS = 24
GRID_ERROR = 0.01
"""What exceeds a limit by more than this share, between two places of the grid, is none of TOTG's."""

Piece = tuple[float, Callable[[Array], tuple[Array, Array, Array]]]
"""Its length, and position, first and second derivative at places along it, each (n, dof)."""


def trapezoid(times_s: Array, distance: float, speed: float, duration_s: float) -> Array:
    """Positions of a motion with constant acceleration, speed and deceleration; held outside."""
    ramp_s = duration_s - distance / speed
    t = np.clip(times_s, 0.0, duration_s)
    first, last = 0.5 * speed * t**2 / ramp_s, distance - 0.5 * speed * (duration_s - t) ** 2 / ramp_s
    middle = speed * (t - 0.5 * ramp_s)
    return np.where(t < ramp_s, first, np.where(t < duration_s - ramp_s, middle, last))


def problems(
    limits: JointLimits,
    start: Array,
    share: float,
    step_s: float,
    count: int,
    seed: int,
    most_legs: int = 5,
    grid: int = 400,
) -> Iterator[Array]:
    """What TOTG sends for some legs of up to 0.6 rad a joint, at a share of the limits."""
    random = np.random.default_rng(seed)
    velocity, acceleration = share * limits.max_velocity, share * limits.max_acceleration
    while count > 0:
        legs = random.uniform(-0.6, 0.6, (random.integers(1, most_legs + 1), limits.dof))
        waypoints = start + np.cumsum(np.vstack([np.zeros(limits.dof), legs]), axis=0)
        waypoints = np.clip(waypoints, 0.9 * limits.min_position, 0.9 * limits.max_position)
        rows = totg(waypoints, velocity, acceleration, step_s, grid)
        used = max(
            (np.abs(rows[:, 1 + limits.dof : 1 + 2 * limits.dof]) / velocity).max(),
            np.sqrt((np.abs(rows[:, 1 + 2 * limits.dof :]) / acceleration).max()),
        )
        if used > 1.0 + GRID_ERROR:
            continue
        rows *= np.repeat([used, 1.0, 1.0 / used, 1.0 / used**2], [1, *[limits.dof] * 3])
        rows[[0, -1], 1 + limits.dof :] = 0.0
        count -= 1
        yield rows


def totg(waypoints: Array, velocity: Array, acceleration: Array, step_s: float, grid: int = 400) -> Array:
    """What TOTG sends, shape (n, 1 + 3 dof): time, positions, velocities, accelerations, every `step_s`."""
    pieces = blended(waypoints)
    ends = np.cumsum([length for length, _ in pieces])
    places = np.linspace(0.0, ends[-1], grid + 1)
    squares = _phase_plane(pieces, ends, places, velocity, acceleration)
    rates = np.sqrt(squares)
    times_s = np.append(0.0, np.cumsum(2.0 * np.diff(places) / (rates[1:] + rates[:-1])))
    wanted_s = np.append(np.arange(0.0, times_s[-1] - 1e-6, step_s), times_s[-1])
    index = np.clip(np.searchsorted(times_s, wanted_s, side="right") - 1, 0, grid - 1)
    since_s = wanted_s - times_s[index]
    second = (0.5 * np.diff(squares) / np.diff(places))[index]
    rate = rates[index] + second * since_s
    at = places[index] + rates[index] * since_s + 0.5 * second * since_s**2
    q, d, dd = evaluated(pieces, ends, np.clip(at, 0.0, ends[-1]))
    accelerations = d * second[:, None] + dd * (rate**2)[:, None]
    return np.hstack([wanted_s[:, None], q, d * rate[:, None], accelerations])


def blended(waypoints: Array) -> list[Piece]:
    """The lines and the arcs between waypoints, shape (n, dof)."""
    pieces, since = [], waypoints[0]
    for before, corner, after in zip(waypoints, waypoints[1:], waypoints[2:], strict=False):
        (inward, reach), (outward, leave) = (_heading(corner - before), _heading(after - corner))
        half = 0.5 * np.arccos(np.clip(inward @ outward, -1.0, 1.0))
        if not 1e-3 < half < 0.5 * np.pi - 1e-3:
            continue
        cut = min(0.5 * reach, 0.5 * leave, BLEND_RAD * np.sin(half) / (1.0 - np.cos(half)))
        radius = cut / np.tan(half)
        begin = corner - cut * inward
        centre = corner + (outward - inward) / np.linalg.norm(outward - inward) * radius / np.cos(half)
        pieces += [_line(since, begin), _arc(centre, (begin - centre) / radius, inward, radius, 2.0 * half)]
        since = corner + cut * outward
    return [each for each in [*pieces, _line(since, waypoints[-1])] if each[0] > 1e-9]


def evaluated(pieces: list[Piece], ends: Array, places: Array) -> tuple[Array, Array, Array]:
    index = np.minimum(np.searchsorted(ends, places, side="right"), len(pieces) - 1)
    found: list[Array] = []
    for number, (length, curve) in enumerate(pieces):
        mine = index == number
        values = np.array(curve(places[mine] - (ends[number] - length)))
        if not found:
            found = [np.zeros((len(places), values.shape[2])) for _ in range(3)]
        for all_, some in zip(found, values, strict=True):
            all_[mine] = some
    return found[0], found[1], found[2]


def _heading(step: Array) -> tuple[Array, float]:
    length = float(np.linalg.norm(step))
    return step / max(length, 1e-12), length


def _line(begin: Array, end: Array) -> Piece:
    heading, length = _heading(end - begin)

    def at(places: Array) -> tuple[Array, Array, Array]:
        first = np.repeat(heading[None], len(places), axis=0)
        return begin + places[:, None] * heading, first, np.zeros_like(first)

    return length, at


def _arc(centre: Array, x: Array, y: Array, radius: float, angle: float) -> Piece:
    def at(places: Array) -> tuple[Array, Array, Array]:
        c, s = np.cos(places / radius)[:, None], np.sin(places / radius)[:, None]
        return centre + radius * (c * x + s * y), c * y - s * x, -(c * x + s * y) / radius

    return radius * angle, at


def _phase_plane(
    pieces: list[Piece], ends: Array, places: Array, velocity: Array, acceleration: Array
) -> Array:
    """The largest squares of the path's rate at its places that both limits permit, from rest to rest."""
    step = places[1]
    _, d, dd = evaluated(pieces, ends, 0.5 * (places[1:] + places[:-1]))
    d = np.where(np.abs(d) < 1e-9, 1e-9, d)
    highest = np.minimum(
        ((velocity / d) ** 2).min(axis=1), (acceleration / np.maximum(np.abs(dd), 1e-9)).min(axis=1)
    )

    def room(index: int, square: float) -> tuple[float, float]:
        """Between which second derivatives of the path's parameter all joints keep their accelerations."""
        span, bias = acceleration / np.abs(d[index]), -dd[index] * square / d[index]
        return float((bias - span).max()), float((bias + span).min())

    reach = np.minimum(np.append(highest, np.inf), np.append(np.inf, highest))
    reach[-1] = 0.0
    for index in reversed(range(len(d))):
        low, high = 0.0, float(reach[index])
        for _ in range(BISECTIONS):
            square = 0.5 * (low + high)
            slowest, fastest = room(index, square)
            if slowest <= fastest and square + 2.0 * step * slowest <= reach[index + 1]:
                low = square
            else:
                high = square
        reach[index] = low
    reach[0] = 0.0
    for index in range(len(d)):
        reach[index + 1] = min(reach[index + 1], reach[index] + 2.0 * step * room(index, reach[index])[1])
    return reach
