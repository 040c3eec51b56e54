"""From the wire's thread to the event loop. Oracle: the order and the number of what the test has put in."""

from __future__ import annotations

import asyncio
import logging
import threading
from types import SimpleNamespace
from typing import Any

import pytest

from cobot.dds.inbox import MAX_BYTES, LossCounter, SampleInbox


def sample(number: int, size: int = 1) -> Any:
    return SimpleNamespace(number=number, payload=bytes(size))


def test_samples_come_in_order_and_in_the_event_loop() -> None:
    async def test() -> None:
        heard: list[tuple[int, int]] = []
        done = asyncio.Event()

        def deliver(each: Any) -> None:
            heard.append((each.number, threading.get_ident()))
            if each.number == 4999:
                done.set()

        inbox = SampleInbox("/demo", asyncio.get_running_loop(), deliver)
        thread = threading.Thread(target=lambda: [inbox.put(sample(number)) for number in range(5000)])
        thread.start()
        await asyncio.wait_for(done.wait(), 60.0)
        thread.join()
        assert heard == [(number, threading.get_ident()) for number in range(5000)]
        assert inbox.losses.count == 0

    asyncio.run(test())


@pytest.mark.parametrize(("size", "kept"), [(1, 10), (MAX_BYTES // 4, 4)])
def test_what_is_too_much_is_lost_and_counted(size: int, kept: int) -> None:
    async def test() -> None:
        heard: list[int] = []
        inbox = SampleInbox(
            "/demo", asyncio.get_running_loop(), lambda each: heard.append(each.number), most=10
        )
        large = sample(0, size)
        for number in range(15):
            inbox.put(SimpleNamespace(number=number, payload=large.payload))  # type: ignore[arg-type]
        assert inbox.losses.count == 15 - kept
        await asyncio.sleep(0.01)
        assert heard == list(range(kept))
        inbox.put(sample(99))
        await asyncio.sleep(0.01)
        assert heard[-1] == 99  # there is room again

    asyncio.run(test())


def test_losses_are_told_when_their_number_doubles(caplog: pytest.LogCaptureFixture) -> None:
    losses = LossCounter("messages of /demo came too fast")
    with caplog.at_level(logging.WARNING, "cobot.ros2"):
        for _ in range(20):
            losses.add()
    assert [record.getMessage().split(":")[0] for record in caplog.records] == [
        f"lost {count}" for count in (1, 2, 4, 8, 16)
    ]
