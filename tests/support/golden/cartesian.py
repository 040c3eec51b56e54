"""CARTESIAN: poses, moves, forces and contacts."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.ipc.layout import Interpolation, Stream
from cobot.types import Array
from golden.stage import Stage, scenario

DOWN_N = np.array([0.0, 0.0, -10.0, 0.0, 0.0, 0.0])
ALONG_Z = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def home_pose(rig: Stage) -> Array:
    return rig.inputs["home_pose"].copy()


def turned(quaternion: Array, by: Array) -> Array:
    """A quaternion, (w, x, y, z), turned by a small rotation vector in the base frame."""
    angle = float(np.linalg.norm(by))
    axis = by / angle if angle else by
    w, (x, y, z) = np.cos(angle / 2.0), np.sin(angle / 2.0) * axis
    a, b, c, d = quaternion
    return np.array(
        [
            w * a - x * b - y * c - z * d,
            w * b + x * a + y * d - z * c,
            w * c - x * d + y * a + z * b,
            w * d + x * c - y * b + z * a,
        ]
    )


def wave(rig: Stage, cycle: int, size_m: float = 0.05) -> tuple[Array, Array, Array]:
    """From rest: pose, twist and its rate."""
    rate, time_s = np.pi, cycle * 1e-3
    share = 0.5 * (1.0 - np.cos(rate * time_s))
    speed, slope = 0.5 * rate * np.sin(rate * time_s), 0.5 * rate**2 * np.cos(rate * time_s)
    way = np.array([-size_m, 0.8 * size_m, -0.5 * size_m, 0.1, 0.0, 0.15])
    pose = home_pose(rig)
    pose[:3] += share * way[:3]
    pose[3:] = turned(pose[3:], share * way[3:])
    return pose, speed * way, slope * way


def feed(
    rig: Stage, cycles: int, every: int = 10, begin: int = 0, *, forward: bool = False, size_m: float = 0.05
) -> None:
    """Stream the wave."""
    for cycle in range(begin, begin + cycles):
        if cycle % every == 0:
            pose, twist, slope = wave(rig, cycle, size_m)
            rates = {"twist": twist, "twist_rate": slope} if forward else {}
            rig.aim(pose=pose, feed_forward=int(forward), **rates)
        rig.step()


def _wave(kind: Interpolation, every: int, forward: bool) -> Callable[[Stage], None]:
    def play(rig: Stage) -> None:
        rig.session(Stream.CARTESIAN, interpolation=kind, decimation=every)
        feed(rig, 900, every, forward=forward)
        rig.end_stream()
        rig.step(500)

    return play


for _kind in Interpolation:
    for _every, _forward in ((1, False), (10, False), (10, True), (33, False)):
        _name = f"cartesian_{_kind.name}_{_every}" + ("_forward" if _forward else "")
        scenario(name=_name)(_wave(_kind, _every, _forward))
scenario(name="cartesian_LINEAR_10_simulated", simulated=True)(_wave(Interpolation.LINEAR, 10, False))


@scenario()
def cartesian_jittered_and_large(rig: Stage) -> None:
    random = np.random.default_rng(5)
    rig.session(Stream.CARTESIAN)
    due = 0.0
    for cycle in range(1200):
        if cycle >= due:
            rig.aim(pose=wave(rig, cycle, 0.15)[0])
            due += 10.0 + random.uniform(-6.0, 8.0)
        rig.step()


def move_goal(rig: Stage, way: list[float], turn: list[float]) -> Array:
    goal = home_pose(rig)
    goal[:3] += way
    goal[3:] = turned(goal[3:], np.array(turn))
    return goal


@scenario()
def cartesian_move(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    goal = move_goal(rig, [0.05, -0.1, 0.08], [0.2, 0.1, -0.3])
    rig.aim(move=1, move_pose=goal, move_duration_s=1.5)
    rig.step(10)
    rig.aim(pose=home_pose(rig))
    rig.step(1800)


@scenario()
def cartesian_move_cancelled(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    rig.aim(move=1, move_pose=move_goal(rig, [0.0, 0.2, 0.0], [0.0, 0.0, 0.0]), move_duration_s=2.0)
    rig.step(900)
    rig.aim(cancel=1)
    rig.step(500)
    held_on = rig.memory.state.read()["tcp"].copy()
    held_on[1] += 0.005
    rig.aim(pose=held_on)
    rig.step(300)


@scenario()
def cartesian_move_too_fast(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    rig.aim(move=1, move_pose=move_goal(rig, [0.0, 0.25, 0.0], [0.0, 0.0, 0.0]), move_duration_s=0.05)
    rig.step(1800)


@scenario()
def cartesian_move_changed_on_the_way(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, decimation=1000)
    rig.step(5)
    for number in range(1, 9):
        way = [0.0, 0.1, 0.0] if number < 5 else [0.05, 0.05, 0.05]
        rig.aim(move=number, move_pose=move_goal(rig, way, [0.1, 0.0, 0.0]), move_duration_s=1.5)
        rig.step(100)
    rig.step(1200)


@scenario()
def cartesian_jumps_refused(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    feed(rig, 400)
    jump = wave(rig, 400)[0]
    jump[1] += 0.3
    rig.aim(pose=jump)
    rig.step(10)
    feed(rig, 200, begin=410)
    spun = wave(rig, 610)[0]
    spun[3:] = turned(spun[3:], np.array([1.5, 0.0, 0.0]))
    rig.aim(pose=spun)
    rig.step(10)
    feed(rig, 400, begin=620)


@scenario()
def cartesian_faster_than_the_tcp_may(rig: Stage) -> None:
    """The pose limiter is at work; the line leads the wrist close to a singularity."""
    rig.session(Stream.CARTESIAN)
    pose = home_pose(rig)
    for cycle in range(1800):
        if cycle % 10 == 0 and cycle < 1300:
            pose[0] += 0.007 if cycle < 500 else -0.005
            rig.aim(pose=pose)
        rig.step()


@scenario()
def cartesian_turns_faster_than_the_tcp_may(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, interpolation=Interpolation.QUINTIC)
    pose = home_pose(rig)
    for cycle in range(1300):
        if cycle % 10 == 0 and cycle < 700:
            pose[3:] = turned(pose[3:], np.array([0.0, 0.004, 0.017]))
            rig.aim(pose=pose)
        rig.step()


@scenario()
def cartesian_out_of_reach(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    pose = home_pose(rig)
    for cycle in range(2200):
        if cycle % 10 == 0:
            pose[0] += 0.004
            rig.aim(pose=pose)
        rig.step()


@scenario()
def cartesian_posture(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, posture=rig.inputs["posture"])
    for cycle in range(1500):
        if cycle % 100 == 0:
            rig.aim(pose=home_pose(rig))
        rig.step()


@scenario()
def cartesian_posture_while_it_moves(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, posture=rig.inputs["posture"], interpolation=Interpolation.QUINTIC)
    feed(rig, 1200, size_m=0.1)


@scenario()
def cartesian_timeout_and_on(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    feed(rig, 500)
    rig.step(800)
    here = rig.memory.state.read()["tcp"].copy()
    here[2] += 0.004
    rig.aim(pose=here)
    rig.step(300)


@scenario()
def cartesian_into_the_floor_and_away(rig: Stage) -> None:
    """It slows down, holds, and is let go when the stream leads away."""
    rig.session(Stream.CARTESIAN, interpolation=Interpolation.QUINTIC)
    pose = home_pose(rig)
    for cycle in range(2600):
        if cycle % 10 == 0 and pose[2] > -0.3:
            pose[2] -= 0.003
            rig.aim(pose=pose)
        rig.step()
    for _ in range(80):
        here = rig.memory.state.read()["tcp"].copy()
        here[2] += 0.003
        rig.aim(pose=here)
        rig.step(10)


@scenario(simulated=True, start="above_floor")
def cartesian_into_the_floor_simulated(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN)
    pose = rig.inputs["above_floor_pose"].copy()
    for cycle in range(1200):
        if cycle % 10 == 0:
            pose[2] -= 0.001
            rig.aim(pose=pose)
        rig.step()


def _broken(name: str, break_it: Callable[[Stage], None]) -> None:
    def play(rig: Stage) -> None:
        rig.session(Stream.CARTESIAN)
        feed(rig, 700)
        break_it(rig)
        rig.step(900)

    scenario(name=f"cartesian_{name}")(play)


def _poison(what: str) -> Callable[[Stage], None]:
    def break_it(rig: Stage) -> None:
        rig.memory.setpoint.data[what][2] = np.nan
        rig.aim()

    return break_it


_broken("stopped", lambda rig: rig.request("stops"))
_broken("estopped", lambda rig: rig.request("estops"))
_broken("pose_not_a_number", _poison("pose"))
_broken("wrench_not_a_number", _poison("wrench"))
_broken("fail_read", lambda rig: setattr(rig.loopback, "fail_read", "no answer"))
_broken("overrun", lambda rig: rig.step(20, late_ns=2_000_000))


# Forces and contacts


def press(rig: Stage, cycles: int, wrench: Array, pose: Array, way: Array | None = None) -> None:
    """Stream a wrench, and a pose that moves by `way` in each target."""
    for cycle in range(cycles):
        if cycle % 10 == 0:
            if way is not None:
                pose[:3] += way
            rig.aim(pose=pose, wrench=wrench)
        rig.step()


@scenario(simulated=True, start="near_floor")
def force_on_the_floor_in_the_base_frame(rig: Stage) -> None:
    rig.step(50)
    rig.session(Stream.CARTESIAN, force_axes=ALONG_Z)
    press(rig, 2000, DOWN_N, rig.inputs["near_floor_pose"].copy())


@scenario(simulated=True, start="near_floor")
def force_on_the_floor_in_the_tcp_frame(rig: Stage) -> None:
    rig.step(50)
    rig.session(Stream.CARTESIAN, force_axes=ALONG_Z, force_in_tcp=1)
    press(rig, 2000, -DOWN_N, rig.inputs["near_floor_pose"].copy())


@scenario(simulated=True, start="near_floor")
def force_slides_along_the_floor(rig: Stage) -> None:
    rig.step(50)
    rig.session(Stream.CARTESIAN, force_axes=ALONG_Z)
    pose = rig.inputs["near_floor_pose"].copy()
    press(rig, 1500, DOWN_N, pose)
    press(rig, 900, DOWN_N, pose, np.array([0.0, 0.0005, 0.0]))


@scenario(simulated=True)
def force_in_free_space(rig: Stage) -> None:
    rig.step(50)
    axes = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    rig.session(Stream.CARTESIAN, force_axes=axes, force_velocity=np.full(6, 0.02))
    press(rig, 1000, np.array([40.0, 0.0, 0.0, 0.0, 0.0, 0.0]), home_pose(rig))


@scenario(simulated=True)
def force_in_a_turned_frame_with_torque(rig: Stage) -> None:
    rig.step(50)
    frame = np.concatenate(
        [[0.1, 0.0, 0.05], turned(np.array([1.0, 0.0, 0.0, 0.0]), np.array([0.3, 0.4, 0.2]))]
    )
    axes = np.array([0.0, 1.0, 1.0, 0.0, 0.0, 1.0])
    rig.session(
        Stream.CARTESIAN, force_axes=axes, force_frame=frame, force_velocity=np.array([0.03] * 3 + [0.1] * 3)
    )
    rig.simulation.push[:] = [0.0, 5.0, -4.0, 0.0, 0.0, 0.3]
    press(rig, 1000, np.array([0.0, 8.0, 3.0, 0.0, 0.0, 0.5]), home_pose(rig))
    rig.end_stream()
    rig.step(500)


@scenario(simulated=True)
def contact_pushed_and_let_go(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, cartesian_stiffness=np.array([3000.0, 2000.0, 2500.0, 200.0, 200.0, 200.0]))
    rig.simulation.push[:] = [20.0, -30.0, 10.0, 0.0, 0.0, 0.0]
    rig.step(700)
    rig.simulation.push[:] = 0.0
    rig.step(500)


@scenario(simulated=True)
def contact_stop_by_a_wrench(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, max_contact_wrench=np.full(6, 25.0))
    feed(rig, 300)
    rig.simulation.push[0] = 40.0
    rig.step(1000)


@scenario(simulated=True)
def contact_stop_by_a_torque(rig: Stage) -> None:
    rig.session(Stream.CARTESIAN, max_contact_torque=np.full(7, 8.0))
    rig.step(100)
    rig.simulation.push[0] = 40.0
    rig.step(1000)


@scenario(simulated=True)
def contact_soft_arm_held_where_it_was_pushed(rig: Stage) -> None:
    soft = np.array([500.0] * 3 + [50.0] * 3)
    rig.session(Stream.CARTESIAN, cartesian_stiffness=soft)
    rig.simulation.push[0] = 20.0
    rig.step(1200)
    rig.end_stream()
    rig.step(800)
