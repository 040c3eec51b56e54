"""How targets and points reach their source: the compiled feed beside its law in plain Python (`laws.feed`).

Both read the same shared memory, which a client writes that is neither punctual nor right; each drives a
source, a safety layer and a collision monitor of its own, and bit for bit the same comes of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from cobot_run import unique_name
from laws import feed as law
from laws.comparison import require_same
from sample_counts import ENOUGH, samples
from thorough import few
from wild_writer import Writer

from cobot.config import Settings
from cobot.ipc import layout
from cobot.ipc.layout import Interpolation, Intervention, ServoMode
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.stream_writer import PointWriter
from cobot.robot.description import RobotDescription
from cobot.types import Array, CartesianLimits
from rtloop.inboxes.point_queue import PointQueue
from rtloop.inboxes.stream import StreamInbox
from rtloop.safety.limiter import Safety
from rtloop.sources.cartesian import CartesianSource
from rtloop.sources.joint import JointSource
from rtloop.sources.servo_force import ForceServo
from rtloop.sources.servo_modes import make_servo
from rtloop.sources.torque import TorqueSource
from rtloop.streaming.collision_monitor import CollisionMonitor
from rtloop.streaming.feed import PointFeed, TargetFeed

PERIOD_S = 1e-3
SAMPLES = samples(200_000)
NEAR_M = 0.01
CYCLES = 400
"""Of a session, if nothing ends it."""
TIMEOUT_CYCLES = 50
TCP = CartesianLimits(0.5, 2.0, 20.0, 1.0, 5.0, 40.0)
FORCE = (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)


@pytest.fixture
def memories(robot: RobotDescription) -> Iterator[list[RobotMemory]]:
    """One file, mapped for a client, for compiled code and for its oracle."""
    memories = [RobotMemory.create(unique_name(), robot.limits.dof, PERIOD_S, 2)]
    memories += [RobotMemory.attach(memories[0].robot, MemoryRole.READER) for _ in range(2)]
    yield memories
    memories[0].unlink()
    for memory in memories:
        memory.close()


class Client:
    """Writes targets that walk on or jump, of this session or another one, late, torn, or no numbers."""

    def __init__(self, memory: RobotMemory, random: np.random.Generator) -> None:
        self.memory, self.random = memory, random
        self._shaken, self._points = Writer(random), PointWriter(memory)
        self.session = 0

    def begin(self, joints: Array, pose: Array, **request: object) -> None:
        random, data = self.random, self.memory.session.data
        self.session += 1
        data["number"], data["open"], data["decimation"] = self.session, 1, random.choice([1, 5, 10])
        data["cartesian_stiffness"], data["posture"], data["force_axes"] = 500.0, np.nan, 0.0
        data["force_frame"], data["force_velocity"] = [0, 0, 0, 1, 0, 0, 0], 0.05
        data["watchdog_s"] = random.choice([0.05, 0.3, 1.0])
        for name, value in request.items():
            data[name] = value
        self.memory.session.publish()
        self._points.begin(self.session)
        self.joints, self.pose = joints.copy(), pose.copy()
        self.drift = random.normal(size=10) * random.choice([0.1, 0.5])
        self.every = int(random.choice([1, 7, 10, 33]))
        self.silent = 0

    def write(self, cycle: int, time_s: float) -> None:
        """What it writes in this cycle, if anything."""
        random, memory = self.random, self.memory
        if random.random() < 0.01:
            self.drift = random.normal(size=10) * random.choice([0.0, 0.1, 1.0])
        self.joints = self.joints + PERIOD_S * self.drift[:7]
        self.pose[:3] += PERIOD_S * self.drift[7:]
        self.silent = int(random.choice([80, 200])) if random.random() < 0.003 else self.silent - 1
        if self.silent <= 0 and cycle % self.every == 0:
            self._write_target(memory.setpoint.data)
            memory.setpoint.publish()
        match int(random.integers(400)):
            case 0 | 1:
                self._write_chunk(memory.chunk.data, time_s)
                memory.chunk.publish()
            case 2 | 3:
                self._shaken.disturb([memory.setpoint, memory.chunk, memory.session][random.integers(3)])
            case 4 | 5:
                memory.session.data["open"] = random.integers(4)
                memory.session.publish()

    def put(self) -> None:
        """A servo point."""
        random, joints = self.random, self.joints.copy()
        if random.random() < 0.003:
            joints[3] = np.nan
        time_s = float(random.choice([1e-3, 0.01]))
        self._points.put(
            joints + (random.random() < 0.01), time_s, *random.choice([(0.0, 0.0), (0.1, 200.0)])
        )
        self._points._seen = self._points.number - 5

    def _write_target(self, setpoint: np.ndarray) -> None:
        random = self.random
        setpoint["session"] = self.session + (random.random() < 0.02)
        setpoint["number"] += random.random() < 0.95
        setpoint["feed_forward"] = random.integers(2)
        setpoint["joints"] = self.joints + 0.5 * (random.random() < 0.02)
        setpoint["joint_velocity"] = self.drift[:7]
        setpoint["pose"] = self.pose
        setpoint["pose"][2] += 0.2 * (random.random() < 0.02)
        setpoint["twist"][:3], setpoint["twist"][3:] = self.drift[7:], 0.0
        setpoint["wrench"] = random.normal(size=6)
        if random.random() < 0.04:
            setpoint["move"] += 1
            setpoint["move_pose"] = self.pose
            setpoint["move_duration_s"] = random.choice([0.0, 0.05, 1.0])
        if random.random() < 0.04:
            setpoint["cancel"] = setpoint["move"] - random.integers(2)
        if random.random() < 0.01:
            name = str(random.choice(["joints", "pose", "wrench", "move_pose", "joint_velocity"]))
            setpoint[name][random.integers(6)] = random.choice([np.nan, np.inf])

    def _write_chunk(self, chunk: np.ndarray, time_s: float) -> None:
        random, count = self.random, int(self.random.integers(0, 65))
        chunk["session"] = self.session + (random.random() < 0.05)
        chunk["number"] += 1
        chunk["count"] = count
        times_s = np.cumsum(random.uniform(1e-3, 0.01, layout.CHUNK_POINTS))
        chunk["times_s"] = time_s + times_s - random.choice([0.0, 0.02, 1.0], p=[0.6, 0.3, 0.1])
        chunk["points"][:, :7] = self.joints + times_s[:, None] * 0.3 * self.drift[:7]
        chunk["points"][0, 0] += random.choice([0.0, 5.0, np.nan], p=[0.9, 0.06, 0.04])


class Side:
    """A feed, and what a controller does with it."""

    def __init__(self, settings: Settings, robot: RobotDescription, memory: RobotMemory) -> None:
        self.robot, self.memory = robot, memory
        self.safety = Safety(robot.limits, PERIOD_S)
        self.monitor = CollisionMonitor(robot.model, settings.streaming, settings.rt.period_s)
        self.box, self.queue = StreamInbox(memory), PointQueue(memory)
        self.feed: Any = None

    def begin(self, position: Array, kind: str, interpolation: Interpolation) -> None:
        self.safety.reset(position)
        self.box.asks()
        self.monitor.begin(self.safety.command, touching=False)
        self.source, self.points = self._sources(kind, interpolation)
        self.source.begin(self.safety.command)
        self.queue.begin(int(self.memory.session.data["number"]))

    def _sources(self, kind: str, interpolation: Interpolation) -> tuple[Any, Any]:
        limits, request = self.robot.limits, self.memory.session.data
        command_s = int(request["decimation"]) * PERIOD_S
        if kind == "joint":
            return JointSource(interpolation, limits, limits.max_velocity, PERIOD_S, command_s), None
        if kind == "torque":
            return TorqueSource(self.robot.model, limits, PERIOD_S), None
        rest = self.robot.model, limits, TCP, PERIOD_S
        if kind == "cartesian":
            return CartesianSource(interpolation, *rest, command_s, request), None
        mode = ServoMode(int(request["servo_mode"]))
        points = make_servo(mode, limits, limits.max_velocity, PERIOD_S)
        assert points is not None
        return (ForceServo(points, *rest, request) if mode in FORCE else points), points

    def make_compiled(self) -> None:
        request = self.memory.session.data
        shared = self.safety, self.monitor, self.box
        if self.points is None:
            self.feed = TargetFeed(self.source, *shared, PERIOD_S, request, TIMEOUT_CYCLES)
        else:
            self.feed = PointFeed(self.source, self.points, *shared, self.queue, PERIOD_S, request)

    def make_plain(self) -> None:
        request = self.memory.session.data
        shared = self.safety, self.monitor, self.memory, self.box, PERIOD_S
        if self.points is None:
            self.feed = law.TargetFeed(self.source, *shared, request=request, timeout_cycles=TIMEOUT_CYCLES)
        else:
            self.feed = law.PointFeed(self.source, self.points, self.queue, *shared, request)

    def step(self, external: Array, wrench: Array, time_s: float) -> None:
        self.box.asks()
        self.feed.advance(external, wrench, time_s)
        self.feed.watch_surroundings()
        if self.feed.holding or self.feed.not_finite or self.feed.problem:
            self.safety.brake()
        else:
            self.safety.apply(self.source.reference, streamed=True)
        self.source.follow(self.safety.command)

    def told(self) -> list[object]:
        """All that a feed says."""
        feed = self.feed
        said = [feed.holding, feed.not_finite, int(feed.problem), self.safety.interventions.tolist()]
        if self.points is None:
            return [*said, feed.setpoint_seen, feed.move_seen, feed.chunk_seen, feed.move_running]
        counts = ("taken", "dropped", "underruns", "buffered")
        return said + [getattr(self.points, name) for name in counts]


def a_place(robot: RobotDescription, margin_m: float, random: np.random.Generator) -> Array:
    """Where the arm is not in anything; often it is near something, or inside the margin."""
    near, inside = random.random() < 0.5, random.random() < 0.25
    limits, home = robot.limits, np.array(robot.positions["home"].joints)
    while True:
        drawn = home + 0.7 * random.normal(size=(100, limits.dof))
        drawn = np.clip(drawn, 0.9 * limits.min_position, 0.9 * limits.max_position)
        distances_m = np.partition(robot.collision.clearance.distances(drawn, 1.0), 1)
        nearest_m, next_m = distances_m[:, 0], distances_m[:, 1]
        fits = (nearest_m > margin_m) & ((next_m < margin_m + NEAR_M) == near)  # Two links are always near.
        if inside:
            fits = (nearest_m > 0.0) & (nearest_m < margin_m)
        if fits.any():
            return drawn[fits.argmax()]


KINDS: dict[str, dict[str, object]] = {
    "joint": {},
    "cartesian": {},
    "torque": {},
    **{f"servo {mode}": {"servo_mode": mode} for mode in ServoMode if mode},
}
EXPECTED = {
    "joint": {"NOT_FINITE", "JUMP", "COMMAND_TIMEOUT", "COLLISION", "PROXIMITY", "LATE"},
    "cartesian": {"NOT_FINITE", "JUMP", "COMMAND_TIMEOUT", "COLLISION", "PROXIMITY"},
    "torque": {"NOT_FINITE", "COMMAND_TIMEOUT"},
    "servo": {"PROXIMITY"},
}
"""Interventions that must have been counted, or the test says little."""


@pytest.mark.parametrize("kind", few(KINDS))
def test_what_a_feed_makes_of_a_client_is_what_the_law_says(
    settings: Settings, robot: RobotDescription, memories: list[RobotMemory], kind: str
) -> None:
    random = np.random.default_rng(list(KINDS).index(kind))
    client = Client(memories[0], random)
    one, other = Side(settings, robot, memories[1]), Side(settings, robot, memories[2])
    counted, problems = np.zeros(len(Intervention), np.uint64), set()
    cycles = SAMPLES // robot.limits.dof // (2 if "servo" in kind else 1)
    while cycles > 0:
        position = a_place(robot, settings.streaming.collision_margin_m, random)
        pose = np.zeros(7)
        robot.model.forward_into(position, pose)
        client.begin(position, pose, **{"servo_mode": 0} | KINDS[kind])
        for side in (one, other):
            side.begin(position, kind.split()[0], Interpolation(int(client.session % 4)))
        one.make_plain()
        other.make_compiled()
        external, wrench = random.normal(size=robot.limits.dof), random.normal(size=6)
        for cycle in range(CYCLES):
            if kind.startswith("servo") and client.silent <= 0 and cycle % client.every == 0:
                client.put()
            client.write(cycle, (cycle + 1) * PERIOD_S)
            for side in (one, other):
                side.step(external, wrench, (cycle + 1) * PERIOD_S)
            assert other.told() == one.told(), cycle
            require_same(other.source.reference, one.source.reference)
            cycles -= 1
            if other.feed.not_finite:
                break
            if other.feed.problem:
                problems.add(int(other.feed.problem))
                break
        counted += other.safety.interventions
    if ENOUGH:
        names = {each.name for each, count in zip(Intervention, counted, strict=True) if count}
        assert EXPECTED.get(kind.split()[0], set()) <= names
        assert problems <= ({law.SERVO_WATCHDOG, law.CLIENT_ENDED} if "servo" in kind else set())
