"""Dry runs: executes a planned motion on a separate simulated robot, with the real cycle and safety layer, as
fast as possible.

Planning processes call this module. A dry run does not affect the robot itself, and may be killed at any
time.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol

import numpy as np

from cobot.config import Settings
from cobot.errors import PlanningError
from cobot.ipc.layout import RING, Ack, Command, Intervention, MotionResult, text
from cobot.ipc.shm import RobotMemory
from cobot.motions.rehearsal import Flaw, SimulatedRun
from cobot.reasons import Reason, ReasonCode
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits
from rtloop.backends.mujoco import MujocoBackend
from rtloop.clock import FastClock
from rtloop.loop import ControlLoop

FOREVER_NS = 10**16
LOADING_CYCLES = 10_000
"""Maximum number of cycles for loading a motion; enough for the longest motion."""
MAX_SETTLING_S = 30.0
"""Timeout for the arm to settle at the end of a motion, s. It is longer than the time after which the cycle
ends any motion.
"""
RESTING_S = 0.2
"""How long a disturbance acts on the arm at rest before the motion begins, s."""
ROWS = 2000
"""Maximum number of measured positions that are kept, evenly spaced over a motion's duration."""
SATURATED = 0.999
UNSETTLED = Reason("the arm did not settle at its goal", ReasonCode.NOT_SETTLED)


class Disturbance(Protocol):
    """A disturbance of the simulated arm in a dry run. The control cycle is not told about it."""

    def prepare(self, backend: MujocoBackend) -> None:
        """Change the arm before the motion begins."""
        ...

    def act(self, backend: MujocoBackend, time_s: float) -> None:
        """Act on the arm before each cycle.

        Args:
            time_s: time since the motion began, s; 0 before it begins.
        """
        ...


def rehearse(
    settings: Settings,
    robot: RobotDescription,
    start: Array,
    trajectory: Trajectory,
    disturbance: Disturbance | None = None,
) -> SimulatedRun:
    """Simulate a motion with the tool and the attached objects. The arm begins at rest at the joint position
    `start`, which has shape (dof,), in rad.

    Raises:
        PlanningError: the cycle rejects the motion; the error gives the reason.
    """
    with _loop(settings, robot, start, trajectory) as (loop, memory, backend):
        if disturbance is not None:
            disturbance.prepare(backend)
            for _ in range(round(RESTING_S / settings.rt.period_s)):
                disturbance.act(backend, 0.0)
                loop.step()
        _begin(loop, memory, robot.model.carried.version)
        return _follow(loop, memory, robot.limits, trajectory, backend, disturbance)


@contextmanager
def _loop(
    settings: Settings, robot: RobotDescription, start: Array, trajectory: Trajectory
) -> Iterator[tuple[ControlLoop, RobotMemory, MujocoBackend]]:
    rt, names, limits = settings.rt, settings.robot, robot.limits
    alone = settings.model_copy(
        update={"rt": rt.model_copy(update={"trajectory_capacity": trajectory.segments})}
    )
    name = f"{names.name[:40]}.rehearsal.{os.getpid()}"
    memory = RobotMemory.create(name, limits.dof, rt.period_s, trajectory.segments)
    # so that no other process can find it, and nothing remains of it however this process ends
    memory.unlink()
    try:
        memory.heartbeat.data["monotonic_ns"] = time.monotonic_ns() + FOREVER_NS
        memory.heartbeat.publish()
        memory.slots[0].write(1, trajectory)
        # A separate model, because the cycle changes its tool, and the planners need an unchanged one.
        model = RobotModel.load(names.model, limits, base=names.base_frame, tcp=names.tcp)
        backend = MujocoBackend(alone, limits)
        loop = ControlLoop(alone, model, memory, backend, FastClock(rt.period_s))
        loop.open(start, robot.model.carried)
        yield loop, memory, backend
        loop.close()
    finally:
        memory.close()


def _begin(loop: ControlLoop, memory: RobotMemory, tool: int) -> None:
    command = memory.commands[1 % RING]
    command.data["id"], command.data["kind"], command.data["motion_id"] = 1, Command.START, 1
    command.data["tool"] = tool
    command.publish()
    memory.head.data["id"] = 1
    memory.head.publish()
    ack = memory.acks[1 % RING].data
    for _ in range(LOADING_CYCLES):
        loop.step()
        if int(ack["id"]) == 1:
            if int(ack["result"]) != Ack.ACCEPTED:
                raise PlanningError(f"the real-time loop rejects this motion: {text(ack['message'])}")
            return
    raise PlanningError(f"the real-time loop has not loaded this motion in {LOADING_CYCLES} cycles")


def _follow(
    loop: ControlLoop,
    memory: RobotMemory,
    limits: JointLimits,
    trajectory: Trajectory,
    backend: MujocoBackend,
    disturbance: Disturbance | None,
) -> SimulatedRun:
    period_s, state = memory.period_s, memory.state.data
    most = round((trajectory.duration_s + MAX_SETTLING_S) / period_s)
    every = max(1, round(trajectory.duration_s / period_s) // ROWS)
    effort, off = np.zeros(limits.dof), np.zeros(limits.dof)
    kept = [(0.0, state["position"].copy())]
    before, flaw, cycle = state["interventions"].copy(), None, 0
    controller = loop.controller
    with np.errstate(all="ignore"):  # no warnings: comparisons find and report values that are not finite
        while controller.moving and cycle < most:
            if disturbance is not None:
                disturbance.act(backend, cycle * period_s)
            cycle += 1
            loop.step()
            share = np.abs(state["effort"]) / limits.max_effort
            apart = np.abs(state["position"] - state["commanded_position"])
            effort, off = np.maximum(effort, share), np.maximum(off, apart)
            if flaw is None:
                flaw = _flaw(cycle * period_s, limits, share, apart, state["interventions"] - before)
            if cycle % every == 0:
                kept.append((cycle * period_s, state["position"].copy()))
    if flaw is None and controller.motion_result != MotionResult.ARRIVED:
        worst = limits.names[int(apart.argmax())]
        flaw = Flaw(cycle * period_s, worst, controller.reason or UNSETTLED)
    times, positions = zip(*kept, strict=True)
    return SimulatedRun(np.array(times), np.array(positions), effort, off, cycle * period_s, flaw)


def _flaw(time_s: float, limits: JointLimits, share: Array, apart: Array, new: Array) -> Flaw | None:
    """Return the flaw that is detected in a cycle; None if there is none.

    Args:
        share: effort of each joint as a share of its limit.
        apart: distance of each joint from its commanded position, rad.
        new: interventions of the safety layer since the motion began, by kind.
    """
    joint = int(share.argmax())
    if share[joint] >= SATURATED:
        name, limit, unit = limits.names[joint], float(limits.max_effort[joint]), limits.effort_unit(joint)
        words = f"the drive reaches its limit of {limit:g} {unit}"
        return Flaw(time_s, name, Reason(words, ReasonCode.TORQUE_LIMIT, (name,), limit=limit, unit=unit))
    kinds = np.flatnonzero(new)
    if not len(kinds):
        return None
    joint = int(apart.argmax())
    what = Intervention(int(kinds[0])).name
    name, unit, off = limits.names[joint], limits.unit(joint), float(apart[joint])
    words = f"the safety layer intervenes ({what}); the joint is {off:.4g} {unit} from its command"
    return Flaw(time_s, name, Reason(words, ReasonCode.SAFETY_LAYER, (name,), off, unit=unit))
