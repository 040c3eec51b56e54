"""JOINT_IMPEDANCE and JOINT_TORQUE: targets, chunks and torques."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from cobot.ipc.layout import Command, Interpolation, Stream
from cobot.types import Array
from golden.stage import Stage, scenario

SHARES = np.array([1.0, -0.8, 0.6, 0.9, -0.5, -0.7, 0.4])
"""Of a swing, joint by joint."""
STEP_S = 1.0 / 30.0


def swing(cycle: float, size_rad: float = 0.2, rate_hz: float = 0.5) -> Array:
    """From rest: position, velocity and acceleration off home, shape (3, 7)."""
    rate, time_s = 2.0 * np.pi * rate_hz, cycle * 1e-3
    phase = rate * time_s
    rows = np.array([1.0 - np.cos(phase), rate * np.sin(phase), rate**2 * np.cos(phase)])
    return 0.5 * size_rad * rows[:, None] * SHARES


def feed(rig: Stage, cycles: int, every: int = 10, begin: int = 0, *, forward: bool = False) -> None:
    """Stream the swing."""
    for cycle in range(begin, begin + cycles):
        if cycle % every == 0:
            position, velocity, acceleration = swing(cycle)
            rates = {"joint_velocity": velocity, "joint_acceleration": acceleration} if forward else {}
            rig.aim(joints=rig.home + position, feed_forward=int(forward), **rates)
        rig.step()


def _swing(kind: Interpolation, every: int, forward: bool) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        rig.session(interpolation=kind, decimation=every)
        feed(rig, 1100, every, forward=forward)
        rig.end_stream()
        rig.step(600)

    return play


for _kind in Interpolation:
    for _every in (1, 10, 33):
        scenario(name=f"joint_{_kind.name}_{_every}")(_swing(_kind, _every, False))
    scenario(name=f"joint_{_kind.name}_10_forward")(_swing(_kind, 10, True))
scenario(name="joint_QUINTIC_33_forward")(_swing(Interpolation.QUINTIC, 33, True))
scenario(name="joint_LINEAR_10_simulated", simulated=True)(_swing(Interpolation.LINEAR, 10, False))
scenario(name="joint_QUINTIC_10_forward_simulated", simulated=True)(_swing(Interpolation.QUINTIC, 10, True))


def _jitter(kind: Interpolation) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        random = np.random.default_rng(7)
        rig.session(interpolation=kind, decimation=10)
        due = 0.0
        for cycle in range(1300):
            if cycle >= due:
                rig.aim(joints=rig.home + swing(cycle)[0] + random.normal(0.0, 2e-4, 7))
                due += 10.0 + random.uniform(-6.0, 8.0)
            rig.step()

    return play


for _kind in Interpolation:
    scenario(name=f"joint_{_kind.name}_jittered")(_jitter(_kind))


@scenario()
def joint_jump_refused(rig: Stage) -> None:
    rig.session()
    feed(rig, 500)
    outlier = rig.home + swing(500)[0]
    outlier[2] += 0.5
    rig.aim(joints=outlier)
    rig.step(10)
    feed(rig, 800, begin=510)


@scenario()
def joint_timeout_and_on(rig: Stage) -> None:
    rig.session()
    feed(rig, 700)
    rig.step(900)
    rig.aim(joints=rig.home + swing(700)[0] + 0.01)
    rig.step(300)
    rig.step(900)


def _to_the_limit(kind: Interpolation) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        rig.session(interpolation=kind)
        target = rig.home.copy()
        for cycle in range(1000):
            if cycle % 10 == 0:
                target[5] = rig.home[5] + 1.5 * max(0.0, cycle * 1e-3 - 0.1)
                rig.aim(joints=target)
            rig.step()
        rig.step(500)

    return play


for _kind in Interpolation:
    scenario(name=f"joint_{_kind.name}_to_the_limit")(_to_the_limit(_kind))


@scenario(start="near_limits")
def joint_swings_near_the_limits(rig: Stage) -> None:
    rig.session(decimation=10)
    start = rig.inputs["near_limits"]
    for cycle in range(1500):
        if cycle % 10 == 0:
            turn = 0.3 * np.sin(2.0 * np.pi * 0.7 * cycle * 1e-3)
            rig.aim(joints=start + turn * np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]))
        rig.step()


@scenario()
def joint_not_a_number(rig: Stage) -> None:
    rig.session()
    feed(rig, 700)
    target = rig.home + swing(700)[0]
    target[4] = np.nan
    rig.aim(joints=target)
    rig.step(800)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(30)


@scenario()
def joint_a_single_far_target(rig: Stage) -> None:
    rig.session(interpolation=Interpolation.NONE)
    rig.aim(joints=rig.home + 0.02 * SHARES)
    rig.step(400)
    rig.step(300)


@scenario()
def joint_wild_targets(rig: Stage) -> None:
    random = np.random.default_rng(11)
    rig.session(interpolation=Interpolation.NONE, decimation=1)
    target = rig.home.copy()
    for _ in range(1200):
        if random.random() < 0.1:
            target = target + random.normal(0.0, random.choice([1e-4, 2e-3, 0.01]), 7)
            rig.aim(joints=target)
        rig.step()


def _broken(name: str, break_it: Callable[[Stage], None]) -> None:
    def play(rig: Stage) -> None:
        rig.session()
        feed(rig, 800)
        break_it(rig)
        feed(rig, 300, begin=800)
        rig.step(600)
        rig.say(rig.answer(rig.send(Command.RESET)))
        rig.session()
        rig.step(20)

    scenario(name=f"joint_{name}")(play)


def _read_once_fails(rig: Stage) -> None:
    rig.loopback.fail_read = "no answer"
    rig.step(2)
    rig.loopback.fail_read = ""


def _write_once_fails(rig: Stage) -> None:
    rig.loopback.fail_write = "no answer"
    rig.step(2)
    rig.loopback.fail_write = ""


_broken("stopped", lambda rig: rig.request("stops"))
_broken("estopped", lambda rig: rig.request("estops"))
_broken("estopped_by_the_client", lambda rig: rig.client_estop())
_broken("fail_read", _read_once_fails)
_broken("fail_write", _write_once_fails)
_broken("overrun", lambda rig: rig.step(20, late_ns=2_000_000))
_broken("pause_of_the_loop", lambda rig: rig.step(1, late_ns=200_000_000))
_broken("service_silent", lambda rig: rig.fall_silent())


@scenario()
def joint_sessions_refused(rig: Stage) -> None:
    wishes: Sequence[dict[str, object]] = (
        {"stream": 9},
        {"interpolation": 7},
        {"decimation": 0},
        {"stiffness": 1e9},
        {"damping_ratio": 0.1},
        {"max_contact_torque": 0.0},
        {"force_frame": np.nan},
        {"force_velocity": 0.0},
        {"servo_mode": 8},
        {"servo_mode": 6},
        {"servo_mode": 1, "watchdog_s": 0.0},
        {"stops": 99},
    )
    for wish in wishes:
        rig.say(rig.stream(**{"stream": Stream.JOINT_IMPEDANCE, **wish}))
    rig.session()
    rig.say(rig.answer(rig.send(Command.START)))
    rig.step(10)


@scenario()
def joint_targets_of_another_session(rig: Stage) -> None:
    rig.session()
    rig.aim(joints=rig.home + 0.01)
    rig.memory.setpoint.data["session"] += 1
    rig.memory.setpoint.publish()
    rig.step(100)


@scenario(simulated=True)
def joint_soft_and_pushed(rig: Stage) -> None:
    stiffness = np.array([800.0, 800.0, 600.0, 600.0, 300.0, 200.0, 200.0])
    rig.session(stiffness=stiffness)
    rig.simulation.push[:] = [0.0, 40.0, 0.0, 0.0, 0.0, 0.0]
    feed(rig, 900)
    rig.end_stream()
    rig.step(600)


@scenario(simulated=True)
def joint_gives_way_too_far(rig: Stage) -> None:
    rig.session(stiffness=np.full(7, 20.0))
    rig.simulation.push[1] = 60.0
    rig.step(1500)


@scenario(simulated=True)
def joint_contact_stop(rig: Stage) -> None:
    rig.session(max_contact_torque=np.full(7, 8.0))
    feed(rig, 400)
    rig.simulation.push[0] = 40.0
    rig.step(900)


@scenario(start="tucked")
def joint_into_the_surroundings_and_away(rig: Stage) -> None:
    rig.session(interpolation=Interpolation.QUINTIC)
    start, target = rig.inputs["tucked"], rig.inputs["tucked"].copy()
    for cycle in range(1600):
        if cycle % 10 == 0:
            target[1] = min(start[1] + 0.4e-3 * cycle, start[1] + 0.6)
            rig.aim(joints=target)
        rig.step()
    for _ in range(60):
        here = rig.memory.state.read()["commanded_position"].copy()
        here[1] -= 0.004
        rig.aim(joints=here)
        rig.step(10)


# Chunks


def policy(rig: Stage, times_s: Array) -> Array:
    """From rest at 0, some 0.3 rad/s; shape (k, 7)."""
    phase = np.pi * np.maximum(times_s, 0.0)[:, None]
    return rig.home + 0.05 * (phase - np.sin(phase)) * SHARES


def send(rig: Stage, begin_s: float, first: int, count: int) -> None:
    """Points of the policy, numbered in steps from its beginning."""
    times = begin_s + (first + np.arange(count)) * STEP_S
    rig.send_chunk(times, policy(rig, times - begin_s))


@scenario()
def chunks_one_after_the_other(rig: Stage) -> None:
    rig.session()
    begin_s = rig.now_s
    for number in range(4):
        send(rig, begin_s, 15 * number + 1, 18)
        rig.step(500)


@scenario()
def chunks_that_overlap(rig: Stage) -> None:
    rig.session()
    begin_s = rig.now_s
    for number in range(7):
        send(rig, begin_s, 6 * number + 1, 30)
        rig.step(200)


@scenario()
def chunks_late_ones(rig: Stage) -> None:
    rig.session()
    begin_s = rig.now_s
    send(rig, begin_s, 1, 20)
    rig.step(400)
    send(rig, begin_s, 6, 30)
    rig.step(500)
    send(rig, begin_s, 3, 6)
    rig.step(300)


@scenario()
def chunks_starved_and_on(rig: Stage) -> None:
    rig.session()
    send(rig, rig.now_s, 1, 20)
    rig.step(1300)
    here = rig.memory.state.read()["commanded_position"].copy()
    times = rig.now_s + 0.05 + np.arange(1, 20) * STEP_S
    rig.send_chunk(times, here + 0.05 * (np.arange(1, 20)[:, None] / 19) ** 2 * SHARES)
    rig.step(1200)


@scenario()
def chunks_refused(rig: Stage) -> None:
    rig.session()
    begin_s = rig.now_s
    send(rig, begin_s, 1, 30)
    rig.step(400)
    times = begin_s + (15 + np.arange(9)) * STEP_S
    rig.send_chunk(times, policy(rig, times - begin_s) + 0.5)
    rig.step(300)
    rig.send_chunk(times[::-1].copy(), policy(rig, times - begin_s))
    rig.step(200)


@scenario()
def chunks_not_a_number(rig: Stage) -> None:
    rig.session()
    begin_s = rig.now_s
    send(rig, begin_s, 1, 30)
    rig.step(400)
    times = begin_s + (15 + np.arange(9)) * STEP_S
    points = policy(rig, times - begin_s)
    points[4, 2] = np.nan
    rig.send_chunk(times, points)
    rig.step(700)


@scenario()
def chunks_and_single_targets(rig: Stage) -> None:
    rig.session()
    send(rig, rig.now_s, 1, 20)
    rig.step(600)
    for _ in range(20):
        rig.aim(joints=rig.memory.state.read()["commanded_position"].copy())
        rig.step(10)
    times = rig.now_s + np.arange(2, 20) * STEP_S
    held = rig.memory.state.read()["commanded_position"].copy()
    rig.send_chunk(times, np.tile(held + 0.01 * SHARES, (18, 1)))
    rig.step(700)


# Torques

TORQUE = np.array([1.2, 0.8, 0.4, -0.8, 0.2, 0.2, 0.1])


def _torques(rig: Stage, cycles: int, every: int = 10) -> None:
    for cycle in range(cycles):
        if cycle % every == 0:
            rig.aim(joints=np.sin(2.0 * np.pi * cycle * 1e-3) * TORQUE)
        rig.step()


@scenario(simulated=True)
def torque_sines(rig: Stage) -> None:
    rig.session(Stream.JOINT_TORQUE)
    _torques(rig, 1500)
    rig.end_stream()
    rig.step(500)


@scenario(simulated=True)
def torque_every_cycle_and_a_push(rig: Stage) -> None:
    rig.session(Stream.JOINT_TORQUE, decimation=1)
    _torques(rig, 500, 1)
    rig.simulation.push[:3] = [10.0, -5.0, 5.0]
    _torques(rig, 700, 1)


@scenario(simulated=True)
def torque_to_the_limits(rig: Stage) -> None:
    rig.session(Stream.JOINT_TORQUE)
    for cycle in range(1500):
        if cycle % 10 == 0:
            rig.aim(joints=np.array([300.0, 0.0, 0.0, 0.0, 0.0, 0.0, 40.0]))
        rig.step()


@scenario()
def torque_without_a_simulation(rig: Stage) -> None:
    rig.session(Stream.JOINT_TORQUE)
    _torques(rig, 800)


def _torque_broken(name: str, break_it: Callable[[Stage], None]) -> None:
    def play(rig: Stage) -> None:
        rig.session(Stream.JOINT_TORQUE)
        _torques(rig, 800)
        break_it(rig)
        rig.step(1200)

    scenario(name=f"torque_{name}", simulated=True)(play)


_torque_broken("stopped", lambda rig: rig.request("stops"))
_torque_broken("estopped", lambda rig: rig.request("estops"))
_torque_broken("not_a_number", lambda rig: rig.aim(joints=np.full(7, np.nan)))
_torque_broken("drive_fault", lambda rig: setattr(rig.simulation, "drive_fault", "drive 3 hot"))
_torque_broken("silent", lambda rig: None)
