"""Streaming to an arm: context managers that begin a session and bring the arm to rest at their end."""

from __future__ import annotations

import threading
import time
from collections.abc import Sequence
from types import TracebackType
from typing import Generic, Self, TypeVar

import numpy as np

from cobot.errors import ExecutionError, InputError, MotionStopped, UnavailableError
from cobot.layout import CHUNK_POINTS, chunk_dtype, setpoint_dtype
from cobot.realtime.states import CartesianState, JointState, cartesian_state, joint_state
from cobot.realtime.transport import Transport
from cobot.shm import text
from cobot.types import Array, Mode, Pose, vector

REST_S = 5.0
"""How long an arm is waited for that was told to stop: it takes 2.5 s at the most."""
POLL_S = 0.01
State = TypeVar("State")


class Control(Generic[State]):
    """One session. Make it with a `Robot`; use it in a `with` block, or call `stop`.

    Whatever becomes of this process, rtloop brings the arm to rest: when targets stop coming, when the
    process ends, however it ends.
    """

    def __init__(self, transport: Transport, wish: np.ndarray) -> None:
        self._transport = transport
        self._dof = transport.dof
        self._turn = threading.Lock()
        self._setpoint = np.zeros((), setpoint_dtype(self._dof))
        self._chunk = np.zeros((), chunk_dtype(self._dof))
        self._ended = False
        self._session = transport.open_session(wish)
        self._setpoint["session"] = self._chunk["session"] = self._session

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.stop()

    def get_state(self) -> State:
        """The state as rtloop has measured it last, at most some milliseconds old.

        Raises:
            UnavailableError: rtloop does not answer.
        """
        raise NotImplementedError

    def is_running(self) -> bool:
        """Whether targets are still followed."""
        try:
            return not self._ended and int(self._transport.state()["session"]) == self._session
        except UnavailableError:
            return False

    def trigger_estop(self) -> None:
        """Bring the arm to rest and latch; see `Robot.clear_fault`. Takes no lock, from any thread."""
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
        deadline_s = time.monotonic() + REST_S
        while int(self._transport.state()["session"]) == self._session:
            if time.monotonic() > deadline_s:
                raise ExecutionError(f"the arm has not come to rest within {REST_S:g} s")
            time.sleep(POLL_S / 10)

    def _publish(self) -> None:
        self._require_running(self._transport.state())
        self._transport.send_setpoint(self._setpoint)

    def _require_running(self, state: np.ndarray) -> None:
        """Nobody shall go on sending targets that no arm follows.

        Raises:
            MotionStopped: the session has ended, with the reason.
        """
        if self._ended:
            raise MotionStopped("this control has been stopped")
        if int(state["session"]) != self._session or Mode(int(state["mode"])) in (
            Mode.HOLD,
            Mode.STOPPING,
            Mode.ESTOP,
            Mode.FAULT,
        ):
            raise MotionStopped(
                f"the session has ended, mode {Mode(int(state['mode'])).name}: {text(state['reason'])}"
            )

    def _send_chunk(self, times_s: Sequence[float], points: Sequence[Sequence[float]], size: int) -> None:
        count = len(points)
        if not 1 <= count <= CHUNK_POINTS:
            raise InputError(f"a chunk has from 1 to {CHUNK_POINTS} points, got {count}")
        times = vector(times_s, count, name="times_s")
        if not (np.diff(times) > 0.0).all():
            raise InputError(f"times_s must increase, got {times.tolist()}")
        rows = np.stack([vector(point, size, name=f"points[{i}]") for i, point in enumerate(points)])
        with self._turn:
            state = self._transport.state()
            self._require_running(state)
            chunk = self._chunk
            chunk["number"] += 1
            chunk["count"] = count
            chunk["times_s"][:count] = times
            chunk["points"][:count, :size] = rows
            self._transport.send_chunk(chunk)


class JointControl(Control[JointState]):
    """Streams joint positions."""

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
            InputError: another number of joints, or a number that is none.
            MotionStopped: the session has ended, with the reason.
        """
        target = vector(positions, self._dof, name="positions")
        rates = vector(velocities, self._dof, name="velocities") if len(velocities) else None
        if len(accelerations):
            vector(accelerations, self._dof, name="accelerations")
        with self._turn:
            setpoint = self._setpoint
            setpoint["joints"] = target
            setpoint["feed_forward"] = rates is not None
            if rates is not None:
                setpoint["joint_velocity"] = rates
            setpoint["number"] += 1
            self._publish()

    def set_chunk(self, times_s: Sequence[float], positions: Sequence[Sequence[float]]) -> None:
        """Where the joints shall be at times to come: an action chunk. A newer one replaces what lies ahead.

        Args:
            times_s: on the robot's clock, see `Robot.clock_s`, increasing.
            positions: rad, one list for each time.

        Raises:
            InputError, MotionStopped: as `set_target_joints`.
        """
        self._send_chunk(times_s, positions, self._dof)


class JointImpedanceControl(JointControl):
    """Streams joint positions, around which the joints give way like springs."""


class JointTorqueControl(Control[JointState]):
    """Streams joint torques, on top of what gravity and motion take."""

    def get_state(self) -> JointState:
        return joint_state(self._transport.state())

    def set_target_torques(self, torques: Sequence[float]) -> None:
        """The torques from now on, N·m; those beyond the limits count as the limits.

        Raises:
            InputError, MotionStopped: as `JointControl.set_target_joints`.
        """
        target = vector(torques, self._dof, name="torques")
        with self._turn:
            self._setpoint["joints"] = target
            self._setpoint["number"] += 1
            self._publish()


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
        target = _pose(pose)
        force = vector(wrench, 6, name="wrench") if len(wrench) else np.zeros(6)
        twist = vector(velocity, 6, name="velocity") if len(velocity) else None
        if len(acceleration):
            vector(acceleration, 6, name="acceleration")
        with self._turn:
            setpoint = self._setpoint
            setpoint["pose"] = target
            setpoint["wrench"] = force
            setpoint["feed_forward"] = twist is not None
            if twist is not None:
                setpoint["twist"] = twist
            setpoint["number"] += 1
            self._publish()

    def move_to_pose(self, pose: Sequence[float], duration_sec: float = 3.0) -> None:
        """Begin a minimum-jerk motion to a pose and return; one to the same pose that runs goes on.

        Within the limits of velocity and acceleration: what is too short for them takes longer.

        Raises:
            InputError: no pose, or no duration from 0.001 to 600 s.
            MotionStopped: the session has ended, with the reason.
        """
        target = _pose(pose)
        if not 1e-3 <= duration_sec <= 600.0:
            raise InputError(f"duration_sec must be from 0.001 to 600 s, got {duration_sec}")
        with self._turn:
            setpoint = self._setpoint
            setpoint["move_pose"] = target
            setpoint["move_duration_s"] = duration_sec
            setpoint["move"] += 1
            self._publish()

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
        deadline_s = time.monotonic() + (timeout_sec or np.inf)
        while self.is_moving():
            if time.monotonic() > deadline_s:
                return False
            time.sleep(POLL_S)
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
            self._setpoint["cancel"] = self._setpoint["move"]
            self._publish()


def _pose(pose: Sequence[float]) -> Array:
    values = vector(pose, 7, name="pose")
    checked = Pose(values[:3], values[3:])
    if abs(float(np.linalg.norm(values[3:])) - 1.0) > 1e-2:
        raise InputError(f"the quaternion of the pose must have length 1, got {values[3:].tolist()}")
    return np.concatenate([checked.position, checked.quaternion])
