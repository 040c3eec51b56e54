"""The compiled sources of streams compute what their laws say.

Oracles: the same laws in numpy, `tests/support/laws`, around the same generators, which have oracles of
their own.
Each part is compared on a share (`sample_counts`) of 400,000 coordinates of random sessions, or of as many
random inputs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from cobot_run import unique_name
from laws import cartesian as cartesian_law
from laws import joint as joint_law
from laws import servo_law as law
from laws import servo_modes as servo_law
from laws import target_checks as check_law
from laws import torque as torque_law
from laws.comparison import close
from laws.servo_through_points import ThroughPoints as ThroughPointsLaw
from sample_counts import ENOUGH, samples
from thorough import few

from cobot.ipc import layout
from cobot.ipc.layout import Interpolation, Intervention, ServoMode
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.stream_writer import PointWriter
from cobot.robot import quaternion
from cobot.robot.description import RobotDescription
from cobot.types import Array, CartesianLimits, JointLimits
from rtloop.generators.chunks import ChunkInterpolator
from rtloop.generators.factory import make_interpolator
from rtloop.generators.online_trajectory import OnlineTrajectory
from rtloop.generators.pose_interpolation import PoseInterpolator
from rtloop.generators.pose_limiter import PoseLimiter
from rtloop.generators.target_range import PoseRange
from rtloop.inboxes.point_queue import PointQueue
from rtloop.results import result_of
from rtloop.sources.cartesian import CartesianSource
from rtloop.sources.joint import JointSource
from rtloop.sources.servo_force import ForceServo
from rtloop.sources.servo_law import ServoLaw, transition
from rtloop.sources.servo_modes import make_servo
from rtloop.sources.target_checks import angular_distance, check_joint_step, check_pose_step
from rtloop.sources.torque import TorqueSource

PERIOD_S = 1e-3
PROFILED = 1e-9
"""Where a time-optimal profile of a state that carries rounding lies inside."""
SAMPLES = samples(400_000)
RATES = np.array([[1.0], [1.0 / PERIOD_S], [1.0 / PERIOD_S**2]])
"""A rounding of a position, in a velocity and an acceleration that are its differences."""
TCP = CartesianLimits(0.5, 2.0, 20.0, 1.0, 5.0, 40.0)
WITHIN = (0.5, 2.0, 20.0, 1.0, 5.0, 40.0)


def record(dtype: np.dtype) -> Block:
    """A block that nobody else sees."""
    return Block(bytearray(Block.size(dtype)), 0, dtype, "test")


def spoilt(random: np.random.Generator, values: Array, share: float) -> None:
    """Now and then one of the values is no number."""
    if random.random() < share:
        values[random.integers(len(values))] = random.choice([np.nan, np.inf, -np.inf])


def at_rest(limits: JointLimits, random: np.random.Generator) -> Array:
    """A command, shape (3, dof), that holds the arm anywhere within its limits."""
    position = random.uniform(limits.min_position, limits.max_position)
    return np.array([0.9 * position, 0.0 * position, 0.0 * position])


def moving(limits: JointLimits, random: np.random.Generator) -> Array:
    command = at_rest(limits, random)
    command[1] = random.uniform(-0.3, 0.3, limits.dof) * limits.max_velocity
    command[2] = random.uniform(-0.3, 0.3, limits.dof) * limits.max_acceleration
    return command


# Checks of targets


def test_joint_targets_jump_when_the_law_says_so() -> None:
    random, n, dof = np.random.default_rng(1), SAMPLES // 2, 7
    names = tuple(f"axis{k}" for k in range(dof))
    max_velocity = random.uniform(0.5, 12.0, dof)
    last = random.uniform(-3.0, 3.0, (n, dof))
    target = last + random.normal(size=(n, dof)) * random.choice([1e-3, 0.01, 0.05, 0.5], (n, 1))
    spoil = random.random(n) < 0.02
    target[spoil, random.integers(0, dof, spoil.sum())] = np.nan
    interval_s = random.choice([-1.0, 0.0, 5e-4, 0.002, 0.01, 0.033, 0.1, 5.0], n)
    refused = 0
    for most in (None, max_velocity):
        joint, step, allowed = check_law.joint_steps(target, last, interval_s, most)
        for k, (first, rows) in enumerate(zip(joint.tolist(), zip(target, last, strict=True), strict=True)):
            words = ""
            if first >= 0:
                words = (
                    f"axis{first} would jump by {step[k, first]:.4f} rad, "
                    f"allowed: {allowed[k, first]:.4f} rad"
                )
            assert check_joint_step(*rows, interval_s[k], most, names) == result_of(words)
            refused += first >= 0
    assert 0.1 * n < refused < 1.9 * n


def test_poses_jump_when_the_law_says_so() -> None:
    random, n = np.random.default_rng(2), SAMPLES
    last, pose = random.normal(size=(2, n, 7))
    pose[:, :3] = last[:, :3] + random.normal(size=(n, 3)) * random.choice([1e-3, 0.02, 0.3], (n, 1))
    near = random.random(n) < 0.7
    pose[near, 3:] = last[near, 3:] + random.choice([1e-9, 1e-4, 0.05, 0.5], (near.sum(), 1)) * pose[near, 3:]
    for rows in (last, pose):
        rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1)[:, None]
    pose[random.random(n) < 0.5, 3:] *= -1.0
    spoil = random.random(n) < 0.02
    pose[spoil, random.integers(0, 7, spoil.sum())] = np.nan
    interval_s = random.choice([0.0, 0.002, 0.01, 0.033, 5.0], n)
    linear, angular = random.uniform(0.1, 10.0, n), random.uniform(0.5, 50.0, n)
    distance, angle = check_law.distance(pose, last), check_law.angle(pose, last)
    within_s = check_law.clamped_interval(interval_s)
    refused = 0
    for k in range(n):
        words = ""
        if not distance[k] <= linear[k] * within_s[k]:
            words = f"the TCP would jump by {distance[k]:.4f} m, allowed: {linear[k] * within_s[k]:.4f} m"
        elif not angle[k] <= angular[k] * within_s[k]:
            words = (
                f"the TCP would turn by {angle[k]:.4f} rad at once, "
                f"allowed: {angular[k] * within_s[k]:.4f} rad"
            )
        assert check_pose_step(pose[k], last[k], interval_s[k], linear[k], angular[k]) == result_of(words)
        refused += words != ""
    assert 0.1 * n < refused < 0.9 * n
    for k in np.flatnonzero(~spoil)[: n // 4]:
        close(np.array(angular_distance(pose[k, 3:], last[k, 3:])), angle[k], 10.0)


# Servo law


def test_the_servo_law_of_random_lookaheads_and_gains() -> None:
    random, n = np.random.default_rng(3), 500
    one, other = law.ServoLaw(n, PERIOD_S), ServoLaw(n, PERIOD_S)
    state = random.normal(size=(3, n))
    one.begin(state)
    other.begin(state)
    target = state.copy()
    for _ in range(max(SAMPLES // n, 20)):
        if random.random() < 0.2:
            lookahead_s = float(random.choice([0.0, 0.03, 0.1, 0.2, 2.0 / np.sqrt(200.0), 1.0]))
            gain = float(random.choice([0.0, 1.0, 100.0, 200.0, 2000.0, 1e5]))
            one.tune(lookahead_s, gain)
            other.tune(lookahead_s, gain)
            close(transition(lookahead_s, gain, PERIOD_S), law.transition(lookahead_s, gain, PERIOD_S), 1e3)
        target[0] += 1e-3 * target[1]
        target[1] = np.where(random.random(n) < 0.05, random.normal(size=n), target[1])
        one.follow(target)
        other.follow(target)
        assert one.active == other.active
        scale = 1.0 + np.abs(one.reference[:2]).max()
        # What is left of position and velocity after long is next to nothing, and the gain magnifies it.
        close(other.reference[:2], one.reference[:2], scale * np.array([[1.0], [1e3]]))
        close(other.reference[2], one.reference[2], scale * (1.0 + gain_of(one)) * 1e2)
        other.begin(one.reference)


def gain_of(servo: law.ServoLaw) -> float:
    return servo._gain * (1.0 + servo._lookahead_s)


# Torques


def test_torques_of_random_clients_and_surroundings(robot: RobotDescription) -> None:
    random, limits, dof = np.random.default_rng(4), robot.limits, robot.limits.dof
    one = torque_law.TorqueSource(robot.model, limits, PERIOD_S)
    other = TorqueSource(robot.model, limits, PERIOD_S)
    setpoint = record(layout.setpoint_dtype(dof))
    refused = 0
    external, wrench = np.zeros(dof), np.zeros(6)
    for cycle in range(SAMPLES // dof):
        if cycle % 50 == 0:
            command = moving(limits, random)
            one.begin(command)
            other.begin(command)
            external = random.normal(size=dof) * random.choice([0.0, 1.0, 30.0])
        if random.random() < 0.2:
            setpoint.data["joints"] = random.normal(size=dof) * random.choice([0.1, 3.0, 1e3])
            spoilt(random, setpoint.data["joints"], 0.05)
            flaw = one.take(setpoint.data, 0.01)
            assert other.take(setpoint, 0.01) == flaw
            refused += flaw is Intervention.NOT_FINITE
            np.testing.assert_array_equal(other.heading, one.heading)
        one.advance(external, wrench)
        other.advance(external, wrench)
        # The mass matrix divides by inertias down to a hundredth.
        close(
            other.reference, one.reference, np.array([[10.0], [1e3], [1e3]]) * (1.0 + limits.max_jerk.max())
        )
        followed = one.reference + (cycle % 7 == 0) * 1e-3 * random.normal(size=(3, dof))
        one.follow(followed)
        other.follow(followed)
    assert refused > 10 * SAMPLES / 100_000


# Joint targets and chunks


@pytest.mark.parametrize("kind", Interpolation)
def test_joint_targets_and_chunks_of_random_clients(robot: RobotDescription, kind: Interpolation) -> None:
    random, limits, dof = np.random.default_rng(5 + kind), robot.limits, robot.limits.dof
    rates = limits.max_velocity, limits.max_acceleration, limits.max_jerk
    setpoint, chunk = record(layout.setpoint_dtype(dof)), record(layout.chunk_dtype(dof))
    flaws: list[Intervention | None] = []
    still = np.zeros(dof)
    compared, session = 0, 0
    while compared < SAMPLES // len(Interpolation):
        session += 1
        command_s = float(random.choice([0.001, 0.01, 0.033]))
        generators = make_interpolator(kind, dof, PERIOD_S, *rates), ChunkInterpolator(dof, PERIOD_S, *rates)
        one = joint_law.JointSource(*generators, limits.max_velocity, PERIOD_S, command_s)
        other = JointSource(kind, limits, limits.max_velocity, PERIOD_S, command_s)
        command = moving(limits, random)
        one.begin(command)
        other.begin(command)
        target, time_s = command[0].copy(), 0.0
        for _ in range(150):
            time_s += PERIOD_S
            if random.random() < 0.15:
                target = target + random.normal(size=dof) * random.choice([0.0, 1e-4, 2e-3, 0.02, 0.2])
                fill_setpoint(random, setpoint.data, target)
                interval_s = command_s * random.choice([0.0, 0.5, 1.0, 3.0])
                flaws.append(one.take(setpoint.data, interval_s))
                assert other.take(setpoint, interval_s) == flaws[-1]
                target = target if flaws[-1] is None else one._last
            if random.random() < 0.05:
                fill_chunk(random, chunk.data, one.reference[0], time_s)
                flaws.append(one.take_chunk(chunk.data, time_s))
                assert other.take_chunk(chunk, time_s) == flaws[-1]
            one.advance(still, np.zeros(6))
            other.advance(still, np.zeros(6))
            close(other.reference, one.reference, RATES * (1.0 + np.abs(one.reference).max()))
            np.testing.assert_array_equal(other.heading, one.heading)
            if random.random() < 0.01:  # it was held, and goes on from where the safety layer is
                command = one.reference * [[1.0], [0.5], [0.0]]
                one.begin(command)
                other.begin(command)
            compared += dof
        chunks: Any = generators[1]
        assert (other.late, other.starved) == (chunks.late, chunks.starved)
    kinds = {None, Intervention.NOT_FINITE, Intervention.JUMP, Intervention.LATE}
    assert set(flaws) == kinds or SAMPLES < 100_000


def fill_setpoint(random: np.random.Generator, setpoint: np.ndarray, target: Array) -> None:
    setpoint["joints"], setpoint["joint_velocity"] = target, random.normal(size=len(target))
    setpoint["feed_forward"] = random.integers(2)
    spoilt(random, setpoint["joints"], 0.03)
    spoilt(random, setpoint["joint_velocity"], 0.03)


def fill_chunk(random: np.random.Generator, chunk: np.ndarray, here: Array, time_s: float) -> None:
    count = int(random.integers(0, 65))
    chunk["count"] = count if random.random() < 0.95 else random.integers(2**63)
    steps_s = random.uniform(4e-4, 0.03, layout.CHUNK_POINTS)
    times_s = time_s + random.uniform(-0.05, 0.1) + np.cumsum(steps_s)
    if random.random() < 0.05:
        times_s = random.choice([times_s[::-1], times_s - 3.0, times_s + 1e3])
    ways = np.cumsum(random.normal(size=(layout.CHUNK_POINTS, len(here))), axis=0)
    chunk["times_s"] = times_s
    chunk["points"] = here + random.choice([1e-4, 1e-3, 0.1], p=[0.5, 0.3, 0.2]) * ways
    spoilt(random, chunk["times_s"][: max(count, 1)], 0.02)
    spoilt(random, chunk["points"][0], 0.02)


# Poses


def random_request(random: np.random.Generator, limits: JointLimits, here: Array, force: bool) -> np.ndarray:
    """Of a session, as much as the Cartesian source reads."""
    request = np.zeros((), layout.session_dtype(limits.dof))
    stiffness = random.uniform(100.0, 3000.0, 6)
    request["cartesian_stiffness"] = stiffness
    request["posture"] = np.nan if random.random() < 0.5 else here + random.normal(size=limits.dof) * 0.2
    request["force_frame"][3] = 1.0
    if force:
        request["force_axes"] = random.random(6) < 0.4
        request["force_velocity"] = random.choice([0.01, 0.05, 1.0], 6)
        request["force_in_tcp"] = random.integers(2)
        request["force_frame"][:3] = random.normal(size=3) * 0.2
        turn = random.normal(size=4)
        request["force_frame"][3:] = turn / np.linalg.norm(turn)
    return request


class PoseStream:
    """Random targets of the TCP: walks, jumps, moves, and what is none."""

    def __init__(self, random: np.random.Generator, pose: Array, command_s: float) -> None:
        self.random, self.pose, self.command_s = random, pose, command_s
        self.drift = random.normal(size=6) * random.choice([0.0, 0.1, 0.3, 1.0])

    def fill(self, setpoint: np.ndarray) -> None:
        random = self.random
        if random.random() < 0.05:
            self.drift = random.normal(size=6) * random.choice([0.0, 0.1, 0.5])
        step = self.command_s * self.drift
        if random.random() < 0.03:
            step = random.normal(size=6) * random.choice([0.01, 1.0])
        self.pose = self.pose.copy()
        self.pose[:3] += step[:3]
        self.pose[3:] = quaternion.product(quaternion.exp(step[3:].tolist()), self.pose[3:].tolist())
        setpoint["pose"], setpoint["twist"] = self.pose, self.drift
        if random.random() < 0.2:
            setpoint["pose"][3:] *= -1.0
        setpoint["feed_forward"] = random.integers(2)
        setpoint["wrench"] = random.normal(size=6) * random.choice([0.0, 1.0, 30.0])
        for name in ("pose", "twist", "wrench"):
            spoilt(random, setpoint[name], 0.02)
        if random.random() < 0.02:
            setpoint["pose"][3:] *= 1.01


@pytest.mark.parametrize("force", [False, True])
def test_poses_of_random_clients(robot: RobotDescription, force: bool) -> None:
    random, limits, dof = np.random.default_rng(9 + force), robot.limits, robot.limits.dof
    setpoint = record(layout.setpoint_dtype(dof))
    seen: set[Intervention | None] = set()
    events = dict.fromkeys(("clipped", "limited", "waited", "moves", "arrived"), 0)
    compared = 0
    while compared < SAMPLES // 2:
        kind = Interpolation(int(random.integers(4)))
        command_s = float(random.choice([0.001, 0.01, 0.033]))
        command = moving(limits, random) * [[1.0], [random.integers(2) * 0.2], [0.0]]
        if random.random() < 0.5:  # next to the limit of a joint
            joint = random.integers(dof)
            command[0, joint] = limits.max_position[joint] - 1e-5
        request = random_request(random, limits, command[0], force)
        targets = PoseRange(PERIOD_S, command_s)
        parts = PoseInterpolator(kind, PERIOD_S, *WITHIN), PoseLimiter(PERIOD_S, TCP), targets
        if kind is not Interpolation.NONE:
            parts[1].stay_within(targets)
        one = cartesian_law.CartesianSource(*parts, robot.model, limits, TCP, PERIOD_S, command_s, request)
        other = CartesianSource(kind, robot.model, limits, TCP, PERIOD_S, command_s, request)
        one.begin(command)
        other.begin(command)
        stream = PoseStream(random, one._last.copy(), command_s)
        external, wrench = np.zeros(dof), np.zeros(6)
        for _ in range(200):
            if random.random() < 0.1:
                stream.fill(setpoint.data)
                interval_s = command_s * random.choice([0.5, 1.0, 3.0])
                flaw = one.take(setpoint.data, interval_s)
                assert other.take(setpoint, interval_s) == flaw
                seen.add(flaw)
                stream.pose = stream.pose if flaw is None else one._last.copy()
            act_alike(random, one, other, stream, events)
            if random.random() < 0.05:
                wrench = random.normal(size=6) * random.choice([0.0, 5.0, 50.0])
            was_moving = one.move_running
            one.advance(external, wrench)
            other.advance(external, wrench)
            assert other.move_running == one.move_running
            close(other.reference, one.reference, RATES * 10.0)
            one.reference[0] = other.reference[
                0
            ]  # along the force axes and in the null space, rounding adds up
            if random.random() < 0.05:
                close(other.heading, one.heading, 10.0 * (1.0 + np.abs(one.heading).max()) * 1e3)
            followed = one.reference.copy()
            followed[0] += 0.5 * (random.random() < 0.01)
            one.follow(followed)
            other.follow(followed)
            events["arrived"] += was_moving and not one.move_running
            events["waited"] += not one.reference[1:].any()
            events["clipped"] += (np.abs(one.reference[1]) / limits.max_velocity).max() > 0.979
            events["limited"] += bool(
                ((one.reference[0] == limits.min_position) | (one.reference[0] == limits.max_position)).any()
            )
            compared += dof
    if ENOUGH:
        assert seen == {None, Intervention.NOT_FINITE, Intervention.JUMP}
        assert min(events.values()) > 0, events


def act_alike(
    random: np.random.Generator,
    one: cartesian_law.CartesianSource,
    other: CartesianSource,
    stream: PoseStream,
    events: dict[str, int],
) -> None:
    """Now and then begin a move, or cancel it, press, or go on from elsewhere."""
    match int(random.integers(120)):
        case 0:
            step = random.choice([1e-8, 1e-4, 0.05])
            goal = one._limiter.pose + step * random.normal(size=7) * ([1.0] * 3 + [0.3] * 4)
            goal[3:] /= np.linalg.norm(goal[3:])
            spoilt(random, goal, 0.05)
            duration_s = float(random.choice([0.002, 0.1, np.nan], p=[0.7, 0.2, 0.1]))
            flaw = one.start_move(goal, duration_s)
            assert other.start_move(goal, duration_s) == flaw
            assert one.start_move(goal, duration_s) == other.start_move(goal, duration_s) == flaw
            events["moves"] += one.move_running
        case 1:
            one.cancel_move()
            other.cancel_move()
        case 2:
            wrench = random.normal(size=6) * 10.0
            spoilt(random, wrench, 0.3)
            one.press(wrench)
            other.press(wrench)
        case 3:
            held = one.reference * [[1.0], [0.3], [0.0]]
            one.begin(held)
            other.begin(held)


# Servo modes


class Points:
    """A client of servo points: for a law's queue and for the ring in shared memory alike."""

    def __init__(self, written: RobotMemory, read: RobotMemory, random: np.random.Generator) -> None:
        self.random = random
        self.queue = PointQueue(read)
        self._memory, self._writer = written, PointWriter(written)
        self._session = 0

    def begin(self) -> None:
        self._session += 1
        self.plain = servo_law.Queue()
        self.queue.begin(self._session)
        self._writer.begin(self._session)

    def put(self, point: servo_law.Point) -> None:
        self.plain.announced = 0
        self.plain.points.append(point)
        assert self._writer.put(point.joints, point.time_s, point.lookahead_s, point.gain)

    def announce(self) -> None:
        """A point whose writing takes its time."""
        head, number = self._memory.point_head, self._writer.number + 1
        place = self._memory.points[number % layout.POINTS]
        place.data["number"] = 0
        place.publish()
        head.data["session"], head.data["number"] = self._session, number
        head.publish()
        self.plain.announced = 1

    def poll(self) -> None:
        self.queue.poll()
        self._writer._seen = self.queue.seen


