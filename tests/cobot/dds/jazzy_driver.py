"""A gripper's driver with real ROS 2: an action server, and joint states. It does as standard input says.

Usage: jazzy_driver.py GripperCommand|ParallelGripperCommand. A line is a mode (good, slow, reject, abort,
never, nan, silent) or `object WIDTH`, where the fingers stop. The joint's position is the width, at 0.2 m/s.
In the mode `slow` the answer to a goal that closes the fingers takes 0.1 s. The goal that is answered last is
executed.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from typing import Any

import control_msgs.action
import rclpy
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import JointState

PERIOD_S, SLOW_S = 0.02, 0.1
STEP_M = 0.2 * PERIOD_S


class Driver(Node):
    """The driver."""

    def __init__(self, kind: str) -> None:
        super().__init__("driver")
        self.mode, self.object = "good", 0.0
        self.position = 0.08
        self.newest: Any = None
        self.kind = getattr(control_msgs.action, kind)
        group = ReentrantCallbackGroup()
        self.states = self.create_publisher(JointState, "/joint_states", 10)
        self.create_timer(PERIOD_S, self.tell, callback_group=group)
        self.server = ActionServer(
            self,
            self.kind,
            "/hand/cmd",
            self.execute,
            callback_group=group,
            goal_callback=self.judge,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def tell(self) -> None:
        if self.mode != "silent":
            position = math.nan if self.mode == "nan" else self.position
            self.states.publish(JointState(name=["other", "jaw"], position=[9.0, position]))

    def judge(self, goal: Any) -> GoalResponse:
        if self.mode == "slow" and self.target(goal) < self.position:
            time.sleep(SLOW_S)
        self.newest = goal
        return GoalResponse.REJECT if self.mode == "reject" else GoalResponse.ACCEPT

    def target(self, goal: Any) -> float:
        position = goal.command.position
        return float(position[0] if "Parallel" in self.kind.__name__ else position)

    def execute(self, handle: Any) -> Any:
        target = self.target(handle.request)
        result = self.kind.Result()
        while self.newest is handle.request and not handle.is_cancel_requested:
            if self.mode == "abort":
                break
            way = target - self.position
            stopped = way < 0.0 and self.position <= self.object
            if not stopped:
                self.position = (
                    target if abs(way) <= STEP_M else self.position + (STEP_M if way > 0 else -STEP_M)
                )
                if way < 0.0:
                    self.position = max(self.position, self.object)
            if (stopped or self.position == target) and self.mode != "never":
                result.stalled, result.reached_goal = stopped, not stopped
                handle.succeed()
                return result
            time.sleep(PERIOD_S)
        if handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return result

    def obey(self) -> None:
        for line in sys.stdin:
            word, *rest = line.split()
            if word == "object":
                self.object = float(rest[0])
            else:
                self.mode = word
            print("done", flush=True)


def main() -> None:
    rclpy.init()
    driver = Driver(sys.argv[1])
    threading.Thread(target=driver.obey, daemon=True).start()
    executor = MultiThreadedExecutor(8)
    executor.add_node(driver)
    print("ready", flush=True)
    executor.spin()


if __name__ == "__main__":
    main()
