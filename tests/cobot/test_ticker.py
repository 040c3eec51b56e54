"""The kernel's timer in the event loop. Oracle: CLOCK_MONOTONIC."""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path

import pytest

from cobot.ticker import Ticker

DESCRIPTORS = Path("/proc/self/fd")


@pytest.mark.parametrize("rate_hz", [0.9, 200.0, 1000.0])
def test_ticks_are_neither_lost_nor_invented(rate_hz: float) -> None:
    """Late ticks are counted with the next one, so a busy computer changes nothing."""

    async def test() -> tuple[int, float]:
        counts: list[int] = []
        begun_s = time.monotonic()
        ticker = Ticker(rate_hz, counts.append)
        while sum(counts) < 0.3 * rate_hz:
            await asyncio.sleep(0.001)
        elapsed_s = time.monotonic() - begun_s
        ticker.close()
        return sum(counts), elapsed_s

    count, elapsed_s = asyncio.run(test())
    assert count <= elapsed_s * rate_hz
    assert count >= 0.3 * rate_hz


def test_a_closed_ticker_is_silent_and_its_descriptor_gone() -> None:
    async def test() -> None:
        before = len(os.listdir(DESCRIPTORS))
        ticks: list[int] = []
        ticker = Ticker(1000.0, ticks.append)
        assert len(os.listdir(DESCRIPTORS)) == before + 1
        ticker.close()
        assert len(os.listdir(DESCRIPTORS)) == before
        seen = len(ticks)
        await asyncio.sleep(0.02)
        assert len(ticks) == seen

    asyncio.run(test())
