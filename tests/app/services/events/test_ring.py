"""The ring of events and a place in it, on a clock of the test's.

Oracle: a list of all events that were published, and what the HTML standard and the ring's own contract say.
"""

from __future__ import annotations

import asyncio
import json
import math
import random
from collections.abc import Coroutine
from types import SimpleNamespace
from typing import Any

import pytest

from app.services.events.pacing import AT_ONCE
from app.services.events.ring import BURST, CAPACITY_BYTES, LOG_BURST, PER_S, Events
from app.services.reports.listener import EventFilter, Listener
from cobot.errors import InputError


class Bench:
    """A ring, and the time."""

    def __init__(self, capacity: int = 2000) -> None:
        self.now_s = 100.0
        clock: Any = SimpleNamespace(now_s=lambda: self.now_s, wall_ns=lambda: 1_700_000_000_123_456_000)
        self.events = Events(clock, capacity)

    def publish(self, count: int, kind: str = "motion", robot: str = "left") -> None:
        for _ in range(count):
            self.now_s += 1.0 / PER_S
            self.events.publish(kind, robot, number=self.events.newest + 1)


def numbers(found: list[Any]) -> list[int]:
    return [each.number for each in found if each.type != "hello"]


def listening(work: Coroutine[Any, Any, None]) -> None:
    asyncio.run(work)


def test_an_event_says_when_where_and_what() -> None:
    bench = Bench()
    bench.events.publish("mode", "left", mode="HOLD", torque=math.nan)
    (event,) = bench.events.since(0, 10)
    assert json.loads(event.text) == {
        "id": 1,
        "epoch": bench.events.epoch,
        "time": "2023-11-14T22:13:20.123456+00:00",
        "robot": "left",
        "type": "mode",
        "data": {"mode": "HOLD", "torque": None},
    }
    bench.events.publish("service", what="started")
    assert json.loads(bench.events.since(1, 10)[0].text)["robot"] is None


def test_a_type_that_is_not_documented_is_a_mistake_of_ours() -> None:
    with pytest.raises(KeyError):
        Bench().events.publish("moed")


def test_no_two_starts_have_one_epoch() -> None:
    assert len({Events().epoch for _ in range(100)}) == 100


@pytest.mark.parametrize(
    ("after", "place"),
    [(None, (30, False)), ("0", (0, False)), ("30", (30, False)), ("deadbeef-7", (0, True))],
)
def test_where_somebody_goes_on(after: str | None, place: tuple[int, bool]) -> None:
    bench = Bench()
    bench.publish(30)
    assert bench.events.place(after) == place
    assert bench.events.place(f"{bench.events.epoch}-12") == (12, False)


@pytest.mark.parametrize(
    "after", ["", "-", "x", "-1", "1.5", "nan", "١", "9" * 21, "deadbeef9-1", "a-b-1", "12-", "31", "9" * 20]
)
def test_what_is_no_place_is_refused_in_words(after: str) -> None:
    bench = Bench()
    bench.publish(30)
    with pytest.raises(InputError, match="after: "):
        bench.events.place(after)


def test_who_reads_gets_every_event_once_and_in_order_whatever_is_published_meanwhile() -> None:
    rng = random.Random(8007)

    async def read() -> None:
        bench = Bench()
        listener = Listener(bench.events, EventFilter(), "0")
        seen: list[int] = []
        while bench.events.newest < 3000:
            bench.publish(rng.randrange(1, 300))
            while len(seen) < bench.events.newest:
                seen += numbers(await listener.next())
        assert seen == list(range(1, bench.events.newest + 1))
        listener.close()
        assert not bench.events.on_news
        assert await listener.next() == []

    listening(read())


def test_a_slow_one_is_told_which_events_it_has_lost_and_gets_the_others() -> None:
    async def read() -> None:
        bench = Bench(capacity=50)
        slow, quick = (Listener(bench.events, EventFilter(), "0") for _ in range(2))
        assert numbers(await quick.next()) == []
        bench.publish(40)
        assert numbers(await quick.next()) == list(range(1, 41))
        bench.publish(80)
        hello, lost, *others = await slow.next()
        assert (hello.type, hello.number) == ("hello", 0)
        assert (lost.type, lost.number) == ("lost", 70)
        assert json.loads(lost.text)["data"] == {"why": "slow", "count": 70, "first": 1, "last": 70}
        assert numbers(others) == list(range(71, 121))
        lost, *others = await quick.next()
        assert json.loads(lost.text)["data"] == {"why": "slow", "count": 30, "first": 41, "last": 70}
        assert bench.events.lost == 100
        for each in (slow, quick):
            each.close()

    listening(read())