@pytest.fixture
def points(robot: RobotDescription) -> Iterator[Points]:
    memory = RobotMemory.create(unique_name(), robot.limits.dof, PERIOD_S, 2)
    reader = RobotMemory.attach(memory.robot, MemoryRole.READER)
    try:
        yield Points(memory, reader, np.random.default_rng(20))
    finally:
        reader.close()
        memory.unlink()
        memory.close()


def plain_servo(mode: ServoMode, limits: JointLimits) -> Any:
    """The law of a servo mode without force control."""
    rates = limits.max_velocity, limits.max_acceleration, limits.max_jerk
    if mode in (ServoMode.REPLANNED, ServoMode.REPLANNED_FORCE):
        planner = OnlineTrajectory(limits.dof, PERIOD_S, *rates)
        return servo_law.Newest(limits, limits.max_velocity, PERIOD_S, planner)
    if mode is ServoMode.DIRECT:
        return servo_law.Newest(limits, limits.max_velocity, PERIOD_S, None)
    if mode in (ServoMode.BUFFERED, ServoMode.BUFFERED_1MS):
        fixed_s = 1e-3 if mode is ServoMode.BUFFERED_1MS else None
        return servo_law.Buffered(limits, limits.max_velocity, PERIOD_S, fixed_s)
    return ThroughPointsLaw(limits, PERIOD_S)


