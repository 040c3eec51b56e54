"""Streaming to an arm: context managers that begin a session and bring the arm to rest at their end."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import Generic, Self, TypeVar

import numpy as np

from cobot.client.states import CartesianState, JointState, cartesian_state, joint_state
from cobot.client.transport import Transport
from cobot.errors import ExecutionError, MotionStopped, UnavailableError
from cobot.ipc.layout import CHUNK_POINTS, Stream, chunk_dtype, setpoint_dtype, text
from cobot.ipc.session_rules import check_chunk, check_setpoint
from cobot.types import LoopMode, vector

REST_S = 5.0
"""An arm that was told to stop is waited for so long, s: it takes 2.5 s at the most."""
POLL_S = 0.01
State = TypeVar("State")


class Control(ABC, Generic[State]):
    """One session. Make it with a `Robot`; use it in a `with` block, or call `stop`.

    Whatever becomes of this process, rtloop brings the arm to rest: when targets stop coming, when the
    process ends, however it ends.
    """

    def __init__(self, transport: Transport, request: np.ndarray) -> None:
        self._transport = transport
        self._dof = transport.dof
        self._stream = Stream(int(request["stream"]))
        self._turn = threading.Lock()
        self._setpoint = np.zeros((), setpoint_dtype(self._dof))
        self._chunk = np.zeros((), chunk_dtype(self._dof))
        self._ended = False
        self._session = transport.open_session(request)
        self._setpoint["session"] = self._chunk["session"] = self._session

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @abstractmethod
    def get_state(self) -> State:
        """The state as rtloop has measured it last, at most some milliseconds old.

        Raises:
            UnavailableError: rtloop does not answer.
        """

    def is_running(self) -> bool:
        """Whether targets are still followed."""
        try:
            return not self._ended and int(self._transport.state()["session"]) == self._session
        except UnavailableError:
            return False

    def trigger_estop(self) -> None:
        """Bring the arm to rest and latch; see `Robot.clear_fault`. Takes no lock, from any thread.

        Raises:
            MotionStopped: this control has been stopped: the arm is no longer its own to stop.
        """
        if self._ended:
            raise MotionStopped("this control has been stopped; POST /stop stops what else moves the arm")
        self._transport.request_estop()

    def stop(self) -> None:
        """End the session and wait until the arm rests. May be called again, and from any thread.

        Raises:
            UnavailableError: rtloop does not answer.
            ExecutionError: the arm does not come to rest.
        """
        with self._turn:
            if self._ended:
                return
            self._ended = True
            self._transport.end_session()
        deadline_s = self._transport.clock.now_s() + REST_S
        while int(self._transport.state()["session"]) == self._session:
            if self._transport.clock.now_s() > deadline_s:
                raise ExecutionError(f"the arm has not come to rest within {REST_S:g} s")
            self._transport.clock.sleep(POLL_S / 10)

    def _publish(self, counter: str, **fields: object) -> None:
        """Have rtloop take these fields of the setpoint, the others as they are; or change nothing at all."""
        with self._turn:
            wanted = self._setpoint.copy()
            for name, value in fields.items():
                wanted[name] = value
            wanted[counter] += 1
            check_setpoint(wanted, self._stream)
            self._require_running(self._transport.state())
            self._transport.send_setpoint(wanted)
            self._setpoint = wanted

    def _require_running(self, state: np.ndarray) -> None:
        """Nobody shall go on sending targets that no arm follows.

        Raises:
            MotionStopped: the session has ended, with the reason.
        """
        if self._ended:
            raise MotionStopped("this control has been stopped")
        if int(state["session"]) != self._session or LoopMode(int(state["mode"])) in (
            LoopMode.HOLD,
            LoopMode.STOPPING,
            LoopMode.ESTOP,
            LoopMode.FAULT,
        ):
            raise MotionStopped(
                f"the session has ended, mode {LoopMode(int(state['mode'])).name}: {text(state['reason'])}"
            )


class JointImpedanceControl(Control[JointState]):
    """Streams joint positions, around which the joints give way like springs."""

    def get_state(self) -> JointState:
        return joint_state(self._transport.state())

    def set_target_joints(
        self,
        positions: Sequence[float],
        velocities: Sequence[float] = (),
        accelerations: Sequence[float] = (),
    ) -> None:
        """Where the joints shall be, one command period from now.

        Args:
            positions: rad.
            velocities: at the target, rad/s; without them the interpolation makes its own.
            accelerations: rad/s²; checked, and of no further use.

        Raises:
            InputError: another number of joints, a value that is not finite, or, once, from the second target
                on: the first target was too far from the arm to be followed.
            MotionStopped: the session has ended, with the reason.
        """
        target = vector(positions, self._dof, name="positions")
        rates = vector(velocities, self._dof, name="velocities") if len(velocities) else 0.0
        if len(accelerations):
            vector(accelerations, self._dof, name="accelerations")
        self._publish("number", joints=target, feed_forward=bool(len(velocities)), joint_velocity=rates)

    def set_chunk(self, times_s: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Where the joints shall be at times to come: an action chunk. A newer one replaces what lies ahead.

        Args:
            times_s: on the robot's clock, see `Robot.clock_s`, increasing.
            positions: rad, one list for each time.

        Raises:
            InputError, MotionStopped: as `set_target_joints`.
        """
        count = len(positions)
        with self._turn:
            chunk = self._chunk.copy()
            chunk["number"] += 1
            chunk["count"] = count
            if 1 <= count <= CHUNK_POINTS:
                chunk["times_s"][:count] = vector(times_s, count, name="times_s")
                for index, point in enumerate(positions):
                    row = vector(point, self._dof, name=f"positions[{index}]")
                    chunk["points"][index, : self._dof] = row
            check_chunk(chunk, self._stream)
            self._require_running(self._transport.state())
            self._chunk = chunk
            self._transport.send_chunk(chunk)


