"""As much of rclpy's surface as the manual's client uses, where there is no ROS.

What goes over the wire is sent by the Fast DDS peer (`ros_peer.Peer`), so that a script written for rclpy
talks to cobot through a DDS stack that nobody here wrote. Domain: ROS_DOMAIN_ID.
"""

from __future__ import annotations

import os
from typing import Any

from ros_peer import Peer

from rclpy.types import MESSAGES

_peer: Peer | None = None


def init(args: list[str] | None = None) -> None:
    global _peer
    _peer = Peer(int(os.environ.get("ROS_DOMAIN_ID", "0")), MESSAGES)


def ok() -> bool:
    return _peer is not None and _peer.process.poll() is None


def shutdown() -> None:
    global _peer
    peer().close()
    _peer = None


def peer() -> Peer:
    if _peer is None:
        raise RuntimeError("rclpy.init() has not been called")
    return _peer


def spin_until_future_complete(node: Any, future: Any, timeout_sec: float | None = None) -> None:
    future.wait(timeout_sec)
