"""The stopping distance of an arm and its deceleration, on the virtual clock, from full speed."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import ruckig
from rig import Rig

from benchmarks.table import Row, row
from benchmarks.virtual import MOVED, eased, rig
from cobot.ipc.layout import Interpolation
from cobot.planners import MotionRequest, plan
from cobot.types import Array, JointLimits, PlannerName, Scaling

FULL = 0.95
"""Of the velocity limits, for a stream."""
RISE_S = 1.5
REST_CYCLES = 1500
COLUMNS = ("median distance, rad", "peak deceleration", "peak jerk")
"""The peaks as shares of the limits."""
Cause = Callable[[Rig], None]


def _stop(arm: Rig) -> None:
    arm.request("stops")


def _estop(arm: Rig) -> None:
    arm.request("estops")


def _silence(arm: Rig) -> None:
    """Let the targets end. Everything else continues as usual."""


def _dead_service(arm: Rig) -> None:
    arm.beat(ahead_s=-arm.settings.rt.service_timeout_s)


STREAM_CAUSES: dict[str, Cause] = {"stop": _stop, "command timeout": _silence, "e-stop": _estop}
PLAN_CAUSES: dict[str, Cause] = {"stop": _stop, "service timeout": _dead_service, "e-stop": _estop}


def stops(repetitions: int) -> Iterator[Row]:
    """Trigger each cause of a stop at random moments of streams and of planned motions."""
    for name, cause in STREAM_CAUSES.items():
        yield _row(f"{name}, from a stream at full speed", [_streamed(cause, n) for n in range(repetitions)])
    for name, cause in PLAN_CAUSES.items():
        yield _row(f"{name}, from a ptp at full speed", [_planned(cause, n) for n in range(repetitions)])


def _row(name: str, found: list[tuple[float, float, float, float]]) -> Row:
    distances, decelerations, jerks, shortest = np.array(found).T
    return row(
        name,
        "",
        (float(np.median(distances)), float(decelerations.max()), float(jerks.max())),
        "Ruckig's fastest stop of each joint, the limits",
        (float(np.median(shortest)), 1.0, 1.0),
        columns=COLUMNS,
        aim="1 of the limits",
    )


def _streamed(cause: Cause, seed: int) -> tuple[float, float, float, float]:
    """Targets at 100 Hz that accelerate up to the limits."""
    random = np.random.default_rng(seed)
    with rig() as arm:
        start = arm.home - 1.2 * MOVED
    with rig(start=start) as arm:
        fastest = np.minimum(arm.limits.max_velocity, arm.settings.streaming.joint_velocity)
        step = 0.01 * FULL * fastest * MOVED
        refusal = arm.stream(interpolation=Interpolation.RUCKIG, decimation=10)
        assert not refusal, refusal
        target = start.copy()
        for count in range(150 + int(random.integers(40))):
            target += step * eased(count * 0.01, RISE_S)
            arm.aim(joints=target)
            arm.step(10)
        return _stopped(arm, cause)


def _planned(cause: Cause, seed: int) -> tuple[float, float, float, float]:
    random = np.random.default_rng(seed)
    with rig() as arm:
        goal = np.array(arm.robot.positions[("work", "transport")[seed % 2]].joints) + 1.5 * MOVED
        trajectory = plan(arm.robot, MotionRequest(arm.home, goal, PlannerName.PTP, Scaling(1.0)))
        refusal = arm.start(trajectory)
        assert not refusal, refusal
        arm.step(round(1000 * trajectory.duration_s * random.uniform(0.3, 0.7)))
        return _stopped(arm, cause)


def _stopped(arm: Rig, cause: Cause) -> tuple[float, float, float, float]:
    """The stopping distance of the joint that moves furthest, the peaks as shares of the limits, and the
    shortest possible distance.
    """
    state = arm.loop.controller.safety.command.copy()
    begin = len(arm.commanded)
    cause(arm)
    arm.step(REST_CYCLES)
    assert not np.diff(arm.commanded[-2:], axis=0).any(), "the arm has not come to rest"
    _, deceleration, jerk = arm.rates()
    distance = np.abs(arm.commanded[-1] - state[0]).max()
    return float(distance), deceleration[begin:].max(), jerk[begin:].max(), _shortest(state, arm.limits)


def _shortest(state: Array, limits: JointLimits) -> float:
    """The stopping distance of the joint that moves furthest if each joint brakes as hard as the limits
    allow, rad.
    """
    problem = ruckig.InputParameter(limits.dof)
    problem.control_interface = ruckig.ControlInterface.Velocity
    problem.synchronization = ruckig.Synchronization.No
    problem.current_position, problem.current_velocity, problem.current_acceleration = state.tolist()
    problem.max_velocity = limits.max_velocity.tolist()
    problem.max_acceleration = limits.max_acceleration.tolist()
    problem.max_jerk = limits.max_jerk.tolist()
    problem.target_velocity = [0.0] * limits.dof
    trajectory = ruckig.Trajectory(limits.dof)
    ruckig.Ruckig(limits.dof).calculate(problem, trajectory)
    end, _, _ = trajectory.at_time(trajectory.duration)
    return float(np.abs(np.array(end) - state[0]).max())
