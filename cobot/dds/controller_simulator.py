"""`cobot simulate ros2_control`: the controllers of an arm, without the arm.

They correspond to those of ros2_control with mock hardware: a joint trajectory controller with its action and
topic, a forward position controller, a controller manager that lists and switches them, a GPIO controller,
joint states, and the robot's description.
"""

from __future__ import annotations

import argparse
import asyncio
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cobot.clock import SYSTEM
from cobot.config import Settings, load_settings
from cobot.dds.action_server import DdsActionServer
from cobot.dds.gpio_values import GPIO, message_of, values_of
from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode, Message
from cobot.dds.rtps import NetworkError, Participant
from cobot.errors import CobotError
from cobot.robot.description import RobotDescription, load_robot
from cobot.ros.failures import FjtError
from cobot.ros.messages import Messages, ros_time
from cobot.ros.robot_messages import JOINT_STATES, STRING, RobotMessages
from cobot.ros.trajectory_controller import CANCELED, TrajectoryController

FOLLOW = "control_msgs/action/FollowJointTrajectory"
TRAJECTORY = "trajectory_msgs/msg/JointTrajectory"
COMMANDS, FLOAT = "std_msgs/msg/Float64MultiArray", "std_msgs/msg/Float64"
FEEDBACK_S, SCALING_S = 0.05, 0.1
TOPIC = "topic"
"""Name of a motion that arrives on the topic instead of the action."""
INTERFACES = ("position", "velocity")
GPIO_CONTROLLER = "gpio_command_controller"


