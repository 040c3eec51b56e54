"""What a backend is: one protocol that all have, and those that some have beside it.

    Backend              all: open, enable, read, write, disable, close
    Paced                the device gives the beat
    Reporting            the device says how it is
    Stepwise             enabling and recovering take time, in which its packets are answered
    ImpedanceControlled  the drives can be told how to give way
    TorqueControlled     they take torques on top of positions
    WrenchControlled     they take a force of the TCP on top of positions
    CarriesTool          they have to know what they carry
    HasIo                it has inputs and outputs by name

A device that takes no command a cycle, because it is slower or plans by itself, has another protocol, and is
driven as a `Backend` by `rtloop.backends.trajectory_driver`:

    TrajectoryDevice     takes whole motions: load, start, progress, stop, state

What a device can do stands in its class as `capabilities`, its options as `Options`, what it imports only
when it is made as `sdk`, and the simulated device that the contract is run on as `contract_rig`
(`rtloop.contract.rig`). docs/your-backend.md leads through them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

from pydantic import BaseModel, ConfigDict

from cobot.errors import ConfigError
from cobot.robot.device import Capabilities, DeviceStatus
from cobot.robot.io_points import IoPoint
from cobot.robot.tool import Tool
from cobot.types import Array
from rtloop.backends.compiled import Measured


class BackendError(Exception):
    """A device does not answer, refuses or reports a fault; the text goes to the user as the reason."""


class BackendOptions(BaseModel):
    """Base of a backend's `Options`: what may stand beside `type` in `robot.backend`. A path is best a
    `cobot.config.Location`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)


class Backend(Protocol):
    """A robot arm that takes a joint command each cycle.

    The constructor is called with (settings, limits). `open`, `enable`, `disable` and `close` may block;
    `read` and `write` are called each cycle and must be real-time safe: bounded, no allocation on
    purpose, no I/O but the device's own. Each method may raise BackendError.

    A class may have an attribute `capabilities`, a `Capabilities`; one without is taken for a simulation that
    measures everything and can be driven with any period. It may have an attribute `Options`, a model of
    pydantic (`BackendOptions`); its instance is `settings.backend_options(Options)`. `cobot backend test`
    says whether it keeps what is promised here.
    """

    def open(self, initial_position: Array) -> None:
        """Connect. A simulation stands at `initial_position`, shape (dof,), rad; a robot is where it is."""
        ...

    def enable(self) -> None:
        """Switch the drives on, holding the position; also after a fault, once its cause is gone."""
        ...

    def read(self, measured: Measured) -> None:
        """Fill in what is measured."""
        ...

    def write(self, command: Array) -> None:
        """Command where the joints should be now, shape (3, dof): rad, rad/s, rad/s²."""
        ...

    def disable(self) -> None:
        """Switch the drives off, brakes on."""
        ...

    def close(self) -> None:
        """Let go of the device."""
        ...


@runtime_checkable
class Paced(Protocol):
    """A device that gives the beat: rtloop waits for it in place of its own clock."""

    def wait(self, timeout_s: float) -> bool:
        """Wait for the device's next packet; of several that have piled up, the newest counts.

        A beat is a cycle: `read`, `write` and the path go on by one period. Without one, `read` is still
        called and says in a BackendError if that lasts too long; nothing is written and no path goes on.

        Returns:
            Whether there was a packet; False after `timeout_s`, never before.

        Raises:
            BackendError: the connection is gone; rtloop goes by its own clock until `wait` works again.
        """
        ...


@runtime_checkable
class Reporting(Protocol):
    """A device that says how it is."""

    def status(self) -> DeviceStatus:
        """How it is now. Called some times a second, between two cycles; it may not wait for the device."""
        ...


@runtime_checkable
class Stepwise(Protocol):
    """A device that takes its time to be enabled, or to recover from a fault, and wants its packets answered
    meanwhile: for a reset rtloop calls `wait`, `read`, one step and `write` (of where the arm is), cycle by
    cycle, in place of `enable`, which is called once, at the start, before the first cycle.
    """

    def enable_step(self) -> bool:
        """A bit of `enable`; whether it is done. BackendError: it cannot be enabled, with the reason."""
        ...

    def recover_step(self) -> bool:
        """A bit of what a reset after a fault or an e-stop needs before `enable_step`; whether it is done.

        Raises:
            BackendError: it cannot recover, with the reason.
        """
        ...


@dataclass(frozen=True, slots=True)
class Impedance:
    """How the arm gives way around its commanded position: springs and dampers.

    Attributes:
        cartesian: whether they act on the TCP along the base frame's axes (then 6 each, N/m and N·m/rad;
            the null space is held by the joints' own springs) or on the joints (dof each, N·m/rad).
        stiffness: of the springs.
        damping_ratio: of each spring with the inertia that it moves; 1 is critical.
    """

    cartesian: bool
    stiffness: Array
    damping_ratio: Array


@runtime_checkable
class ImpedanceControlled(Protocol):
    """A backend whose drives control torque: it can be told how to give way.

    Attributes:
        nominal_stiffness: of the joints at their stiffest, shape (dof,), N·m/rad.
        nominal_cartesian_stiffness: of the TCP at its stiffest, shape (6,), N/m and N·m/rad.
    """

    nominal_stiffness: Array
    nominal_cartesian_stiffness: Array

    def set_impedance(self, impedance: Impedance | None) -> None:
        """From the next cycle on, at rest; None for position control. Real-time safe, or some cycles.

        Raises:
            BackendError: the robot refuses: no session begins, or its end is a fault.
        """
        ...


