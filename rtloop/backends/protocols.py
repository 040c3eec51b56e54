"""The backend protocols: one that every backend implements, and optional ones.

    Backend              all: open, enable, read, write, disable, close
    Paced                an externally clocked device
    Reporting            the device reports its status
    Stepwise             enabling and recovery take several cycles, in which its packets are answered
    SwitchesOffLater     the drives may be off only after `disable` has returned
    ImpedanceControlled  the drives have adjustable stiffness and damping
    TorqueControlled     the drives take torques in addition to positions
    WrenchControlled     the drives take a force at the TCP in addition to positions
    CarriesTool          the drives must know their load
    HasIo                the device has named inputs and outputs
    ReadsInputs          its inputs can be read one by one, in each cycle
    HasCell              a simulation with loose parts
    Simulated            a simulation that can be pulled and begun again

A device that does not accept a command in each cycle, because it is slower or does its own planning,
implements a different protocol. `rtloop.backends.trajectory_driver` makes it a `Backend`:

    TrajectoryDevice     takes whole motions: load, start, progress, stop, state

A backend's class declares the device's `capabilities`, its `Options`, the package `sdk` that its instances
import, and with `contract_rig` the simulated device for the contract checks (`rtloop.contract.rig`).
docs/your-backend.md is the guide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from pydantic import BaseModel, ConfigDict

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.device import Capabilities, DeviceStatus
from cobot.robot.io_points import IoPoint
from cobot.robot.tool import Tool
from cobot.types import Array
from rtloop.backends.addresses import is_of_this_computer
from rtloop.backends.compiled import Measured
from rtloop.results import Accepted, Rejected


class BackendError(Exception):
    """Raised if a device does not answer, rejects a request or reports a fault. Its text is shown to users as
    the reason.
    """


def require_accepted(result: Accepted | Rejected) -> None:
    """Check that a result is not a rejection. Raises a BackendError with the reason if it is."""
    if isinstance(result, Rejected):
        raise BackendError(result.reason)


class BackendOptions(BaseModel):
    """Base class for the `Options` of a backend, which are the keys of `robot.backend` in addition to `type`.
    Use `cobot.config.Location` for paths.

    Attributes:
        simulator: whether the device is a simulator on this computer, so that a hand, parts and contact
            forces may be simulated next to it; see `rtloop.backends.device_in_cell`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)
    simulator: bool = False

    def remote_setting(self, settings: Settings) -> str:
        """Return the setting, with its value, that may place the device on another computer; "" if the device
        is on this one. A class overrides this if its option is not named `address`.
        """
        if "address" not in type(self).model_fields:
            return ""
        address = getattr(self, "address", None)
        return "" if is_of_this_computer(address) else f"robot.backend.address is {str(address)[:80]!r}"


class Backend(Protocol):
    """A robot arm that takes a joint command in each cycle.

    The constructor is called with (settings, limits). `open`, `enable`, `disable` and `close` may block.
    During a reset, `enable` blocks the cycle, so a device that may not answer must be `Stepwise`. `read` and
    `write` are called in each cycle and must be real-time safe: they take a bounded time, do not allocate
    memory deliberately, and perform no input or output except with the device. Each method may raise
    BackendError.

    A class may define an attribute `capabilities` of type `Capabilities`. Without it, the backend is assumed
    to be a simulation that measures everything and works with any period. A class may also define an
    attribute `Options`, a pydantic model (`BackendOptions`). `settings.backend_options(Options)` returns an
    instance of it. `cobot backend test` checks a backend against this contract.
    """

    def open(self, initial_position: Array) -> None:
        """Connect. A simulation begins at `initial_position`, which has shape (dof,), in rad; a real robot
        ignores it.
        """
        ...

    def enable(self) -> None:
        """Switch the drives on and hold the position. Also called after a fault whose cause no longer
        exists.
        """
        ...

    def read(self, measured: Measured) -> None:
        """Fill in the measured values."""
        ...

    def write(self, command: Array) -> None:
        """Command the joints' current target, shape (3, dof): rad, rad/s, rad/s²."""
        ...

    def disable(self) -> None:
        """Switch the drives off and apply the brakes."""
        ...

    def close(self) -> None:
        """Release the device."""
        ...


