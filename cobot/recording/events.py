"""What happened in a run, as far as the cycles tell: modes, their reasons, interventions of the safety layer.

Whoever knows of more events adds them to what `events_of` gives: all of them go into /events of a recording.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cobot.ipc.layout import Intervention
from cobot.types import LoopMode

LATCHED = (LoopMode.FAULT, LoopMode.ESTOP)


@dataclass(frozen=True, slots=True)
class Event:
    """One moment.

    Attributes:
        kind: mode, reason or intervention.
        mode: in which the robot was from then on.
        text: for people: why, or which intervention.
    """

    cycle: int
    monotonic_ns: int
    kind: str
    mode: str
    text: str


def mode_name(mode: int) -> str:
    """Its name, or its number if it has none."""
    return LoopMode(mode).name if mode in LoopMode.__members__.values() else str(mode)


def events_of(records: np.ndarray, before: np.ndarray | None, reasons: Mapping[int, str]) -> list[Event]:
    """The events within records.

    Args:
        records: of `cobot.ipc.records.record_dtype`, in order.
        before: the record before the first one; None: the first one begins with its mode.
        reasons: the notes' sentences by their numbers.
    """
    if not len(records):
        return []
    first = records[:1] if before is None else before.reshape(1)
    previous = np.concatenate([first, records[:-1]])
    changed = (records["mode"] != previous["mode"]) | (records["note"] != previous["note"])
    changed[0] |= before is None
    begun = records["interventions"] & ~previous["interventions"]
    if before is None:
        begun[0] = records["interventions"][0]
    found = []
    for index in np.flatnonzero(changed | (begun != 0)):
        record = records[index]
        cycle, moment_ns = int(record["number"]), int(record["monotonic_ns"])
        mode, reason = mode_name(int(record["mode"])), reasons.get(int(record["note"]), "")
        found += [
            Event(cycle, moment_ns, "intervention", mode, kind.name.lower())
            for kind in Intervention
            if int(begun[index]) >> kind & 1
        ]
        if changed[index]:
            is_mode = (before is None and index == 0) or record["mode"] != previous[index]["mode"]
            found.append(Event(cycle, moment_ns, "mode" if is_mode else "reason", mode, reason))
    return found


def latched_in(records: np.ndarray, before: np.ndarray | None) -> list[tuple[int, LoopMode]]:
    """The cycles in which a fault or an e-stop began, and which of the two.

    Args:
        before: as for `events_of`; None: what the first record is in has begun earlier.
    """
    if not len(records):
        return []
    modes = records["mode"]
    previous = np.concatenate([modes[:1] if before is None else before["mode"].reshape(1), modes[:-1]])
    begun = np.isin(modes, LATCHED) & ~np.isin(previous, LATCHED)
    return [(int(records["number"][index]), LoopMode(int(modes[index]))) for index in np.flatnonzero(begun)]