class Walk:
    """Random points: at a pace, in bursts, with gaps, far away, beyond the limits, or no numbers at all."""

    def __init__(self, random: np.random.Generator, limits: JointLimits, joints: Array) -> None:
        self.random, self.limits, self.joints = random, limits, joints.copy()
        self.time_s = float(random.choice([5e-4, 0.001, 0.002, 0.0033, 0.01, 0.033]))
        self.speed = random.choice([0.0, 0.1, 1.0]) * random.normal(size=len(joints))
        self.law = [(0.0, 0.0), (0.1, 200.0), (0.03, 2000.0)][random.integers(3)]
        self.due = 0.0

    def next(self) -> servo_law.Point:
        random, time_s = self.random, self.time_s
        if random.random() < 0.02:
            self.speed = random.normal(size=len(self.joints)) * random.choice([0.0, 0.2, 1.0])
        joints = self.joints + time_s * self.speed
        if random.random() < 0.01:
            joints = joints + random.normal(size=len(joints)) * random.choice([0.05, 0.5, 10.0])
        self.joints = np.clip(joints, self.limits.min_position, self.limits.max_position)
        if random.random() < 0.02:
            time_s = float(random.choice([0.0, -1.0, 0.1, 1e9]))
        spoilt(random, joints, 0.003)
        values = np.array([time_s, *self.law])
        spoilt(random, values, 0.002)
        return servo_law.Point(*values.tolist(), joints)

    def arrived(self) -> int:
        """How many points come in this cycle."""
        if self.random.random() < 0.005:
            self.due -= float(self.random.choice([0.02, 0.1, 0.3]))  # a gap
        self.due += PERIOD_S * self.random.uniform(0.5, 1.5)
        count = min(max(int(self.due / self.time_s), 0), 12)
        self.due -= count * self.time_s
        return count


