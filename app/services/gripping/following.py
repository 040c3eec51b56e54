"""Waits for the end of a gripper command."""

from __future__ import annotations

import asyncio
import contextlib

from app.services.devices.gripper_worker import GripperWorker
from app.services.gripping.commands import Running, start_of
from app.services.rights.claims import Caller
from app.services.rights.stop_reason import StopReason
from cobot.clock import Clock
from cobot.errors import DeviceError, MotionTimeout
from cobot.grippers import GripperState
from cobot.reasons import Reason, ReasonCode

MIN_WAIT_S = 0.001
"""Minimum duration of a wait, s. Without it, rounding could cause waits of zero length."""


async def follow(
    worker: GripperWorker, running: Running, caller: Caller, clock: Clock, name: str
) -> GripperState:
    """Start a command, and return the gripper's state at its end.

    Args:
        name: the gripper's type, for errors.

    Raises:
        MotionStopped: the command was interrupted, or the client has disconnected.
        MotionTimeout: the caller's timeout has passed.
        DeviceError: the device rejects the command, has a fault, or its connection is lost.
    """
    deadline_s = clock.now_s() + caller.timeout_s
    gone = asyncio.create_task(caller.gone.wait())
    asked = worker.ask(start_of(running.command))
    for each in (gone, asked):
        each.add_done_callback(lambda _: running.news.set())
    try:
        while True:
            if running.interruption is not None:
                raise running.interruption
            if caller.gone.is_set():
                raise StopReason("the client has disconnected", "client_left").error
            state = _ended(worker, asked, name)
            if state is not None:
                return state
            left_s = deadline_s - clock.now_s()
            if left_s <= 0.0:
                raise MotionTimeout(
                    f"gripper {name}: {running.name} has not ended within {caller.timeout_s:g} s: "
                    f"{worker.problem or 'the fingers are still moving'}",
                    details=Reason("", ReasonCode.GRIPPER_SLOW, limit=caller.timeout_s, unit="s").fields(),
                )
            running.news.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(running.news.wait(), max(left_s, MIN_WAIT_S))
    finally:
        gone.cancel()
        asked.cancel()


def _ended(worker: GripperWorker, asked: asyncio.Future[int], name: str) -> GripperState | None:
    """Return the gripper's state at the end of a command; None while the command is running."""
    if not asked.done():
        return None
    if (problem := asked.exception()) is not None:
        raise _faulty(name, str(problem))
    reading = worker.reading
    if reading.number <= asked.result():
        return None
    if reading.problem:
        raise _faulty(name, reading.problem)
    assert reading.state is not None
    if reading.state.fault:
        raise _faulty(name, reading.state.fault)
    return None if reading.state.moving else reading.state


def _faulty(name: str, problem: str) -> DeviceError:
    reason = Reason(problem, ReasonCode.GRIPPER_DEVICE, (name,))
    return DeviceError(f"gripper {name}: {problem}", details=reason.fields())
