"""Live data over a network to a client of Foxglove's protocol that nobody here wrote.

Oracles: robo-ws-bridge, which speaks the published protocol; rosbags, which reads messages by the definitions
that came over the wire; where REST says the arm is.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any

import numpy as np
import pytest
from cobot_run import WAIT_S, Run
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cobot.client import Client

bridge = pytest.importorskip("robo_ws_bridge", reason="robo-ws-bridge is not installed: make setup-test")
THERE = [0.3, 0.2, 0.0, -1.4, 0.0, 1.4, 0.0]


class Watching:
    """What has come, by topic, read."""

    def __init__(self, run: Run) -> None:
        address = f"ws{run.url.removeprefix('http')}/foxglove?rate_hz=50"
        self.client = bridge.WebSocketBridgeClient(address)
        self.client.on_message(self._take)
        self.client.on_status(self._complain)
        self.store = get_typestore(Stores.EMPTY)
        self.came: dict[str, list[Any]] = {}
        self.complaints: list[str] = []

    async def _take(self, channel: Any, moment_ns: int, content: bytes) -> None:
        name = channel["schemaName"]
        if name not in self.store.fielddefs:
            types = get_types_from_msg(channel["schema"], name)
            self.store.register(
                {each: kind for each, kind in types.items() if each not in self.store.fielddefs}
            )
        self.came.setdefault(channel["topic"], []).append(self.store.deserialize_cdr(content, name))

    async def _complain(self, level: int, message: str, number: str | None) -> None:
        self.complaints.append(message)

    async def until(self, condition: Any) -> None:
        async with asyncio.timeout(WAIT_S):
            while not condition():
                await asyncio.sleep(0.02)

    async def session(self, run: Run, topics: tuple[str, ...]) -> None:
        await self.client.connect()
        await self.until(lambda: len(self.client.channels) >= 5)
        for topic in topics:
            await self.client.subscribe(topic)
        await self.until(lambda: self.came.get("/joint_states"))
        await asyncio.to_thread(moved, run)
        end = np.array(run.joints())
        await self.until(lambda: np.abs(self.came["/joint_states"][-1].position - end).max() < 1e-3)
        await self.until(lambda: self.came["/cycle"][-1].mode == self.came["/cycle"][-1].MODE_HOLD)
        await self.until(lambda: len(motions(self.came["/events"])) >= 2)
        for topic in topics:
            await self.client.unsubscribe(topic)
        await self.client.disconnect()


def moved(run: Run) -> None:
    with Client(run.url) as client:
        client.move_joints(THERE, speed=0.5)


def motions(events: list[Any]) -> list[str]:
    return [json.loads(event.text)["what"] for event in events if event.kind == "motion"]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # of that client
def test_a_client_that_is_not_ours_sees_a_motion(shared: Run) -> None:
    shared.go_home()
    watching = Watching(shared)
    asyncio.run(watching.session(shared, ("/joint_states", "/cycle", "/events")))
    assert {each["topic"] for each in watching.client.channels.values()} == {
        "/joint_states", "/commanded", "/wrench", "/cycle", "/events",
    }  # fmt: skip
    assert set(watching.came) == {"/joint_states", "/cycle", "/events"}
    assert motions(watching.came["/events"]) == ["begun", "finished"]
    np.testing.assert_allclose(watching.came["/joint_states"][-1].position, THERE, atol=5e-3)
    assert watching.came["/cycle"][0].mode == watching.came["/cycle"][0].MODE_HOLD
    assert watching.complaints == []
