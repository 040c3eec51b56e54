"""An event loop that never waits, and the clock that shows its time."""

from __future__ import annotations

import asyncio
import errno
import math
import selectors
import time
from collections.abc import Callable
from typing import Any


class _NoFiles(selectors.DefaultSelector):
    """Waits for no file: it only has the time go on to when the loop wants to be woken."""

    def __init__(self, wait: Callable[[float | None], None]) -> None:
        super().__init__()
        self._wait = wait

    def select(self, timeout: float | None = None) -> list[Any]:
        self._wait(timeout)
        return []


class VirtualLoop(asyncio.SelectorEventLoop):
    """An event loop that never waits: when nothing is ready, its time jumps to its next timer or beat."""

    def __init__(self) -> None:
        self._now_s = 1000.0
        self._beats: list[Beat] = []
        super().__init__(_NoFiles(self._pass))

    def time(self) -> float:
        return self._now_s

    def every(self, period_s: float, call: Callable[[], None]) -> Beat:
        """Have something called once a period, from now on; it costs less than timers."""
        beat = Beat(self._beats, period_s, self._now_s, call)
        self._beats.append(beat)
        return beat

    def run_in_executor(self, executor: Any, function: Any, *arguments: Any) -> Any:  # type: ignore[override]
        """At once, in this thread: no time goes by."""
        future = self.create_future()
        try:
            future.set_result(function(*arguments))
        except Exception as exc:  # noqa: BLE001 - it belongs to who awaits the future
            future.set_exception(exc)
        return future

    async def subprocess_exec(self, *_: Any, **__: Any) -> Any:
        """Refused: a process takes real time, and what it writes would never be read here."""
        raise OSError(errno.ENOTSUP, "on virtual time no process can be started")

    def _pass(self, timeout: float | None) -> None:
        assert timeout is not None or self._beats, (
            "nothing will ever happen: everybody waits for somebody else"
        )
        end_s = math.inf if timeout is None else self._now_s + timeout
        while self._beats and (beat := min(self._beats)).due_s <= end_s:
            self._now_s = max(self._now_s, beat.due_s)
            beat()
            if self._ready or timeout is None:  # Somebody has been woken, or may have set a timer.
                return
        self._now_s = end_s


class Beat:
    """What a virtual loop calls again and again, until it is closed."""

    def __init__(self, beats: list[Beat], period_s: float, due_s: float, call: Callable[[], None]) -> None:
        self.due_s = due_s
        self._beats, self._period_s, self._call = beats, period_s, call

    def __lt__(self, other: Beat) -> bool:
        return self.due_s < other.due_s

    def __call__(self) -> None:
        self.due_s += self._period_s
        self._call()

    def close(self) -> None:
        self._beats.remove(self)


class VirtualClock:
    """`cobot.clock.Clock` on a virtual loop. A thread's sleep has the loop go on."""

    def __init__(self, loop: VirtualLoop) -> None:
        self._loop = loop
        self._epoch_ns = time.time_ns() - self.now_ns()

    def now_s(self) -> float:
        return self._loop.time()

    def now_ns(self) -> int:
        return round(self._loop.time() * 1e9)

    def wall_ns(self) -> int:
        return self._epoch_ns + self.now_ns()

    def sleep(self, seconds: float) -> None:
        self._loop.run_until_complete(asyncio.sleep(seconds))

    def ticker(self, rate_hz: float, on_tick: Callable[[int], None]) -> VirtualTicks:
        return VirtualTicks(self._loop, 1.0 / rate_hz, on_tick)


class VirtualTicks:
    """Ticks on the loop's own timers."""

    def __init__(self, loop: VirtualLoop, period_s: float, on_tick: Callable[[int], None]) -> None:
        self._loop, self._period_s, self._on_tick = loop, period_s, on_tick
        self._due_s = loop.time() + period_s
        self._timer = loop.call_at(self._due_s, self._tick)

    def close(self) -> None:
        self._timer.cancel()

    def _tick(self) -> None:
        self._due_s += self._period_s
        self._timer = self._loop.call_at(self._due_s, self._tick)
        self._on_tick(1)
