"""A client of a gripper's actions with real ROS 2, in its own Python: what it saw, as JSON on the last line.

Usage: jazzy_gripper.py ROBOT
"""

from __future__ import annotations

import json
import math
import sys
from typing import Any

import rclpy
from control_msgs.action import GripperCommand, ParallelGripperCommand
from rcl_interfaces.msg import Log
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_sensor_data
from rclpy_session import Session
from sensor_msgs.msg import JointState


def gap(position: float, max_effort: float = 0.0) -> Any:
    goal = GripperCommand.Goal()
    goal.command.position, goal.command.max_effort = position, max_effort
    return goal


def fingers(**command: Any) -> Any:
    return ParallelGripperCommand.Goal(command=JointState(**command))


class Hand(Session):
    """The node of a user of a gripper."""

    def __init__(self, robot: str) -> None:
        super().__init__(robot)
        self.warnings: list[str] = []
        self.create_subscription(Log, "/rosout", lambda each: self.warnings.append(each.msg), 100)
        below = f"/{robot}/gripper"
        self.gap = ActionClient(self, GripperCommand, f"{below}/gripper_cmd")
        self.joints = ActionClient(self, ParallelGripperCommand, f"{below}/parallel_gripper_cmd")
        for client in (self.gap, self.joints):
            self.until(client.server_is_ready, "the actions of the gripper")

    def begin(self, client: Any, goal: Any) -> tuple[Any, list[Any]]:
        told: list[Any] = []
        sent = client.send_goal_async(goal, feedback_callback=lambda each: told.append(each.feedback))
        return self.result(sent, "an answer to the goal"), told

    def end(self, handle: Any) -> tuple[int, Any]:
        answer = self.result(handle.get_result_async(), "the result")
        return answer.status, answer.result

    def go_to_a_width(self) -> None:
        handle, told = self.begin(self.gap, gap(0.03, 20.0))
        status, result = self.end(handle)
        state = self.hear(f"/{self.robot}/joint_states", JointState, qos_profile_sensor_data)[0]
        self.report["gap"] = {
            "status": status,
            "position": result.position,
            "verdict": [result.stalled, result.reached_goal],
            "feedback": [each.position for each in told],
            "names": list(state.name),
            "fingers": list(state.position[-2:]),
            "lengths": [len(each) for each in (state.name, state.position, state.velocity, state.effort)],
        }

    def move_finger_joints(self) -> None:
        handle, told = self.begin(self.joints, fingers(name=["gripper_finger_1"], position=[0.035]))
        status, result = self.end(handle)
        self.report["joints"] = {
            "status": status,
            "names": list(result.state.name),
            "position": list(result.state.position),
            "verdict": [result.stalled, result.reached_goal],
            "feedback": len(told),
        }

    def cancel(self) -> None:
        handle, told = self.begin(self.joints, fingers(position=[0.0], velocity=[0.01]))
        self.until(lambda: told and told[-1].state.position[0] < 0.034, "a finger that moves")
        self.result(handle.cancel_goal_async(), "an answer to the cancel")
        status, result = self.end(handle)
        self.report["cancelled"] = {"status": status, "position": list(result.state.position)}

    def preempt(self) -> None:
        first, told = self.begin(self.joints, fingers(position=[0.0], velocity=[0.01]))
        self.until(lambda: told, "feedback")
        second, _ = self.begin(self.gap, gap(0.08))
        self.report["preempted"] = [self.end(first)[0], self.end(second)[0]]

    def ask_for_nonsense(self) -> None:
        wrong = [
            (self.gap, gap(0.5)),
            (self.gap, gap(math.nan)),
            (self.gap, gap(0.02, math.inf)),
            (self.joints, fingers(position=[])),
            (self.joints, fingers(name=["thumb"], position=[0.01])),
            (self.joints, fingers(position=[math.nan])),
        ]
        self.report["accepted"] = [self.begin(client, goal)[0].accepted for client, goal in wrong]
        self.until(lambda: sum("is refused" in each for each in self.warnings) >= len(wrong), "the reasons")
        self.report["reasons"] = [each for each in self.warnings if "is refused" in each]


def main() -> None:
    rclpy.init()
    hand = Hand(sys.argv[1])
    for step in (
        hand.go_to_a_width,
        hand.move_finger_joints,
        hand.cancel,
        hand.preempt,
        hand.ask_for_nonsense,
    ):
        step()
    print(json.dumps(hand.report), flush=True)
    hand.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
