"""A client of FollowJointTrajectory with real ROS 2 (rclpy): sends goals one after the other, and tells what
became of each as JSON: a line when it is answered, one with `took_s` when it has ended.

Usage: jazzy_follower.py ACTION GOALS, where GOALS is a JSON list of objects: `joints`, `points` (pairs of
time_from_start and positions), `cancel_s` (optional: cancelled so long after it was accepted),
`repeat` (optional: so many times).
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

import rclpy
from builtin_interfaces.msg import Duration
from control_msgs.action import FollowJointTrajectory
from rclpy.action import ActionClient
from trajectory_msgs.msg import JointTrajectoryPoint

WAIT_S = 60.0


def point(time_s: float, positions: list[float]) -> JointTrajectoryPoint:
    duration = Duration(sec=int(time_s), nanosec=int(1e9 * (time_s % 1.0)))
    zeros = [0.0] * len(positions)
    return JointTrajectoryPoint(
        positions=positions, velocities=zeros, accelerations=zeros, time_from_start=duration
    )


def follow(node: Any, client: ActionClient, wish: dict[str, Any]) -> dict[str, Any]:
    goal, feedback = FollowJointTrajectory.Goal(), []
    goal.trajectory.joint_names = wish["joints"]
    goal.trajectory.points = [point(*each) for each in wish["points"]]
    begun = time.monotonic()
    sent = client.send_goal_async(goal, lambda message: feedback.append(message))
    rclpy.spin_until_future_complete(node, sent, timeout_sec=WAIT_S)
    handle = sent.result()
    told: dict[str, Any] = {"accepted": handle.accepted, "accepted_s": time.monotonic() - begun}
    print(json.dumps(told), flush=True)
    if not handle.accepted:
        return {**told, "took_s": told["accepted_s"]}
    result = handle.get_result_async()
    if "cancel_s" in wish:
        rclpy.spin_until_future_complete(node, result, timeout_sec=wish["cancel_s"])
        cancelled = handle.cancel_goal_async()
        rclpy.spin_until_future_complete(node, cancelled, timeout_sec=WAIT_S)
    rclpy.spin_until_future_complete(node, result, timeout_sec=WAIT_S)
    answer = result.result()
    told |= {"status": answer.status, "error_code": answer.result.error_code}
    told |= {
        "text": answer.result.error_string,
        "took_s": time.monotonic() - begun,
        "feedback": len(feedback),
    }
    return told


def main() -> None:
    rclpy.init()
    node = rclpy.create_node("follower")
    client = ActionClient(node, FollowJointTrajectory, sys.argv[1])
    assert client.wait_for_server(timeout_sec=WAIT_S)
    for wish in json.loads(sys.argv[2]):
        for _ in range(wish.get("repeat", 1)):
            print(json.dumps(follow(node, client, wish)), flush=True)


if __name__ == "__main__":
    main()
