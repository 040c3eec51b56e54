"""The queue's motions go on into moves that come while the arm moves, on virtual time.

Oracle: what the cycle has commanded, cycle by cycle; pinocchio for where the TCP is; joint_limits.yaml.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from independent_models import second_robot
from virtual_service import VirtualService

from app.aubo.poses import numbers_of
from app.services.motion.planning import PlanningService
from app.services.state.link import RobotLink
from cobot.errors import ExecutionError
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode

IDLE = -1
START = [0.0, 0.5, 0.0, -1.3, 0.0, 1.34, 0.0]
SETTLED_RAD = 2e-3
RADIUS_M = 0.05


class Queue:
    """The vendor's motions of one robot, and what its cycle has commanded."""

    def __init__(self, service: VirtualService) -> None:
        self.http, self.name = service, service.name
        services = service.app.state.services
        self.planning: PlanningService = services.planning
        self.link: RobotLink = services.link
        self.robot: RobotDescription = services.robot

    def __call__(self, method: str, **fields: Any) -> Any:
        response = self.http.post(f"/{self.name}/MotionControl/{method}", json=fields)
        assert response.status_code == 200, response.text
        content = response.json()
        assert content["code"] == 0, content
        return content["result"]

    def joint(self, change: dict[int, float], radius_m: float = 0.0, v: float = 0.5) -> list[float]:
        goal = list(START)
        for joint, by in change.items():
            goal[joint] += by
        self("moveJoint", q=goal, v=v, a=1.5, blend_radius=radius_m)
        return goal

    def done(self) -> list[int]:
        """The numbers that were under way, in their order."""
        seen: list[int] = []

        def ended() -> bool:
            number = self("getExecId")
            if not seen or seen[-1] != number:
                seen.append(number)
            return bool(number == IDLE)

        self.http.until(ended)
        return seen[:-1]

    @property
    def motions(self) -> int:
        """How many have begun so far."""
        return self.http.rig.loop.controller.motion_id

    def commanded(self, since: int) -> np.ndarray:
        return np.array(self.http.rig.commanded[since:])

    @property
    def now(self) -> int:
        return len(self.http.rig.commanded)


@pytest.fixture
def queue(service: VirtualService) -> Iterator[Queue]:
    made = Queue(service)
    service.post("/stop").raise_for_status()
    made("moveJoint", q=START, v=1.0, a=4.0)
    made.done()
    yield made
    made("setSpeedFraction", fraction=1.0)
    service.post("/stop").raise_for_status()


def speeds(positions: np.ndarray) -> np.ndarray:
    """Of the fastest joint, rad/s."""
    return np.asarray(np.abs(np.diff(positions, axis=0)).max(axis=1) / 1e-3)


def within_limits(queue: Queue, positions: np.ndarray) -> None:
    limits = queue.http.rig.limits
    for order, bound in enumerate((limits.max_velocity, limits.max_acceleration, limits.max_jerk), start=1):
        assert (np.abs(np.diff(positions, order, axis=0)) / 1e-3**order / bound).max() < 1.005


def rests(positions: np.ndarray) -> int:
    """How many cycles the arm stood still between its first and its last movement."""
    moves = np.flatnonzero(speeds(positions) > 1e-4)
    return int(moves[-1] - moves[0] + 1 - len(moves))


def corners(queue: Queue, since: int, places: list[list[float]]) -> list[float]:
    """How near the TCP came to where it would be at these joints, m."""
    path = second_robot().path(queue.commanded(since))[0]
    goals = second_robot().path(np.array(places))[0]
    return [float(np.linalg.norm(path - goal, axis=1).min()) for goal in goals]


def test_a_move_that_comes_while_the_arm_moves_is_gone_on_into_without_a_stop(queue: Queue) -> None:
    since, begun = queue.now, queue.motions
    places = [queue.joint({0: 0.8}, RADIUS_M)]
    for change in ({0: 0.8, 1: 0.5}, {0: 0.0, 1: 0.5}):
        queue.http.sleep(0.3)
        places.append(queue.joint(change, RADIUS_M))
    queue.http.sleep(0.3)
    end = queue.joint({})
    numbers = queue.done()
    assert numbers == list(range(numbers[0], numbers[0] + 4))
    assert queue.motions == begun + 1
    positions = queue.commanded(since)
    assert rests(positions) == 0
    assert all(1e-3 < apart < RADIUS_M for apart in corners(queue, since, places))
    within_limits(queue, positions)
    np.testing.assert_allclose(positions[-1], end, atol=1e-9)


def test_moves_without_a_radius_follow_each_other_with_no_wait(queue: Queue) -> None:
    since, begun = queue.now, queue.motions
    place = queue.joint({0: 0.4})
    queue.http.sleep(0.2)
    end = queue.joint({0: 0.4, 3: 0.3})
    assert queue("getQueueSize") == 2
    queue.done()
    assert queue.motions == begun + 1
    positions = queue.commanded(since)
    assert corners(queue, since, [place])[0] < 1e-4
    assert rests(positions) < 20
    within_limits(queue, positions)
    np.testing.assert_allclose(positions[-1], end, atol=1e-9)