@runtime_checkable
class Paced(Protocol):
    """An externally clocked device: rtloop waits for its packets instead of its own clock."""

    def wait(self, timeout_s: float) -> bool:
        """Wait for the device's next packet. If several are queued, the newest one is used.

        A packet starts a cycle: `read` and `write` are called, and the path advances by one period. Without a
        packet, only `read` is called; the path does not advance. It raises a BackendError if no packet has
        arrived for too long.

        Returns:
            Whether a packet has arrived. False is returned after `timeout_s`, never earlier.

        Raises:
            BackendError: the connection is lost; rtloop uses its own clock until `wait` works again.
        """
        ...


@runtime_checkable
class Reporting(Protocol):
    """A device that reports its status."""

    def status(self) -> DeviceStatus:
        """Return the current status. It is called several times a second, between cycles, and must not wait
        for the device.
        """
        ...


@runtime_checkable
class Stepwise(Protocol):
    """A device that needs several cycles to be enabled or to recover from a fault. Its packets are answered
    in the meantime.

    For a reset, rtloop does not call `enable`. Instead, it calls `wait`, `read`, one step and `write` (of the
    current position) in each cycle. `enable` is called once, at the start, before the first cycle.
    """

    def enable_step(self) -> bool:
        """Perform one step of `enable`. Returns True when enabling is done. Raises a BackendError with the
        reason if it fails.
        """
        ...

    def recover_step(self) -> bool:
        """Perform one step of the recovery after a fault or an e-stop, before `enable_step`. Return True when
        the recovery is done.

        Raises:
            BackendError: the device cannot recover; the error gives the reason.
        """
        ...


@runtime_checkable
class SwitchesOffLater(Protocol):
    """A device whose `disable` may return before the drives are off."""

    def is_switching_off(self) -> bool:
        """Whether the drives may still be on after `disable`. Real-time safe."""
        ...


@dataclass(frozen=True, slots=True)
class Impedance:
    """Stiffness and damping of the arm around its commanded position.

    Attributes:
        cartesian: whether stiffness and damping act at the TCP along the base frame's axes (6 values each,
            N/m and N·m/rad; the joints' own springs hold the null space) or on the joints (dof values each,
            N·m/rad).
        stiffness: stiffness of the springs.
        damping_ratio: damping ratio of each spring, for the inertia that it moves. 1 is critical damping.
    """

    cartesian: bool
    stiffness: Array
    damping_ratio: Array


@runtime_checkable
class ImpedanceControlled(Protocol):
    """A backend with torque-controlled drives. Their stiffness and damping can be set.

    Attributes:
        nominal_stiffness: maximum stiffness of the joints, shape (dof,), N·m/rad.
        nominal_cartesian_stiffness: maximum stiffness of the TCP, shape (6,), N/m and N·m/rad.
    """

    nominal_stiffness: Array
    nominal_cartesian_stiffness: Array

    def set_impedance(self, impedance: Impedance | None) -> None:
        """Set the impedance that applies from the next cycle on; None selects position control. The arm is at
        rest. Must be real-time safe, or delay the cycle by a few periods at most.

        Raises:
            BackendError: the robot rejects the impedance. At the beginning of a session, the session is then
                rejected; at its end, this is a fault.
        """
        ...


@runtime_checkable
class GuidedByHand(Protocol):
    """A backend whose device can release the arm itself, so that a person can guide it by hand without
    springs.
    """

    def begin_guiding(self) -> None:
        """Make the device release the arm at the next `write`. The arm is at rest. Until `follow_commands` is
        called, each command equals the measured position; the device must not follow it.

        Raises:
            BackendError: the device does not permit guiding. The device still holds the arm.
        """
        ...

    def end_guiding(self) -> None:
        """Make the device hold the arm at its current position from the next `write` on. Real-time safe; does
        nothing if the arm is already held. If `write` is no longer called, the device must hold the arm on
        its own, because rtloop may have been killed.
        """
        ...

    def follow_commands(self) -> None:
        """Follow the commands from the next `write` on. The arm is at rest, and the first command is its
        position.
        """
        ...


