"""The distance by which the arm moves beyond the targets of a stream that steps, stops or wavers.

The streams are those of `tests/rtloop/streaming/test_overshoot.py`, on the virtual clock. What is measured is
what is commanded, after the safety layer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from rig import Rig

from benchmarks.table import EACH, Row, row
from benchmarks.virtual import MOVED, rig
from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.stream_writer import PointWriter
from cobot.types import Array
from rtloop.generators.target_range import POSE_SHARE, SHARE

Make = Callable[[int, np.random.Generator], Array]
Follow = Callable[[Rig, int, Array, Array], Array]

RATES_HZ = (10, 100, 1000)
JITTERS = (0.0, 1.0)
"""Delays of the targets, each up to this share of a period."""
AFTER_S = 1.5
"""Time in which the arm settles on the last target."""
POSE_SCALE = 0.5
"""Poses move half as far and fast, in m, as joints do in rad."""
NO_LAW = (0.0, 0.0)
SERVO = [
    (ServoMode.REPLANNED, NO_LAW),
    (ServoMode.DIRECT, NO_LAW),
    (ServoMode.DIRECT, (0.03, 100.0)),
    (ServoMode.BUFFERED, NO_LAW),
    (ServoMode.BUFFERED, (0.03, 100.0)),
    (ServoMode.BUFFERED, (0.1, 200.0)),
    (ServoMode.BUFFERED_1MS, NO_LAW),
    (ServoMode.THROUGH, NO_LAW),
]
"""Modes with lookahead_time and gain of their points. With 0.03 s and 100 the law alone overshoots 62 %."""


def steps(rate_hz: int, random: np.random.Generator) -> Array:
    """Targets that stand still, step up, stand still, and step back by half. The steps are small enough not
    to be rejected as jumps.
    """
    size = min(0.02, 0.7 * (1.0 / rate_hz + 0.005))
    held = np.ones(max(2, round(0.4 * rate_hz)))
    return np.concatenate([0.0 * held, size * held, 0.5 * size * held])


def ramp(rate_hz: int, random: np.random.Generator) -> Array:
    """Targets that move at a constant speed, and then suddenly stand still."""
    speed, rise_s = random.uniform(0.05, 0.6), random.uniform(0.2, 1.0)
    times_s = np.arange(round((rise_s + 0.5) * rate_hz) + 2) / rate_hz
    return speed * np.minimum(times_s, rise_s)


def walk(rate_hz: int, random: np.random.Generator) -> Array:
    """Targets that move at a different speed after each target."""
    return np.cumsum(random.uniform(-0.6, 0.6, max(12, round(0.8 * rate_hz))) / rate_hz)


def noise(rate_hz: int, random: np.random.Generator) -> Array:
    """Random targets up to 10 mrad from zero."""
    return random.uniform(-1.0, 1.0, max(12, round(0.6 * rate_hz))) * min(0.01, 0.4 / rate_hz)


TARGETS: tuple[Make, ...] = (steps, ramp, walk, noise)


def arrivals(targets: Array, rate_hz: int, jitter: float, random: np.random.Generator) -> Array:
    """Times at which the targets arrive, in order, s. Each target is late by up to a share of a period."""
    late = random.uniform(0.0, jitter, len(targets))
    return np.maximum.accumulate((np.arange(len(targets)) + late) / rate_hz)


def beyond(way: Array, targets: Array) -> tuple[float, float]:
    """The distance by which the path leads beyond the range of the targets and its start, and this range."""
    low, high = min(targets.min(), 0.0), max(targets.max(), 0.0)
    return max(way.max() - high, low - way.min()), high - low


def beyond_steps(way: Array, targets: Array, arrivals_s: Array) -> tuple[float, float]:
    """The distance by which the path leads beyond the targets of `steps` when it settles at each of them, and
    the targets' range.

    The last step goes down: what is below its target counts from its arrival on, and from each joint's peak,
    because a joint may still be on its way up when the step arrives.
    """
    arrived = round(1000 * arrivals_s[np.flatnonzero(targets != targets[-1])[-1] + 1])
    too_far = way.max() - targets.max()
    for joint in way.T:
        last = max(arrived, int(joint.argmax()))
        too_far = max(too_far, -joint[:last].min(initial=0.0), targets[-1] - joint[last:].min())
    return too_far, float(np.ptp(targets))


def swing(way: Array, targets: Array, arrivals_s: Array) -> float:
    """The distance by which the path swings back on the near side of the targets of `steps` after it has
    approached them, as a share of the step.
    """
    first, last = np.flatnonzero(np.diff(targets)) + 1
    begun, turned = round(1000 * arrivals_s[first]), round(1000 * arrivals_s[last])
    back = 0.0
    for joint in way.T:
        up, down = joint[begun:turned], joint[max(turned, int(joint.argmax())) :]
        back = max(back, (np.maximum.accumulate(up) - up).max(initial=0.0) / np.ptp(targets))
        back = max(back, 2.0 * (down - np.minimum.accumulate(down)).max() / np.ptp(targets))
    return float(back)


def joints(kind: Interpolation) -> Follow:
    """The commanded positions of the moved joints relative to home, for joint targets with this
    interpolation. Shape: (n, 4).

    The client repeats its last target, or the session would hold the arm after its timeout.
    """

    def follow(arm: Rig, rate_hz: int, targets: Array, arrivals_s: Array) -> Array:
        every = max(1, round(1000 / rate_hz))
        assert arm.stream(interpolation=kind, decimation=every) == ""
        sent, begun = 0, len(arm.commanded)
        for cycle in range(_cycles(arrivals_s)):
            arrived = np.searchsorted(arrivals_s, cycle * 1e-3 + 1e-9, side="right")
            if arrived > sent or (arrived == len(targets) and cycle % every == 0):
                arm.aim(joints=arm.home + MOVED * targets[arrived - 1])
                sent = arrived
            arm.step()
        return _moved(arm, begun)

    return follow


def points(mode: ServoMode, law: tuple[float, float]) -> Follow:
    """The points of a servo session."""

    def follow(arm: Rig, rate_hz: int, targets: Array, arrivals_s: Array) -> Array:
        assert arm.stream(servo_mode=mode, watchdog_s=60.0) == ""
        writer = PointWriter(arm.memory)
        writer.begin(int(arm.memory.session.data["number"]))
        sent, begun = 0, len(arm.commanded)
        for cycle in range(_cycles(arrivals_s)):
            arrived = np.searchsorted(arrivals_s, cycle * 1e-3 + 1e-9, side="right")
            for target in targets[sent:arrived]:
                assert writer.put(list(arm.home + MOVED * target), 1.0 / rate_hz, *law)
            sent = arrived
            arm.step()
        return _moved(arm, begun)

    return follow


def chunks(seen_s: float = 0.5) -> Follow:
    """Chunks with the targets of the next `seen_s` seconds. A new chunk comes after half of that time,
    delayed by the jitter.
    """

    def follow(arm: Rig, rate_hz: int, targets: Array, arrivals_s: Array) -> Array:
        assert arm.stream() == ""
        begun, began_s = len(arm.commanded), float(arm.memory.state.data["robot_time_s"])
        count = min(max(2, round(seen_s * rate_hz)), 64)
        starts = range(0, len(targets), max(1, count // 2))
        due = {round(1000 * arrivals_s[first]): first for first in starts}
        for cycle in range(_cycles(arrivals_s)):
            if (first := due.get(cycle)) is not None:
                chosen = np.arange(first, min(first + count, len(targets)))
                send_chunk(arm, began_s + 0.05 + (chosen + 1.0) / rate_hz, targets[chosen])
            arm.step()
        return _moved(arm, begun)

    return follow


def poses(kind: Interpolation) -> Follow:
    """The commanded TCP positions for poses along the base's y axis with this interpolation, m, shape (n, 1).

    It is given back as if poses moved as far as joints.
    """

    def follow(arm: Rig, rate_hz: int, targets: Array, arrivals_s: Array) -> Array:
        begin = arm.robot.model.chain.poses(arm.home[None])[0]
        every = max(1, round(1000 / rate_hz))
        assert arm.stream(Stream.CARTESIAN, interpolation=kind, decimation=every) == ""
        sent, begun = 0, len(arm.commanded)
        for cycle in range(_cycles(arrivals_s)):
            arrived = np.searchsorted(arrivals_s, cycle * 1e-3 + 1e-9, side="right")
            if arrived > sent or (arrived == len(targets) and cycle % every == 0):
                off = POSE_SCALE * targets[arrived - 1]
                arm.aim(pose=begin + np.array([0.0, off, 0.0, 0.0, 0.0, 0.0, 0.0]))
                sent = arrived
            arm.step()
        places = arm.robot.model.chain.poses(np.array(arm.commanded[begun:]))
        return np.asarray((places[:, 1:2] - begin[1]) / POSE_SCALE)

    return follow


def send_chunk(arm: Rig, times_s: Array, offsets: Array) -> None:
    """Send waypoints of the moved joints relative to home."""
    chunk = arm.memory.chunk.data
    chunk["session"] = arm.memory.session.data["number"]
    chunk["number"] += 1
    chunk["count"] = len(times_s)
    chunk["times_s"][: len(times_s)] = times_s
    chunk["points"][: len(times_s)] = arm.home + np.outer(offsets, MOVED)
    arm.memory.chunk.publish()


def _cycles(arrivals_s: Array) -> int:
    return round((arrivals_s[-1] + AFTER_S) * 1000)


def _moved(arm: Rig, begun: int) -> Array:
    return np.asarray((np.array(arm.commanded[begun:]) - arm.home)[:, MOVED > 0.0])


STREAMS: dict[str, tuple[Follow, float]] = (
    {f"joints, {kind.name.lower()}": (joints(kind), SHARE) for kind in Interpolation}
    | {
        f"servo mode {mode}" + (f", lookahead {law[0]} s, gain {law[1]:.0f}" if law[0] else ""): (
            points(mode, law),
            SHARE,
        )
        for mode, law in SERVO
    }
    | {"chunks": (chunks(), SHARE)}
    | {f"poses, {kind.name.lower()}": (poses(kind), POSE_SHARE) for kind in Interpolation}
)
"""Every way to stream, with the share of the range by which it may go beyond moving targets."""


def overshoot(repetitions: int) -> Iterator[Row]:
    """The largest distance by which a stream leads beyond its targets' range, as a share of this range, at
    any rate and jitter.
    """
    for name, (follow, share) in STREAMS.items():
        bounds = (0.0, *[100.0 * share] * 3)
        yield row(
            name,
            "",
            [100.0 * max(_shares(follow, make, repetitions)) for make in TARGETS],
            "stated bound",
            bounds,
            columns=("step, %", "ramp, %", "random walk, %", "noise, %"),
            ratio_of=EACH,
            aim="≤ 1",
        )


def _shares(follow: Follow, make: Make, repetitions: int) -> Iterator[float]:
    for rate_hz in RATES_HZ:
        for jitter in JITTERS:
            for seed in range(repetitions):
                random = np.random.default_rng([seed, rate_hz])
                targets = make(rate_hz, random)
                arrivals_s = arrivals(targets, rate_hz, jitter, random)
                with rig() as arm:
                    way = follow(arm, rate_hz, targets, arrivals_s)
                if make is steps:
                    too_far, extent = beyond_steps(way, targets, arrivals_s)
                else:
                    too_far, extent = beyond(way, targets)
                yield round(max(too_far, 0.0) / extent, 4)
