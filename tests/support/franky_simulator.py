"""franky-sim through its own interface, with some differences: `python franky_simulator.py ADDRESS`.

Its wrists: the dampers that it ships with, 200 N·m s/rad at 1 kHz, step a wrist of 0.076 kg m² beyond its
rest by more than it was away (200 · 0.001 / 0.076 = 2.6, stable is less than 2), so that a joint which has
moved swings between its torque limits for ever, at 12 · 0.001 / 0.076 / 2 = 0.08 rad/s. With `KV` it rests.

Its time: a state is followed by the next one only when it has been answered, as long as somebody controls the
arm and PATIENCE_S is not over. So a busy computer costs no packet, and the arm is slow in place of wild.

Its faults: it has none. A line of JSON on standard input, {"fault": NAME}, has one of
`rtloop.contract.FAULTS` last, {"fault": ""} ends it; each is answered by a line of how the arm is.
"""

from __future__ import annotations

import fcntl
import json
import queue
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any

import franky_sim
import numpy as np
from franky_sim.franka_robot_protocol import (
    AutomaticErrorRecoveryCommand,
    AutomaticErrorRecoveryStatus,
    BaseCommand,
    MoveStatus,
    RobotCommand,
    RobotMode,
)
from franky_sim.franka_robot_server import ControlMode
from franky_sim.mujoco_simulator import MUJOCO_DEFAULT_KP, FrankaMujocoRobot, MujocoSimulator

from rtloop.backends.simulators.times import DurationCounter

KV = (300.0, 300.0, 150.0, 150.0, 40.0, 40.0, 40.0)
PATIENCE_S = 0.5
"""libfranka gives up a robot that has been silent for a second."""
PERIOD_S = 0.001
PUBLISHED = np.array(
    [
        [2.175] * 4 + [2.61] * 3,
        [10.0, 7.5, 10.0, 10.0, 10.0, 10.0, 10.0],
        [5000.0, 3750.0, 5000.0, 5000.0, 5000.0, 5000.0, 5000.0],
    ]
)
"""The least of what Franka Robotics publishes for the FR3 and the Panda: rad/s, rad/s², rad/s³."""
LOST = 20
"""With losses one state in so many is not sent."""
SIOCGSTAMPNS = 0x8907
"""When the packet that was read last has come, CLOCK_REALTIME; Linux notes it from the first question on."""
_TIMESPEC = struct.Struct("qq")
POSITION = ControlMode.POSITION
JOINT_REFLEX = 6
"""Among libfranka's errors."""


class Answers:
    """Whether the last state has been answered, how late, and how near commands come to what is published.

    Attributes:
        sent_ns: when the last state was sent, CLOCK_REALTIME.
        ages: from each state to the arrival of the command that answers it.
        worst: shares of velocity, acceleration and jerk of commanded positions.
    """

    def __init__(self, robot: FrankaMujocoRobot) -> None:
        self.seen = False
        self.sent_ns = 0
        self.ages = DurationCounter()
        self.worst = np.zeros(3)
        self._commanded = np.zeros(7)
        self._rows: list[np.ndarray] = []
        for name in ("torque_control", "joint_position_control"):  # the second one calls the first
            setattr(robot, name, self._noting(getattr(robot, name), name == "joint_position_control"))

    def _noting(self, control: Callable[..., None], positions: bool) -> Callable[..., None]:
        def noted(target: Sequence[float], has_new_command: bool = True) -> None:
            control(target, has_new_command)
            self.seen = has_new_command
            if positions:
                self._commanded = np.array(target)

        return noted

    def judge(self, connection: socket.socket) -> None:
        """What was commanded in this period, from rest on."""
        arrived = _TIMESPEC.unpack(fcntl.ioctl(connection, SIOCGSTAMPNS, bytes(_TIMESPEC.size)))
        self.ages.add(arrived[0] + 1e-9 * (arrived[1] - self.sent_ns))
        self._rows = [*(self._rows or [self._commanded] * 3)[-3:], self._commanded]
        for order in (1, 2, 3):
            rates = np.abs(np.diff(self._rows[-1 - order :], order, axis=0)) / PERIOD_S**order
            self.worst[order - 1] = max(self.worst[order - 1], (rates / PUBLISHED[order - 1]).max())

    def extrapolate(self) -> None:
        """Nothing has come: the robot goes on at constant acceleration."""
        if len(self._rows) >= 3:
            before, last, here = self._rows[-3:]
            self._rows = [last, here, 3.0 * here - 3.0 * last + before]

    def begin(self) -> None:
        """What comes begins at rest."""
        self._rows.clear()


