"""What stands in the recording's shared memory of a robot: a record for each cycle, and why modes changed.

A file in /dev/shm beside the state's, made by the supervisor:

    header    constant: magic, layout, dof, places of the rings, period
    status    the recorder writes: how it stands
    notes     rtloop writes: a ring of sentences, each with the cycle from which on it holds
    fresh     rtloop writes, every cycle: a ring of the last seconds
    history   the recorder writes: a ring of the last minutes, copied from `fresh`

Two rings, because what rtloop writes in a cycle has to be mapped and locked in its memory: that is some
megabytes, whatever the history holds. `cobot.ipc.ring` reads and writes them.
"""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import TEXT, Phase
from cobot.ipc.state_fields import RECORDED

MAGIC = b"COBOTREC"
FRESH_BYTES = 8_000_000
"""Some 18 s of seven joints at 1 kHz: so long a recorder may be away without losing a cycle."""
HISTORY_BYTES = 52_000_000
"""The largest history, whatever `recording.ring_s` says; with seven joints at 1 kHz 122 s."""
NOTES = 256
NAME = "S64"
TIMED = (Phase.WAKEUP, Phase.READ, Phase.UPDATE, Phase.WRITE)
"""The phases whose times are in a record, in this order."""

OWN = (
    ("note", "u4", ()),  # the number of the newest note, 0 for none
    ("interventions", "u4", ()),  # of the safety layer in this cycle: a bit for each `Intervention`
    ("phases_ns", "u4", (len(TIMED),)),
    ("fresh", "u1", ()),  # whether the robot was read in this cycle
)
"""Fields of a record that the state block does not have."""


def record_dtype(dof: int) -> np.dtype:
    """A cycle: the fields of the state block that are recorded, in its units and frames, and `OWN`.

    Positions are exact; what is only looked at has the precision of float32. The widest fields come first, so
    that each is aligned.
    """
    fields = [*((field.name, field.recorded, field.shape(dof)) for field in RECORDED), *OWN]
    fields.sort(key=lambda field: -np.dtype(field[1]).itemsize)
    padding = -np.dtype(fields).itemsize % 8
    return np.dtype(
        [
            ("number", "u8"),  # of the cycle, as the state's `cycle`: records of a ring have it in turn
            *fields,
            *([("padding", "u1", (padding,))] if padding else []),
            ("checksum", "u8"),  # XXH64 of all that stands before it
        ]
    )


NOTE = np.dtype(
    [
        ("number", "u8"),  # from 1 on
        ("cycle", "u8"),
        ("monotonic_ns", "i8"),
        ("mode", "u8"),
        ("reason", TEXT),
        ("checksum", "u8"),
    ]
)
RECORDER = np.dtype(
    [
        ("pid", "u8"),
        ("monotonic_ns", "i8"),  # its last sign of life
        ("handled", "u8"),  # up to this cycle it has looked for faults and e-stops
        ("lost", "u8"),  # cycles that it has come too late for, since rtloop's first
        ("recording", "u8"),  # 1 while a continuous recording runs
        ("first", "u8"),  # of the continuous recording: its first cycle
        ("next", "u8"),  # and the first one that is in no finished file of it yet
        ("part", "u8"),  # and the number of the file that is being written
        ("name", "S128"),  # of that recording, without the part
        ("files", "u8"),
        ("bytes", "u8"),
        ("problem", "S200"),  # why nothing can be written, "" while all is well
    ]
)
HEADER = np.dtype(
    [
        ("magic", "S8"),
        ("layout", "u4"),
        ("dof", "u4"),
        ("fresh", "u4"),  # places
        ("history", "u4"),
        ("period_s", "f8"),
        ("created_ns", "i8"),
        ("robot", NAME),
        ("joint_names", NAME, (16,)),
        ("checksum", "u8"),
    ]
)