def test_who_comes_back_after_a_restart_is_told_so_and_gets_what_there_is() -> None:
    async def read() -> None:
        bench = Bench()
        bench.publish(3)
        listener = Listener(bench.events, EventFilter(), "deadbeef-4711")
        hello, lost, *others = await listener.next()
        assert (hello.type, lost.type) == ("hello", "lost")
        assert json.loads(lost.text)["data"] == {"why": "restarted", "count": None}
        assert numbers(others) == [1, 2, 3]
        listener.close()

    listening(read())


def test_a_crowd_is_told_a_few_at_a_time_and_everybody_in_the_end() -> None:
    """Oracle: what runs in the loop in between, once in each of its iterations."""

    async def read() -> None:
        bench = Bench()
        crowd = [Listener(bench.events, EventFilter({"mode"})) for _ in range(50)]
        for each in crowd:
            await each.next()
        heard: list[int] = []

        async def hear(listener: Listener) -> None:
            heard.extend(numbers(await listener.next()))

        hearing = [asyncio.create_task(hear(each)) for each in crowd]
        await asyncio.sleep(0)
        bench.events.publish("mode", mode="HOLD")
        most = before = 0
        while len(heard) < len(crowd):
            await asyncio.sleep(0)
            most, before = max(most, len(heard) - before), len(heard)
        assert 0 < most <= 2 * AT_ONCE
        await asyncio.gather(*hearing)
        for each in crowd:
            each.close()

    listening(read())


def test_it_hears_what_it_wants_and_what_is_about_all_robots() -> None:
    async def read() -> None:
        bench = Bench()
        listener = Listener(bench.events, EventFilter({"motion", "service"}, {"left"}))
        bench.publish(1, "motion", "left")
        bench.publish(1, "motion", "right")
        bench.publish(1, "mode", "left")
        bench.publish(1, "service", "")
        assert [(each.type, each.robot) for each in await listener.next()] == [
            ("hello", ""),
            ("motion", "left"),
            ("service", ""),
        ]
        listener.close()

    listening(read())


def test_the_end_of_the_service_is_the_last_event() -> None:
    async def read() -> None:
        bench = Bench()
        listener = Listener(bench.events, EventFilter())
        bench.events.close()
        bench.events.close()
        *_, last = await listener.next()
        assert json.loads(last.text)["data"] == {"what": "ends"}
        assert await listener.next() == []
        listener.close()

    listening(read())


def test_who_hears_nothing_is_told_where_it_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.services.reports.listener.KEEP_ALIVE_S", 0.01)

    async def read() -> None:
        bench = Bench()
        listener = Listener(bench.events, EventFilter({"fault"}))
        await listener.next()
        bench.publish(7)
        (alive,) = await listener.next()
        assert (alive.type, alive.number) == ("alive", 7)
        listener.close()

    listening(read())


def test_a_flood_of_one_type_leaves_room_for_others_and_is_counted() -> None:
    bench = Bench()
    for _ in range(100_000):
        bench.events.publish("stop", "left", by="a flood")
    bench.events.publish("mode", "left", mode="HOLD")
    bench.events.publish("stop", "right", by="somebody")
    assert bench.events.newest == BURST + 2
    bench.now_s += 1.0
    bench.events.publish("stop", "left", by="a flood")
    assert json.loads(bench.events.since(bench.events.newest - 1, 1)[0].text)["data"] == {
        "by": "a flood",
        "held_back": 100_000 - BURST,
    }
    for _ in range(100):
        bench.events.publish("log", message="again")
    assert bench.events.newest == BURST + 3 + LOG_BURST


def test_large_events_are_bounded_by_their_bytes() -> None:
    bench = Bench()
    for _ in range(300):
        bench.now_s += 1.0
        bench.events.publish("log", message="x" * 100_000)
    kept = bench.events.since(0, 1000)
    assert sum(len(each.text) for each in kept) <= CAPACITY_BYTES
    assert len(kept) > 30
    bench.events.publish("mode", "left", mode="x" * 2 * CAPACITY_BYTES)
    assert len(bench.events.since(0, 10)) == 1, "the newest is always kept"
