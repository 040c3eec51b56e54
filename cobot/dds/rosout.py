"""The log of this process on /rosout, for `ros2 topic echo /rosout` and rqt_console."""

from __future__ import annotations

import logging

from cobot.dds.node import DdsNode
from cobot.ros.messages import ros_time

TYPE = "rcl_interfaces/msg/Log"


class RosoutHandler(logging.Handler):
    """Publishes log records. The levels of Python and ROS are equal: 10, 20, 30, 40, 50."""

    def __init__(self, node: DdsNode) -> None:
        super().__init__()
        self._name = node.name.full.strip("/").replace("/", ".")
        self._publisher = node.publisher("/rosout", TYPE, depth=1000)

    def emit(self, record: logging.LogRecord) -> None:
        message = {
            "stamp": ros_time(int(record.created * 1e9)),
            "level": record.levelno // 10 * 10,
            "name": self._name,
            "msg": record.getMessage(),
            "file": record.filename,
            "function": record.funcName or "",
            "line": record.lineno,
        }
        try:
            self._publisher.publish(message)
        except Exception:  # noqa: BLE001  what logging does with handlers that fail
            self.handleError(record)
