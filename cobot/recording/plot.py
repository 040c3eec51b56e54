"""Draws a recording as an SVG file that consists of lines and text."""

from __future__ import annotations

from html import escape

import numpy as np

from cobot.recording.events import mode_name
from cobot.recording.reader import Cycles
from cobot.types import Array

WIDTH, HEIGHT = 1000, 180
LEFT, TOP, GAP = 70, 60, 30
COLOURS = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#777777")
"""Colours of the lines. People with colour blindness can also distinguish them (P. Tol)."""
MAX_POINTS = 2000
"""Maximum number of points in a line. For each interval between two points, the smallest and the largest
value are drawn.
"""


def svg_of(cycles: Cycles) -> str:
    """Draw positions, velocities, torques and tracking errors over time, with modes and events."""
    charts = [
        ("position, rad", cycles.position),
        ("velocity, rad/s", cycles.velocity),
        ("torque, N·m", cycles.effort),
        ("commanded − measured position, rad", cycles.commanded - cycles.position),
    ]
    height = TOP + len(charts) * (HEIGHT + GAP) + 20
    span_s = max(float(cycles.times_s[-1]), cycles.period_s)
    parts = [
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {LEFT + WIDTH + 110} {height}" '
            'font-family="sans-serif" font-size="12">'
        ),
        (
            f'<rect width="100%" height="100%" fill="white"/><text x="{LEFT}" y="20" font-size="15">'
            f"{escape(cycles.robot)}: {escape(cycles.reason)}, {span_s:.2f} s</text>"
        ),
        *_modes(cycles, span_s, height),
    ]
    for index, (name, rows) in enumerate(charts):
        parts += _chart(name, cycles.times_s, rows, TOP + index * (HEIGHT + GAP), span_s)
    for joint, name in enumerate(cycles.joint_names):
        y, colour = TOP + 15 + 18 * joint, COLOURS[joint % len(COLOURS)]
        parts.append(f'<text x="{LEFT + WIDTH + 10}" y="{y}" fill="{colour}">{escape(name)}</text>')
    return "\n".join([*parts, "</svg>\n"])


def _chart(name: str, times_s: Array, rows: Array, top: float, span_s: float) -> list[str]:
    finite = rows[np.isfinite(rows)]
    low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
    if high - low < 1e-9:
        low, high = low - 0.5, high + 0.5
    parts = [
        f'<rect x="{LEFT}" y="{top}" width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#bbb"/>',
        f'<text x="{LEFT}" y="{top - 6}">{escape(name)}</text>',
        *(
            f'<text x="{LEFT - 6}" y="{y}" text-anchor="end">{value:.4g}</text>'
            for y, value in ((top + 10, high), (top + HEIGHT, low))
        ),
    ]
    for tick in _ticks(span_s):
        x = LEFT + WIDTH * tick / span_s
        parts.append(f'<line x1="{x:.1f}" y1="{top}" x2="{x:.1f}" y2="{top + HEIGHT}" stroke="#eee"/>')
        parts.append(f'<text x="{x:.1f}" y="{top + HEIGHT + 14}" text-anchor="middle">{tick:g} s</text>')
    for joint in range(rows.shape[1]):
        chosen = _thinned(rows[:, joint])
        x = LEFT + WIDTH * times_s[chosen] / span_s
        y = top + HEIGHT * (high - rows[chosen, joint]) / (high - low)
        good = np.isfinite(y)
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x[good], y[good], strict=True))
        colour = COLOURS[joint % len(COLOURS)]
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.2"/>')
    return parts


def _modes(cycles: Cycles, span_s: float, height: float) -> list[str]:
    """SVG elements: a line with the new mode's name at each change of the mode, and a dot for each
    intervention.
    """
    begun = np.flatnonzero(np.diff(cycles.modes, prepend=-1))
    parts = []
    for index in begun:
        x = LEFT + WIDTH * cycles.times_s[index] / span_s
        parts.append(
            f'<line x1="{x:.1f}" y1="38" x2="{x:.1f}" y2="{height - 20}" stroke="#999" '
            f'stroke-dasharray="3 3"/><text x="{x + 3:.1f}" y="40" font-size="10">'
            f"{escape(mode_name(int(cycles.modes[index])))}</text>"
        )
    for event in cycles.events:
        x = LEFT + WIDTH * event.time_s / span_s
        said = escape(f"{event.time_s:.3f} s {event.kind} {event.mode} {event.text}".strip())
        parts.append(f'<circle cx="{x:.1f}" cy="48" r="3" fill="#d33"><title>{said}</title></circle>')
    return parts


def _thinned(values: Array) -> np.ndarray:
    """Indices of the values that are drawn: the smallest and the largest one in each interval."""
    if len(values) <= MAX_POINTS:
        return np.arange(len(values))
    stretches = np.array_split(np.arange(len(values)), MAX_POINTS // 2)
    extremes = [(each[values[each].argmin()], each[values[each].argmax()]) for each in stretches]
    return np.unique(np.array([0, len(values) - 1, *np.ravel(extremes)]))


def _ticks(span_s: float) -> Array:
    """About six round times for the labels of the axis."""
    raw = span_s / 6.0
    size = 10.0 ** np.floor(np.log10(raw))
    step = next(each * size for each in (1.0, 2.0, 5.0, 10.0) if each * size >= raw)
    return np.arange(0.0, span_s + 1e-9, step)
