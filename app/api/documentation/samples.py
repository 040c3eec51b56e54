"""Sample files that the documentation offers for uploads. Each can be uploaded unchanged."""

from __future__ import annotations

import json

SAMPLES_PATH = "/docs/samples"
_HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
_ROWS = [(0.0, _HOME), (2.0, [0.2, 0.15, 0.0, -1.4, 0.0, 1.45, 0.0]), (4.0, _HOME)]
_CSV = "\n".join(
    [
        ",".join([*(f"joint{n}" for n in range(1, len(_HOME) + 1)), "t"]),
        *(",".join(f"{value:.5f}" for value in (*joints, time_s)) for time_s, joints in _ROWS),
        "",
    ]
)
_SEQUENCE = {
    "home": {"joints": _HOME, "speed": 0.5},
    "waypoints": [
        {"joints": [0.3, 0.2, 0.0, -1.3, 0.0, 1.4, 0.0], "speed": 0.5, "label": "aside"},
        {"named": "home", "speed": 0.5},
    ],
}
_LUA = """-- Moves aside and home again, and reports both. See docs/lua.md.
movej({ 0.3, 0.2, 0.0, -1.3, 0.0, 1.4, 0.0 }, 0.5)
textmsg("aside, joint 1 at", get_joint_positions()[1])
move_named("home", 0.5)
textmsg("at home")
"""
SAMPLES = {
    "trajectory.csv": ("text/csv", _CSV),
    "sequence.json": ("application/json", json.dumps(_SEQUENCE, indent=2) + "\n"),
    "program.lua": ("text/plain; charset=utf-8", _LUA),
}
"""The media type and the text of each sample, by file name."""


def link(name: str) -> str:
    """Return a link to a sample, in Markdown."""
    return f"[{name}]({SAMPLES_PATH}/{name})"
