"""The smoothness and the lag of the arm when it follows a policy that sends few targets."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from rig import Rig

from benchmarks.table import Row, row
from benchmarks.virtual import MOVED, eased, rig
from cobot.ipc.layout import Interpolation
from cobot.types import Array
from rtloop.generators.interpolation import Linear

RATES_HZ = (10, 30, 100)
JITTER_S = 1e-3
"""By which a policy is early or late."""
RISE_S = 2.0
CHUNK_S = 0.5
"""What a policy that sends chunks sees of its future."""
MAX_LAG_S = 0.3
COLUMNS = ("RMS jerk, rad/s³", "peak jerk, rad/s³", "lag, ms")


def smoothness(duration_s: float) -> Iterator[Row]:
    """The jerk of the commands and their delay, next to the same targets joined by straight lines."""
    for rate_hz in RATES_HZ:
        for kind in (*Interpolation, None):
            commanded, bare = _followed(rate_hz, kind, duration_s)
            if kind is None and not np.ptp(commanded):
                print("smoothness of chunks: rtloop does not follow chunks")
                continue
            yield row(
                f"policy of {rate_hz} Hz, {'chunks' if kind is None else kind.name.lower()}",
                "",
                _measured(commanded),
                "straight lines between the targets, no safety layer",
                _measured(bare),
                columns=COLUMNS,
            )


def _path(time_s: Array | float) -> Array:
    """The position that the policy requests for a joint, rad from home: up to 0.34 rad/s, 1.1 rad/s², 4.5
    rad/s³.
    """
    time_s = np.asarray(time_s, float)
    wave = 0.1 * np.sin(0.6 * np.pi * time_s) + 0.03 * np.sin(1.6 * np.pi * time_s + 1.0)
    return eased(time_s, RISE_S) * wave


def _followed(rate_hz: int, kind: Interpolation | None, duration_s: float) -> tuple[Array, Array]:
    """Joint 1 relative to home in each cycle, as commanded and on straight lines between the targets. None
    means chunks.
    """
    every, cycles = round(1000 / rate_hz), round(duration_s * 1000)
    random = np.random.default_rng(rate_hz)
    due_s = (0.5 + np.arange(duration_s * rate_hz)) / rate_hz
    due_s += random.uniform(-JITTER_S, JITTER_S, len(due_s))
    bare, lines = Linear(1, 1e-3), np.zeros(cycles)
    with rig() as arm:
        refusal = arm.stream(interpolation=Interpolation.LINEAR if kind is None else kind, decimation=every)
        assert not refusal, refusal
        began_s = float(arm.memory.state.data["robot_time_s"])
        sent = taken = 0
        for cycle in range(cycles):
            if sent < len(due_s) and cycle * 1e-3 >= due_s[sent]:
                if kind is None:
                    _send_chunk(arm, due_s[sent] + np.arange(0.0, CHUNK_S, 1.0 / rate_hz), began_s)
                else:
                    arm.aim(joints=arm.home + MOVED * _path(due_s[sent]))
                sent += 1
            arm.step()
            if cycle % every == every - 1 and sent > taken:
                taken = sent
                bare.aim(np.array([_path(due_s[sent - 1])]), None, every * 1e-3)
            bare.advance()
            lines[cycle] = bare.reference[0, 0]
        return np.array(arm.commanded)[-cycles:, 0] - arm.home[0], lines


def _send_chunk(arm: Rig, times_s: Array, began_s: float) -> None:
    chunk = arm.memory.chunk.data
    count = len(times_s)
    chunk["session"] = arm.memory.session.data["number"]
    chunk["number"] += 1
    chunk["count"] = count
    chunk["times_s"][:count] = began_s + times_s
    chunk["points"][:count] = arm.home + np.outer(_path(times_s), MOVED)
    arm.memory.chunk.publish()


def _measured(joint: Array) -> tuple[float, float, float]:
    """RMS and peak of the jerk, and the lag for which the joint fits the policy's path best."""
    jerk = np.diff(joint, 3)[round(RISE_S * 1000) :] / 1e-9
    times_s = np.arange(len(joint)) * 1e-3
    past = round(RISE_S * 1000)
    lags_s = np.arange(0.0, MAX_LAG_S, 1e-3)
    errors = [np.mean((joint - _path(times_s - lag_s))[past:] ** 2) for lag_s in lags_s]
    return float(np.sqrt(np.mean(jerk**2))), float(np.abs(jerk).max()), 1e3 * float(lags_s[np.argmin(errors)])
