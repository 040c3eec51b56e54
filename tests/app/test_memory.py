"""What the service holds no longer goes back to the system. Oracle: Python's word that an object is gone."""

from __future__ import annotations

import asyncio
import gc
import weakref

import pytest

from app import memory


class Circle:
    """Ends with the garbage collector's next round only."""

    def __init__(self) -> None:
        self.itself = self
        self.content = b"x" * (1 << 26)


def test_garbage_that_nobody_has_collected_yet_goes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "LOOK_S", 0.0)

    async def main() -> None:
        giving = asyncio.create_task(memory.give_back())
        await asyncio.sleep(0)
        circle = weakref.ref(Circle())
        assert circle() is not None
        while circle() is not None:
            await asyncio.sleep(0)
        giving.cancel()

    gc.disable()
    try:
        asyncio.run(asyncio.wait_for(main(), 60.0))
    finally:
        gc.enable()
