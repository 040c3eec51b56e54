"""Planning within a budget: what a changed scene, a lost process and the end of the time do to it.

Oracle: the calls that a planning service of this test's own has got.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from virtual_time import VirtualLoop

from app.services.motion.improvement import OVERTIME_S, SLICE_S, plan_within_budget
from cobot.errors import UnavailableError
from cobot.motions.improving import Improving
from cobot.motions.requests import MotionRequest
from cobot.trajectory import Trajectory
from cobot.types import PlannerName, Scaling

START, GOAL = np.zeros(2), np.ones(2)


def motion(duration_s: float) -> Trajectory:
    return Trajectory(np.array([0.0, duration_s]), np.zeros((1, 2, 6)))


class Process:
    """A planning service whose slices take no time but that of `spent_s`, and get 0.1 s faster each."""

    def __init__(self, then: Callable[[int], None] = lambda slices: None) -> None:
        self.scene, self.tool = object(), object()
        self.firsts = self.slices = 0
        self.asked_s: list[float] = []
        self._then = then

    async def first(self) -> Trajectory:
        self.firsts += 1
        return motion(3.0)

    async def compute(self, work: Any) -> Improving:
        self.slices += 1
        self._then(self.slices)
        found, slice_s = work.keywords["found"], work.keywords["slice_s"]
        self.asked_s.append(slice_s)
        before = found if isinstance(found, Improving) else Improving(found, 3.0, GOAL[None], np.array([1.0]))
        best = motion(before.best.duration_s - 0.1)
        tries, spent_s = before.tries + 1, before.spent_s + slice_s
        return Improving(best, 3.0, before.goals, before.lower_bounds_s, tries, tries, spent_s)

    def plan(self, budget_s: float, planner: PlannerName = PlannerName.OMPL) -> Any:
        request = MotionRequest(START, GOAL, planner, Scaling(1.0))
        clock: Any = SimpleNamespace(now_s=lambda: 0.0)
        here: Any = self
        return asyncio.run(plan_within_budget(here, clock, here.compute, request, here.first, budget_s))


def test_the_budget_is_spent_in_slices() -> None:
    process = Process()
    found = process.plan(2.5 * SLICE_S)
    assert found.tries == process.slices == 3
    np.testing.assert_allclose(process.asked_s, [SLICE_S, SLICE_S, 0.5 * SLICE_S])
    assert abs(found.best.duration_s - 2.7) < 1e-9


def test_without_a_budget_and_without_a_choice_the_first_motion_is_the_answer() -> None:
    for budget_s, planner in ((0.0, PlannerName.OMPL), (1.0, PlannerName.PTP)):
        process = Process()
        assert process.plan(budget_s, planner).duration_s == 3.0
        assert (process.firsts, process.slices) == (1, 0)


def test_a_motion_of_a_former_scene_is_not_the_answer() -> None:
    def change(slices: int) -> None:
        if slices == 2:
            process.scene = object()

    process = Process(change)
    found = process.plan(4.0 * SLICE_S)
    assert process.firsts == 2
    assert found.tries == process.slices - 2 > 0


def test_the_best_motion_is_kept_when_no_process_is_left() -> None:
    def end(slices: int) -> None:
        if slices == 3:
            raise UnavailableError("no planning process was free")

    process = Process(end)
    found = process.plan(10.0 * SLICE_S)
    assert (found.tries, process.slices) == (2, 3)


def test_a_budget_ends_when_other_requests_have_all_processes(caplog: pytest.LogCaptureFixture) -> None:
    """The oracle is the time of a virtual event loop, in which the third slice never gets a process."""

    class Busy(Process):
        async def compute(self, work: Any) -> Improving:
            if self.slices == 2:
                await asyncio.Event().wait()
            return await super().compute(work)

    async def plan() -> tuple[Any, float]:
        loop, here = asyncio.get_running_loop(), cast(Any, Busy())
        clock, begun_s = cast(Any, SimpleNamespace(now_s=loop.time)), loop.time()
        request = MotionRequest(START, GOAL, PlannerName.OMPL, Scaling(1.0))
        found = await plan_within_budget(here, clock, here.compute, request, here.first, 0.5)
        return found, loop.time() - begun_s

    with asyncio.Runner(loop_factory=VirtualLoop) as runner:
        found, took_s = runner.run(asyncio.wait_for(plan(), 100.0))
    assert found.tries == 2
    assert took_s == pytest.approx(0.5 + OVERTIME_S)
    assert "not improved further: no process was free in time" in caplog.text