def test_a_plan_that_is_late_lets_the_arm_rest_and_go_on(
    queue: Queue, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle of either outcome: the same places in the same order, within the limits, at rest or not."""
    compute = queue.planning.compute

    async def slow(*arguments: Any) -> Any:
        found = await compute(*arguments)
        await asyncio.sleep(1.5)
        return found

    since, begun = queue.now, queue.motions
    place = queue.joint({0: 0.6}, RADIUS_M)
    queue.http.sleep(0.3)
    with monkeypatch.context() as patched:
        end_task = queue.http.begin(
            queue.http.asking(
                "POST",
                f"/{queue.name}/MotionControl/moveJoint",
                json={"q": START, "v": 0.5, "a": 1.5},
            )
        )
        queue.http.sleep(0.002)
        patched.setattr(queue.planning, "compute", slow)
        assert queue.http.end(end_task).json()["code"] == 0
        queue.done()
    assert queue.motions == begun + 2
    positions = queue.commanded(since)
    assert rests(positions) > 0
    assert corners(queue, since, [place])[0] < 1e-4
    within_limits(queue, positions)
    np.testing.assert_allclose(positions[-1], START, atol=1e-9)


def test_what_rtloop_refuses_is_gone_to_after_a_rest(queue: Queue, monkeypatch: pytest.MonkeyPatch) -> None:
    async def refuse(*arguments: Any) -> None:
        raise ExecutionError("it differs from the current motion")

    monkeypatch.setattr(queue.link.commands, "replace", refuse)
    since, begun = queue.now, queue.motions
    place = queue.joint({0: 0.6}, RADIUS_M)
    queue.http.sleep(0.3)
    queue.joint({})
    queue.done()
    assert queue.motions == begun + 2
    assert corners(queue, since, [place])[0] < 1e-4
    assert "the arm stops before this move: it differs from the current motion" in queue.http.output


@pytest.mark.parametrize("fraction", [0.3, 0.7])
def test_it_goes_on_at_any_speed_and_after_a_pause(queue: Queue, fraction: float) -> None:
    since = queue.now
    place = queue.joint({0: 0.8}, RADIUS_M)
    queue.http.sleep(0.2)
    queue("setSpeedFraction", fraction=fraction)
    queue.http.sleep(0.2)
    middle = queue.joint({0: 0.8, 1: 0.5}, RADIUS_M)
    queue.http.sleep(0.3)
    queue("stopMove")
    queue.joint({})
    queue.http.sleep(0.5)
    assert queue.http.rig.mode is LoopMode.TRAJECTORY
    queue("startMove")
    queue.done()
    assert all(apart < RADIUS_M for apart in corners(queue, since, [place, middle]))
    within_limits(queue, queue.commanded(since))
    np.testing.assert_allclose(queue.commanded(since)[-1], START, atol=1e-9)


def test_a_stop_ends_a_motion_that_was_prolonged_on_its_path(queue: Queue) -> None:
    since = queue.now
    queue.joint({0: 0.8}, RADIUS_M)
    queue.http.sleep(0.3)
    queue.joint({0: 0.8, 1: 0.5})
    queue.http.sleep(0.5)
    assert queue.http.post("/stop").json()["success"]
    assert queue("getExecId") == IDLE
    assert queue("getQueueSize") == 0
    assert "stopped by POST /stop" in queue("getLastError")
    within_limits(queue, queue.commanded(since))
    queue.joint({})
    queue.done()


def test_a_move_to_where_the_arm_gets_to_is_a_stop_there(queue: Queue) -> None:
    since = queue.now
    place = queue.joint({0: 0.6}, RADIUS_M)
    queue.http.sleep(0.2)
    queue.joint({0: 0.6}, RADIUS_M)
    queue.joint({})
    numbers = queue.done()
    assert numbers[0] < numbers[-1]
    assert corners(queue, since, [place])[0] < 1e-4
    np.testing.assert_allclose(queue.commanded(since)[-1], START, atol=1e-9)


def test_lines_that_come_one_after_the_other_are_one_motion_of_even_speed(queue: Queue) -> None:
    """Twice around a square, each line sent when the one before has been accepted, as a program does."""
    place = queue.robot.model.forward(np.array(START))
    pose, since, begun = numbers_of(place), queue.now, queue.motions
    corner: list[np.ndarray] = []
    for y, z in [(0.2, 0.0), (0.2, -0.2), (0.0, -0.2), (0.0, 0.0)] * 2:
        goal = [pose[0], pose[1] + y, pose[2] + z, *pose[3:]]
        queue("moveLine", pose=goal, v=0.15, a=1.0, blend_radius=RADIUS_M)
        corner.append(np.array(goal[:3]))
        queue.http.sleep(0.05)
    numbers = queue.done()
    assert numbers == sorted(numbers)
    assert queue.motions == begun + 1
    path = second_robot().path(queue.commanded(since))[0]
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / 1e-3
    moving = np.flatnonzero(speed > 0.02)
    assert speed[moving[200] : moving[-200]].min() > 0.07
    assert speed.max() < 0.15 * 1.01
    inner = path[moving[200] : moving[-200]]
    for each in corner[:-1]:
        assert 1e-3 < np.linalg.norm(inner - each, axis=1).min() < RADIUS_M
    within_limits(queue, queue.commanded(since))
    assert np.linalg.norm(path[-1] - corner[-1]) < 1e-5
