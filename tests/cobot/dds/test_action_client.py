"""The client of a gripper's action next to an action of the test, without a network.

Oracle: the order of the calls that arrive at the action, and the lines that the client prints.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any

import pytest

from cobot.dds import action_client
from cobot.dds.action_client import ActionClient

SETTINGS = {"action": "/hand", "type": "t", "joint": "jaw", "joint_states": "/joint_states"}


class Action:
    """Answers a goal when the test says so. The id of a goal is its number."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, Any]] = []
        self.answers: dict[Any, asyncio.Future[Any]] = {}

    def __call__(self, *_: object, **__: object) -> Action:
        return self

    async def send(self, goal: Any) -> Any:
        number = goal["number"]
        self.calls.append(("send", number))
        self.answers[number] = asyncio.get_running_loop().create_future()
        return await self.answers[number]

    async def result(self, goal_id: Any) -> Any:
        return await asyncio.Event().wait()

    async def cancel(self, goal_id: Any) -> None:
        self.calls.append(("cancel", goal_id))


async def settled() -> None:
    for _ in range(20):
        await asyncio.sleep(0.0)


def run(
    monkeypatch: pytest.MonkeyPatch,
    work: Callable[[ActionClient, Action], Awaitable[None]],
    answer_timeout_s: float = 60.0,
) -> Action:
    action = Action()
    monkeypatch.setattr(action_client, "ActionCaller", action)
    node: Any = type("Node", (), {"subscription": lambda *_, **__: None})()

    async def play() -> None:
        await work(ActionClient({**SETTINGS, "answer_timeout_s": answer_timeout_s}, node), action)

    asyncio.run(play())
    return action


def goal(client: ActionClient, number: int) -> asyncio.Future[None]:
    return begin(client._run(number, {"number": number}))


def begin(work: Coroutine[Any, Any, None]) -> asyncio.Future[None]:
    return asyncio.ensure_future(work)


def test_a_goal_waits_for_the_answer_to_the_previous_one_and_only_the_newest_is_sent(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def work(client: ActionClient, action: Action) -> None:
        tasks = [goal(client, number) for number in (1, 2, 3)]
        await settled()
        assert action.calls == [("send", 1)]
        action.answers[1].set_result(1)
        await settled()
        assert action.calls == [("send", 1), ("send", 3)]
        for task in tasks:
            task.cancel()

    run(monkeypatch, work)


def test_a_cancel_before_the_answer_cancels_the_goal_when_it_is_accepted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def work(client: ActionClient, action: Action) -> None:
        tasks = [goal(client, 1), begin(client._cancel(1))]
        await settled()
        action.answers[1].set_result(1)
        await settled()
        assert action.calls == [("send", 1), ("cancel", 1)]
        tasks[0].cancel()

    run(monkeypatch, work)


def test_a_goal_that_is_cancelled_while_it_waits_is_never_sent(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def work(client: ActionClient, action: Action) -> None:
        tasks = [goal(client, 1), goal(client, 2), begin(client._cancel(2))]
        await settled()
        action.answers[1].set_result(1)
        await settled()
        assert action.calls == [("send", 1), ("cancel", 1)]
        tasks[0].cancel()

    run(monkeypatch, work)
    told = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {"what": "result", "number": 2, "status": 5, "values": {"stalled": False}} in told


def test_a_goal_that_is_accepted_too_late_is_cancelled_if_there_is_a_newer_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def work(client: ActionClient, action: Action) -> None:
        tasks = [goal(client, 1), goal(client, 2)]
        while ("send", 2) not in action.calls:
            await asyncio.sleep(0.001)
        action.answers[1].set_result(1)
        await settled()
        assert action.calls == [("send", 1), ("send", 2), ("cancel", 1)]
        for task in tasks:
            task.cancel()

    run(monkeypatch, work, answer_timeout_s=0.001)
