"""Agents that go away while the arm moves for them, on virtual time.

Oracles: the official client in both of its protocols, which says what it thinks is the end of a connection
or a cancellation, and where the arm is.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from typing import Any

import httpx
import pytest
from mcp_agent import ADDRESS, FAR, HOME, Agent, Cell, token
from starlette.types import Message, Receive, Scope, Send
from virtual_service import URL

from app.mcp.departures import GONE, Departures
from cobot.access.roles import Role

SLOWLY = 0.1


class Line:
    """Between an agent and the service: a connection that can be cut.

    Attributes:
        cut: set to cut it.
        calls: the requests for a tool that went by.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self.cut = asyncio.Event()
        self.calls: list[dict[str, Any]] = []

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        body = [await receive()]
        while body[-1].get("more_body"):
            body.append(await receive())
        sent = b"".join(each["body"] for each in body)
        if b'"tools/call"' in sent:
            self.calls.append(json.loads(sent))

        async def received() -> Message:
            if body:
                return body.pop(0)
            await self.cut.wait()
            return {"type": "http.disconnect"}

        await self._cell.service.app(scope, received, send)


class Moving:
    """An agent whose plan is being run, which takes ten seconds."""

    def __init__(self, cell: Cell, mode: str) -> None:
        cell.goes_to(HOME)
        self.cell, self.line = cell, Line(cell)
        plan = cell.agent.call("plan_to_joints", joints=FAR, speed=SLOWLY)["plan_id"]
        cell.asks("/robot/approve", {"plan_id": plan})
        agent = Agent(cell.service, mode=mode, app=self.line)
        agent.headers = cell.agent.headers
        self.call = cell.service.begin(
            agent.doing(lambda client: client.call_tool("execute", {"plan_id": plan}))
        )
        cell.service.until(lambda: cell.joints()[0] > 0.1)

    def job(self) -> dict[str, Any]:
        found = self.cell.service.ask("GET", "/jobs?n=1", headers=self.cell.operator).json()
        job: dict[str, Any] = found["jobs"][0]
        return job

    def cancel(self, headers: dict[str, str], address: str = ADDRESS, **about: Any) -> None:
        """What a client sends whose user does not want to wait any longer."""
        more = {"mcp-protocol-version": "2025-06-18", "accept": "application/json, text/event-stream"}
        sent = {"jsonrpc": "2.0", "method": "notifications/cancelled"} | ({"params": about} if about else {})

        async def sending() -> int:
            transport = httpx.ASGITransport(self.cell.service.app, client=(address, 4001))
            async with httpx.AsyncClient(transport=transport, timeout=None) as client:
                answer = await client.post(f"{URL}/mcp/mcp", json=sent, headers=headers | more)
            return answer.status_code

        assert self.cell.service.run(sending()) == 202


def cut(moving: Moving) -> None:
    moving.line.cut.set()


def cancelled(moving: Moving) -> None:
    moving.cancel(moving.cell.agent.headers, requestId=moving.line.calls[0]["id"])


@pytest.mark.parametrize(("mode", "leave"), [("legacy", cut), ("auto", cut), ("legacy", cancelled)])
def test_the_arm_stops_for_whom_nobody_waits_any_more(
    cell: Cell, mode: str, leave: Callable[[Moving], None]
) -> None:
    moving = Moving(cell, mode)
    leave(moving)
    job = cell.service.until(lambda: (job := moving.job())["state"] == "cancelled" and job)
    assert "the client has disconnected" in job["error"]["detail"]
    at_rest = cell.joints()
    cell.service.sleep(1.0)
    assert cell.joints() == pytest.approx(at_rest, abs=2e-3)
    assert at_rest[0] < 1.2
    moving.call.cancel()


def test_a_request_that_still_waits_for_its_turn_can_be_cancelled() -> None:
    """The tool has not begun: it finds the event set."""
    scope: Scope = {"headers": [], "client": (ADDRESS, 4000)}
    about = {"method": "notifications/cancelled", "params": {"requestId": 7}}
    departures = Departures()

    async def never() -> Message:
        await asyncio.Event().wait()
        raise AssertionError("unreachable")

    async def cancelled() -> tuple[bool, bool]:
        with departures.watch(scope, {"id": 7, "method": "tools/call"}, b"", never):
            gone: asyncio.Event = scope[GONE]
            before = gone.is_set()
            with departures.watch(dict(scope), about, b"", never):
                return before, gone.is_set()

    assert asyncio.run(cancelled()) == (False, True)


@pytest.mark.parametrize("sent", ["", '{"method": "notifications/cancelled", "params": '])
def test_what_is_nested_too_deep_is_a_mistake_of_who_sends_it(cell: Cell, sent: str) -> None:
    more = {"content-type": "application/json", "accept": "application/json, text/event-stream"}
    answer = cell.service.post("/mcp/mcp", content=sent + "[" * 30_000, headers=cell.agent.headers | more)
    assert answer.status_code == 400, answer.text


def test_what_is_rehearsed_for_whom_nobody_waits_is_given_up(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A planning process that never answers stands for one that computes for long."""
    cell.goes_to(HOME)
    plan = cell.agent.call("plan_to_joints", joints=FAR, speed=SLOWLY)["plan_id"]
    ended = []

    async def compute(work: object, timeout_s: float) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            ended.append(timeout_s)

    monkeypatch.setattr(cell.service.app.state.services.planning, "compute", compute)
    line = Line(cell)
    agent = Agent(cell.service, mode="legacy", app=line)
    agent.headers = cell.agent.headers
    call = cell.service.begin(agent.doing(lambda client: client.call_tool("rehearse", {"plan_id": plan})))
    cell.service.until(lambda: line.calls)
    cell.service.sleep(0.5)
    assert ended == []
    line.cut.set()
    cell.service.until(lambda: ended)
    call.cancel()
    monkeypatch.undo()
    rehearsal = cell.agent.call("rehearse", plan_id=plan)
    assert rehearsal["runs_through"]
    assert rehearsal["duration_s"] > 10.0


def test_nobody_else_and_nothing_else_cancels_a_motion(cell: Cell) -> None:
    moving = Moving(cell, "legacy")
    number = moving.line.calls[0]["id"]
    other = {"authorization": f"Bearer {token(cell.service, Role.AGENT)}"}
    moving.cancel(other, requestId=number)
    moving.cancel(cell.agent.headers, "192.0.2.8", requestId=number)
    moving.cancel(cell.agent.headers, requestId=f"{number}1")
    moving.cancel(cell.agent.headers)
    answer = cell.service.end(moving.call)
    assert json.loads(answer.content[0].text)["success"], answer
    assert cell.joints() == pytest.approx(FAR, abs=2e-3)
