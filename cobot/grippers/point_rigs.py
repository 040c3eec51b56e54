"""Simulated devices that are connected to a robot's inputs and outputs, for the contract of their drivers."""

from __future__ import annotations

from typing import TYPE_CHECKING

from cobot.cell import AnyHand
from cobot.grippers.protocol import Gripper, GripperError, IoPort

if TYPE_CHECKING:
    from cobot.grippers.digital import DigitalOptions
    from cobot.grippers.vacuum import VacuumOptions


class PointRig:
    """A robot's inputs and outputs, and a clock.

    Attributes:
        values: values of the points, by name.
        seconds: the time on the clock.
        object_m: width of the object between the fingers; None for no object.
        silent: whether the robot reports nothing.
    """

    faults = frozenset({"disconnect"})

    def __init__(self, values: dict[str, float]) -> None:
        self.values = values
        self.seconds = 10.0
        self.object_m: float | None = None
        self.silent = False

    def now_s(self) -> float:
        """The time on the clock, s."""
        return self.seconds

    def read(self, name: str) -> float:
        """See `IoPort`."""
        if self.silent:
            raise GripperError("the robot does not report its inputs and outputs")
        if name not in self.values:
            raise GripperError(f"the robot has no input or output {name!r}")
        return self.values[name]

    def set(self, name: str, value: float) -> None:
        """See `IoPort`."""
        self.read(name)
        self.values[name] = value

    def place(self, width_m: float | None) -> None:
        """See `GripperRig`, also for `inject` and `clear`."""
        self.object_m = width_m

    def inject(self, fault: str) -> None:
        self.silent = True

    def clear(self, fault: str) -> None:
        self.silent = False


class HandRig(PointRig):
    """The simulated hand of a cell. The fingers move to a width, and stop at an object between them.

    Attributes:
        width: width between the fingers, m.
    """

    def __init__(self, hand: AnyHand) -> None:
        self.hand = hand
        self.width = hand.stroke_m
        super().__init__({})
        self.values |= {"hand.width": self.width, "hand.speed": hand.max_speed_m_s, "hand.force": 0.0}

    def gripper(self, port: IoPort) -> Gripper:
        """Create one more driver for the same hand."""
        from cobot.grippers.simulated import SimulatedGripper

        return SimulatedGripper(self.hand, self, self)

    def read(self, name: str) -> float:
        """See `IoPort`."""
        target = self.values["hand.width"]
        presses = self.width > target and self.width == self.object_m
        measured = {
            "hand.measured_width": self.width,
            "hand.measured_force": self.values["hand.force"] * presses,
            "hand.moving": float(self.width != target and not presses),
        }
        return super().read(name) if self.silent or name not in measured else measured[name]

    def step(self, duration_s: float) -> None:
        """Simulate the next `duration_s`."""
        self.seconds += duration_s
        target = self.values["hand.width"]
        if self.object_m is not None and self.width >= self.object_m:
            target = max(target, self.object_m)
        way_m, step_m = target - self.width, self.values["hand.speed"] * duration_s
        self.width = target if abs(way_m) <= step_m else self.width + (step_m if way_m > 0.0 else -step_m)


class DigitalRig(PointRig):
    """Simulated fingers. One or two valves drive them after a delay, and sensors report that they are fully
    open or closed.
    """

    def __init__(self, options: DigitalOptions) -> None:
        self._options = options
        self._opened = 1.0
        outputs = [name for name in (options.close_output, options.open_output) if name is not None]
        super().__init__(dict.fromkeys(outputs, 0.0))
        if options.open_output is not None:
            self.values[options.open_output] = 1.0
        self.step(0.0)

    def gripper(self, port: IoPort) -> Gripper:
        """Create one more driver for the same fingers."""
        from cobot.grippers.digital import DigitalGripper

        return DigitalGripper(self._options, self, self)

    def step(self, duration_s: float) -> None:
        """Simulate the next `duration_s`."""
        options = self._options
        self.seconds += duration_s
        shut, apart = options.close_output, options.open_output
        closes = self.values[shut] if shut is not None else 1.0 - self.values[apart or ""]
        opens = self.values[apart] if apart is not None else 1.0 - closes
        self._opened += duration_s * (opens / options.open_time_s - closes / options.close_time_s)
        self._opened = min(max(self._opened, self._narrowest), 1.0)
        for name, on in (
            (options.closed_input, self._opened <= 0.0),
            (options.opened_input, self._opened >= 1.0),
        ):
            if name is not None:
                self.values[name] = float(on is not options.inverted_inputs)

    @property
    def _narrowest(self) -> float:
        """The position at which the fingers stop, as a share of the distance from closed to open."""
        options = self._options
        if self.object_m is None:
            return 0.0
        return (self.object_m - options.closed_width) / (options.open_width - options.closed_width)


class VacuumRig(PointRig):
    """A simulated suction cup. The vacuum builds up while it is switched on and a part is at the cup.
    Otherwise it decays.
    """

    BUILD_UP_S = 0.2

    def __init__(self, options: VacuumOptions) -> None:
        self._options = options
        self._vacuum = 0.0
        outputs = (options.output, options.off_value), (options.blow_output, 0.0)
        super().__init__({name: value for name, value in outputs if name is not None})
        self.step(0.0)

    def gripper(self, port: IoPort) -> Gripper:
        """Create one more driver for the same cup."""
        from cobot.grippers.vacuum import VacuumGripper

        return VacuumGripper(self._options, self, self)

    def step(self, duration_s: float) -> None:
        """Simulate the next `duration_s`."""
        options = self._options
        self.seconds += duration_s
        sucks = self.values[options.output] == options.on_value and self.object_m is not None
        self._vacuum += (1.0 if sucks else -1.0) * duration_s / self.BUILD_UP_S
        self._vacuum = min(max(self._vacuum, 0.0), 1.0)
        if options.sensor is not None:
            beyond = (self._vacuum - 0.5) * (1.0 + 4.0 * options.hysteresis)
            self.values[options.sensor] = options.threshold + (-beyond if options.inverted_sensor else beyond)