class SimulatedControllers:
    """The simulated controllers; see the module.

    Args:
        joints: joint names, with their prefix.
        position: joint positions at the start, shape (dof,), rad.
        gpio: interfaces of the GPIO controller as GPIO/INTERFACE. Each can be set, and its first value is 0.
    """

    def __init__(
        self,
        node: DdsNode,
        joints: list[str],
        position: np.ndarray,
        namespace: str,
        controller: str,
        forward: str,
        description: Message,
        gpio: list[str],
    ) -> None:
        rows = np.zeros((3, len(joints)))
        rows[0] = position
        self._joints, self._node = joints, node
        self._names = controller, forward
        self.controller = TrajectoryController(joints, rows, self._end)
        self.forwarding = False
        self._refused = ""
        self._time_s = time.monotonic()
        self._action = DdsActionServer(
            node,
            f"{namespace}/{controller}/follow_joint_trajectory",
            FOLLOW,
            self._accepts,
            self._begin,
            self._cancel,
        )
        self._states = node.publisher(f"{namespace}/joint_states", JOINT_STATES)
        self._scaling = node.publisher(f"{namespace}/speed_scaling_state_broadcaster/speed_scaling", FLOAT)
        node.publisher(f"{namespace}/robot_description", STRING, latched=True).publish(description)
        node.subscription(f"{namespace}/{controller}/joint_trajectory", TRAJECTORY, self._follow)
        node.subscription(f"{namespace}/{forward}/commands", COMMANDS, self._command, reliable=False)
        self._gpio = dict.fromkeys(gpio, 0.0)
        self._gpio_states = node.publisher(f"{namespace}/{GPIO_CONTROLLER}/gpio_states", GPIO)
        node.subscription(f"{namespace}/{GPIO_CONTROLLER}/commands", GPIO, self._take_gpio)
        manager = f"{namespace}/controller_manager"
        node.service(f"{manager}/list_controllers", "controller_manager_msgs/srv/ListControllers", self._list)
        node.service(
            f"{manager}/switch_controller", "controller_manager_msgs/srv/SwitchController", self._switch
        )

    async def run(self, rate_hz: float) -> None:
        """Simulate the motion in real time, until this task is cancelled."""
        period_s = 1.0 / rate_hz
        feedback_s = scaling_s = due_s = time.monotonic()
        while True:
            due_s += period_s
            await asyncio.sleep(max(due_s - time.monotonic(), 0.0))
            now_s = self._advance()
            due_s = max(due_s, now_s - 0.1)
            self._tell_states()
            if now_s >= feedback_s:
                feedback_s = now_s + FEEDBACK_S
                self._tell_feedback()
            if now_s >= scaling_s:
                scaling_s = now_s + SCALING_S
                self._scaling.publish({"data": 100.0 * self.controller.rate})
                self._gpio_states.publish(message_of(self._gpio))

    def _advance(self) -> float:
        """Simulate the time since the last call. Returns the current time, s."""
        before_s, self._time_s = self._time_s, time.monotonic()
        self.controller.step(self._time_s - before_s)
        return self._time_s

    def switch(self, *, activate: set[str], deactivate: set[str]) -> bool:
        """Activate and deactivate controllers. Two active controllers cannot share joints.

        Returns:
            Whether the controllers were switched.
        """
        trajectories, forward = self._names
        if not activate | deactivate <= {trajectories, forward}:
            return False
        active = self._active() - deactivate | activate
        if len(active) > 1:
            return False
        if trajectories not in active:
            self.controller.end(
                CANCELED, FjtError.INVALID_GOAL, "Current goal cancelled during deactivate transition."
            )
        self.controller.active = trajectories in active
        self.forwarding = forward in active
        return True

    def _active(self) -> set[str]:
        trajectories, forward = self._names
        states = {trajectories: self.controller.active, forward: self.forwarding}
        return {name for name, active in states.items() if active}

    # Action and topics

    def _accepts(self, name: str, goal: Message) -> bool:
        self._refused = self.controller.refusal(goal)
        if self._refused:
            print(f"cobot simulate ros2_control: a goal is rejected: {self._refused}", flush=True)
        return not self._refused

    def _begin(self, name: str, goal: Message) -> None:
        self._advance()
        self.controller.begin(name, goal)

    def _cancel(self, name: str) -> bool:
        goal = self.controller.goal
        if goal is None or goal.key != name:
            return False
        self._node.loop.call_soon(self._end_cancelled, name)
        return True

    def _end_cancelled(self, name: str) -> None:
        goal = self.controller.goal
        if goal is not None and goal.key == name:
            self.controller.end(CANCELED, FjtError.SUCCESSFUL, "")

    def _end(self, name: str, status: int, result: dict[str, Any]) -> None:
        if name != TOPIC:
            self._action.end(name, status, result)

    def _follow(self, trajectory: Message) -> None:
        if not self.controller.refusal({"trajectory": trajectory}):
            self._begin(TOPIC, {"trajectory": trajectory})

    def _command(self, message: Message) -> None:
        values = np.array(message["data"], float)
        if self.forwarding and values.shape == self.controller.rows[0].shape and np.isfinite(values).all():
            self.controller.rows[0] = values

    def _take_gpio(self, message: Message) -> None:
        self._gpio |= {name: value for name, value in values_of(message).items() if name in self._gpio}

    # Controller manager

    async def _list(self, request: Message) -> Message:
        trajectories, forward = self._names
        kinds = {
            trajectories: "joint_trajectory_controller/JointTrajectoryController",
            forward: "forward_command_controller/ForwardCommandController",
        }
        active = self._active()
        listed = [self._listed(name, kind, name in active, command=True) for name, kind in kinds.items()]
        broadcaster = "joint_state_broadcaster"
        kind = f"{broadcaster}/JointStateBroadcaster"
        return {"controller": [*listed, self._listed(broadcaster, kind, active=True, command=False)]}

    def _listed(self, name: str, kind: str, active: bool, *, command: bool) -> Message:
        needed = [f"{joint}/position" for joint in self._joints] if command else []
        return {
            "name": name,
            "state": "active" if active else "inactive",
            "type": kind,
            "update_rate": 250,
            "claimed_interfaces": needed if active else [],
            "required_command_interfaces": needed,
            "required_state_interfaces": [
                f"{joint}/{interface}" for joint in self._joints for interface in INTERFACES
            ],
        }

    async def _switch(self, request: Message) -> Message:
        activate, deactivate = (set(request[f"{word}_controllers"]) for word in ("activate", "deactivate"))
        return {"ok": self.switch(activate=activate, deactivate=deactivate)}

    def _tell_states(self) -> None:
        position, velocity, _ = self.controller.rows.tolist()
        header = {"stamp": ros_time(SYSTEM.wall_ns()), "frame_id": ""}
        effort = [0.0] * len(position)
        self._states.publish(
            {
                "header": header,
                "name": self._joints,
                "position": position,
                "velocity": velocity,
                "effort": effort,
            }
        )

    def _tell_feedback(self) -> None:
        goal = self.controller.goal
        if goal is None or goal.key == TOPIC:
            return
        position, velocity, acceleration = self.controller.rows.tolist()
        desired = {"positions": position, "velocities": velocity, "accelerations": acceleration}
        zeros = [0.0] * len(position)
        self._action.feedback(
            goal.key,
            {
                "header": {"stamp": ros_time(SYSTEM.wall_ns())},
                "joint_names": self._joints,
                "desired": desired,
                "actual": {"positions": position, "velocities": velocity},
                "error": {"positions": zeros, "velocities": zeros},
            },
        )


