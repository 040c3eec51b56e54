"""Streaming to an arm: context managers that begin a session, and that stop the arm at their end."""

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
"""Timeout for stopping the arm when a session ends, s. A stop takes at most 2.5 s."""
POLL_S = 0.01
State = TypeVar("State")


class Control(ABC, Generic[State]):
    """One session. Create it with a `Robot`. Use it in a `with` block, or call `stop`.

    rtloop stops the arm if no more targets arrive, and if this process ends for any reason.
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
        """The latest state that rtloop has measured. It is at most a few milliseconds old.

        Raises:
            UnavailableError: rtloop does not answer.
        """

    def is_running(self) -> bool:
        """Whether the arm still follows targets."""
        try:
            return not self._ended and int(self._transport.state()["session"]) == self._session
        except UnavailableError:
            return False

    def trigger_estop(self) -> None:
        """Stop the arm and latch an e-stop; see `Robot.clear_fault`. Takes no lock. Callable from any thread.

        Raises:
            MotionStopped: this control has been stopped, so it may no longer stop the arm.
        """
        if self._ended:
            raise MotionStopped("this control has been stopped; POST /stop stops any other motion of the arm")
        self._transport.request_estop()

    def stop(self) -> None:
        """End the session and wait until the arm has stopped. May be called again, and from any thread.

        Raises:
            UnavailableError: rtloop does not answer.
            ExecutionError: the arm does not stop within the timeout.
        """
        with self._turn:
            if self._ended:
                return
            self._ended = True
            self._transport.end_session()
        deadline_s = self._transport.clock.now_s() + REST_S
        while int(self._transport.state()["session"]) == self._session:
            if self._transport.clock.now_s() > deadline_s:
                raise ExecutionError(f"the arm has not stopped within {REST_S:g} s")
            self._transport.clock.sleep(POLL_S / 10)

    def _publish(self, counter: str, **fields: object) -> None:
        """Send these fields of the setpoint to rtloop, and leave the other fields unchanged. If a value is
        invalid, nothing changes.
        """
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
        """Raise an error if the session has ended, because the arm no longer follows targets.

        Raises:
            MotionStopped: the session has ended; the message gives the reason.
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
                f"the session has ended (mode {LoopMode(int(state['mode'])).name}): {text(state['reason'])}"
            )


class JointImpedanceControl(Control[JointState]):
    """Streams joint positions. Each joint yields to forces like a spring."""

    def get_state(self) -> JointState:
        return joint_state(self._transport.state())

    def set_target_joints(
        self,
        positions: Sequence[float],
        velocities: Sequence[float] = (),
        accelerations: Sequence[float] = (),
    ) -> None:
        """Set the joint target that is due one command period from now.

        Args:
            positions: joint positions, rad.
            velocities: velocities at the target, rad/s. Without them, the interpolation sets the velocities.
            accelerations: accelerations, rad/s². They are checked but not used.

        Raises:
            InputError: the number of joints is wrong, or a value is not finite. A first target that is too
                far from the arm is reported once, by the call for a later target.
            MotionStopped: the session has ended; the message gives the reason.
        """
        target = vector(positions, self._dof, name="positions")
        rates = vector(velocities, self._dof, name="velocities") if len(velocities) else 0.0
        if len(accelerations):
            vector(accelerations, self._dof, name="accelerations")
        self._publish("number", joints=target, feed_forward=bool(len(velocities)), joint_velocity=rates)

    def set_chunk(self, times_s: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Set joint targets for future times: an action chunk. A newer chunk replaces the targets that have
        not been executed.

        Args:
            times_s: increasing times on the robot's clock, see `Robot.clock_s`.
            positions: one list of joint positions for each time, rad.

        Raises:
            InputError, MotionStopped: see `set_target_joints`.
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
    """Streams joint torques. They are added to the torques for gravity and motion."""

    def get_state(self) -> JointState:
        return joint_state(self._transport.state())

    def set_target_torques(self, torques: Sequence[float]) -> None:
        """Set the joint torques from now on, N·m. Torques beyond the limits are clamped.

        Raises:
            InputError, MotionStopped: see `JointImpedanceControl.set_target_joints`.
        """
        self._publish("number", joints=vector(torques, self._dof, name="torques"))


class CartesianMotionForceControl(Control[CartesianState]):
    """Streams poses and wrenches of the TCP. The TCP yields to forces like a spring."""

    def get_state(self) -> CartesianState:
        return cartesian_state(self._transport.state())

    def set_target_pose(
        self,
        pose: Sequence[float],
        wrench: Sequence[float] = (),
        velocity: Sequence[float] = (),
        acceleration: Sequence[float] = (),
    ) -> None:
        """Set the TCP target that is due one command period from now. It is ignored during a `move_to_pose`.

        Args:
            pose: position x, y, z, m, and quaternion w, x, y, z, in the base frame.
            wrench: force, N, and torque, N·m, that the TCP exerts along the force-controlled axes, in the
                force frame.
            velocity: velocity at the target, m/s and rad/s, in the base frame. Without it, the interpolation
                sets the velocity.
            acceleration: acceleration, m/s² and rad/s². It is checked but not used.

        Raises:
            InputError: the number of values is wrong, a value is not a finite number, or the quaternion is
                invalid.
            MotionStopped: the session has ended; the message gives the reason.
        """
        force = vector(wrench, 6, name="wrench") if len(wrench) else 0.0
        twist = vector(velocity, 6, name="velocity") if len(velocity) else 0.0
        if len(acceleration):
            vector(acceleration, 6, name="acceleration")
        target = vector(pose, 7, name="pose")
        self._publish("number", pose=target, wrench=force, feed_forward=bool(len(velocity)), twist=twist)

    def move_to_pose(self, pose: Sequence[float], duration_sec: float = 3.0) -> None:
        """Begin a minimum-jerk motion to a pose, and return without waiting. If a motion to the same pose is
        already running, it continues.

        A duration that is too short for the limits of velocity and acceleration is lengthened.

        Raises:
            InputError: the pose is invalid, or the duration is not 0.001 to 600 s.
            MotionStopped: the session has ended; the message gives the reason.
        """
        self._publish("move", move_pose=vector(pose, 7, name="pose"), move_duration_s=duration_sec)

    def move_to_pose_sync(
        self, pose: Sequence[float], duration_sec: float = 3.0, timeout_sec: float = 0.0
    ) -> bool:
        """Call `move_to_pose` and wait until the motion ends.

        Args:
            timeout_sec: timeout in seconds; 0 means no timeout.

        Returns:
            Whether the motion has ended within the timeout.
        """
        self.move_to_pose(pose, duration_sec)
        deadline_s = self._transport.clock.now_s() + (timeout_sec or np.inf)
        while self.is_moving():
            if self._transport.clock.now_s() > deadline_s:
                return False
            self._transport.clock.sleep(POLL_S)
        return True

    def is_moving(self) -> bool:
        """Whether a `move_to_pose` is running.

        Raises:
            MotionStopped: the session has ended; the message gives the reason.
        """
        state = self._transport.state()
        self._require_running(state)
        return bool(state["move_running"]) or int(state["move_seen"]) != int(self._setpoint["move"])

    def cancel_move(self) -> None:
        """End a `move_to_pose`. The arm stops and waits for the next target."""
        with self._turn:
            self._require_running(self._transport.state())
            self._setpoint["cancel"] = self._setpoint["move"]
            self._transport.send_setpoint(self._setpoint)