class Faults:
    """What happens to a robot that franky-sim serves.

    Attributes:
        lost: whether its last state was.
    """

    def __init__(self, arm: Any, answers: Answers) -> None:
        self._arm, self._answers = arm, answers
        self._fault, self._reflex = "", False
        self._last = b""
        self._sent = 0
        self.lost = False
        self._send, self._process, self._bytes = arm.send_state, arm.process_commands, arm._get_state_bytes
        arm.send_state, arm.process_commands = self._send_state, self._process_commands
        arm._get_state_bytes = self._state_bytes
        AutomaticErrorRecoveryCommand.handle = lambda command, _: self._recover(command)

    def begin(self, fault: str) -> None:
        ended, self._fault = self._fault, fault
        if fault == "disconnect":
            self._arm.cleanup()
            self._arm.reset_state()
        elif ended == "disconnect":
            self._arm.init()
        if fault == "e_stop":
            self._abort(MoveStatus.kEmergencyAborted)
        elif fault == "protective_stop":
            self._reflex = True
            self._abort(MoveStatus.kReflexAborted)

    def _abort(self, status: MoveStatus) -> None:
        arm, motion = self._arm, self._arm.current_motion_id
        arm.stop_motion(send_preemption_signal=False)
        if motion:
            BaseCommand.send_response(arm._tcp_socket, RobotCommand.kMove, motion, status)
            arm.reset_current_motion_id()

    def _recover(self, command: AutomaticErrorRecoveryCommand) -> None:
        if self._fault == "protective_stop":
            command.reply(AutomaticErrorRecoveryStatus.kManualErrorRecoveryRequiredRejected)
            return
        self._reflex = False
        command.reply(AutomaticErrorRecoveryStatus.kSuccess)

    def _process_commands(self) -> None:
        if self._fault == "disconnect":
            self._arm._post_process_commands()  # it holds itself
        else:
            self._process()

    def _send_state(self) -> None:
        self._sent += 1
        self._answers.sent_ns = time.time_ns()
        if self._fault == "disconnect":
            return
        self.lost = self._fault == "loss" and self._sent % LOST == 0
        if self.lost:
            self._arm._FrankaServer__message_id += 1  # the robot's time goes on
        else:
            self._send()

    def _state_bytes(self) -> bytes:
        if self._fault == "frozen" and self._last:
            return self._last
        state = self._arm.robot_state
        if self._fault == "nan":
            state = state.replace(q=(float("nan"), *state.q[1:]))
        if self._fault == "e_stop":
            state = state.replace(robot_mode=RobotMode.kUserStopped)
        elif self._reflex:
            errors = tuple(number == JOINT_REFLEX for number in range(41))
            state = state.replace(robot_mode=RobotMode.kReflex, errors=errors, reflex_reason=errors)
        self._last = state.pack_state()
        return bytes(self._last)


def main(address: str) -> None:
    asked: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
    with MujocoSimulator() as simulator:
        robot = simulator.add_robot(kp=MUJOCO_DEFAULT_KP, kv=KV)
        answers = Answers(robot)
        with franky_sim.SimulationServer(simulator, [address]) as server:
            (arm,) = server.robot_servers
            faults = Faults(arm, answers)
            answered_motion = 0

            def wait(_: MujocoSimulator) -> None:
                """A motion is answered from its first command on."""
                nonlocal answered_motion
                until_s = time.monotonic() + PATIENCE_S
                while arm.current_motion_id == answered_motion and not (answers.seen or faults.lost):
                    if time.monotonic() > until_s:
                        break
                    time.sleep(1e-4)
                    arm.process_commands()
                if arm.current_motion_id == 0 or arm._FrankaRobotServer__control_mode != POSITION:
                    answers.begin()
                elif answers.seen:
                    answers.judge(arm._FrankaServer__udp_socket)
                else:
                    answers.extrapolate()
                answered_motion = arm.current_motion_id if answers.seen or faults.lost else 0
                if not asked.empty():
                    faults.begin(asked.get()["fault"])
                    told = {"q": robot.inner_state.q, "worst": answers.worst.tolist()}
                    told |= {"answers": answers.ages.count, "age_s": answers.ages.shares()}
                    print(json.dumps(told), flush=True)

            simulator.register_pre_step_callback(wait)
            threading.Thread(
                target=lambda: [asked.put(json.loads(line)) for line in sys.stdin], daemon=True
            ).start()
            print("ready", flush=True)
            server.run_forever()


if __name__ == "__main__":
    main(sys.argv[1])
