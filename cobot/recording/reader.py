"""Reads a recording as arrays, for plots and replays."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mcap.exceptions import McapError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore
from zstandard import ZstdError

from cobot.errors import InputError
from cobot.recording.bounds import bounded_reader
from cobot.recording.messages import CYCLE, DEFINITIONS, EVENT, JOINT_STATE
from cobot.recording.path import Marked, RecordedPath
from cobot.types import Array

MAX_SHOWN_BYTES = 200_000_000
"""Maximum size of a file whose path is shown, in bytes. Computing the path for a file of this size takes some
seconds.
"""
UNREADABLE = (McapError, ZstdError, struct.error, ValueError, KeyError, TypeError, IndexError, AssertionError)
"""Errors that the reader raises if a file is damaged or is not a recording of cobot."""

Result = TypeVar("Result")


@dataclass(frozen=True, slots=True)
class Cycles:
    """All cycles of a recording. In the shapes, n is the number of cycles.

    Attributes:
        robot, joint_names, period_s, reason: metadata of the file.
        times_s: times on the robot's clock, starting at 0, shape (n,).
        position, velocity, effort: measured positions, rad, velocities, rad/s, and efforts, N·m, shape (n,
            dof) each.
        commanded, commanded_effort: commanded positions, rad, and efforts, N·m, shape (n, dof) each.
        modes: values of `cobot.types.LoopMode`, shape (n,).
        missing: number of missing cycles between the first and the last one.
    """

    robot: str
    joint_names: list[str]
    period_s: float
    reason: str
    times_s: Array
    position: Array
    velocity: Array
    effort: Array
    commanded: Array
    commanded_effort: Array
    modes: np.ndarray
    missing: int
    events: list[Marked] = field(default_factory=list)


def read_recording(path: Path) -> Cycles:
    """Read all cycles of a file.

    Raises:
        InputError: the file cannot be read, or is not a recording of a robot; the message gives the reason.
    """
    return _read_or_reject(path, _read)


def read_path(path: Path, samples: int) -> RecordedPath:
    """Read the path of the arm at `samples` of its cycles, and all events.

    Raises:
        InputError: see `read_recording`. Also if the file is too large.
    """
    return _read_or_reject(path, lambda file: _sample_file(file, samples))


def _read_or_reject(path: Path, read: Callable[[Path], Result]) -> Result:
    try:
        return read(path)
    except OSError as exc:
        raise InputError(f"{path}: {exc.strerror or exc}") from exc
    except UNREADABLE as exc:
        raise InputError(f"{path}: is not a complete recording of cobot: {exc}") from exc


def _types() -> Typestore:
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, definition in DEFINITIONS.items():
        store.register(get_types_from_msg(definition, name))
    return store


def _sample_file(path: Path, samples: int) -> RecordedPath:
    size = path.stat().st_size
    if size > MAX_SHOWN_BYTES:
        raise InputError(
            f"{path.name}: has {size / 1e6:.0f} MB; up to {MAX_SHOWN_BYTES / 1e6:.0f} MB can be shown; "
            "use cobot plot for this file"
        )
    store = _types()
    states: list[tuple[int, bytes]] = []
    events: list[tuple[int, Marked]] = []
    with path.open("rb") as file:
        reader = bounded_reader(file)
        for _, channel, message in reader.iter_messages(["/joint_states", "/events"], log_time_order=False):
            if channel.topic == "/joint_states":
                states.append((message.log_time, message.data))
            else:
                event: Any = store.deserialize_cdr(message.data, EVENT)
                kind, mode, text = (str(getattr(event, name)) for name in ("kind", "mode", "text"))
                events.append((message.log_time, Marked(0.0, kind, mode, text)))
    if not states:
        raise ValueError("it contains no cycle")
    chosen = np.unique(np.linspace(0, len(states) - 1, samples).round().astype(int)).tolist()
    rows: list[Any] = [store.deserialize_cdr(states[index][1], JOINT_STATE) for index in chosen]
    begin_ns = states[0][0]
    return RecordedPath(
        1e-9 * np.array([states[index][0] - begin_ns for index in chosen], dtype=float),
        np.array([row.position for row in rows]),
        np.array([row.velocity for row in rows]),
        [replace(event, time_s=1e-9 * (time_ns - begin_ns)) for time_ns, event in events],
    )


def _read(path: Path) -> Cycles:
    store = _types()
    rows: dict[str, list[list[Array]]] = {"/joint_states": [], "/commanded": []}
    numbers: list[int] = []
    modes: list[int] = []
    events: list[tuple[int, Marked]] = []
    with path.open("rb") as file:
        reader = bounded_reader(file)
        about = {each.name: each.metadata for each in reader.iter_metadata()}["cobot"]
        period_s = float(about["period_s"])
        for _, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic in rows:
                state: Any = store.deserialize_cdr(message.data, JOINT_STATE)
                rows[channel.topic].append(
                    [getattr(state, name) for name in ("position", "velocity", "effort")]
                )
            elif channel.topic == "/cycle":
                cycle: Any = store.deserialize_cdr(message.data, CYCLE)
                numbers.append(int(cycle.cycle))
                modes.append(int(cycle.mode))
            elif channel.topic == "/events":
                event: Any = store.deserialize_cdr(message.data, EVENT)
                kind, mode, text = (str(getattr(event, name)) for name in ("kind", "mode", "text"))
                events.append((int(event.cycle), Marked(0.0, kind, mode, text)))
    if not numbers:
        raise ValueError("it contains no cycle")
    measured, commanded = np.array(rows["/joint_states"]), np.array(rows["/commanded"])
    if not len(measured) == len(commanded) == len(numbers):
        raise ValueError("its topics are of different lengths")
    first = numbers[0]
    return Cycles(
        robot=about["robot"],
        joint_names=list(json.loads(about["joint_names"])),
        period_s=period_s,
        reason=about.get("reason", ""),
        times_s=(np.array(numbers) - first) * period_s,
        position=measured[:, 0],
        velocity=measured[:, 1],
        effort=measured[:, 2],
        commanded=commanded[:, 0],
        commanded_effort=commanded[:, 2],
        modes=np.array(modes),
        missing=numbers[-1] - first + 1 - len(numbers),
        events=[
            Marked((number - first) * period_s, each.kind, each.mode, each.text) for number, each in events
        ],
    )
