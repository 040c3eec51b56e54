"""Force control: keeps the settings, and runs its own session while no other session is active."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from app.services.streaming.sessions import StreamService, StreamSession
from cobot.errors import CobotError, ConflictError, InputError, LimitError
from cobot.ipc.layout import Interpolation, Stream, setpoint_dtype
from cobot.ipc.session_rules import (
    DAMPING_RATIO,
    NO_FRAME,
    damping_flaw,
    decimation,
    nominal_session,
    stiffness_flaw,
)
from cobot.robot.description import RobotDescription
from cobot.types import Array, vector

NAME = "force control"
PERIOD_S = 0.01
SESSION_TIMEOUT_S = 2.0
STOP_TIMEOUT_S = 3.0
MAX_VELOCITY = (0.1, 0.1, 0.1, 0.5, 0.5, 0.5)
"""Default maximum velocity of force control, m/s and rad/s."""
NO_LIMIT = (np.inf,) * 6
AXES = ("x", "y", "z", "rx", "ry", "rz")


@dataclass(frozen=True, slots=True)
class ForceSettings:
    """The settings of force control. Most settings have six values: three along x, y and z, in units of m and
    N, then three about x, y and z, in units of rad and N·m.

    Attributes:
        enabled: whether force control is enabled.
        axes: axes of the force frame along which the force is controlled instead of the position.
        wrench: the wrench that the TCP exerts on its surroundings, in the force frame.
        max_velocity: the maximum velocity of force control.
        stiffness: TCP stiffness; None for the robot's nominal stiffness.
        damping_ratio: damping ratio of the TCP, from 0.3 to 1.
        in_tcp: whether the force frame is given in the TCP frame; if not, in the base frame.
        frame: pose of the force frame: position x, y, z, then quaternion w, x, y, z.
        thresholds: external wrench at the TCP, in the base frame, above which the arm is stopped. It is
            checked every 10 ms in any mode while force control is enabled.
        limits: external wrench in the same form, above which rtloop ends a session. Sessions that begin after
            the change check it in every cycle.
    """

    enabled: bool = False
    axes: tuple[bool, ...] = (False,) * 6
    wrench: tuple[float, ...] = (0.0,) * 6
    max_velocity: tuple[float, ...] = MAX_VELOCITY
    stiffness: tuple[float, ...] | None = None
    damping_ratio: tuple[float, ...] = (DAMPING_RATIO,) * 6
    in_tcp: bool = False
    frame: tuple[float, ...] = NO_FRAME
    thresholds: tuple[float, ...] = NO_LIMIT
    limits: tuple[float, ...] = NO_LIMIT

    def describe(self, request: np.ndarray) -> None:
        """Write the settings that stay fixed during a session into a record of
        `cobot.ipc.layout.session_dtype`.
        """
        request["force_axes"] = self.axes
        request["force_velocity"] = self.max_velocity
        if self.stiffness is not None:
            request["cartesian_stiffness"] = self.stiffness
        request["cartesian_damping_ratio"] = self.damping_ratio
        request["force_in_tcp"], request["force_frame"] = self.in_tcp, self.frame
        request["max_contact_wrench"] = self.limits


class ForceService:
    """Keeps the settings of force control. While force control is enabled, the TCP holds its pose and exerts
    the wrench along the force axes.

    A Cartesian session of another client may take over force control. `lend` then ends the service's session,
    and the other session uses `settings`, whose `wrench` may still change.

    Attributes:
        settings: the current settings.
        reason: reason why force control last ended on its own; "" if it never has.
    """

    def __init__(
        self,
        robot: RobotDescription,
        link: RobotLink,
        streams: StreamService,
        stopping: StopService,
        report: Callable[[str], None],
    ) -> None:
        self._robot = robot
        self._link = link
        self._streams = streams
        self._stopping = stopping
        self._report = report
        self._session: StreamSession | None = None
        self._task: asyncio.Task[None] | None = None
        self._changing = asyncio.Lock()
        self._sequence = 0
        self._stops = 0
        self._setpoint = np.zeros((), setpoint_dtype(link.memory.dof))
        self.settings = ForceSettings()
        self.reason = ""

    async def enable(self) -> None:
        """Enable force control.

        Raises:
            InputError: the settings are invalid; the error gives the reason.
            ConflictError: another client is moving the arm, or a servo session has begun without force axes.
            NotReadyError, ExecutionError, UnavailableError: see `StreamService.open`.
        """
        async with self._changing:
            if self.settings.enabled:
                return
            await self._open()
            self._stops = self._link.stops
            self.settings = replace(self.settings, enabled=True)
            self.reason = ""
            self._task = asyncio.create_task(self._run(), name="force control")

    async def disable(self) -> None:
        """Disable force control. Returns when the arm is at rest."""
        async with self._changing:
            self.settings = replace(self.settings, enabled=False)
            if self._task is not None:
                self._task.cancel()
                self._task = None
            await self._end("force control was disabled")

    async def lend(self) -> None:
        """End this session so that another client's session can move the arm with these `settings`."""
        async with self._changing:
            await self._end("another session takes over")

    async def take_back(self) -> None:
        """Continue force control at the arm's current position, after another session had interrupted it.
        Nothing happens if force control was disabled or stopped meanwhile.

        Raises:
            CobotError: see `enable`.
        """
        async with self._changing:
            if self.settings.enabled and self._session is None and self._link.stops == self._stops:
                await self._open()

    def close(self) -> None:
        if self._task is not None:
            self._task.cancel()

    def set_target(
        self, axes: list[bool], wrench: list[float], max_velocity: list[float], frame: Array, *, in_tcp: bool
    ) -> None:
        """Set the axes of force control and the wrench.

        Args:
            axes: 6 values, true for each axis with force control.
            wrench: 6 values, N and N·m: the wrench that the TCP exerts on its surroundings.
            max_velocity: 6 values, m/s and rad/s. 0 means the default; an empty list means all defaults.
            frame: pose of the force frame, x, y, z, w, x, y, z.

        Raises:
            InputError: a list does not have six numbers, or a value is invalid.
            ConflictError: force control is enabled, and more than the wrench would change.
        """
        if len(axes) != 6:
            raise InputError(f"axes must be 6 values of true or false, got {axes}")
        force = vector(wrench, 6, name="wrench")
        speed = vector(max_velocity or [0.0] * 6, 6, name="max_velocity")
        if (speed < 0.0).any():
            raise InputError(f"max_velocity must be at least 0 (the default), got {speed.tolist()}")
        self._change(
            axes=tuple(axes),
            max_velocity=tuple(np.where(speed > 0.0, speed, MAX_VELOCITY).tolist()),
            frame=tuple(frame.tolist()),
            in_tcp=in_tcp,
        )
        self.settings = replace(self.settings, wrench=tuple(force.tolist()))

    def set_impedance(self, damping_ratio: list[float], stiffness: list[float]) -> None:
        """Set the TCP's compliance along the position-controlled axes.

        Args:
            damping_ratio: 6 values from 0.3 to 1. 0 means 0.7; an empty list means all defaults.
            stiffness: 6 values, N/m and N·m/rad. 0 means the nominal stiffness; an empty list means all
                defaults.

        Raises:
            InputError: there are not six numbers, or a value is outside the robot's range, which the error
                gives.
            ConflictError: force control is enabled.
        """
        ratio = vector(damping_ratio or [0.0] * 6, 6, name="damping ratio")
        ratio = np.where(ratio == 0.0, DAMPING_RATIO, ratio)
        if flaw := damping_flaw("the damping ratio", ratio):
            raise LimitError(flaw)
        nominal = self._streams.info["cartesian_stiffness"]
        wanted = vector(stiffness or [0.0] * 6, 6, name="stiffness")
        wanted = np.where(wanted == 0.0, nominal, wanted)
        if nominal.any() and (flaw := stiffness_flaw("the stiffness", wanted, nominal)):
            raise LimitError(flaw)
        self._change(damping_ratio=tuple(ratio.tolist()), stiffness=tuple(wanted.tolist()))

    def set_thresholds(self, thresholds: list[float]) -> None:
        """Set the external wrench above which the arm is stopped: 6 values, N and N·m. 0 means no threshold.

        Raises:
            InputError: there are not six numbers of at least 0.
        """
        self.settings = replace(self.settings, thresholds=_bounds(thresholds, "thresholds"))

    def set_limits(self, limits: list[float]) -> None:
        """Set the external wrench above which rtloop ends a session: 6 values, N and N·m. 0 means no limit.

        Raises:
            InputError: there are not six numbers of at least 0.
            ConflictError: force control is enabled.
        """
        self._change(limits=_bounds(limits, "limits"))

    def external_wrench(self) -> Array:
        """Estimated wrench that the surroundings exert on the TCP, in the base frame, shape (6,), N and N·m.

        Raises:
            UnavailableError: rtloop has died while writing a state.
        """
        return self._link.state().wrench

    def _change(self, **changes: object) -> None:
        changed = replace(self.settings, **changes)  # type: ignore[arg-type]
        if self.settings.enabled and changed != self.settings:
            names = [name for name, value in changes.items() if value != getattr(self.settings, name)]
            raise ConflictError(
                f"{', '.join(names)} cannot change while force control is enabled; disable it first"
            )
        self.settings = changed

    async def _open(self) -> None:
        request = nominal_session(self._streams.info)
        request["stream"], request["interpolation"] = Stream.CARTESIAN, Interpolation.NONE
        request["decimation"] = decimation(1.0 / PERIOD_S, self._streams.period_s)
        self.settings.describe(request)
        self._session = await self._streams.open(request, NAME, SESSION_TIMEOUT_S)
        self._sequence = 0
        # Hold the commanded pose, because the measured pose yields to external forces.
        pose = self._robot.model.forward(self._link.state().commanded_position)
        self._setpoint["pose"][:3], self._setpoint["pose"][3:] = pose.position, pose.quaternion
        self._feed()

    async def _end(self, reason: str) -> None:
        session, self._session = self._session, None
        if session is not None:
            session.end(reason)
            await asyncio.shield(session.ended)

    def _feed(self) -> None:
        assert self._session is not None
        self._sequence += 1
        self._setpoint["number"] += 1
        self._setpoint["wrench"] = self.settings.wrench
        self._session.take_setpoint(self._sequence, self._setpoint)

    async def _run(self) -> None:
        """Send targets to the session and watch the thresholds until force control ends on its own."""
        while not (reason := self._step()):
            await asyncio.sleep(PERIOD_S)
        ended = self._link.stops != self._stops or (self._session is not None and self._session.over != "")
        self.settings = replace(self.settings, enabled=False)
        self.reason, self._session, self._task = reason, None, None
        self._report(f"force control has ended: {reason}")
        if not ended:  # a second stop could end the next motion
            await self._stopping.stop(STOP_TIMEOUT_S)

    def _step(self) -> str:
        """Run one step. Returns the reason why force control must end; "" if it continues."""
        try:
            wrench = self.external_wrench()
            for axis, value, threshold in zip(AXES, wrench.tolist(), self.settings.thresholds, strict=True):
                if abs(value) > threshold:
                    return f"{value:.1f} along or about {axis} exceed the threshold of {threshold:g}"
            if self._session is not None:
                if self._session.over:
                    return self._session.over
                self._feed()
            elif self._link.stops != self._stops:
                return "a stop was requested"
        except CobotError as exc:
            return str(exc)
        return ""


def _bounds(values: list[float], name: str) -> tuple[float, ...]:
    numbers = vector(values, 6, name=name)
    if (numbers < 0.0).any():
        raise InputError(f"{name} must be at least 0 (0: no limit), got {numbers.tolist()}")
    return tuple(np.where(numbers > 0.0, numbers, np.inf).tolist())
