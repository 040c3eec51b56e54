"""HOLD and TRAJECTORY: planned motions, what disturbs them, and what is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.ipc.layout import Command
from golden.stage import Stage, scenario

LATE_NS = 1_100_000
BEGUN = 400
TO_REST = 1200
PATHS = ("ptp", "lin", "curve", "ompl")


@scenario()
def hold(rig: Stage) -> None:
    rig.step(300)


@scenario(simulated=True)
def hold_simulated_and_pushed(rig: Stage) -> None:
    rig.step(200)
    rig.simulation.push[:] = [20.0, -15.0, 10.0, 1.0, 0.5, -0.5]
    rig.step(400)
    rig.simulation.push[:] = 0.0
    rig.step(400)


@scenario()
def hold_on_a_late_computer(rig: Stage) -> None:
    rig.step(200, late_ns=5_000_000)


@scenario()
def hold_fault_and_reset(rig: Stage) -> None:
    rig.step(20)
    rig.loopback.fail_read = "cable unplugged"
    rig.step(30)
    rig.loopback.fail_enable = "brake not released"
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.loopback.fail_read = rig.loopback.fail_enable = ""
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(100)


@scenario()
def hold_pushed_beyond_a_limit(rig: Stage) -> None:
    rig.loopback.offset[5] = rig.limits.max_position[5] + 0.01 - rig.home[5]
    rig.step(20)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.loopback.offset[5] = 0.0
    rig.step(200)
    rig.go("ptp", 50)


@scenario()
def hold_estop_and_reset(rig: Stage) -> None:
    rig.request("estops")
    rig.step(30)
    rig.go("ptp", 10)
    rig.request("stops")
    rig.step(10)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.go("ptp", 900)


def _follow(path: str) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        rig.go(path, 2600)

    return play


for _path in PATHS:
    scenario(name=f"trajectory_{_path}")(_follow(_path))
    scenario(name=f"trajectory_{_path}_simulated", simulated=True)(_follow(_path))


def _stop(path: str, after: int, what: str, simulated: bool) -> None:
    def play(rig: Stage) -> None:
        rig.go(path, after)
        rig.request(what)
        rig.step(TO_REST)
        rig.say(rig.answer(rig.send(Command.RESET)))
        rig.step(20)

    scenario(name=f"trajectory_{path}_{what}_after_{after}", simulated=simulated)(play)


_stop("ptp", 40, "stops", False)
_stop("ptp", 400, "stops", True)
_stop("ptp", 1100, "stops", False)
_stop("curve", 700, "stops", False)
_stop("curve", 1000, "estops", False)
_stop("lin", 600, "stops", True)
_stop("ompl", 900, "estops", True)


def _rates(path: str, rates: list[tuple[float, int]], stop: bool = False) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        rig.go(path, 300)
        for rate, cycles in rates:
            number = rig.send(Command.SET_RATE, value=rate)
            rig.step(cycles)
            rig.say(rig.answer(number))
        if stop:
            rig.request("stops")
        rig.step(TO_REST)

    return play


scenario(name="trajectory_pause_and_resume")(_rates("ptp", [(0.0, 700), (1.0, 600)]))
scenario(name="trajectory_at_0.3")(_rates("ptp", [(0.3, 1000)]))
scenario(name="trajectory_pause_and_stop")(_rates("curve", [(0.0, 800)], stop=True))
scenario(name="trajectory_many_rates")(
    _rates("curve", [(0.2, 150), (0.7, 90), (0.0, 120), (1.0, 60), (0.5, 210), (1.0, 300)])
)
scenario(name="trajectory_many_rates_simulated", simulated=True)(
    _rates("lin", [(0.0, 60), (1.0, 40), (0.1, 200), (0.9, 33), (1.0, 300)])
)
scenario(name="trajectory_rates_refused")(_rates("ptp", [(-0.1, 5), (1.1, 5), (float("nan"), 5)]))


@scenario()
def trajectory_estop_in_motion_and_a_reset_too_early(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.request("estops")
    rig.step(2)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(TO_REST)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(30)


@scenario()
def trajectory_service_silent(rig: Stage) -> None:
    rig.go("curve", 600)
    rig.fall_silent()
    rig.step(TO_REST)


@scenario()
def trajectory_overruns(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    many = rig.settings.rt.overruns_to_stop
    for lateness in [*[LATE_NS] * (many - 1), 900_000, *[LATE_NS] * (many - 1)]:
        rig.step(late_ns=lateness)
    rig.step(late_ns=900_000)
    rig.step(many, LATE_NS)
    rig.step(TO_REST)


@scenario(simulated=True)
def trajectory_pauses_of_the_loop(rig: Stage) -> None:
    rig.go("ptp", 200)
    rig.step(late_ns=50_000_000)
    rig.step(200)
    rig.step(late_ns=200_000_000)
    rig.step(TO_REST)


@scenario()
def trajectory_fail_read(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.loopback.fail_read = "drive 3 overheated"
    rig.step(2)
    rig.loopback.fail_read = ""
    rig.step(TO_REST)
    rig.say(rig.answer(rig.send(Command.RESET)))


@scenario()
def trajectory_fail_write(rig: Stage) -> None:
    rig.go("curve", BEGUN)
    rig.loopback.fail_write = "drive 3 overheated"
    rig.step(2)
    rig.loopback.fail_write = ""
    rig.step(TO_REST)
    rig.say(rig.answer(rig.send(Command.RESET)))


@scenario(simulated=True)
def trajectory_fail_write_for_long(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.simulation.fail_write = "no answer"
    rig.step(600)
    rig.simulation.fail_write = ""
    rig.step(200)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(100)


@scenario()
def trajectory_not_a_number_measured(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.loopback.offset[3] = np.nan
    rig.step()
    rig.loopback.offset[3] = 0.0
    rig.step(TO_REST)


@scenario(simulated=True)
def trajectory_stale(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.simulation.stale = True
    rig.step(700)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.simulation.stale = False
    rig.step(300)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(100)


@scenario(simulated=True)
def trajectory_sensor_not_finite(rig: Stage) -> None:
    rig.go("curve", BEGUN)
    rig.simulation.not_finite = True
    rig.step(50)
    rig.simulation.not_finite = False
    rig.step(TO_REST)


@scenario(simulated=True)
def trajectory_misread_jump(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.simulation.jump[3] = 0.05
    rig.step(300)
    rig.simulation.jump[3] = 0.0
    rig.step(900)
    rig.say(rig.answer(rig.send(Command.RESET)))
    rig.step(50)


@scenario()
def trajectory_pushed_off(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    rig.loopback.offset[4] = 1.1 * rig.settings.rt.tracking_error_rad
    rig.step(TO_REST)


@scenario()
def trajectory_not_settled(rig: Stage) -> None:
    rig.go("lin", 10)
    rig.loopback.offset[2] = 5 * rig.settings.rt.settle_position_rad
    rig.step(4200)


@scenario()
def trajectory_beyond_the_limits(rig: Stage) -> None:
    rig.go("curve_too_fast", 2500)


@scenario()
def trajectory_beyond_the_limits_stopped(rig: Stage) -> None:
    rig.go("curve_too_fast", 300)
    rig.request("stops")
    rig.step(TO_REST)


@scenario()
def trajectory_much_too_fast(rig: Stage) -> None:
    rig.go("swing_too_fast", 1500)
    rig.go("swing_too_fast", 1500)


for _path, _what in (("zigzag_small", "stops"), ("zigzag_large", "stops"), ("zigzag_large", "estops")):

    def _aside(rig: Stage, path: str = _path, what: str = _what) -> None:
        rig.go(path, 1503)
        rig.request(what)
        rig.step(1000)

    scenario(name=f"trajectory_{_path}_{_what}_aside")(_aside)


@scenario()
def trajectory_refused_starts(rig: Stage) -> None:
    rig.go("elsewhere", 5)
    rig.go("beyond_a_stop", 5)
    rig.go("no_rest", 5)
    slot = rig.memory.slots[0]
    slot.write(1, rig.trajectory("ptp"))
    rig.say(rig.answer(rig.send(Command.START, slot=2, motion_id=1)))
    rig.say(rig.answer(rig.send(Command.START, slot=0, motion_id=9)))
    rig.say(rig.answer(rig.send(77)))
    rig.say(rig.answer(rig.send(Command.SET_RATE, value=0.5)))
    slot.coefficients[2, 3, 4] += 1e-3
    rig.say(rig.answer(rig.send(Command.START, slot=0, motion_id=1)))
    slot.coefficients[2, 3, 4] = np.nan
    rig.say(rig.answer(rig.send(Command.START, slot=0, motion_id=1)))
    slot.head.data["segments"] = 2001
    slot.head.publish()
    rig.say(rig.answer(rig.send(Command.START, slot=0, motion_id=1)))
    rig.request("stops")
    overtaken = rig.send(Command.START, slot=0, motion_id=1, stops=rig.memory.requests.data["stops"] - 1)
    rig.say(rig.answer(overtaken))
    rig.step(20)


@scenario()
def trajectory_second_start_and_session_refused_in_motion(rig: Stage) -> None:
    rig.go("ptp", 200)
    rig.memory.slots[1].write(9, rig.trajectory("ptp"))
    rig.say(rig.answer(rig.send(Command.START, slot=1, motion_id=9)))
    rig.session()
    rig.step(1500)


@scenario()
def trajectory_stopped_while_it_loads(rig: Stage) -> None:
    rig.memory.slots[0].write(1, rig.trajectory("zigzag_small"))
    number = rig.send(Command.START, slot=0, motion_id=1)
    rig.step(3)
    rig.request("stops")
    rig.say(rig.answer(number))
    rig.step(200)


@scenario()
def trajectory_rtloop_restarted(rig: Stage) -> None:
    rig.go("ptp", BEGUN)
    successor = Stage(rig.settings, rig.robot, rig.inputs, memory=rig.memory, start=rig.home, trace=rig.trace)
    successor.step(100)
    rig.request("stops")
    successor.step(20)