@runtime_checkable
class TorqueControlled(Protocol):
    """A backend for torque streams: its drives are compliant on their own and accept torques in addition to
    the commanded position. An `ImpedanceControlled` backend does not need it.
    """

    def write_torque(self, torque: Array) -> None:
        """Add torques from the next `write` on, shape (dof,), N·m. Real-time safe."""
        ...


@runtime_checkable
class WrenchControlled(Protocol):
    """A backend whose drives accept a force at the TCP in addition to positions, for force control in a
    stream of poses.
    """

    def write_wrench(self, wrench: Array) -> None:
        """Set the force that the TCP exerts from the next `write` on, shape (6,), N and N·m, along the base
        frame's axes. Real-time safe.
        """
        ...


@runtime_checkable
class CarriesTool(Protocol):
    """A backend whose drives must know their load, for example to compensate gravity themselves."""

    def set_tool(self, tool: Tool) -> None:
        """Use this tool from the next cycle on. Called before `open`, if there is a tool, and later while the
        arm is at rest. The call may delay the cycle by a few periods, and must not move the arm.

        Raises:
            BackendError: the robot cannot carry the tool; nothing has changed.
        """
        ...


@runtime_checkable
class HasIo(Protocol):
    """A device with named inputs and outputs. Its `capabilities.io` must be True.

    The optional attribute `report_period_s`, 0.001 to 0.2 s, sets the interval at which `io` and
    `Reporting.status` are called. By default they are called every 0.2 s.
    """

    def io(self) -> Sequence[IoPoint]:
        """Return all inputs and outputs as last reported by the device. Called whenever `Reporting.status` is
        called.
        """
        ...

    def set_output(self, name: str, value: float) -> None:
        """Request to set an output of `io` with the next `write` or soon after it. The output is set once
        `io` reports the value. Called between cycles; must not wait for the device.

        Args:
            value: a value that fits the output's kind, see `cobot.robot.io_points`; 0 or 1 for a boolean.

        Raises:
            BackendError: the device does not accept the value now; the error gives the reason.
        """
        ...


@runtime_checkable
class HasCell(Protocol):
    """A simulation with loose parts.

    Attributes:
        part_names: names of the parts.
    """

    part_names: tuple[str, ...]

    def part_poses(self, poses: Array) -> None:
        """Write the poses of all parts in the base frame into `poses`, shape (n, 7): the position x, y, z (m)
        and the quaternion w, x, y, z. Real-time safe.
        """
        ...

    def mount(self, tool: Tool) -> None:
        """Make the simulated arm carry this tool from the next cycle on. It is the tool of `CarriesTool`
        without the held parts. Called before `open`, and later while the arm is at rest.
        """
        ...

    def reset_cell(self) -> None:
        """Reset the parts, the hand, the outputs and the counters to their initial state. The arm stays where
        it is. Called between cycles.
        """
        ...


@runtime_checkable
class Simulated(Protocol):
    """A simulated arm that users can reset and pull for experiments. A backend for a real robot must not
    implement this protocol.
    """

    def restart(self, initial_position: Array) -> None:
        """Put the arm at rest at this position, and reset its cell to the initial state. Called between
        cycles while nothing moves.
        """
        ...

    def pull(self, link: str, point: Array, target: Array) -> None:
        """Pull at a point on a link, as a hand on a spring does, for 0.2 s or until the next call. This has
        an effect only while the arm has an impedance. The force is limited.

        Args:
            link: name of a body that is moved by the joints.
            point: point on the link, in the link's frame, m.
            target: position that the point is pulled to, in the base frame, m.

        Raises:
            BackendError: there is no such link.
        """
        ...

    def let_go(self) -> None:
        """Stop pulling now."""
        ...


@runtime_checkable
class ReadsInputs(Protocol):
    """A `HasIo` device whose inputs can be read one by one in the cycle. For other backends `io` is called
    instead.
    """

    def read_input(self, name: str) -> float:
        """Read the current value of an input; 0 or 1 for a boolean. Real-time safe.

        Raises:
            BackendError: there is no such input, or it cannot be read; the error gives the reason.
        """
        ...