@runtime_checkable
class TorqueControlled(Protocol):
    """A backend whose drives give way in their own manner and take torques on top of the commanded position:
    for a stream of torques, unless it is `ImpedanceControlled`.
    """

    def write_torque(self, torque: Array) -> None:
        """To be added from the next `write` on, shape (dof,), N·m. Real-time safe."""
        ...


@runtime_checkable
class WrenchControlled(Protocol):
    """Likewise of a force at the TCP: for force control in a stream of poses."""

    def write_wrench(self, wrench: Array) -> None:
        """What the TCP shall exert from the next `write` on, shape (6,), N and N·m, along the base frame's
        axes. Real-time safe.
        """
        ...


@runtime_checkable
class CarriesTool(Protocol):
    """A backend whose drives have to know what they carry, as those that make up for gravity themselves."""

    def set_tool(self, tool: Tool) -> None:
        """From the next cycle on. Called before `open`, if there is a tool then, and while the arm rests: it
        may take some cycles, and the arm must not move.

        Raises:
            BackendError: the robot cannot carry it; nothing has changed.
        """
        ...


@runtime_checkable
class HasIo(Protocol):
    """A device with inputs and outputs that have names; `capabilities.io` says that it has them."""

    def io(self) -> Sequence[IoPoint]:
        """All of them, as the device has reported them last; called as `Reporting.status`."""
        ...

    def set_output(self, name: str, value: float) -> None:
        """Have an output of `io` set with the next `write`, or soon; it is done when `io` says so. Called
        between two cycles: it may not wait for the device.

        Args:
            value: of its kind, see `cobot.robot.io_points`; of a boolean 0 or 1.

        Raises:
            BackendError: the device does not take it now, with why.
        """
        ...


@runtime_checkable
class TrajectoryDevice(Protocol):
    """A robot arm that takes a whole motion at a time and moves along it by itself, in place of a `Backend`.

    Constructor and attributes are as a `Backend`'s; `Reporting`, `CarriesTool` and `HasIo` may stand beside
    it. Each
    method may raise BackendError, and all may wait for the device for some tenths of a second: they are
    called one at a time, by a thread that no cycle waits for.

    Two attributes may say more: `state_period_s`, how often the device is asked how far it is (0.05), and
    `point_period_s`, how far apart the points of a motion are (0.02).
    """

    def open(self, initial_position: Array) -> None:
        """See `Backend`; so are `enable`, `disable` and `close`."""
        ...

    def enable(self) -> None: ...

    def disable(self) -> None: ...

    def close(self) -> None: ...

    def state(self, measured: Measured) -> None:
        """Fill in what is measured now. BackendError: it stands still although it should not, with why."""
        ...

    def load(self, times_s: Array, rows: Array) -> None:
        """Take a motion over, from rest where the arm is to rest; nothing moves yet.

        Args:
            times_s: of its points, shape (n,), from 0 on.
            rows: position, velocity and acceleration there, shape (3, n, dof): rad, rad/s, rad/s². The arm
                has to come through all of them; between them a quintic is exact.
        """
        ...

    def start(self) -> None:
        """Begin to move along what was loaded last."""
        ...

    def progress(self) -> float:
        """How much of it is done, s of its own time: the last of `times_s` when the arm has arrived. A device
        that has slowed down says less than a clock.
        """
        ...

    def stop(self) -> None:
        """Come to rest, on the path where it can; also if nothing moves."""
        ...


@runtime_checkable
class MovesByItself(Protocol):
    """What a `Backend` has whose device was given a whole motion. Real-time safe."""

    def begin(self, breakpoints_s: Array, coefficients: Array, share: float) -> None:
        """Have the device load this path and move along it, so much slower: `cobot.trajectory.Trajectory`."""
        ...

    def done_s(self) -> float:
        """How far along that path the arm was when it was read last, s of the path's time."""
        ...

    def halt(self) -> None:
        """Have it come to rest."""
        ...

    def is_halted(self) -> bool:
        """Whether the device has been told to, or cannot be: then what is measured says where it is."""
        ...


class NoOptions(BackendOptions):
    """Of a backend that has none."""


SIMULATED = Capabilities()


def capabilities_of(backend: object) -> Capabilities:
    """Of a backend or its class; the methods of some protocols say by themselves what it can.

    Raises:
        ConfigError: its attribute is something else. That of a class may be there for its instances alone.
    """
    capabilities = getattr(backend, "capabilities", SIMULATED)
    if isinstance(backend, type) and hasattr(capabilities, "__get__"):
        capabilities = SIMULATED
    if not isinstance(capabilities, Capabilities):
        kind = backend if isinstance(backend, type) else type(backend)
        raise ConfigError(
            f"robot.backend: {kind.__name__}.capabilities is {capabilities!r}, it has to be a Capabilities: "
            "without one a backend would count as a simulation that measures everything"
        )
    if isinstance(backend, TrajectoryDevice):
        return replace(capabilities, trajectories=True)
    if hasattr(backend, "set_impedance"):
        return replace(capabilities, impedance=True, torque=True)
    return capabilities