class JointTorqueControl(Control[JointState]):
    """Streams joint torques, on top of what gravity and motion take."""

    def get_state(self) -> JointState:
        return joint_state(self._transport.state())

    def set_target_torques(self, torques: Sequence[float]) -> None:
        """The torques from now on, N·m; those beyond the limits count as the limits.

        Raises:
            InputError, MotionStopped: as `JointImpedanceControl.set_target_joints`.
        """
        self._publish("number", joints=vector(torques, self._dof, name="torques"))


class CartesianMotionForceControl(Control[CartesianState]):
    """Streams poses and wrenches of the TCP, around which it gives way like a spring."""

    def get_state(self) -> CartesianState:
        return cartesian_state(self._transport.state())

    def set_target_pose(
        self,
        pose: Sequence[float],
        wrench: Sequence[float] = (),
        velocity: Sequence[float] = (),
        acceleration: Sequence[float] = (),
    ) -> None:
        """Where the TCP shall be, one command period from now; ignored while a `move_to_pose` is under way.

        Args:
            pose: x, y, z in m and w, x, y, z, in the base frame.
            wrench: what the TCP shall exert along the axes with force control, in the force frame: N, N·m.
            velocity: at the target: m/s, rad/s, in the base frame; without it the interpolation makes one.
            acceleration: m/s², rad/s²; checked, and of no further use.

        Raises:
            InputError: another number of numbers, one that is none, or no quaternion.
            MotionStopped: the session has ended, with the reason.
        """
        force = vector(wrench, 6, name="wrench") if len(wrench) else 0.0
        twist = vector(velocity, 6, name="velocity") if len(velocity) else 0.0
        if len(acceleration):
            vector(acceleration, 6, name="acceleration")
        target = vector(pose, 7, name="pose")
        self._publish("number", pose=target, wrench=force, feed_forward=bool(len(velocity)), twist=twist)

    def move_to_pose(self, pose: Sequence[float], duration_sec: float = 3.0) -> None:
        """Begin a minimum-jerk motion to a pose and return; one to the same pose that runs goes on.

        Within the limits of velocity and acceleration: what is too short for them takes longer.

        Raises:
            InputError: no pose, or no duration from 0.001 to 600 s.
            MotionStopped: the session has ended, with the reason.
        """
        self._publish("move", move_pose=vector(pose, 7, name="pose"), move_duration_s=duration_sec)

    def move_to_pose_sync(
        self, pose: Sequence[float], duration_sec: float = 3.0, timeout_sec: float = 0.0
    ) -> bool:
        """`move_to_pose`, and wait for its end.

        Args:
            timeout_sec: 0 for none.

        Returns:
            Whether it has ended within the timeout.
        """
        self.move_to_pose(pose, duration_sec)
        deadline_s = self._transport.clock.now_s() + (timeout_sec or np.inf)
        while self.is_moving():
            if self._transport.clock.now_s() > deadline_s:
                return False
            self._transport.clock.sleep(POLL_S)
        return True

    def is_moving(self) -> bool:
        """Whether a `move_to_pose` is under way.

        Raises:
            MotionStopped: the session has ended, with the reason.
        """
        state = self._transport.state()
        self._require_running(state)
        return bool(state["move_running"]) or int(state["move_seen"]) != int(self._setpoint["move"])

    def cancel_move(self) -> None:
        """End a `move_to_pose`: the arm comes to rest where it is, and waits for the next target."""
        with self._turn:
            self._require_running(self._transport.state())
            self._setpoint["cancel"] = self._setpoint["move"]
            self._transport.send_setpoint(self._setpoint)