@runtime_checkable
class TrajectoryDevice(Protocol):
    """A robot arm that accepts whole motions and executes them autonomously, used instead of a `Backend`.

    The constructor and the attributes are the same as for a `Backend`. The class may also implement
    `Reporting`, `CarriesTool` and `HasIo`. Each method may raise BackendError and may wait for the device for
    a few tenths of a second, `enable` even for seconds. A thread calls the methods one at a time; only
    `set_tool` and `disable` are called in the cycle, while nothing moves.

    Two attributes are optional: `state_period_s`, the interval at which the device is polled (0.05), and
    `point_period_s`, the maximum time between points of a motion (0.02).
    """

    def open(self, initial_position: Array) -> None:
        """Connect; see `Backend`. The methods `enable`, `disable` and `close` also work as in `Backend`."""
        ...

    def enable(self) -> None: ...

    def disable(self) -> None: ...

    def close(self) -> None: ...

    def state(self, measured: Measured) -> None:
        """Fill in the current measured values. Raises a BackendError, with the reason, if the device has
        stopped unexpectedly.
        """
        ...

    def load(self, times_s: Array, rows: Array) -> None:
        """Load a motion without starting it.

        The motion begins at the arm's current position, and is at rest at both ends.

        Args:
            times_s: times of the points of the motion, shape (n,), starting at 0.
            rows: position, velocity and acceleration at the points, shape (3, n, dof): rad, rad/s, rad/s².
                The arm must pass through all points. Quintics between the points reproduce the path exactly.
        """
        ...

    def start(self) -> None:
        """Begin to execute the last loaded motion."""
        ...

    def progress(self) -> float:
        """Return the executed part of the motion, in motion time, s. On arrival, it is the last value of
        `times_s`. If the device slows down, the progress advances more slowly than a clock.
        """
        ...

    def stop(self) -> None:
        """Stop the arm, on the path if possible. Also called when nothing moves."""
        ...


@runtime_checkable
class MovesByItself(Protocol):
    """The additional methods of a `Backend` for a device that executes whole motions. All are real-time
    safe.
    """

    def begin(self, breakpoints_s: Array, coefficients: Array, share: float) -> None:
        """Make the device load and execute this path, slowed down to `share` of its speed. The arguments are
        defined as in `cobot.trajectory.Trajectory`.
        """
        ...

    def done_s(self) -> float:
        """Return the progress along the path given to `begin` at the last reading, in path time, s."""
        ...

    def halt(self) -> None:
        """Stop the arm."""
        ...

    def is_halted(self) -> bool:
        """Whether the stop has been sent or cannot be sent. Once it has, the measured position is valid."""
        ...


class NoOptions(BackendOptions):
    """The options class of a backend that needs no options."""


SIMULATED = Capabilities()


def capabilities_of(backend: object) -> Capabilities:
    """Return the capabilities of a backend or its class. Some capabilities follow from the protocols that the
    backend implements.

    Raises:
        ConfigError: the attribute `capabilities` is not a `Capabilities`. On a class, it may be a descriptor
            that works only on instances.
    """
    capabilities = getattr(backend, "capabilities", SIMULATED)
    if isinstance(backend, type) and hasattr(capabilities, "__get__"):
        capabilities = SIMULATED
    if not isinstance(capabilities, Capabilities):
        kind = backend if isinstance(backend, type) else type(backend)
        raise ConfigError(
            f"robot.backend: {kind.__name__}.capabilities is {capabilities!r}; it must be a "
            "Capabilities, because without one cobot would treat the backend as a simulation that measures "
            "everything"
        )
    if isinstance(backend, TrajectoryDevice):
        return replace(capabilities, trajectories=True)
    capabilities = replace(capabilities, guides=capabilities.freedrive and hasattr(backend, "begin_guiding"))
    if hasattr(backend, "set_impedance"):
        return replace(capabilities, impedance=True, torque=True)
    return capabilities
