"""Records of a robot's recording in shared memory: one record per cycle, and one note per change of mode,
with its reason.

The supervisor creates a file in /dev/shm next to the file of the state. It contains:

header    constant: magic, layout, dof, places of the rings, period
status    the recorder writes: its status
notes     rtloop writes: a ring of sentences, each with the first cycle to which it applies
fresh     rtloop writes, every cycle: a ring of the last seconds
history   the recorder writes: a ring of the last minutes, copied from `fresh`

There are two rings because rtloop must map and lock all memory that it writes in a cycle. The ring `fresh`
has only some megabytes, independent of the size of the history. `cobot.ipc.ring` reads and writes the rings.
"""

from __future__ import annotations

import numpy as np

from cobot.ipc.layout import TEXT, Phase
from cobot.ipc.state_fields import RECORDED

MAGIC = b"COBOTREC"
FRESH_BYTES = 8_000_000
"""Size of the ring `fresh`. It holds about 18 s for seven joints at 1 kHz. The recorder may pause for this
time without losing a cycle.
"""
HISTORY_BYTES = 53_800_000
"""Maximum size of the history, even if `recording.ring_s` needs more. It holds 122 s for seven joints at 1
kHz.
"""
NOTES = 256
NAME = "S64"
TIMED = (Phase.WAKEUP, Phase.READ, Phase.UPDATE, Phase.WRITE)
"""The phases whose durations are in a record, in this order."""

OWN = (
    ("note", "u4", ()),  # number of the newest note; 0 if there is none
    ("interventions", "u4", ()),  # by the safety layer in this cycle: one bit per `Intervention`
    ("phases_ns", "u4", (len(TIMED),)),
    ("fresh", "u1", ()),  # whether the robot was read in this cycle
)
"""Fields of a record that are not in the state block."""


def record_dtype(dof: int) -> np.dtype:
    """The record of a cycle. It contains the recorded fields of the state block, in the same units and
    frames, and the fields in `OWN`.

    Positions are exact. Fields that are only displayed have the precision of float32. The widest fields come
    first, so that each field is aligned.
    """
    fields = [*((field.name, field.recorded, field.shape(dof)) for field in RECORDED), *OWN]
    fields.sort(key=lambda field: -np.dtype(field[1]).itemsize)
    padding = -np.dtype(fields).itemsize % 8
    return np.dtype(
        [
            ("number", "u8"),  # the state's `cycle`; increases from record to record in a ring
            *fields,
            *([("padding", "u1", (padding,))] if padding else []),
            ("checksum", "u8"),  # XXH64 of all fields before it
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
        ("monotonic_ns", "i8"),  # last heartbeat
        ("handled", "u8"),  # last cycle that was searched for faults and e-stops
        ("lost", "u8"),  # cycles overwritten before the recorder read them, since rtloop started
        ("recording", "u8"),  # 1 while a continuous recording runs
        ("first", "u8"),  # first cycle of the continuous recording
        ("next", "u8"),  # first cycle that is not in a finished file yet
        ("part", "u8"),  # number of the file that is being written
        ("name", "S128"),  # name of the continuous recording, without the part
        ("files", "u8"),
        ("bytes", "u8"),
        ("problem", "S200"),  # the reason why nothing can be written; "" if writing works
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
