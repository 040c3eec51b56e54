"""Servo modes 1 to 7: points, their laws, and what becomes of them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.ipc.layout import POINTS, ServoMode
from cobot.ipc.stream_writer import PointWriter
from cobot.types import Array
from golden.joint import SHARES
from golden.stage import Stage, scenario

MODES = [mode for mode in ServoMode if mode]
LAW = (0.1, 200.0)
Reference = Callable[[float], Array]


def wave(rig: Stage, size_rad: float = 0.2, rate_hz: float = 0.4) -> Reference:
    """From rest and smooth to the third derivative."""

    def at(time_s: float) -> Array:
        ease = np.clip(0.5 * time_s, 0.0, 1.0)
        ease = ease**4 * (35.0 - 84.0 * ease + 70.0 * ease**2 - 20.0 * ease**3)
        return rig.home + ease * size_rad * 0.5 * np.sin(2.0 * np.pi * rate_hz * time_s) * SHARES

    return at


def feed(
    rig: Stage,
    writer: PointWriter,
    reference: Reference,
    cycles: int,
    every: int = 10,
    law: tuple[float, float] = (0.0, 0.0),
    begin: int = 0,
) -> None:
    """Send points of a reference as a client would."""
    for cycle in range(begin, begin + cycles):
        if cycle % every == 0:
            writer.put(reference(cycle * 1e-3), every * 1e-3, *law)
        rig.step()


def _follow(mode: ServoMode, every: int, law: tuple[float, float]) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        feed(rig, rig.serve(mode), wave(rig), 1400, every, law)
        rig.end_stream()
        rig.step(500)

    return play


for _mode in MODES:
    scenario(name=f"servo_{_mode}_10ms")(_follow(_mode, 10, (0.0, 0.0)))
for _mode in (ServoMode.REPLANNED, ServoMode.DIRECT, ServoMode.BUFFERED, ServoMode.BUFFERED_1MS):
    scenario(name=f"servo_{_mode}_10ms_with_law")(_follow(_mode, 10, LAW))
for _mode, _every in ((2, 1), (3, 2), (4, 1), (5, 2), (1, 33)):
    scenario(name=f"servo_{_mode}_{_every}ms")(_follow(ServoMode(_mode), _every, (0.0, 0.0)))
scenario(name="servo_2_5ms_with_a_hard_law")(_follow(ServoMode.DIRECT, 5, (0.03, 100.0)))
scenario(name="servo_4_1ms_with_a_swinging_law")(_follow(ServoMode.BUFFERED_1MS, 1, (0.03, 400.0)))


def _underrun(mode: ServoMode) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        reference, writer = wave(rig), rig.serve(mode, 5.0)
        feed(rig, writer, reference, 800)
        rig.step(600)
        feed(rig, writer, reference, 400, begin=800)
        rig.step(600)

    return play


for _mode in (ServoMode.BUFFERED, ServoMode.BUFFERED_1MS, ServoMode.THROUGH, ServoMode.THROUGH_FORCE):
    scenario(name=f"servo_{_mode}_underrun")(_underrun(_mode))


def _jump(mode: ServoMode) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        reference, writer = wave(rig), rig.serve(mode, 5.0)
        feed(rig, writer, reference, 800)
        outlier = reference(0.8)
        outlier[2] += 0.5
        writer.put(outlier, 0.01, 0.0, 0.0)
        rig.step(10)
        feed(rig, writer, reference, 500, begin=810)

    return play


for _mode in (ServoMode.REPLANNED, ServoMode.DIRECT, ServoMode.BUFFERED, ServoMode.BUFFERED_1MS):
    scenario(name=f"servo_{_mode}_jump")(_jump(_mode))


def _end(mode: ServoMode, name: str, end: Callable[[Stage, PointWriter], None]) -> None:
    def play(rig: Stage) -> None:
        writer = rig.serve(mode, 0.2)
        feed(rig, writer, wave(rig), 800)
        end(rig, writer)
        rig.step(900)

    scenario(name=f"servo_{mode}_{name}")(play)


def _poison(rig: Stage, writer: PointWriter) -> None:
    target = rig.home.copy()
    target[1] = np.nan
    writer.put(target, 0.01, 0.0, 0.0)


for _mode in (ServoMode.REPLANNED, ServoMode.BUFFERED, ServoMode.THROUGH, ServoMode.THROUGH_FORCE):
    _end(_mode, "watchdog", lambda rig, writer: None)
    _end(_mode, "not_a_number", _poison)
for _mode in MODES:
    _end(_mode, "stopped", lambda rig, writer: rig.request("stops"))
for _mode in (ServoMode.DIRECT, ServoMode.THROUGH, ServoMode.REPLANNED_FORCE):
    _end(_mode, "estopped", lambda rig, writer: rig.request("estops"))
    _end(_mode, "fault", lambda rig, writer: setattr(rig.loopback, "fail_read", "no answer"))
for _mode in (ServoMode.BUFFERED, ServoMode.REPLANNED_FORCE):
    _end(_mode, "service_silent", lambda rig, writer: rig.fall_silent())


def _finish(mode: ServoMode) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        reference, writer = wave(rig), rig.serve(mode, 0.2)
        for number in range(60):
            writer.put(reference(number * 0.01), 0.01, 0.0, 0.0)
        rig.step(5)
        rig.memory.session.data["open"] = 2
        rig.memory.session.publish()
        rig.step(1600)

    return play


for _mode in (ServoMode.BUFFERED, ServoMode.THROUGH, ServoMode.THROUGH_FORCE):
    scenario(name=f"servo_{_mode}_finishing")(_finish(_mode))


@scenario()
def servo_1_a_single_far_point(rig: Stage) -> None:
    rig.serve(ServoMode.REPLANNED, 10.0).put(rig.home + 0.3 * SHARES, 0.02, 0.0, 0.0)
    rig.step(1200)


@scenario()
def servo_3_jittered(rig: Stage) -> None:
    random = np.random.default_rng(3)
    reference, writer, number, due = wave(rig), rig.serve(ServoMode.BUFFERED), 0, 0.0
    for cycle in range(1300):
        while cycle >= due:
            writer.put(reference(number * 0.02), 0.02, 0.0, 0.0)
            number += 1
            due = number * 20 + random.uniform(-9, 9)
        rig.step()


@scenario()
def servo_3_times_that_are_no_whole_cycles(rig: Stage) -> None:
    writer = rig.serve(ServoMode.BUFFERED, 2.0)
    for number in range(300):
        writer.put(rig.home + 2.5e-4 * number * SHARES, 2.5e-3, 0.0, 0.0)
    rig.step(900)


@scenario()
def servo_3_a_full_buffer(rig: Stage) -> None:
    writer = rig.serve(ServoMode.BUFFERED, 60.0)
    taken = [writer.put(rig.home + 1e-5 * number * SHARES, 0.01, 0.0, 0.0) for number in range(POINTS + 20)]
    rig.say(str(sum(taken)))
    rig.step(400)


def _through(kind: str) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        random = np.random.default_rng(5)
        steps = {
            "walk": random.normal(0.0, 0.01, (40, 7)),
            "corners": np.repeat(random.uniform(-0.02, 0.02, (4, 7)), 10, axis=0),
            "noise": np.diff(random.normal(0.0, 3e-4, (41, 7)), axis=0) + 0.004,
        }[kind]
        writer = rig.serve(ServoMode.THROUGH, 60.0)
        for point in rig.home + np.cumsum(steps, axis=0):
            writer.put(point, 0.02, 0.0, 0.0)
        rig.step(2000)

    return play


for _kind in ("walk", "corners", "noise"):
    scenario(name=f"servo_5_through_{_kind}")(_through(_kind))


def _wild(mode: ServoMode) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        random = np.random.default_rng(int(mode))
        writer, target = rig.serve(mode, 5.0), rig.home.copy()
        for _ in range(800):
            if random.random() < 0.05:
                target = target + random.normal(0.0, random.choice([1e-4, 2e-3, 0.01]), 7)
                time_s = random.choice([0.001, 0.0025, 0.02])
                writer.put(target, time_s, *(LAW if random.random() < 0.5 else (0.0, 0.0)))
            rig.step()
        rig.end_stream()
        rig.step(500)

    return play


for _mode in MODES:
    scenario(name=f"servo_{_mode}_wild")(_wild(_mode))


@scenario(start="over_the_floor")
def servo_3_into_the_floor(rig: Stage) -> None:
    start, end = rig.inputs["over_the_floor"], rig.inputs["in_the_floor"]
    feed(rig, rig.serve(ServoMode.BUFFERED), lambda t: start + min(t / 2.0, 1.0) * (end - start), 1900)
    rig.step(400)


@scenario()
def servo_points_of_an_older_session(rig: Stage) -> None:
    old = rig.serve(ServoMode.BUFFERED)
    for _ in range(100):
        old.put(rig.home + 0.01 * SHARES, 0.01, 0.0, 0.0)
    rig.end_stream()
    rig.step(300)
    rig.serve(ServoMode.BUFFERED)
    rig.step(200)


def _press(mode: ServoMode) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        rig.step(50)
        axes = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        writer = rig.serve(mode, force_axes=axes, force_velocity=np.array([0.05] * 3 + [0.5] * 3))
        rig.aim(wrench=np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0]))
        start, aside = rig.inputs["near_floor"], rig.inputs["near_floor_aside"]
        for cycle in range(2000):
            if cycle % 10 == 0:
                share = float(np.clip((cycle - 1000) / 1000.0, 0.0, 1.0))
                share = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
                writer.put(start + share * (aside - start), 0.01, 0.0, 0.0)
            rig.step()

    return play


for _mode in (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE):
    scenario(name=f"servo_{_mode}_presses_on_the_floor", simulated=True, start="near_floor")(_press(_mode))
