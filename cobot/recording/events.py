"""The events of a run, which are derived from its cycles: modes, reasons, faults, e-stops, motions, sessions
and interventions of the safety layer.

Code that adds a new kind of event appends it to the result of `events_of`. All events are written to the
topic /events of a recording.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from cobot.ipc.layout import Intervention, MotionResult
from cobot.types import LoopMode

LATCHED = (LoopMode.FAULT, LoopMode.ESTOP)
ENDS = {
    int(MotionResult.ARRIVED): "arrived",
    int(MotionResult.MET): "ended by its condition",
    int(MotionResult.STOPPED): "stopped on its path",
    int(MotionResult.STOPPED_ASIDE): "stopped off its path",
    int(MotionResult.FAILED): "failed",
}


EVENT_KINDS = frozenset({"mode", "reason", "fault", "estop", "motion", "session", "intervention"})


@dataclass(frozen=True, slots=True)
class RunEvent:
    """One event of a run.

    Attributes:
        kind: one of `EVENT_KINDS`.
        mode: mode of the robot since this event.
        text: human-readable description, which gives the reason, the number or the result.
    """

    cycle: int
    monotonic_ns: int
    kind: str
    mode: str
    text: str


def mode_name(mode: int) -> str:
    """The name of a mode, or its number if it has no name."""
    return LoopMode(mode).name if mode in LoopMode.__members__.values() else str(mode)


def events_of(records: np.ndarray, before: np.ndarray | None, reasons: Mapping[int, str]) -> list[RunEvent]:
    """The events that occur within these records.

    Args:
        records: array of `cobot.ipc.records.record_dtype`, in order.
        before: record before the first one. With None, the mode of the first record is reported as an event.
        reasons: sentences of the notes by their numbers.
    """
    if not len(records):
        return []
    first = records[:1] if before is None else before.reshape(1)
    previous = np.concatenate([first, records[:-1]])
    changed = (records["mode"] != previous["mode"]) | (records["note"] != previous["note"])
    changed[0] |= before is None
    for name in ("motion_id", "motion_result", "session"):
        changed |= records[name] != previous[name]
    begun = records["interventions"] & ~previous["interventions"]
    if before is None:
        begun[0] = records["interventions"][0]
    found = []
    for index in np.flatnonzero(changed | (begun != 0)):
        record = records[index]
        cycle, moment_ns = int(record["number"]), int(record["monotonic_ns"])
        mode, reason = mode_name(int(record["mode"])), reasons.get(int(record["note"]), "")
        found += [
            RunEvent(cycle, moment_ns, "intervention", mode, kind.name.lower())
            for kind in Intervention
            if int(begun[index]) >> kind & 1
        ]
        found += [
            RunEvent(cycle, moment_ns, kind, mode, said)
            for kind, said in _changes(
                record, None if before is None and index == 0 else previous[index], reason
            )
        ]
    return found


def _changes(record: np.ndarray, previous: np.ndarray | None, reason: str) -> Iterator[tuple[str, str]]:
    """The kind and the text of each change between a record and the previous one.

    Args:
        previous: previous record; None if it is unknown.
    """
    if previous is None:
        yield "mode", reason
        return
    motion, session = int(record["motion_id"]), int(record["session"])
    result = int(record["motion_result"])
    if motion != previous["motion_id"] and motion:
        yield "motion", f"motion {motion} begun"
    if session != previous["session"]:
        if previous["session"]:
            yield "session", f"session {int(previous['session'])} ended"
        if session:
            yield "session", f"session {session} begun"
    mode = int(record["mode"])
    if mode != previous["mode"]:
        if mode in LATCHED:
            yield mode_name(mode).lower(), reason
        yield "mode", reason
    elif record["note"] != previous["note"]:
        yield "reason", reason
    if result != previous["motion_result"] and result in ENDS:
        yield "motion", f"motion {motion} {ENDS[result]}"


def latched_in(records: np.ndarray, before: np.ndarray | None) -> list[tuple[int, LoopMode]]:
    """The cycles in which a fault or an e-stop began, each with the mode that began.

    Args:
        before: last record before these records; None if it is unknown. The mode of the first record is then
            assumed to have begun earlier.
    """
    if not len(records):
        return []
    modes = records["mode"]
    previous = np.concatenate([modes[:1] if before is None else before["mode"].reshape(1), modes[:-1]])
    begun = np.isin(modes, LATCHED) & ~np.isin(previous, LATCHED)
    return [(int(records["number"][index]), LoopMode(int(modes[index]))) for index in np.flatnonzero(begun)]
