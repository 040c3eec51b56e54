"""Runs a gripper's driver in a separate thread, so that the event loop never waits for the device.

The thread connects, passes commands to the driver, and reads the state repeatedly. If the driver raises an
exception, the worker reports it as a problem and connects again, after increasingly long pauses.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import queue
import threading
from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from app.services.state.link import RobotLink
from cobot.errors import CobotError
from cobot.foreign import plain_error, plain_text
from cobot.grippers import Gripper, GripperError, GripperState
from cobot.robot.io_points import IoPoint, output_of, require_number

IDLE_PERIOD_S = 0.1
"""Interval between readings of a gripper that neither moves nor holds an object, s."""
BUSY_PERIOD_S = 0.01
"""Interval between readings of a gripper that moves or holds an object, s. A driver may set a different
interval.
"""
BACKOFF_S = (0.1, 3.0)
"""The first and the longest pause between two attempts to connect, s. Each pause is twice the previous
one.
"""
FIRST_REPORT_S = 2.0
"""Timeout for the first report of the robot's inputs and outputs, for a driver that uses them, s."""
HUNG_S = 3.0
"""Duration of a call after which the driver is reported as hanging, s."""

log = logging.getLogger("cobot.gripper")

Result = TypeVar("Result")
Start = Callable[[Gripper], None]


class DaemonThread(Executor):
    """An executor with one daemon thread, so that the process can end even if a driver hangs."""

    def __init__(self, name: str) -> None:
        self._work: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        threading.Thread(target=self._run, name=name, daemon=True).start()

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()

        def work() -> None:
            if future.set_running_or_notify_cancel():
                try:
                    future.set_result(fn(*args, **kwargs))
                except BaseException as exc:  # noqa: BLE001 - a foreign class may raise anything
                    future.set_exception(exc)

        self._work.put(work)
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        self._work.put(None)

    def _run(self) -> None:
        while (work := self._work.get()) is not None:
            work()


class NotReported(GripperError):
    """Raised if the robot has not reported its inputs and outputs yet."""


class RobotPort:
    """The robot's inputs and outputs as a driver sees them: the values reported before the current call of
    the driver, and the outputs that this call sets.

    Attributes:
        points: inputs and outputs by name, as the robot has reported them; None before its first report.
        wanted: outputs that the driver has set and that have not been sent yet.
    """

    def __init__(self) -> None:
        self.points: dict[str, IoPoint] | None = None
        self.wanted: dict[str, float] = {}

    def read(self, name: str) -> float:
        """See `IoPort`."""
        if name in self.wanted:
            return self.wanted[name]
        return self._point(name).value

    def set(self, name: str, value: float) -> None:
        """Set an output, as `IoPort` describes. The value is sent when the driver's method returns."""
        try:
            require_number(output_of([self._point(name)], name), value)
        except CobotError as exc:
            raise GripperError(str(exc)) from exc
        self.wanted.pop(name, None)
        self.wanted[name] = value

    def _point(self, name: str) -> IoPoint:
        if self.points is None:
            raise NotReported(
                f"{name!r}: the robot has not reported any input or output; /health shows whether rtloop "
                f"runs, and docs/state-and-stop.md lists the inputs and outputs of each backend"
            )
        if name not in self.points:
            known = ", ".join(self.points) or "none"
            raise GripperError(f"the robot has no input or output {name!r}; it reports: {known}")
        return self.points[name]


@dataclass(frozen=True, slots=True)
class Reading:
    """The last report from the driver.

    Attributes:
        number: number of the reading, which increases.
        state: gripper state; None before the first reading.
        problem: reason why there is no newer state; "" if there is no problem.
        read_s: time of the reading, on the service's clock.
    """

    number: int
    state: GripperState | None
    problem: str
    read_s: float


