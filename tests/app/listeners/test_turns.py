"""Whose turn it is. Oracle: counting iterations of a real event loop."""

from __future__ import annotations

import asyncio
import functools
import itertools
import time
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from app.listeners import turns
from app.listeners.turns import MAX_TURNS, Turns


def in_a_loop(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
    @functools.wraps(test)
    def run(**fixtures: Any) -> None:
        asyncio.run(test(**fixtures))

    return run


async def iterations(work: list[int], count: int) -> list[int]:
    """How many pieces of work each of so many iterations did."""
    did = []
    for _ in range(count):
        before = len(work)
        await asyncio.sleep(0)
        did.append(len(work) - before)
    return did


@in_a_loop
async def test_work_is_done_at_once_while_there_is_little() -> None:
    done: list[int] = []
    order = Turns()
    for number in range(MAX_TURNS):
        order.wait(lambda number=number: done.append(number))
    assert done == list(range(MAX_TURNS))


@in_a_loop
async def test_of_much_work_each_iteration_does_some_in_its_order() -> None:
    done: list[int] = []
    order = Turns()
    for number in range(10 * MAX_TURNS):
        order.wait(lambda number=number: done.append(number))
    assert len(done) == MAX_TURNS
    assert max(await iterations(done, 200)) <= MAX_TURNS
    assert done == list(range(10 * MAX_TURNS))


@in_a_loop
async def test_slow_work_is_done_piece_by_piece() -> None:
    done: list[int] = []
    order = Turns()

    def slow() -> None:
        time.sleep(0.004)
        done.append(1)

    for _ in range(MAX_TURNS + 8):
        order.wait(slow)
    assert await iterations(done, 8) == [1] * 8


@in_a_loop
async def test_nothing_is_forgotten_when_the_computer_pauses_at_any_moment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each look at the clock finds that a second has passed."""
    seconds = itertools.count()
    monkeypatch.setattr(turns.time, "perf_counter", lambda: float(next(seconds)))
    done: list[int] = []
    order = Turns()
    for number in range(5 * MAX_TURNS):
        order.wait(lambda number=number: done.append(number))
    await iterations(done, 5 * MAX_TURNS)
    assert done == list(range(5 * MAX_TURNS))


@in_a_loop
async def test_coroutines_wait_in_the_same_order_and_may_give_up() -> None:
    done: list[int] = []
    order = Turns()

    async def wait(number: int) -> None:
        await order.turn()
        done.append(number)

    tasks = [asyncio.create_task(wait(number)) for number in range(4 * MAX_TURNS)]
    await asyncio.sleep(0)
    tasks[2 * MAX_TURNS].cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    assert done == [number for number in range(4 * MAX_TURNS) if number != 2 * MAX_TURNS]
