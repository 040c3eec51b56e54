"""Faults, and what the arm does meanwhile: seen from outside, in the state block, cycle by cycle."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise

import numpy as np
from rig import Rig

from cobot.config import Settings
from cobot.errors import TornReadError
from cobot.ipc.layout import RING, Ack, Command, ServoMode, Stream, text
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.ipc.stream_writer import PointWriter
from cobot.motions.requests import MotionRequest
from cobot.planners.ptp import plan_ptp
from cobot.robot.description import RobotDescription
from cobot.types import Array, JointLimits, LoopMode, PlannerName, Scaling
from rtloop.modes import STREAMING

SLACK = 1.011
"""Of the rates: the safety layer permits one per cent for the rounding of differences."""
POSITION_SLACK_RAD = 1.1e-5
REST_RAD_S = 1e-3
"""What is commanded may be no faster when the arm is taken over."""
NEAR_RAD = 1e-3
KINDS = ("motion", "joint", "cartesian", "torque", "servo")
FORCE_MODES = (ServoMode.REPLANNED_FORCE, ServoMode.THROUGH_FORCE)
MOVE = np.array([0.4, 0.2, -0.3, 0.3, 0.2, -0.3, 0.4])
BLOCKS = (
    "state",
    "statistics",
    "acks",
    "heartbeat",
    "requests",
    "head",
    "commands",
    "tool",
    "output",
    "io",
    "signals",
    "slots",
    "info",
    "session_ack",
    "session",
    "setpoint",
    "chunk",
    "stream_requests",
    "point_head",
    "points",
)


class Record:
    """What the arm was told and where it was.

    A command may leave the limits behind in one case only: the arm rests and is taken over where it is, after
    a session, a reset, or an rtloop or a device that has been gone, or because its drives are off.
    """

    def __init__(self, limits: JointLimits, period_s: float) -> None:
        self._limits, self._period_s = limits, period_s
        self.turn = threading.Lock()  # for who adds in a thread
        self.cycles: list[int] = []
        self.modes: list[LoopMode] = []
        self.commanded: list[Array] = []
        self.measured: list[Array] = []
        self.reasons: set[str] = set()
        self._sessions: list[int] = []
        self._starts: list[int] = []
        self._unwritten: list[bool] = []
        self._reason = b""
        self._writing_fails = False
        self._beyond_rad = np.zeros(limits.dof)  # the position limits, where the arm was pushed

    def add(self, state: np.ndarray, start: int = 0, truth: Array | None = None) -> None:
        """A state, unless it is the last one again.

        Args:
            start: tells one rtloop from the next.
            truth: where the joints really are, shape (dof,), rad, if that is known better.
        """
        cycle = int(state["cycle"])
        if self.cycles and cycle == self.cycles[-1] and start == self._starts[-1]:
            return
        reason = state["reason"].item()
        if reason != self._reason:
            self._reason = reason
            self.reasons.add(text(state["reason"]))
            self._writing_fails = reason.startswith(b"writing to")
        mode, measured = LoopMode(int(state["mode"])), state["position"] if truth is None else truth
        self.note(cycle, mode, state["commanded_position"], measured, int(state["session"]), start)

    def note(
        self, cycle: int, mode: LoopMode, commanded: Array, measured: Array, session: int, start: int = 0
    ) -> None:
        """What a cycle did, from who knows it from elsewhere than the state block."""
        self.cycles.append(cycle)
        self.modes.append(mode)
        self.commanded.append(commanded.copy())
        self.measured.append(measured.copy())
        self._sessions.append(session)
        self._starts.append(start)
        self._unwritten.append(self._writing_fails)

    def violations(self) -> list[str]:
        """Every limit that was not kept, in words."""
        with self.turn:
            return self._find_violations()

    def _find_violations(self) -> list[str]:
        commanded, measured = np.array(self.commanded), np.array(self.measured)
        cycles = np.array(self.cycles)
        taken_over = self._taken_over(commanded, measured)
        gaps = np.diff(cycles, prepend=cycles[0] - 1) != 1
        begins = np.unique([0, *np.flatnonzero(taken_over | gaps), len(cycles)])
        found = self._not_at_rest(commanded, measured, taken_over)
        for begin, end in pairwise(begins):
            rows = commanded[begin:end]
            if begin and taken_over[begin]:
                rows = np.concatenate([np.repeat(rows[:1], 3, axis=0), rows])  # from rest
            found += self._excesses(rows, int(cycles[begin]))
        return found + self._strays(commanded, measured, taken_over)

    def forget(self, but: int = 3) -> None:
        """All but the last rows, which the next differences need."""
        rows = (self.cycles, self.modes, self.commanded, self.measured)
        with self.turn:
            for column in (*rows, self._sessions, self._starts, self._unwritten):
                del column[: len(column) - but]

    def moved_rad(self, cycles: int) -> float:
        """How far any joint was commanded in so many last cycles."""
        recent = np.array(self.commanded[-cycles:])
        return float(np.ptp(recent, axis=0).max())

    def fastest(self) -> float:
        """The largest velocity of the arm itself, as a share of its limit."""
        steps = np.abs(np.diff(np.array(self.measured), axis=0)) / self._limits.max_velocity
        return float(steps.max()) / self._period_s

    def _taken_over(self, commanded: Array, measured: Array) -> Array:
        sessions, starts = np.array(self._sessions), np.array(self._starts)
        latched = np.isin(self.modes, (LoopMode.ESTOP, LoopMode.FAULT))
        held = np.isin(self.modes, (LoopMode.HOLD,))
        found = np.zeros(len(sessions), bool)
        found[1:] = (sessions[:-1] != 0) & (sessions[1:] == 0)
        found[1:] |= latched[:-1] & held[1:]
        found[1:] |= starts[:-1] != starts[1:]
        rested = np.ones(len(sessions), bool)
        rested[2:] = np.abs(np.diff(commanded[:-1], axis=0)).max(axis=1) <= REST_RAD_S * self._period_s
        found |= (np.array(self._unwritten) | (latched & rested)) & (commanded == measured).all(axis=1)
        return found

    def _not_at_rest(self, commanded: Array, measured: Array, taken_over: Array) -> list[str]:
        """The arm stood, and is held where it stood, or where it was told to stand."""
        found = []
        for row in np.flatnonzero(taken_over):
            cycle, before = self.cycles[row], row - 1
            alive = self._starts[row] == self._starts[before] and not self._unwritten[row]
            if alive and row > 1 and self.cycles[row - 2] == cycle - 2 and not taken_over[before]:
                speed = np.abs(commanded[before] - commanded[row - 2]).max() / self._period_s
                if speed > REST_RAD_S:
                    found.append(f"cycle {cycle}: taken over while moving at {speed:.4f} rad/s")
            here = np.abs(commanded[row] - measured[row]).max()
            there = np.abs(commanded[row] - commanded[before]).max()
            if min(here, there) > NEAR_RAD:
                found.append(f"cycle {cycle}: taken over {here:.4f} rad from where the arm is")
        return found

    def _excesses(self, rows: Array, cycle: int) -> list[str]:
        limits, found = self._limits, []
        bounds = (limits.max_velocity, limits.max_acceleration, limits.max_jerk)
        names = ("velocity", "acceleration", "jerk")
        for order, (name, bound) in enumerate(zip(names, bounds, strict=True), start=1):
            if len(rows) <= order:
                break
            share = np.abs(np.diff(rows, order, axis=0)) / self._period_s**order / bound
            for row in np.flatnonzero(~(share <= SLACK).all(axis=1)):
                joint = int(share[row].argmax())
                found.append(
                    f"some {row} cycles after {cycle}: {name} of {limits.names[joint]} is "
                    f"{share[row, joint]:.3f} times its limit"
                )
        return found

    def _strays(self, commanded: Array, measured: Array, taken_over: Array) -> list[str]:
        """Positions beyond the limits, but for an arm that was pushed there."""
        limits, found = self._limits, []
        beyond = np.maximum(commanded - limits.max_position, limits.min_position - commanded)
        out = (beyond > POSITION_SLACK_RAD).any(axis=1) | taken_over
        for row in np.flatnonzero(out):
            if taken_over[row]:
                self._beyond_rad = np.maximum(beyond[row], 0.0)
            elif not (beyond[row] <= self._beyond_rad + POSITION_SLACK_RAD).all():
                found.append(f"cycle {self.cycles[row]}: {beyond[row].max():.5f} rad beyond a position limit")
        return found


class WatchedRig(Rig):
    """An arm on the virtual clock, a simulated one; who asks and who looks has a mapping of its own."""

    def __init__(
        self,
        settings: Settings,
        robot: RobotDescription,
        memory: RobotMemory | None = None,
        *,
        simulated: bool = True,
    ) -> None:
        super().__init__(settings, robot, simulated=simulated, memory=memory)
        self._own = self.memory
        self.memory = RobotMemory.attach(self._own.robot, MemoryRole.READER)
        for block in (self.memory.head, self.memory.requests, self.memory.session, self.memory.setpoint):
            block.salvage()
        self.record = Record(robot.limits, settings.rt.period_s)

    def close(self) -> None:
        self.memory.close()
        self._own.unlink()
        self._own.close()

    def step(self, cycles: int = 1, late_ns: int = 0) -> None:
        for _ in range(cycles):
            truth = self.simulation._data.qpos.copy()  # as the cycle finds it
            super().step(1, late_ns)
            self.record.add(self.memory.state.read(), truth=truth)

    def answer(self, number: int, cycles: int = 3000) -> str:
        ack = self.memory.acks[number % RING]
        for _ in range(cycles):
            if ack.try_read() and int(ack.data["id"]) == number:
                return "" if int(ack.data["result"]) == Ack.ACCEPTED else text(ack.data["message"])
            self.step()
            self.await_surroundings()
        raise AssertionError("no answer")

    def reset(self) -> str:
        """Leave ESTOP or FAULT; "" or why not. Waits until the arm rests."""
        self.run()
        return self.answer(self.send(Command.RESET))


class Task:
    """Something that the arm does: a planned motion, one of the streams, or a servo session."""

    def __init__(self, rig: Rig, kind: str, interval: int = 10, **wishes: object) -> None:
        self.rig, self.kind, self.interval = rig, kind, interval
        self._period_s = rig.settings.rt.period_s
        self._cycle = 0
        self._pose = np.zeros(7)
        self._origin = rig.loop.controller.safety.position.copy()
        if kind == "motion":
            request = MotionRequest(self._origin, self._origin + self._way(), PlannerName.PTP, Scaling(0.4))
            refusal = rig.start(plan_ptp(rig.robot, request, request.goal))
        else:
            stream = {
                "joint": Stream.JOINT_IMPEDANCE,
                "cartesian": Stream.CARTESIAN,
                "torque": Stream.JOINT_TORQUE,
                "servo": Stream.JOINT_IMPEDANCE,
            }[kind]
            if kind == "servo":
                wishes = {"servo_mode": ServoMode.THROUGH, "watchdog_s": 0.5, **wishes}
                stream = Stream.CARTESIAN if wishes["servo_mode"] in FORCE_MODES else stream
            refusal = rig.stream(stream, **{"decimation": interval, **wishes})
            rig.robot.model.forward_into(self._origin, self._pose)
            self._points = PointWriter(rig.memory)
            self._points.begin(int(rig.memory.session.data["number"]))
        assert refusal == "", refusal

    def step(self, cycles: int = 1) -> None:
        """Go on with it."""
        for _ in range(cycles):
            if self.kind != "motion" and self._cycle % self.interval == 0:
                self.send(self.target())
            self._cycle += 1
            self.rig.step()

    def send(self, target: dict[str, Array]) -> None:
        """Stream a target."""
        if self.kind == "servo":
            self._points.put(target["joints"].tolist(), self.interval * self._period_s, 0.0, 0.0)
        else:
            self.rig.aim(**target)

    def target(self) -> dict[str, Array]:
        """From rest, and back after two seconds."""
        time_s = self._cycle * self._period_s
        share = (1.0 - np.cos(np.pi * time_s)) / 2.0
        if self.kind in ("joint", "servo"):
            return {"joints": self._origin + 0.6 * share * self._way()}
        if self.kind == "cartesian":
            pose = self._pose.copy()
            pose[:3] += share * np.array([-0.1, 0.08, -0.05])
            return {"pose": pose}
        torque = np.array([1.2, 0.8, 0.4, -0.8, 0.2, 0.2, 0.1])
        return {"joints": np.sin(2.0 * np.pi * time_s) * torque}

    @property
    def running(self) -> bool:
        return self.rig.mode is LoopMode.TRAJECTORY if self.kind == "motion" else self.rig.mode in STREAMING

    def end(self) -> None:
        """Come to rest."""
        if self.rig.mode in STREAMING:
            self.rig.end_stream()
        self.rig.run()

    def _way(self) -> Array:
        """Towards home from far away, so that no series of tasks leads to the limits."""
        away = self._origin - self.rig.home
        return np.where(away * MOVE > 0.0, -MOVE, MOVE)


def spoil(memory: RobotMemory, name: str, random: np.random.Generator) -> None:
    """Random bytes all over a block, as a writer gone wild would leave them."""
    for view in _views(memory, name):
        view[:] = random.bytes(len(view))


def _views(memory: RobotMemory, name: str) -> Iterator[memoryview]:
    found = getattr(memory, name)
    for part in found if isinstance(found, list) else [found]:
        block = part if isinstance(part, Block) else part.head
        yield block._head.cast("B")
        yield block._shared
        if not isinstance(part, Block):
            yield part.breakpoints_s.data.cast("B")
            yield part.coefficients.data.cast("B")


@contextmanager
def watched(robot: str, limits: JointLimits, period_s: float) -> Iterator[Record]:
    """Look at a running robot's state block, as often as this computer permits, until the context ends."""
    memory = RobotMemory.attach(robot, MemoryRole.READER)
    record = Record(limits, period_s)
    ended = threading.Event()

    def look() -> None:
        start = 0
        while not ended.is_set():
            try:
                state = memory.state.read()
                if not record.cycles or int(state["cycle"]) != record.cycles[-1]:
                    start = int(memory.statistics.read()["started_ns"]) or start
                with record.turn:
                    record.add(state, start)
            except (TornReadError, ValueError):  # spoilt: the next cycle mends it
                continue
            time.sleep(2e-4)

    looker = threading.Thread(target=look, daemon=True)
    looker.start()
    try:
        yield record
    finally:
        ended.set()
        looker.join()
        memory.close()
