"""Backend for a Franka arm. Without an impedance, it commands positions, which the robot's own controller
follows. With an impedance, it commands torques.

The robot is externally clocked: it sends its state a thousand times per second and expects a command after
each. If a command is late, the robot continues at constant acceleration, and `Bridge` continues from there. A
reflex, the user stop or a lost connection ends the control and causes a fault. A reset recovers from the
fault, with a new connection if the old one was lost.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cobot.config import Settings
from cobot.robot.device import Capabilities, DeviceStatus
from cobot.robot.tool import BARE, Tool
from cobot.types import Array, JointLimits
from rtloop.backends import BackendError, Impedance, Measured
from rtloop.backends.agreement import check_agreement
from rtloop.backends.franka.bridge import Bridge
from rtloop.backends.franka.kinematics import told_flange
from rtloop.backends.franka.link import Knock, Knocking, Link
from rtloop.backends.franka.options import DOF, FrankaOptions
from rtloop.backends.franka.words import MODES, REFUSALS, active_errors, in_words
from rtloop.backends.giving_way import GivingWay
from rtloop.backends.protocols import require_accepted

if TYPE_CHECKING:
    from rtloop.contract import ContractRig

PERIOD_S = 0.001
MAX_TORQUE_RATE = 990.0
"""Maximum rate of the torques, N·m/s. Franka specifies 1000 for both robots; above that, the controller
reports a discontinuity.
"""
REST_RAD_S = 0.02
"""The arm is at rest if no joint is faster than this, rad/s."""


class FrankaBackend:
    """The backend for a Franka arm. It implements these protocols of `rtloop.backends`: `Backend`, `Paced`,
    `Reporting`, `Stepwise`, `ImpedanceControlled` and `CarriesTool`.
    """

    Options: ClassVar[type[FrankaOptions]] = FrankaOptions
    sdk: ClassVar[str] = "pylibfranka"
    capabilities: ClassVar[Capabilities] = Capabilities(
        periods_s=(PERIOD_S,),
        impedance=True,
        torque=True,
        freedrive=False,
        payload=True,
        stops={1: False, 2: False},
        hardware=True,
    )

    def __init__(
        self,
        settings: Settings,
        limits: JointLimits,
        *,
        library: Any = None,
        knock: Callable[[str], Knocking] = Knock,
    ) -> None:
        """Create the backend. `library` and `knock` replace pylibfranka and the connection check in tests."""
        if limits.dof != DOF:
            raise BackendError(f"a Franka has {DOF} joints, but this robot has {limits.dof}")
        options = settings.backend_options(FrankaOptions)
        if options is None:
            raise BackendError("robot.backend: franka needs address, the address of the robot's control unit")
        self._link = Link(options.address, options.realtime, library, knock)
        self._franka = self._link.library
        self._options = options
        self._state: Any = None
        self._fresh = False
        self._preparing: Iterator[bool] | None = None
        self._periods = 1
        self._lost_packets = 0
        self._giving = GivingWay(settings, limits, MAX_TORQUE_RATE)
        self._impedance: Impedance | None = None
        self._tool = BARE
        self._bridge = Bridge(DOF, PERIOD_S)
        self.nominal_stiffness = self._giving.nominal_stiffness
        self.nominal_cartesian_stiffness = self._giving.nominal_cartesian_stiffness

    # Backend

    def open(self, initial_position: Array) -> None:
        while not self._link.is_open(wait_s=0.1):
            pass
        self._receive()
        if self._options.check_pose:
            joints, flange = np.array(self._state.q), told_flange(self._state)
            require_accepted(check_agreement(self._giving.robot, joints, flange))

    def enable(self) -> None:
        while not self.enable_step():
            pass

    def enable_step(self) -> bool:
        if self._link.robot is None:
            self._preparing = None
            if not self._link.is_open():
                return False
            self._receive()
        if self._impedance is not None:  # a new connection begins without an impedance
            self.set_impedance(None)
        if self._link.control is not None:
            return True
        preparing, self._preparing = self._preparing or self._prepare(), None
        with self._link.in_words():
            if next(preparing, True):
                self._start()
                return True
        self._preparing = preparing
        return False

    def recover_step(self) -> bool:
        """Request a recovery. `enable_step` executes it."""
        self._preparing = None  # drop an unfinished reset
        return True

    def read(self, measured: Measured) -> None:
        if not self._fresh:  # no cycle has waited for the state
            self._receive()
        self._fresh = False
        state = self._state
        measured.position[:], measured.velocity[:] = state.q, state.dq
        measured.effort[:], measured.desired_effort[:] = state.tau_J, state.tau_J_d
        # The robot reports the wrench that it exerts on its surroundings; `measured.wrench` is the opposite.
        measured.external_effort[:] = state.tau_ext_hat_filtered
        measured.wrench[:] = state.O_F_ext_hat_K
        measured.external *= -1.0

    def write(self, command: Array) -> None:
        if self._link.control is None:
            raise BackendError(self._explain_no_control())
        periods, self._periods = self._periods, 1
        with self._link.in_words():
            if self._impedance is None:
                sent = self._bridge.bridge(command, periods)
                self._link.control.writeOnce(self._franka.JointPositions(sent[0].tolist()))
            else:
                state = self._state
                torques = self._giving.torques(command, np.array(state.q), np.array(state.dq))
                self._link.control.writeOnce(self._franka.Torques(torques.tolist()))

    def disable(self) -> None:
        """Release control. The robot's own controller then holds the arm. Use Desk to engage the brakes."""
        if self._link.control is not None:
            with contextlib.suppress(BackendError), self._link.in_words():
                self._end()

    def close(self) -> None:
        self.disable()
        self._link.robot = self._link.control = None

    # Paced, Reporting

    def wait(self, timeout_s: float) -> bool:
        """Wait for the robot's next state. libfranka does the waiting, with its own timeout."""
        self._receive()
        return True

    def status(self) -> DeviceStatus:
        state = self._state
        if state is None or self._link.lost:
            return DeviceStatus(connection=self._link.lost or "not connected")
        mode = state.robot_mode.name
        return DeviceStatus(
            connection="connected",
            quality=f"{100.0 * state.control_command_success_rate:.0f} % of the commands arrive in time",
            safety_stop=REFUSALS["UserStopped"] if mode == "UserStopped" else "",
            drives=MODES.get(mode, mode),
            packets_lost=self._lost_packets,
            device_time_s=state.time.to_sec(),
            text=in_words(active_errors(self._state)),
        )

    # ImpedanceControlled, CarriesTool

    def set_impedance(self, impedance: Impedance | None) -> None:
        """Switch between positions and torques. The arm must be at rest: control ends and begins again in the
        other form, which takes a few cycles.
        """
        if impedance is not None and self._impedance is not None:
            self._impedance = impedance
            self._giving.use(impedance)
            return
        if (impedance is None) == (self._impedance is None):
            return
        with self._pause():
            self._impedance = impedance

    def set_tool(self, tool: Tool) -> None:
        self._tool = tool
        if self._link.robot is not None:  # if not connected, `enable` sends it later
            with self._pause():
                self._tell_tool()

    # Private methods

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> ContractRig:
        """Create a rig with the backend and a stand-in for the robot."""
        from rtloop.backends.franka.rig import FrankaRig

        return FrankaRig(settings, limits)

    def _prepare(self) -> Iterator[bool]:
        """Prepare the robot for control and send its settings. Yields False after each step.

        pylibfranka blocks the whole interpreter until the robot has replied, which takes tens of
        milliseconds. So each step sends one command, and cycles run between the steps.
        """
        mode = self._state.robot_mode.name
        if mode in REFUSALS:
            raise BackendError(REFUSALS[mode])
        if mode == "Reflex" or active_errors(self._state):
            self._link.robot.automatic_error_recovery()
            yield False
        options = self._options
        self._link.robot.set_collision_behavior(
            options.contact_torque, options.collision_torque, options.contact_force, options.collision_force
        )
        yield False
        if options.joint_stiffness is not None:
            self._link.robot.set_joint_impedance(options.joint_stiffness)
            yield False
        self._tell_tool()
        yield False

    def _tell_tool(self) -> None:
        """Send the load in the flange frame. The end effector is not included, because it is set in Desk."""
        tool = self._tool
        inertia = tool.inertia_matrix.ravel(order="F").tolist()
        self._link.robot.set_load(tool.mass, list(tool.centre), inertia)

    def _start(self) -> None:
        """Begin to control the robot. The commands begin at the position that the robot itself has as its
        reference.
        """
        if self._impedance is None:
            mode = self._franka.ControllerMode.JointImpedance
            self._link.control = self._link.robot.start_joint_position_control(mode)
        else:
            self._giving.begin(self._impedance)
            self._link.control = self._link.robot.start_torque_control()
        self._receive()
        self._bridge.begin(np.array(self._state.q_d))
        self._periods = 1

    def _end(self) -> None:
        """End the control. The arm must be at rest; the robot then holds it."""
        control, self._link.control = self._link.control, None
        if self._impedance is None:
            last = self._franka.JointPositions(self._bridge.sent[0].tolist())
        else:
            last = self._franka.Torques(self._giving.torque.tolist())
        last.motion_finished = True
        control.writeOnce(last)

    @contextlib.contextmanager
    def _pause(self) -> Iterator[None]:
        """Context manager that interrupts control of the robot, because the robot accepts some settings only
        while it is not controlled.

        Raises:
            BackendError: the arm is moving, or the robot rejects the settings.
        """
        controlled = self._link.control is not None
        with self._link.in_words():
            if controlled:
                if np.abs(np.array(self._state.dq)).max() > REST_RAD_S:
                    raise BackendError("the arm is moving; this is possible only at rest")
                self._end()
            yield
            if controlled:
                self._start()

    def _receive(self) -> None:
        """Receive the newest state.

        Raises:
            BackendError: the robot is not connected, or has ended the control; the error gives the reason.
        """
        if self._link.robot is None:
            raise BackendError(self._link.lost or "the robot is not connected")
        with self._link.in_words():
            if self._link.control is None:
                self._state = self._link.robot.read_once()
            else:
                self._state, passed = self._link.control.readOnce()
                periods = max(1, round(passed.to_sec() / PERIOD_S))
                self._lost_packets += periods - 1
                self._periods = periods
        self._fresh = True

    def _explain_no_control(self) -> str:
        if self._link.lost:
            return self._link.lost
        mode = self._state.robot_mode.name if self._state is not None else "Other"
        why = in_words(active_errors(self._state)) or REFUSALS.get(
            mode, "the robot is not under control: reset it"
        )
        return f"the robot is {MODES.get(mode, mode)}: {why}"