@pytest.mark.parametrize("mode", few([mode for mode in ServoMode if mode is not ServoMode.NONE], 2))
def test_servo_points_of_random_clients(robot: RobotDescription, points: Points, mode: ServoMode) -> None:
    random, limits, dof = points.random, robot.limits, robot.limits.dof
    force = mode in (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
    through = mode in (ServoMode.THROUGH, ServoMode.THROUGH_FORCE)
    seen: set[Intervention | None] = set()
    counts = np.zeros(3, int)
    compared = 0
    while compared < SAMPLES // (4 if force else 2):
        points.begin()
        one, other = plain_servo(mode, limits), make_servo(mode, limits, limits.max_velocity, PERIOD_S)
        assert other is not None
        command = at_rest(limits, random)
        sources: tuple[Any, Any] = one, other
        if force:
            request = random_request(random, limits, command[0], True)
            rest = robot.model, limits, TCP, PERIOD_S
            sources = (
                cartesian_law.ForceServo(one, *rest, PERIOD_S, request),
                ForceServo(other, *rest, request),
            )
        for source in sources:
            source.begin(command)
        walk = Walk(random, limits, command[0])
        external, wrench = np.zeros(dof), np.zeros(6)
        for _ in range(400):
            late = points.plain.announced and random.random() < 0.2
            for _ in range(max(walk.arrived(), int(late))):
                points.put(walk.next())
            if random.random() < 0.02:
                points.announce()
            points.poll()
            flaw = one.fetch(points.plain)
            assert other.fetch(points.queue) == flaw
            seen.add(flaw)
            if flaw is not None:
                break  # an e-stop ends such a session
            if random.random() < 0.02:
                wrench = random.normal(size=6) * random.choice([0.0, 5.0, 50.0])
                for source in sources if force else ():
                    source.press(wrench)
            for source in sources:
                source.advance(external, wrench)
            expected, found = sources[0].reference, sources[1].reference
            scale = (1.0 + np.abs(expected).max(axis=1, keepdims=True)) * RATES
            if through:  # whose rate's acceleration is replanned in each cycle from the last
                close(found, expected, np.array([[1.0], [10.0], [1e3]]) * scale / RATES, PROFILED)
            else:
                close(found, expected, scale * (10.0 if force else 1.0))
                expected[0] = found[0]  # as rounding would add up along the force axes
            assert names_of(other) == names_of(one)
            followed = expected.copy()
            followed[0] += 0.5 * (random.random() < 0.01)
            for source in sources:
                source.follow(followed)
            compared += dof
        counts += [one.taken, one.dropped, one.underruns]
    if ENOUGH:
        assert seen == {None, Intervention.NOT_FINITE}
        drops = mode in (ServoMode.DIRECT, ServoMode.BUFFERED, ServoMode.BUFFERED_1MS)
        waits = mode in (ServoMode.BUFFERED, ServoMode.BUFFERED_1MS)
        assert (counts > 0).tolist()[: 2 + waits] == [True, drops, True][: 2 + waits]


def names_of(source: Any) -> tuple[int, int, int, int]:
    return source.taken, source.dropped, source.underruns, source.buffered
