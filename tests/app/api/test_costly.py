"""Costly answers leave the event loop to others. Oracle: the order of what happens, written down."""

from __future__ import annotations

import asyncio
import time
from itertools import pairwise

import pytest
from virtual_service import VirtualService
from virtual_time import VirtualLoop

from app.api.costly import MAX_REST_S, REST, Costly
from app.api.routers.jobs import FEW
from cobot.errors import CobotError

WORKS_S = 0.01


def test_one_is_made_after_the_other_with_rests_between() -> None:
    made: list[tuple[float, float]] = []

    async def make(costly: Costly, *, fails: bool) -> None:
        async with costly.turn():
            begun_s = time.perf_counter()
            while time.perf_counter() < begun_s + WORKS_S:
                pass
            made.append((begun_s, time.perf_counter()))
            if fails:
                raise CobotError

    async def crowd() -> None:
        costly = Costly()
        work = [make(costly, fails=number == 1) for number in range(4)]
        await asyncio.gather(*work, return_exceptions=True)

    asyncio.run(crowd())
    assert len(made) == 4
    for (begun_s, ended_s), (next_s, _) in pairwise(made):
        assert next_s - ended_s >= 0.9 * min(REST * (ended_s - begun_s), MAX_REST_S)


def test_what_takes_nobody_knows_how_long_begins_after_a_rest_whatever_becomes_of_the_one_before() -> None:
    loop = VirtualLoop()

    async def crowd() -> list[float]:
        costly, begun_s = Costly(), []

        async def work() -> None:
            await costly.start(0.5)
            begun_s.append(loop.time())
            await asyncio.sleep(9.0)

        await asyncio.gather(*(work() for _ in range(3)))
        return begun_s

    begun_s = loop.run_until_complete(crowd())
    loop.close()
    assert [each - begun_s[0] for each in begun_s] == pytest.approx([0.0, 0.5, 1.0])


@pytest.mark.parametrize("path", ["/metrics", "/audit?limit=1000"])
def test_who_waits_for_a_turn_keeps_neither_a_state_nor_a_stop_waiting(
    service: VirtualService, path: str
) -> None:
    """A crowd of them delayed a stop by a second and a half."""

    async def held() -> None:
        async with service.app.state.costly.turn():
            crowd = [asyncio.create_task(service.asking("GET", path)) for _ in range(20)]
            for method, other in (("GET", "/health"), ("POST", "/stop"), ("GET", "/robot/pose")):
                assert (await service.asking(method, other)).status_code == 200
            assert not any(each.done() for each in crowd)
        assert {(await each).status_code for each in crowd} == {200}

    service.run(held())


def test_long_lists_of_jobs_and_kept_plans_wait_for_their_turn(service: VirtualService) -> None:
    """A list of a thousand jobs kept the event loop for a tenth of a second."""
    body = {"joints": service.joints(), "speed": 1.0}
    for _ in range(FEW + 1):
        assert service.post("/robot/move/joints", json=body).json()["success"]
    plan = service.post("/robot/plan/joints", json=body).json()["plan_id"]

    async def held() -> None:
        async with service.app.state.costly.turn():
            waiting = [
                asyncio.create_task(service.asking("GET", path))
                for path in ("/jobs?n=1000", f"/robot/plans/{plan}")
            ]
            assert len((await service.asking("GET", "/jobs")).json()["jobs"]) == FEW
            assert (await service.asking("POST", "/stop")).status_code == 200
            assert not any(each.done() for each in waiting)
        jobs, kept = [(await each).json() for each in waiting]
        assert len(jobs["jobs"]) == FEW + 1
        assert kept["plan_id"] == plan

    service.run(held())