def main() -> int:
    """Run until SIGTERM or Ctrl-C. Returns the exit status: 0, or 2 if the process could not start."""
    chosen = _parser().parse_args()
    try:
        asyncio.run(_serve(chosen, load_settings(chosen.config).of(chosen.robot)))
    except (CobotError, NetworkError, OSError) as exc:
        print(f"cobot simulate ros2_control: {exc}", file=sys.stderr)
        return 2
    return 0


async def _serve(chosen: argparse.Namespace, settings: Settings) -> None:
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    robot = load_robot(settings)
    joints = [chosen.prefix + name for name in robot.limits.names]
    start = np.array(robot.positions[settings.robot.start_position].joints)
    ros = settings.ros
    domain = ros.domain_id if chosen.domain is None else chosen.domain
    name = NodeName("controller_manager", chosen.namespace or "/")
    participant = Participant(
        domain,
        ros.interfaces or None,
        localhost_only=ros.localhost_only,
        peers=ros.peers,
        name=name.full,
        user_data=ENCLAVE,
    )
    node = DdsNode(participant, name, Messages(), None, loop)
    try:
        controllers = SimulatedControllers(
            node,
            joints,
            start,
            chosen.namespace,
            chosen.controller,
            chosen.forward,
            _description(robot, settings, chosen.prefix),
            chosen.gpio,
        )
        controllers.controller.rate = chosen.speed
        if chosen.stream:
            controllers.switch(activate={chosen.forward}, deactivate={chosen.controller})
        where = "this computer only" if ros.localhost_only else "all networks"
        active = chosen.forward if chosen.stream else chosen.controller
        print(
            f"cobot simulate ros2_control: domain {domain}, {where}, namespace {chosen.namespace or '/'}, "
            f"active {active}, joint states {chosen.rate:g} Hz",
            flush=True,
        )
        moving = asyncio.create_task(controllers.run(chosen.rate))
        waiting = asyncio.create_task(ended.wait())
        await asyncio.wait((moving, waiting), return_when=asyncio.FIRST_COMPLETED)
        moving.cancel()
        waiting.cancel()
    finally:
        node.close()
        participant.close()


def _description(robot: RobotDescription, settings: Settings, prefix: str) -> Message:
    """The robot's URDF as a message, with the prefix added to its joint names."""
    made = RobotMessages(robot.model, settings.robot.base_frame, settings.robot.tcp).description()
    if prefix:
        for name in robot.limits.names:
            made["data"] = made["data"].replace(f'<joint name="{name}"', f'<joint name="{prefix}{name}"')
    return made


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="cobot simulate ros2_control", description=__doc__)
    add = parser.add_argument
    add(
        "--config",
        type=Path,
        metavar="FILE",
        help="settings of the robot; by default the iiwa that is part of cobot",
    )
    add("--robot", metavar="NAME", help="name of a robot in `robots`")
    add("--domain", type=_within(int, 0, 232), metavar="ID", help="ROS_DOMAIN_ID; by default ros.domain_id")
    add("--namespace", default="", metavar="NS", help="namespace of topics and controllers, such as /left")
    add(
        "--controller",
        default="joint_trajectory_controller",
        metavar="NAME",
        help="name of the controller for trajectories",
    )
    add(
        "--forward",
        default="forward_position_controller",
        metavar="NAME",
        help="name of the controller for streams",
    )
    add("--prefix", default="", metavar="TEXT", help="prefix of the name of each joint")
    add(
        "--rate",
        type=_within(float, 1, 1000),
        default=250.0,
        metavar="HZ",
        help="joint states per second; default: 250",
    )
    add(
        "--speed",
        type=_within(float, 0, 1),
        default=1.0,
        metavar="SHARE",
        help="value of the speed slider; default: 1",
    )
    add(
        "--gpio",
        action="append",
        type=_interface,
        default=[],
        metavar="GPIO/INTERFACE",
        help="an input or output; may be repeated",
    )
    add(
        "--stream",
        action="store_true",
        help="activate the controller for streams instead of the one for trajectories",
    )
    return parser


def _interface(argument: str) -> str:
    """Check the name of an input or output in an argument."""
    gpio, _, name = argument.rpartition("/")
    if not gpio or not name:
        raise argparse.ArgumentTypeError(
            f"{argument[:80]!r} is not GPIO/INTERFACE, such as tool/digital_out_0"
        )
    return argument


def _within(kind: type[float], least: float, most: float) -> Callable[[str], float]:
    """Create a function that reads a number of this kind from an argument, and checks its range."""

    def read(argument: str) -> float:
        try:
            value = kind(argument)
        except ValueError:
            value = None
        if value is None or not least <= value <= most:
            raise argparse.ArgumentTypeError(f"{argument[:80]!r} is not a number from {least:g} to {most:g}")
        return value

    return read


if __name__ == "__main__":
    sys.exit(main())
