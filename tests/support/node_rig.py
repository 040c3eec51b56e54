"""A node of ours in the test's process, its event loop in a thread."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from ros_peer import until

from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode
from cobot.dds.rtps import Participant
from cobot.ros.messages import Messages

Value = TypeVar("Value")
NAME = NodeName("cobot")

DEFINITIONS = {
    "aubo_interfaces/srv/GetDof": "---\nint32 code\nstring message\nint32 result\n",
    "aubo_interfaces/srv/MoveJoint": (
        "float64[] q\nfloat64 a\nfloat64 v\nfloat64 blend_radius\nfloat64 duration\n"
        "---\nint32 code\nstring message\nint32 result\n"
    ),
    "aubo_interfaces/action/Count": "int32 until\n---\nint32 reached\n---\nint32 now\n",
}


class NodeRig:
    """A node on localhost."""

    def __init__(self, domain: int, gid_bytes: int | None = None) -> None:
        self.domain = domain
        self.messages = Messages(DEFINITIONS)
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self._thread.start()
        self.participant = Participant(domain, localhost_only=True, name=NAME.full, user_data=ENCLAVE)
        self.node: DdsNode = self.do(
            lambda: DdsNode(self.participant, NAME, self.messages, gid_bytes, self.loop)
        )

    def do(self, action: Callable[[], Value]) -> Value:
        """Call something in the event loop; what it gave."""

        async def call() -> Value:
            return action()

        return asyncio.run_coroutine_threadsafe(call(), self.loop).result(30.0)

    def until_known(self, topic: str) -> None:
        """Until the participant has found a foreign reader of a topic, by its name in DDS."""
        until(
            lambda: any(end.topic == topic and end.kind == "reader" for end in self.participant.discovered()),
            f"nobody reads {topic}",
        )

    def close(self) -> None:
        self.do(self.node.close)
        self.participant.close()

        async def cancel_all() -> None:
            others = asyncio.all_tasks() - {asyncio.current_task()}
            for task in others:
                task.cancel()
            await asyncio.gather(*others, return_exceptions=True)
            for _ in range(3):  # transports close a turn of the loop later
                await asyncio.sleep(0)

        asyncio.run_coroutine_threadsafe(cancel_all(), self.loop).result(30.0)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join(10.0)
        self.loop.close()

    def __enter__(self) -> NodeRig:
        return self

    def __exit__(self, *_: Any) -> None:
        self.close()
