"""A planned motion on a simulated robot of its own: the real cycle with its safety layer, as fast as can be.

Planning processes call this. It knows nothing of the robot that runs, and may be killed at any moment.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from cobot.config import Settings
from cobot.errors import PlanningError
from cobot.ipc.layout import RING, Ack, Command, Intervention, MotionResult, text
from cobot.ipc.shm import RobotMemory
from cobot.motions.rehearsal import Flaw, SimulatedRun
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits
from rtloop.backends.mujoco import MujocoBackend
from rtloop.clock import FastClock
from rtloop.loop import ControlLoop

FOREVER_NS = 10**16
LOADING_CYCLES = 10_000
"""A motion of the longest kind is loaded in less."""
LONGEST_SETTLING_S = 30.0
"""The cycle ends every motion sooner: it gives it some seconds to settle."""
ROWS = 2000
"""So many measured positions are kept of a motion, evenly over its time."""
SATURATED = 0.999


def rehearse(
    settings: Settings, robot: RobotDescription, start: Array, trajectory: Trajectory
) -> SimulatedRun:
    """Run a motion from where it begins, at rest, shape (dof,), rad, with the tool and what is in the hand.

    Raises:
        PlanningError: the cycle refuses the motion; says why.
    """
    with _loop(settings, robot, start, trajectory) as (loop, memory):
        _begin(loop, memory, robot.model.carried.version)
        return _followed(loop, memory, robot.limits, trajectory)


@contextmanager
def _loop(
    settings: Settings, robot: RobotDescription, start: Array, trajectory: Trajectory
) -> Iterator[tuple[ControlLoop, RobotMemory]]:
    rt, names, limits = settings.rt, settings.robot, robot.limits
    alone = settings.model_copy(
        update={"rt": rt.model_copy(update={"trajectory_capacity": trajectory.segments})}
    )
    name = f"{names.name[:40]}.rehearsal.{os.getpid()}"
    memory = RobotMemory.create(name, limits.dof, rt.period_s, trajectory.segments)
    memory.unlink()  # nobody else is to find it, and nothing is left of it, however this process ends
    try:
        memory.heartbeat.data["monotonic_ns"] = time.monotonic_ns() + FOREVER_NS
        memory.heartbeat.publish()
        memory.slots[0].write(1, trajectory)
        # A model of its own: the cycle has it carry the tool, and this one's carries it for the planners.
        model = RobotModel.load(names.model, limits, base=names.base_frame, tcp=names.tcp)
        backend = MujocoBackend(alone, limits)
        loop = ControlLoop(alone, model, memory, backend, FastClock(rt.period_s))
        loop.open(start, robot.model.carried)
        yield loop, memory
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
                raise PlanningError(f"the cycle refuses this motion: {text(ack['message'])}")
            return
    raise PlanningError(f"the cycle has not taken this motion in {LOADING_CYCLES} cycles")


def _followed(
    loop: ControlLoop, memory: RobotMemory, limits: JointLimits, trajectory: Trajectory
) -> SimulatedRun:
    period_s, state = memory.period_s, memory.state.data
    most = round((trajectory.duration_s + LONGEST_SETTLING_S) / period_s)
    every = max(1, round(trajectory.duration_s / period_s) // ROWS)
    effort, off = np.zeros(limits.dof), np.zeros(limits.dof)
    kept = [(0.0, state["position"].copy())]
    before, flaw, cycle = state["interventions"].copy(), None, 0
    controller = loop.controller
    with np.errstate(all="ignore"):  # what is not finite is found by comparisons, and reported
        while controller.moving and cycle < most:
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
        flaw = Flaw(cycle * period_s, worst, controller.reason or "it has not settled at its goal")
    times, positions = zip(*kept, strict=True)
    return SimulatedRun(np.array(times), np.array(positions), effort, off, cycle * period_s, flaw)


def _flaw(time_s: float, limits: JointLimits, share: Array, apart: Array, new: Array) -> Flaw | None:
    """What is wrong in a cycle, if something is.

    Args:
        share: of its limit that each joint's effort takes.
        apart: how far each joint is from where it is commanded to be, rad.
        new: interventions of the safety layer since the motion's start, by kind.
    """
    joint = int(share.argmax())
    if share[joint] >= SATURATED:
        most = f"{limits.max_effort[joint]:g} {limits.effort_unit(joint)}"
        return Flaw(time_s, limits.names[joint], f"the drive gives all of its {most}")
    kinds = np.flatnonzero(new)
    if not len(kinds):
        return None
    joint = int(apart.argmax())
    what = Intervention(int(kinds[0])).name
    unit = limits.unit(joint)
    says = f"the safety layer intervenes ({what}); it is {apart[joint]:.4g} {unit} from where it is to be"
    return Flaw(time_s, limits.names[joint], says)
