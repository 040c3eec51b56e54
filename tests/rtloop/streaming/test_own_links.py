"""Streams at full speed towards places where the arm overlaps with itself or its surroundings, at random.

Oracle: MuJoCo's distances at the commanded positions; they do not come from cobot's own formulas.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
from folders import ROOT
from franka_settings import franka_settings
from rig import Rig
from sample_counts import ENOUGH, samples
from thorough import few

from cobot.config import Settings, load_settings
from cobot.ipc.layout import Interpolation, ServoMode, Stream
from cobot.ipc.stream_writer import PointWriter
from cobot.launch.new_robot.new_robot import NewRobot
from cobot.robot.collision import geom_pairs
from cobot.robot.description import RobotDescription, load_robot
from cobot.types import Array, LoopMode
from rtloop.streaming.collision_monitor import CollisionMonitor

CYCLES, EVERY = samples(48_000), 10
MARGIN_M, SHORT_M = 0.005, 0.004
"""A small margin, so that an arm that stops too late touches, and the part of it that may be used up."""
BENT = {"rail arm": np.array([0.0, 0.3, 0.5, 0.4, 0.4, 0.9, 0.2])}
"""Where arms begin whose home is stretched out, so that no pose leads away from there."""
LAG_RAD = 0.25
"""A client whose arm is held this far behind its target turns back."""
LINK_ROOM = 0.5


@cache
def arm(name: str) -> tuple[Settings, RobotDescription]:
    """One of the arms that come with cobot, with a small margin."""
    if name == "rail arm":
        with TemporaryDirectory() as folder:
            NewRobot(ROOT / "examples" / "rail_arm" / "rail_arm.urdf").write(Path(folder) / "rail")
            settings = load_settings(Path(folder) / "rail" / "cobot-setting.yaml")
            return with_margin(settings), load_robot(settings)
    settings = franka_settings() if name == "fr3" else load_settings()
    return with_margin(settings), load_robot(settings)


def with_margin(settings: Settings) -> Settings:
    streaming = settings.streaming.model_copy(update={"collision_margin_m": MARGIN_M})
    return settings.model_copy(update={"streaming": streaming})


def distances_m(robot: RobotDescription, rows: Array, farthest_m: float) -> Array:
    """Between any two shapes that may collide, at each row of joints."""
    mj = robot.model.mj
    data, pairs = mujoco.MjData(mj), geom_pairs(mj)
    found = np.zeros((len(rows), len(pairs)))
    for row, joints in enumerate(rows):
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        found[row] = [mujoco.mj_geomDistance(mj, data, *pair, farthest_m, None) for pair in pairs]
    return found


class Client:
    """Streams joints in straight lines to places where the arm is in something; turns back when it is held.

    Attributes:
        target: the joints that are streamed.
        home: where it began.
        fastest: what a stream may ask of them, rad/s.
    """

    def __init__(self, rig: Rig, seed: int) -> None:
        self.rig, self.random = rig, np.random.default_rng(seed)
        limits = rig.limits
        self.fastest = np.minimum(limits.max_velocity, rig.settings.streaming.joint_velocity)
        self.target = self.home = rig.loop.controller.safety.position.copy()
        self._left, self._turns_back = 0, False

    def go_home(self) -> None:
        """From where the arm is."""
        self.target = self.rig.loop.controller.safety.position.copy()
        self._goal, self._step = self.home, 0.005 * self.fastest
        self._left, self._turns_back = 200, False

    def advance(self, period_s: float) -> None:
        """The next target."""
        here = self.rig.loop.controller.safety.position
        off = np.abs(self.target - here).max()
        if self._left == 0 or (self._turns_back and off < 0.01):
            self._goal = self.place_in_something(here)
            self._left, self._turns_back = int(self.random.integers(3, 150)), False
            self._step = self.random.uniform(0.3, 0.97, len(here)) * self.fastest * period_s
        elif off > LAG_RAD and not self._turns_back:
            self._left, self._turns_back = 500, True
        self._left -= 1
        goal = here if self._turns_back else self._goal
        self.target = self.target + np.clip(goal - self.target, -self._step, self._step)

    def place_in_something(self, here: Array) -> Array:
        limits, is_free = self.rig.limits, self.rig.robot.collision.is_free
        while True:
            way = self.random.choice([0.3, 1.0, 2.0]) * self.random.normal(size=len(here))
            place = np.clip(here + way, limits.min_position, limits.max_position)
            if not is_free(place):
                return np.array(place)


def joints(kind: Interpolation, rig: Rig, client: Client) -> None:
    assert rig.stream(interpolation=kind, decimation=EVERY) == ""
    for cycle in range(CYCLES):
        if cycle % EVERY == 0:
            client.advance(EVERY * rig.settings.rt.period_s)
            rig.aim(joints=client.target)
        rig.step()


def lies(rig: Rig, client: Client) -> None:
    """A target in each cycle, with a velocity that is not its own: small, and the other way."""
    assert rig.stream(interpolation=Interpolation.NONE, decimation=1) == ""
    while len(rig.commanded) < CYCLES:
        path = there_and_back(client, 2.0 / client.fastest)
        for row, velocity in zip(path, np.diff(path, axis=0, append=path[-1:]), strict=True):
            rig.aim(joints=row, joint_velocity=-0.05 * np.sign(velocity), feed_forward=1)
            rig.step()


def poses(rig: Rig, client: Client) -> None:
    assert rig.stream(Stream.CARTESIAN, interpolation=Interpolation.LINEAR, decimation=EVERY) == ""
    while len(rig.commanded) < 3 * CYCLES:
        path = there_and_back(client, 4.0 / client.fastest)
        for pose in rig.robot.model.chain.poses(path[::EVERY]):
            rig.aim(pose=pose)
            rig.step(EVERY)


def there_and_back(client: Client, slowness: Array) -> Array:
    """From home into something and back, a row a cycle; at the peak joints have 1.9 / `slowness`."""
    home = client.home
    way = client.place_in_something(home) - home
    share = np.linspace(0.0, 1.0, int((np.abs(way) * slowness).max() / client.rig.settings.rt.period_s))
    there = home + (share**3 * (10.0 - 15.0 * share + 6.0 * share**2))[:, None] * way
    return np.concatenate([there, np.repeat(there[-1:], 300, axis=0), there[::-1]])


def points(mode: ServoMode, rig: Rig, client: Client) -> None:
    """A servo session, which ends where the arm is held, and then another one from there."""
    writer, period_s = PointWriter(rig.memory), rig.settings.rt.period_s
    for _ in range(CYCLES // EVERY):
        if rig.mode != LoopMode.JOINT_IMPEDANCE:
            rig.run()
            client.go_home()
            assert rig.stream(servo_mode=mode, watchdog_s=0.5) == ""
            writer.begin(int(rig.memory.session.data["number"]))
        client.advance(EVERY * period_s)
        writer.put(client.target.tolist(), EVERY * period_s, 0.03, 100.0)
        rig.step(EVERY)


STREAMS: dict[str, Callable[[Rig, Client], None]] = {
    **{f"joints, {kind.name}": partial(joints, kind) for kind in Interpolation},
    "a client that misstates its velocities": lies,
    "poses": poses,
    **{f"servo mode {mode}": partial(points, mode) for mode in (ServoMode.REPLANNED, ServoMode.DIRECT)},
}


@pytest.mark.parametrize("name", few(["iiwa", "fr3", "rail arm"]))
@pytest.mark.parametrize("stream", STREAMS)
def test_no_stream_at_any_speed_brings_two_parts_nearer_than_the_margin(name: str, stream: str) -> None:
    settings, robot = arm(name)
    rig = Rig(settings, robot, start=BENT.get(name))
    STREAMS[stream](rig, Client(rig, list(STREAMS).index(stream)))
    rows, counted = np.array(rig.commanded), rig.counted()
    rig.close()
    assert counted.get("COLLISION", 0) > 0 or not ENOUGH, "no stream was held"
    assert distances_m(robot, rows[::8], 2.0 * MARGIN_M).min() >= MARGIN_M - SHORT_M


def inside(robot: RobotDescription, seed: int) -> tuple[Array, Array]:
    """A place where one pair is inside the margin and no other is near it, and the joint step that brings
    this pair nearest, of which the largest is 1.
    """
    random, limits = np.random.default_rng(seed), robot.limits
    while True:
        place = random.uniform(0.9 * limits.min_position, 0.9 * limits.max_position)
        found = distances_m(robot, place[None], 1.0)[0]
        if 0.2 * MARGIN_M < found.min() < 0.6 * MARGIN_M and np.sort(found)[1] > 4.0 * MARGIN_M:
            steps = place + 1e-4 * np.eye(len(place))
            slope = (distances_m(robot, steps, 1.0)[:, found.argmin()] - found.min()) / 1e-4
            return place, -slope / np.abs(slope).max()


def now_s(rig: Rig) -> float:
    assert rig.memory.state.try_read()
    return float(rig.memory.state.data["robot_time_s"])


def go(rig: Rig, kind: str, step: Array, writer: PointWriter, steps: int = 30) -> None:
    """Stream from where the arm is, a joint step in each 10 ms."""
    here = rig.loop.controller.safety.position.copy()
    fields = {"servo_mode": ServoMode[kind], "watchdog_s": 0.5} if kind in ServoMode.__members__ else {}
    stream = Stream.CARTESIAN if kind in ("pose", "move") else Stream.JOINT_IMPEDANCE
    assert rig.stream(stream, decimation=EVERY, **fields) == ""
    writer.begin(int(rig.memory.session.data["number"]))
    pose = np.zeros(7)
    for count in range(1, steps + 1):
        target = here + count * step
        rig.robot.model.forward_into(target, pose)
        if fields and rig.mode is LoopMode.JOINT_IMPEDANCE:
            writer.put(target.tolist(), 0.01, 0.03, 100.0)
        elif kind == "joint":
            rig.aim(joints=target)
        elif kind == "pose":
            rig.aim(pose=pose)
        elif kind == "move" and count == 1:
            rig.robot.model.forward_into(here + 30 * step, pose)
            rig.aim(move=int(rig.memory.setpoint.data["move"]) + 1, move_pose=pose, move_duration_s=3.0)
        elif kind == "chunk" and count == 1:
            chunk = rig.memory.chunk.data
            chunk["session"], chunk["count"] = rig.memory.session.data["number"], 30
            chunk["number"] += 1
            chunk["times_s"][:30] = now_s(rig) + 0.01 * np.arange(1, 31)
            chunk["points"][:30, : len(here)] = here + np.arange(1, 31)[:, None] * step
            rig.memory.chunk.publish()
        rig.step(EVERY)
    rig.end_stream()
    rig.run()


def test_no_stream_creeps_over_the_margin() -> None:
    """At 0.3 mm/s, the way to rest is shorter than what counts as an approach from one look to the next."""
    settings, robot = arm("iiwa")
    place, nearer = inside(robot, 4)
    found = distances_m(robot, place - np.array([[0.0], [1e-4]]) * nearer, 1.0).min(axis=1)
    slope = (found[1] - found[0]) / 1e-4
    begin = place - nearer * (MARGIN_M + 2e-4 - found[0]) / slope
    rig = Rig(settings, robot, start=begin)
    go(rig, "joint", 3e-6 / slope * nearer, PointWriter(rig.memory), steps=250)
    rows = np.array(rig.commanded)
    rig.close()
    found = distances_m(robot, rows[::20], 1.0).min(axis=1)
    assert MARGIN_M - 5e-5 < found.min() < MARGIN_M


@pytest.mark.parametrize(
    "kind", ["joint", "pose", "move", "chunk", "REPLANNED", "DIRECT", "BUFFERED", "THROUGH"]
)
@pytest.mark.parametrize("speed_rad_s", [0.5, 0.01])
def test_no_session_that_begins_inside_the_margin_leads_deeper(kind: str, speed_rad_s: float) -> None:
    """Nor do many, each of which begins where the one before has ended. The same streams lead out."""
    settings, robot = arm("iiwa")
    place, nearer = inside(robot, 4)
    rig, step = Rig(settings, robot, start=place), 0.01 * speed_rad_s * nearer
    writer = PointWriter(rig.memory)
    for _ in range(8):
        go(rig, kind, step, writer)
    found = distances_m(robot, np.array(rig.commanded), 1.0).min(axis=1)
    begun = len(rig.commanded)
    for _ in range(5):
        go(rig, kind, -step, writer)
    left = distances_m(robot, np.array(rig.commanded[begun:]), 1.0).min(axis=1)
    rig.close()
    assert found.min() >= found[0] - 1e-6
    assert rig.counted()["COLLISION"] >= 8
    assert left[-1] > left[0] + 1e-4


@pytest.mark.parametrize("name", few(["iiwa", "fr3", "rail arm"]))
def test_links_that_pass_closely_do_not_slow_a_stream(name: str) -> None:
    """Nor does the base that they pass: only links whose way to rest takes more than half of their room."""
    settings, robot = arm(name)
    section, limits, mj = settings.streaming, robot.limits, robot.model.mj
    monitor, random = CollisionMonitor(robot.model, section, settings.rt.period_s), np.random.default_rng(3)
    monitor.begin(np.zeros((3, limits.dof)), touching=False)
    of_floor = np.array(["floor" in (mj.geom(a).name, mj.geom(b).name) for a, b in geom_pairs(mj)])
    passed = 0
    for _ in range(samples(400)):
        place = random.uniform(limits.min_position, limits.max_position)
        velocity = random.uniform(-0.3, 0.3, limits.dof)
        stopping_s = np.abs(velocity) / (2.0 * limits.max_acceleration)
        stopping_s += 0.5 * limits.max_acceleration / limits.max_jerk + 0.018
        line = place + np.linspace(0.0, 1.0, 4)[:, None] * (velocity * stopping_s)
        found = distances_m(robot, line, 1.0)
        here, nearest = found[0], found[1:]
        room_m = here - section.collision_margin_m
        slows = (nearest < here - 1e-6) & (nearest < section.collision_margin_m + section.slow_down_m)
        if room_m.min() <= 0.0 or slows[:, of_floor].any():
            continue
        if ((here - nearest) / room_m)[:, ~of_floor].max() > 0.8 * LINK_ROOM:
            continue
        for _ in range(4):
            monitor.look(np.array([place, velocity, 0.0 * place]))
        assert monitor.share == 1.0
        passed += 1
    assert passed > samples(20)
