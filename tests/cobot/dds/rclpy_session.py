"""A user's session with real ROS 2, in its own Python: what a node sees of cobot, as JSON on the last line.

Usage: rclpy_session.py ROBOT
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rclpy
from aubo_interfaces.srv import GetDof
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import JointState
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectoryPoint

WAIT_S = 60.0
REQUESTS = 100
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class Session(Node):
    """The node of a user."""

    def __init__(self, robot: str) -> None:
        super().__init__("user")
        self.robot = robot
        self.report: dict[str, Any] = {}

    def until(self, condition: Any, what: str) -> Any:
        """Spin until it holds."""
        deadline_s = time.monotonic() + WAIT_S
        while time.monotonic() < deadline_s:
            rclpy.spin_once(self, timeout_sec=0.05)
            value = condition()
            if value:
                return value
        raise SystemExit(f"{what}: not within {WAIT_S:.0f} s; so far {self.report}")

    def result(self, future: Any, what: str) -> Any:
        self.until(future.done, what)
        return future.result()

    def hear(self, topic: str, type_: type, qos: Any, count: int = 1) -> list[Any]:
        """The next messages of a topic."""
        messages: list[Any] = []
        subscription = self.create_subscription(type_, topic, messages.append, qos)
        self.until(lambda: len(messages) >= count, f"messages of {topic}")
        self.destroy_subscription(subscription)
        return messages

    def look_around(self) -> None:
        """What `ros2 node list`, `node info` and `topic list` ask."""
        self.until(lambda: "/cobot" in self.seen_nodes(), "the node /cobot")
        self.until(lambda: len(self.seen_services()) > 280, "the services of /cobot")
        self.report["nodes"] = self.seen_nodes()
        self.report["services"] = self.seen_services()
        self.report["publishers"] = dict(self.get_publisher_names_and_types_by_node("cobot", "/"))
        self.report["topics"] = dict(self.get_topic_names_and_types())

    def seen_nodes(self) -> list[str]:
        return [f"{space.rstrip('/')}/{name}" for name, space in self.get_node_names_and_namespaces()]

    def seen_services(self) -> dict[str, list[str]]:
        return dict(self.get_service_names_and_types_by_node("cobot", "/"))

    def read(self) -> None:
        robot = self.robot
        states = self.hear(f"/{robot}/joint_states", JointState, qos_profile_sensor_data, count=50)
        stamps = [each.header.stamp.sec + 1e-9 * each.header.stamp.nanosec for each in states]
        self.report["joints"] = list(states[-1].name)
        self.report["position"] = list(states[-1].position)
        self.report["stamps_rise"] = all(b > a for a, b in zip(stamps, stamps[1:]))  # noqa: B905, RUF007
        moving = self.hear("/tf", TFMessage, 10)[0]
        static = self.hear("/tf_static", TFMessage, LATCHED)[0]
        self.report["frames"] = sorted(
            each.child_frame_id for each in (*moving.transforms, *static.transforms)
        )
        self.report["description"] = self.hear("/robot_description", String, LATCHED)[0].data[:200]

    def ask(self) -> None:
        client = self.create_client(GetDof, f"/{self.robot}/RobotConfig/getDof")
        self.until(client.service_is_ready, "the service getDof")
        self.report["dof"] = []
        for _ in range(REQUESTS):
            answer = self.result(client.call_async(GetDof.Request()), "an answer of getDof")
            self.report["dof"].append([answer.code, answer.result])

    def move(self) -> None:
        """Follow a trajectory from where the arm is."""
        client = ActionClient(self, FollowJointTrajectory, f"/{self.robot}/follow_joint_trajectory")
        self.until(client.server_is_ready, "the action follow_joint_trajectory")
        end = [value + 0.1 for value in self.report["position"]]
        told: list[Any] = []
        sent = client.send_goal_async(self.goal(end, seconds=2), feedback_callback=told.append)
        handle = self.result(sent, "an answer to the goal")
        result = self.result(handle.get_result_async(), "the result of the goal")
        reached = told[-1].feedback.actual.positions if told else []
        self.report["goal"] = {
            "accepted": handle.accepted,
            "status": result.status,
            "error_code": result.result.error_code,
            "feedback": len(told),
            "off": max(abs(a - b) for a, b in zip(end, reached)) if told else None,  # noqa: B905
        }

    def cancel(self) -> None:
        """Cancel a motion of 20 s once it has begun."""
        client = ActionClient(self, FollowJointTrajectory, f"/{self.robot}/follow_joint_trajectory")
        self.until(client.server_is_ready, "the action follow_joint_trajectory")
        told: list[Any] = []
        sent = client.send_goal_async(self.goal(self.report["position"], seconds=20), told.append)
        handle = self.result(sent, "an answer to the goal that is cancelled")
        self.until(lambda: told, "feedback")
        cancelled = self.result(handle.cancel_goal_async(), "an answer to the cancellation")
        result = self.result(handle.get_result_async(), "the result of the cancelled goal")
        self.report["cancelled"] = [len(cancelled.goals_canceling), result.status]

    def goal(self, end: list[float], seconds: int) -> FollowJointTrajectory.Goal:
        """A motion from the place where the arm is."""
        goal = FollowJointTrajectory.Goal()
        goal.trajectory.joint_names = self.report["joints"]
        goal.trajectory.points = [JointTrajectoryPoint(positions=end, time_from_start=Duration(sec=seconds))]
        return goal


def main() -> None:
    rclpy.init()
    session = Session(sys.argv[1])
    for step in (session.look_around, session.read, session.ask, session.move, session.cancel):
        step()
    print(json.dumps(session.report), flush=True)
    session.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
