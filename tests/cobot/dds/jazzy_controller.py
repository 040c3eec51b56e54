"""The controllers of an arm with real ROS 2 (rclpy), as ros2_control's documentation describes them: an
action server of FollowJointTrajectory, joint states with 250 Hz, list_controllers, a forward command
controller, a GPIO controller, a speed slider. It does as standard input says.

Usage: jazzy_controller.py JOINT... . Each line of standard input is one of

    good            as it should be
    reject abort never late silent degrees swapped nan frozen missing slow
    ahead           its clock is five hours ahead; otherwise it is that of 1970
    inactive        the controller is deactivated, which ends its goal
    replace         another goal replaces the current one
    speed SHARE     of the speed slider
    forward         the forward command controller is active instead
    refuse_io       the services of the drivers set no output
    silent_io       does not answer a request for an output until the next mode
    ur_io           tells its outputs, as JSON
    driver_io       tells the signals of the services of other drivers, as JSON
    gpio            tells the values of the GPIO controller, as JSON
    seen            tells the number of points, the first and last time and the tolerances of the newest goal,
                    and where the arm is, as JSON
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from typing import Any

import rclpy
from control_msgs.action import FollowJointTrajectory
from control_msgs.msg import DynamicInterfaceGroupValues, InterfaceValue, JointTrajectoryControllerState
from controller_manager_msgs.msg import ControllerState
from controller_manager_msgs.srv import ListControllers
from dsr_msgs2.srv import GetCtrlBoxDigitalInput, GetCtrlBoxDigitalOutput, SetCtrlBoxDigitalOutput
from motoros2_interfaces.srv import ReadSingleIO, WriteSingleIO
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, Float64MultiArray, String
from ur_msgs.msg import Analog, Digital, IOStates
from ur_msgs.srv import SetIO
from xarm_msgs.srv import GetDigitalIO, SetDigitalIO

PERIOD_S, FEEDBACK_S, SLIDER_S, LATE_S = 0.004, 0.05, 0.1, 4.0
AHEAD_S = int(time.time()) + 18_000
SLOW_S, STATE_S = 0.5, 0.02
"""Time between two joint states in the mode `slow`, and between two states of the controller."""
JTC, FORWARD = "joint_trajectory_controller", "forward_position_controller"
GPIO, UR_IO = "gpio_command_controller", "io_and_status_controller"


def at(point: Any, order: list[int], rows: int) -> list[list[float]]:
    """Positions, velocities, accelerations of a point in the joints' order, as many as it has."""
    stated = [point.positions, point.velocities, point.accelerations][:rows]
    return [[row[place] for place in order] for row in stated if len(row)]


def quintic(s: float, d: float, p: list[list[float]], q: list[list[float]], j: int) -> tuple[float, float]:
    """Position and velocity of joint j at the share s of d seconds, linear without velocities."""
    if len(p) < 3 or len(q) < 3:
        return p[0][j] + s * (q[0][j] - p[0][j]), (q[0][j] - p[0][j]) / d
    v0, v1, a0, a1 = p[1][j] * d, q[1][j] * d, p[2][j] * d * d, q[2][j] * d * d
    c0, c1, c2 = p[0][j], v0, a0 / 2
    h = q[0][j] - c0 - c1 - c2
    g, k = v1 - c1 - 2 * c2, a1 - 2 * c2
    c3, c4, c5 = 10 * h - 4 * g + k / 2, -15 * h + 7 * g - k, 6 * h - 3 * g + k / 2
    position = c0 + s * (c1 + s * (c2 + s * (c3 + s * (c4 + s * c5))))
    velocity = c1 + s * (2 * c2 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))
    return position, velocity / d


LINK = """<link name="{name}"><inertial><mass value="2"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="0 0 0.1"/><geometry><cylinder radius="0.03" length="0.12"/></geometry></collision>
</link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{before}"/><child link="{link}"/>
<origin xyz="0 0 0.2"/><axis xyz="{axis}"/>
<limit lower="-2.5" upper="2.5" velocity="2" effort="100"/></joint>"""


def urdf(joints: list[str]) -> str:
    """A robot_description: links one above the other."""
    parts, before = [LINK.format(name="base_link")], "base_link"
    for number, name in enumerate(joints):
        link, axis = f"link_{number}", "0 1 0" if number % 2 else "0 0 1"
        parts += [LINK.format(name=link), JOINT.format(name=name, before=before, link=link, axis=axis)]
        before = link
    return f'<robot name="arm">{"".join(parts)}</robot>'


