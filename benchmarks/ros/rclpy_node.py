"""A node of real ROS 2, for the Python of its environment: counts JointStates, or publishes them as a peer.

python rclpy_node.py listen TOPIC SECONDS      prints how many have come a second
python rclpy_node.py publish TOPIC HZ
"""

from __future__ import annotations

import sys
import time

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import JointState

PATIENCE_S = 30.0


def listen(node: Node, topic: str, seconds: float) -> float:
    """Count messages, beginning with the first one."""
    count = 0

    def heard(_: JointState) -> None:
        nonlocal count
        count += 1

    node.create_subscription(JointState, topic, heard, QoSProfile(depth=1000))
    deadline_s = time.monotonic() + PATIENCE_S
    while not count:
        rclpy.spin_once(node, timeout_sec=0.1)
        if time.monotonic() > deadline_s:
            sys.exit(f"nothing has come on {topic} within {PATIENCE_S:g} s")
    count, begun_s = 0, time.monotonic()
    while time.monotonic() < begun_s + seconds:
        rclpy.spin_once(node, timeout_sec=0.1)
    return count / (time.monotonic() - begun_s)


def publish(node: Node, topic: str, rate_hz: float) -> None:
    """Publish messages as large as those of seven joints until the process is killed."""
    publisher = node.create_publisher(JointState, topic, QoSProfile(depth=1000))
    message = JointState(name=[f"joint{index}" for index in range(1, 8)], position=[0.1] * 7)
    message.velocity = message.effort = [0.1] * 7
    message.header.frame_id = "base_link"
    due_s = time.monotonic()
    while True:
        message.header.stamp = node.get_clock().now().to_msg()
        publisher.publish(message)
        due_s += 1.0 / rate_hz
        time.sleep(max(0.0, due_s - time.monotonic()))


if __name__ == "__main__":
    what, name, number = sys.argv[1:]
    rclpy.init()
    made = rclpy.create_node(f"benchmark_{what}")
    if what == "listen":
        print(listen(made, name, float(number)))
    else:
        publish(made, name, float(number))
