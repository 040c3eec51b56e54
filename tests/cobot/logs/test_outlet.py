"""The queue between who logs and what is slow."""

from __future__ import annotations

import errno
import gc
import threading
import time

import pytest
from cobot_run import WAIT_S

from cobot.logs import outlet as module
from cobot.logs.outlet import Outlet
from cobot.logs.repeats import Repeats


class Sink:
    """Takes what it is given when `open` is set, or fails."""

    def __init__(self) -> None:
        self.taken: list[str] = []
        self.open = threading.Event()
        self.fails = False

    def write(self, item: str) -> None:
        self.open.wait()
        if self.fails:
            raise OSError(errno.ENOSPC, "No space left on device")
        self.taken.append(item)


def outlet(sink: Sink, **options: object) -> Outlet[str]:
    return Outlet[str](sink.write, lambda count: f"lost {count}", capacity=10, **options)  # type: ignore[arg-type]


def test_nobody_waits_for_a_sink_that_takes_nothing_and_the_loss_is_said_when_there_is_room() -> None:
    sink = Sink()
    made = outlet(sink)
    begun_s = time.monotonic()
    for n in range(1000):
        made.put(str(n))
    assert time.monotonic() - begun_s < WAIT_S
    assert made.dropped == 990
    sink.open.set()
    made.wait(10.0)
    made.put("after")
    made.close(10.0)
    # It may be said in parts, as the sink takes the first one late.
    lost = [int(item.removeprefix("lost ")) for item in sink.taken if item.startswith("lost ")]
    assert sum(lost) == 990
    rest = [item for item in sink.taken if not item.startswith("lost ")]
    assert sorted(rest) == sorted([*map(str, range(10)), "after"])


def test_an_end_does_not_wait_for_a_stuck_sink() -> None:
    made = outlet(Sink())
    made.put("x")
    begun_s = time.monotonic()
    made.close(0.05)
    assert time.monotonic() - begun_s < WAIT_S
    made.put("after the end")
    assert made.dropped == 1


def test_what_fails_is_lost_and_counted_and_the_next_is_tried() -> None:
    sink = Sink()
    sink.open.set()
    sink.fails = True
    made = outlet(sink)
    made.put("a")
    made.wait(10.0)
    assert (made.dropped, made.error) == (1, errno.ENOSPC)
    sink.fails = False
    made.put("b")
    made.close(10.0)
    assert sink.taken == ["lost 1", "b"]
    assert made.error == 0


def test_repetitions_are_summarised_without_another_line() -> None:
    sink = Sink()
    sink.open.set()
    made = outlet(
        sink, repeats=Repeats[str](2, 0.0, time.monotonic), repeated=lambda last, n: f"{n} more of {last}"
    )
    made.close(10.0)
    sink.taken.clear()
    now_s = 0.0
    made = outlet(
        sink, repeats=Repeats[str](2, 10.0, lambda: now_s), repeated=lambda last, n: f"{n} more of {last}"
    )
    for n in range(5):
        made.put(f"x{n}", "x")
    made.put("y", "y")
    made.wait(WAIT_S)
    now_s = 11.0
    deadline_s = time.monotonic() + 30.0
    while len(sink.taken) < 4 and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert sink.taken == ["x0", "x1", "y", "3 more of x4"]
    made.close(10.0)


def test_a_garbage_collection_that_logs_does_not_wait_for_itself() -> None:
    """It may begin anywhere, in the midst of `put` too."""
    sink = Sink()
    sink.open.set()
    made = Outlet[str](sink.write, str, repeats=Repeats[str](100, 10.0, time.monotonic), capacity=10**6)

    class Logs:
        def __init__(self) -> None:
            self.itself = self

        def __del__(self) -> None:
            made.put("collected", "kind")

    threshold = gc.get_threshold()
    gc.set_threshold(1)
    try:
        for n in range(3000):
            Logs()
            made.put(str(n), n % 7)
    finally:
        gc.set_threshold(*threshold)
    made.close(WAIT_S)  # what is not written by then counts as dropped
    assert made.dropped == 0


def test_what_could_not_be_written_is_tried_again_though_nobody_says_anything_more(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(module, "LOOK_S", 0.02)
    sink = Sink()
    sink.open.set()
    sink.fails = True
    made = outlet(sink)
    made.put("a")
    made.wait(10.0)
    time.sleep(0.1)
    assert (made.dropped, made.error) == (1, errno.ENOSPC)
    sink.fails = False
    deadline_s = time.monotonic() + 30.0
    while made.error and time.monotonic() < deadline_s:
        time.sleep(0.01)
    assert (made.dropped, made.error, sink.taken) == (1, 0, ["lost 1"])
    made.put("b")
    made.close(10.0)
    assert sink.taken == ["lost 1", "b"]