class Controllers(Node):
    """The node."""

    def __init__(self, joints: list[str], namespace: str) -> None:
        super().__init__("controller_manager", namespace=namespace)
        self.joints, self.mode, self.speed = joints, "good", 1.0
        self.lock = threading.Lock()  # of `goal`, `position` and `velocity`
        self.position = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0][: len(joints)]
        self.velocity = [0.0] * len(joints)
        self.active, self.goal, self.newest = JTC, None, None
        self.begun: Any = None
        self.accepted_s = 0.0
        self.tolerances: dict[str, Any] = {}
        self.gpio = {"tool": {"vacuum": 0.0, "valve": 0.0, "pressure": 0.75}, "cabinet": {"door": 1.0}}
        self.stated_s = 0.0
        self.told_s, self.frozen, self.commands = 0.0, list(self.position), 0
        group, alone = ReentrantCallbackGroup(), MutuallyExclusiveCallbackGroup()
        self.states = self.create_publisher(JointState, "joint_states", QoSProfile(depth=10))
        self.slider = self.create_publisher(Float64, "speed_scaling_state_broadcaster/speed_scaling", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.description = self.create_publisher(String, "robot_description", latched)
        self.description.publish(String(data=urdf(joints)))
        self.create_subscription(Float64MultiArray, f"{FORWARD}/commands", self.command, 10)
        self.gpio_states = self.create_publisher(DynamicInterfaceGroupValues, f"{GPIO}/gpio_states", 10)
        self.create_subscription(DynamicInterfaceGroupValues, f"{GPIO}/commands", self.command_gpio, 10)
        self.controller_states = self.create_publisher(
            JointTrajectoryControllerState, f"{JTC}/controller_state", 1
        )
        self.create_timer(STATE_S, self.tell_state, callback_group=group)
        self.ur_outputs: dict[int, bool] = dict.fromkeys(range(18), False)
        self.ur_states = self.create_publisher(IOStates, f"{UR_IO}/io_states", 10)
        self.create_service(SetIO, f"{UR_IO}/set_io", self.set_io, callback_group=group)
        self.signals = {
            "motoros2": {"20": 1, "10010": 0},
            "xarm": {"in 8": 1, "out 3": 0},
            "doosan": {"in 2": 1, "out 1": 0},
        }
        for type_, name, answer in (
            (ReadSingleIO, "read_single_io", self.read_motoros2),
            (WriteSingleIO, "write_single_io", self.write_motoros2),
            (GetDigitalIO, "xarm/get_cgpio_digital", self.read_xarm),
            (SetDigitalIO, "xarm/set_cgpio_digital", self.write_xarm),
            (GetCtrlBoxDigitalInput, "io/get_ctrl_box_digital_input", self.read_doosan),
            (GetCtrlBoxDigitalOutput, "io/get_ctrl_box_digital_output", self.read_doosan),
            (SetCtrlBoxDigitalOutput, "io/set_ctrl_box_digital_output", self.write_doosan),
        ):
            self.create_service(type_, name, answer, callback_group=group)
        self.create_service(
            ListControllers, "controller_manager/list_controllers", self.list, callback_group=group
        )
        self.server = ActionServer(
            self,
            FollowJointTrajectory,
            f"{JTC}/follow_joint_trajectory",
            self.execute,
            callback_group=group,
            goal_callback=self.judge,
            handle_accepted_callback=self.accept,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )
        self.clock_s = time.monotonic()
        self.create_timer(PERIOD_S, self.step, callback_group=alone)
        self.create_timer(SLIDER_S, self.slide, callback_group=group)

    # The controller

    def judge(self, request: Any) -> GoalResponse:
        self.newest = request.trajectory
        self.tolerances = {
            "path": {each.name: each.position for each in request.path_tolerance},
            "goal": {each.name: each.position for each in request.goal_tolerance},
            "time_s": request.goal_time_tolerance.sec + 1e-9 * request.goal_time_tolerance.nanosec,
        }
        return GoalResponse.ACCEPT if self.reason(request.trajectory) == "" else GoalResponse.REJECT

    def reason(self, trajectory: Any) -> str:
        if self.mode == "reject" or self.active != JTC:
            return "not active"
        if not trajectory.points:
            return "empty"
        if sorted(trajectory.joint_names) != sorted(self.joints):
            return "joints"
        if (trajectory.header.stamp.sec, trajectory.header.stamp.nanosec) != (0, 0):
            return "the double takes goals for now only"
        before = -1.0
        for point in trajectory.points:
            now = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
            if now <= before or len(point.positions) != len(self.joints):
                return "times"
            before = now
        return "velocity" if any(abs(v) > 1e-6 for v in trajectory.points[-1].velocities) else ""

    def accept(self, handle: Any) -> None:
        trajectory = handle.request.trajectory
        order = [trajectory.joint_names.index(name) for name in self.joints]
        times, points = [0.0], [[list(self.position), list(self.velocity), [0.0] * len(self.joints)]]
        for point in trajectory.points:
            now = point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec
            if now <= 0.0:
                times, points = [], []
            times.append(now)
            points.append(at(point, order, 3))
        self.goal, self.begun, self.accepted_s = handle, [0.0, times, points], time.monotonic()
        handle.execute()

    def execute(self, handle: Any) -> Any:
        result = FollowJointTrajectory.Result()
        while True:
            time.sleep(PERIOD_S)
            if self.mode == "abort" and self.goal is handle and self.begun[0] > 0.3:
                self.hold()
                result.error_code, result.error_string = -4, "Aborted due to path tolerance violation"
                handle.abort()
                return result
            if self.goal is not handle:
                result.error_code = -1
                result.error_string = "Current goal cancelled due to new incoming action."
                handle.abort()
                return result
            if handle.is_cancel_requested:
                self.hold()
                handle.canceled()
                return result
            if self.begun[0] >= self.begun[1][-1] and self.mode != "never":
                if self.mode == "late":
                    time.sleep(LATE_S)
                self.hold()
                result.error_string = "Goal successfully reached!"
                handle.succeed()
                return result
            if time.monotonic() - self.told_s > FEEDBACK_S:
                self.told_s = time.monotonic()
                feedback = FollowJointTrajectory.Feedback(joint_names=self.joints)
                for each in (feedback.desired, feedback.actual):
                    each.positions, each.velocities = list(self.position), list(self.velocity)
                handle.publish_feedback(feedback)

    def hold(self) -> None:
        """End the goal. A step that another thread computes meanwhile has no effect."""
        with self.lock:
            self.goal, self.velocity = None, [0.0] * len(self.joints)

    def step(self) -> None:
        now = time.monotonic()
        passed, self.clock_s = now - self.clock_s, now
        goal = self.goal
        if goal is not None and not goal.is_cancel_requested:
            run, times, points = self.begun
            run = self.begun[0] = min(run + self.speed * passed, times[-1])
            place = max(1, next((n for n, each in enumerate(times) if each >= run), len(times) - 1))
            if len(times) > 1:
                start, span = times[place - 1], times[place] - times[place - 1]
                moved = [
                    quintic((run - start) / span, span, points[place - 1], points[place], j)
                    for j in range(len(self.joints))
                ]
                with self.lock:
                    if self.goal is goal:
                        self.position = [each[0] for each in moved]
                        self.velocity = [self.speed * each[1] for each in moved]
            else:
                self.position = list(points[0][0])
        self.tell(now)

    # Topics and services

    def tell(self, now: float) -> None:
        mode = self.mode
        if mode == "silent" or (mode == "slow" and now - self.stated_s < SLOW_S):
            return
        self.stated_s = now
        names, position, velocity = list(self.joints), list(self.position), list(self.velocity)
        if mode == "frozen":
            position, velocity = list(self.frozen), [0.0] * len(names)
        else:
            self.frozen = list(position)
        if mode == "degrees":
            position = [math.degrees(each) for each in position]
        elif mode == "swapped":
            names[1], names[3] = names[3], names[1]
        elif mode == "nan":
            position[2] = math.nan
        elif mode == "missing":
            names, position, velocity = names[:-1], position[:-1], velocity[:-1]
        order = list(reversed(range(len(names))))
        message = JointState(
            name=["finger", *(names[n] for n in order)],
            position=[0.04, *(position[n] for n in order)],
            velocity=[0.0, *(velocity[n] for n in order)],
        )
        message.header.stamp.sec = AHEAD_S if self.mode == "ahead" else 12  # nobody may compare clocks
        self.states.publish(message)

    def slide(self) -> None:
        self.slider.publish(Float64(data=100.0 * self.speed))
        values = [
            InterfaceValue(interface_names=list(each), values=list(each.values()))
            for each in self.gpio.values()
        ]
        self.tell_ur()
        self.gpio_states.publish(
            DynamicInterfaceGroupValues(interface_groups=list(self.gpio), interface_values=values)
        )

    def tell_state(self) -> None:
        """Where the controller itself has the joints, whatever the joint states say."""
        if self.active != JTC:
            return
        message = JointTrajectoryControllerState(joint_names=self.joints)
        for each in (message.reference, message.feedback):
            each.positions, each.velocities = list(self.position), list(self.velocity)
        self.controller_states.publish(message)

    def tell_ur(self) -> None:
        self.ur_states.publish(
            IOStates(
                digital_in_states=[Digital(pin=pin, state=pin == 3) for pin in range(18)],
                digital_out_states=[Digital(pin=pin, state=on) for pin, on in self.ur_outputs.items()],
                analog_in_states=[Analog(pin=0, domain=Analog.VOLTAGE, state=2.5)],
            )
        )

    def set_io(self, request: Any, response: Any) -> Any:
        """As the driver's page and the definition of the service say."""
        while self.mode == "silent_io":
            time.sleep(0.01)
        response.success = self.mode != "refuse_io" and request.fun == 1
        if response.success:
            self.ur_outputs[request.pin] = request.state != 0.0
        return response

    # Services of other drivers, as their published definitions and code say

    def read_motoros2(self, request: Any, response: Any) -> Any:
        value = self.signals["motoros2"].get(str(request.address))
        response.success, response.value = value is not None, value or 0
        if value is None:
            response.result_code, response.message = 1001, "Address cannot be read from"
        return response

    def write_motoros2(self, request: Any, response: Any) -> Any:
        response.success = self._write("motoros2", str(request.address), request.value)
        response.result_code = 0 if response.success else 1005
        return response

    def read_xarm(self, request: Any, response: Any) -> Any:
        response.digitals = [self.signals["xarm"].get(f"in {number}", 0) for number in range(16)]
        return response

    def write_xarm(self, request: Any, response: Any) -> Any:
        is_now = request.delay_sec == 0.0 and not request.xyz
        done = is_now and self._write("xarm", f"out {request.ionum}", request.value)
        response.ret = 0 if done else 9
        return response

    def read_doosan(self, request: Any, response: Any) -> Any:
        side = "in" if isinstance(response, GetCtrlBoxDigitalInput.Response) else "out"
        response.success = 1 <= request.index <= 16
        response.value = self.signals["doosan"].get(f"{side} {request.index}", 0)
        return response

    def write_doosan(self, request: Any, response: Any) -> Any:
        response.success = self._write("doosan", f"out {request.index}", request.value)
        return response

    def _write(self, driver: str, signal: str, value: int) -> bool:
        while self.mode == "silent_io":
            time.sleep(0.01)
        done = self.mode != "refuse_io" and signal in self.signals[driver] and value in (0, 1)
        if done:
            self.signals[driver][signal] = value
        return done

    def command_gpio(self, message: Any) -> None:
        for group, each in zip(message.interface_groups, message.interface_values):  # noqa: B905
            self.gpio[group] |= dict(zip(each.interface_names, each.values))  # noqa: B905

    def command(self, message: Any) -> None:
        self.commands += 1
        if self.active == FORWARD and len(message.data) == len(self.joints):
            self.position = list(message.data)

    def list(self, request: Any, response: Any) -> Any:
        kinds = {
            JTC: "joint_trajectory_controller/JointTrajectoryController",
            FORWARD: "forward_command_controller/ForwardCommandController",
        }
        for name, kind in kinds.items():
            interfaces = [f"{joint}/position" for joint in self.joints]
            response.controller.append(
                ControllerState(
                    name=name,
                    type=kind,
                    state="active" if self.active == name else "inactive",
                    update_rate=250,
                    claimed_interfaces=interfaces if self.active == name else [],
                    required_command_interfaces=interfaces,
                )
            )
        return response

    def obey(self) -> None:
        for line in sys.stdin:
            word, *rest = line.split()
            answer = "done"
            if word == "speed":
                self.speed = float(rest[0])
            elif word == "ur_io":
                answer = json.dumps([pin for pin, on in self.ur_outputs.items() if on])
            elif word == "driver_io":
                answer = json.dumps(self.signals)
            elif word == "gpio":
                answer = json.dumps(self.gpio)
            elif word == "seen":
                answer = json.dumps(self.seen())
            elif word in ("inactive", "forward"):
                self.active = "" if word == "inactive" else FORWARD
                self.hold()
            elif word == "replace":
                self.hold()
            else:
                self.mode = word
                if word == "good":
                    self.active = JTC
            print(answer, flush=True)

    def seen(self) -> dict[str, Any]:
        points = [] if self.newest is None else self.newest.points
        times = [each.time_from_start.sec + 1e-9 * each.time_from_start.nanosec for each in points]
        return {
            "points": len(points),
            "times": [times[0], times[-1]] if times else [],
            "joints": [] if self.newest is None else list(self.newest.joint_names),
            "position": self.position,
            "accepted_s": self.accepted_s,
            "commands": self.commands,
            "tolerances": self.tolerances,
        }


def main() -> None:
    rclpy.init()
    namespace, *joints = sys.argv[1:]
    controllers = Controllers(joints, namespace)
    threading.Thread(target=controllers.obey, daemon=True).start()
    executor = MultiThreadedExecutor(6)
    executor.add_node(controllers)
    print("ready", flush=True)
    executor.spin()


if __name__ == "__main__":
    main()