class GripperWorker:
    """Runs one gripper's driver in a thread; see the module.

    Args:
        on_reading: function that is called with each new reading.

    Attributes:
        gripper: the driver.
        reading: the newest reading.
    """

    def __init__(
        self, gripper: Gripper, port: RobotPort, link: RobotLink, on_reading: Callable[[Reading], None]
    ) -> None:
        self.gripper = gripper
        self._port = port
        self._link = link
        self._on_reading = on_reading
        self._asked: deque[tuple[Start, asyncio.Future[int]]] = deque()
        self._news = asyncio.Event()
        self._connected = False
        self._calling_since_s: float | None = None
        self._thread = DaemonThread("gripper")
        self.reading = Reading(0, None, "the gripper has not been read yet", link.clock.now_s())
        self._task = asyncio.create_task(self._run(), name="gripper")

    @property
    def problem(self) -> str:
        """Reason why the newest state is not the gripper's current state; "" if the state is current."""
        since_s, now_s = self._calling_since_s, self._link.clock.now_s()
        if since_s is not None and now_s - since_s > HUNG_S:
            return f"the driver of the gripper has not returned for {now_s - since_s:.0f} s"
        return self.reading.problem

    def ask(self, start: Start) -> asyncio.Future[int]:
        """Queue the start of a command, after all earlier ones.

        Returns:
            A future. Its result is the number of the last reading before the command; later readings show its
                effect. If the device rejects the command, the future's exception is a GripperError with the
                reason.
        """
        future: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._asked.append((start, future))
        self._news.set()
        return future

    def tell(self, start: Start) -> asyncio.Future[int]:
        """Like `ask`, but errors are logged, so that the caller need not wait for the result."""
        asked = self.ask(start)
        asked.add_done_callback(self._log_error)
        return asked

    def close(self) -> None:
        """Stop the worker. The fingers stay where they are."""
        self._task.cancel()
        self._thread.submit(self._disconnect)
        self._thread.shutdown()

    def _log_error(self, future: asyncio.Future[int]) -> None:
        if not future.cancelled() and (error := future.exception()) is not None:
            log.warning("%sgripper: %s", self._link.label, plain_text(error))

    async def _run(self) -> None:
        delay_s, longest_s = BACKOFF_S
        while True:
            while self._asked:
                await self._serve(*self._asked.popleft())
            problem, state = await self._call(_read_state)
            self._report(state, problem)
            if problem:
                pause_s, delay_s = delay_s, min(2.0 * delay_s, longest_s)
            else:
                pause_s, delay_s = self._period_s(state), BACKOFF_S[0]
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._news.wait(), pause_s)
            self._news.clear()

    def _period_s(self, state: GripperState | None) -> float:
        busy = state is not None and (state.moving or (state.object is not None and state.object.is_held))
        return float(getattr(self.gripper, "state_period_s", BUSY_PERIOD_S)) if busy else IDLE_PERIOD_S

    async def _serve(self, start: Start, future: asyncio.Future[int]) -> None:
        if future.cancelled():
            return
        problem, _ = await self._call(start)
        if future.cancelled():
            return
        if problem:
            future.set_exception(GripperError(problem))
        else:
            future.set_result(self.reading.number)

    async def _call(self, method: Callable[[Gripper], Result]) -> tuple[str, Result | None]:
        """Call the driver, repeatedly until the robot has reported the points that it uses. Returns the
        problem ("" if there is none) and the result.
        """
        latest_s = self._link.clock.now_s() + FIRST_REPORT_S
        while True:
            problem, result, reported = await self._call_once(method)
            if reported or self._link.clock.now_s() >= latest_s:
                return problem, result
            await asyncio.sleep(BUSY_PERIOD_S)

    async def _call_once(self, method: Callable[[Gripper], Result]) -> tuple[str, Result | None, bool]:
        """Like `_call`, but call the driver only once. The last returned value is false if the driver needed
        a report that the robot has not sent yet.
        """
        report, reported = self._link.io(), True
        self._port.points = None if report is None else {each.name: each for each in report.points}
        self._port.wanted.clear()
        try:
            result = await self._in_thread(self._call_connected, method)
            await self._hand_over()
            return "", result, True
        except (GripperError, CobotError) as exc:
            problem, reported = plain_text(exc), not isinstance(exc, NotReported)
        except asyncio.CancelledError:
            raise
        except BaseException as exc:
            problem = f"an error in its driver: {plain_error(exc)}"
            log.debug("gripper", exc_info=exc)
        if self._connected:
            self._connected = False
            await self._in_thread(self._disconnect)
        return problem, None, reported

    async def _in_thread(self, function: Callable[..., Result], *arguments: Any) -> Result:
        """Run a function in the driver's thread. If the function hangs, `problem` reports this until it
        returns.
        """
        self._calling_since_s = self._link.clock.now_s()
        try:
            return await asyncio.get_running_loop().run_in_executor(self._thread, function, *arguments)
        finally:
            self._calling_since_s = None

    async def _hand_over(self) -> None:
        while self._port.wanted:
            name = next(iter(self._port.wanted))
            await self._link.commands.set_output(name, self._port.wanted.pop(name))

    def _call_connected(self, method: Callable[[Gripper], Result]) -> Result:
        if not self._connected:
            self.gripper.connect()
            self._connected = True
        return method(self.gripper)

    def _disconnect(self) -> None:
        with contextlib.suppress(Exception):
            self.gripper.disconnect()

    def _report(self, state: GripperState | None, problem: str) -> None:
        before, now_s = self.reading, self._link.clock.now_s()
        if problem:
            if problem != before.problem:
                log.warning("%sgripper: %s", self._link.label, problem)
            self.reading = Reading(before.number + 1, before.state, problem, before.read_s)
        else:
            self.reading = Reading(before.number + 1, state, "", now_s)
        self._on_reading(self.reading)


def _read_state(gripper: Gripper) -> GripperState:
    state = gripper.state()
    if not isinstance(state, GripperState):
        raise GripperError(
            f"its driver's state() has returned {plain_text(type(state), 80)}; it must be a GripperState"
        )
    return replace(state, fault=plain_text(state.fault))
