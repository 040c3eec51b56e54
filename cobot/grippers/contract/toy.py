"""A working gripper for a toy device. Replace `ToyDevice` by your device.

All units are m, N and s. docs/your-gripper.md of cobot describes the rest.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from cobot.grippers import (
    Grasp,
    GripperCapabilities,
    GripperError,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    PowerLoss,
)

STROKE_M, SPEED_M_S, FORCE_N = 0.1, (0.01, 0.2), (5.0, 50.0)


class ToyDevice:
    """Two fingers that move to a width, and stop at an object between them. Faults are plain attributes.

    Attributes:
        now_s: time on the device's clock.
        object_m: width of the object between the fingers; None for no object.
        unplugged: whether the device does not answer.
        fault: the fault that the device reports; "" for none.
    """

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self.now_s = now_s
        self.object_m: float | None = None
        self.unplugged = False
        self.fault = ""
        self.target_m = self._width_m = STROKE_M
        self._speed_m_s = SPEED_M_S[1]
        self.force_n = 0.0
        self._seen_s = now_s()

    def command(self, width_m: float, speed_m_s: float, force_n: float) -> None:
        """Move to a width."""
        self.width_m()
        self._require_plugged()
        self.target_m, self._speed_m_s, self.force_n = width_m, speed_m_s, force_n

    def width_m(self) -> float:
        """The current width."""
        self._require_plugged()
        now_s = self.now_s()
        step_m, self._seen_s = self._speed_m_s * max(0.0, now_s - self._seen_s), now_s
        before_m = self._width_m
        way_m = self.target_m - before_m
        self._width_m = (
            self.target_m if abs(way_m) <= step_m else before_m + (step_m if way_m > 0 else -step_m)
        )
        if self.object_m is not None and self._width_m < self.object_m <= before_m:
            self._width_m = self.object_m
        return self._width_m

    @property
    def touches(self) -> bool:
        """Whether the fingers press on an object."""
        return self.object_m is not None and self.target_m < self.width_m() == self.object_m

    def _require_plugged(self) -> None:
        if self.unplugged:
            raise OSError("no answer")


DEVICES: dict[str, ToyDevice] = {}
"""The toy devices by address. A driver for a real device does not need this."""


class ToyOptions(GripperOptions):  # next to `type` in robot.gripper: {type: ..., address: ...}
    address: str = "toy"


class ToyGripper:
    """The driver."""

    Options = ToyOptions

    def __init__(self, options: ToyOptions, port: IoPort) -> None:
        self._device = DEVICES.setdefault(options.address, ToyDevice())
        self.capabilities = GripperCapabilities(
            width_m=(0.0, STROKE_M),
            force_n=FORCE_N,
            speed_m_s=SPEED_M_S,
            object_detection=True,
            on_power_loss=PowerLoss.KEEPS,
            hardware=False,
        )

    def connect(self) -> None:
        self.state()

    def disconnect(self) -> None: ...

    def open(self) -> None:
        self.move(STROKE_M, None, None)

    def close(self) -> None:
        self.move(0.0, None, None)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        try:
            self._device.command(width, speed or SPEED_M_S[1], force or FORCE_N[0])
        except OSError as exc:
            raise GripperError(f"the toy does not answer: {exc}; check its plug") from exc

    def grasp(self, grasp: Grasp) -> None:
        narrow = 0.0 if grasp.width is None else grasp.width - grasp.tolerance_inner
        self.move(max(0.0, narrow - 0.002), grasp.speed, grasp.force)

    def release(self, width: float | None) -> None:
        self.move(STROKE_M if width is None else width, None, None)

    def stop(self) -> None:
        state = self.state()
        if state.moving and state.width is not None:
            self.move(state.width, None, None)

    def home(self) -> None:
        self.open()

    def state(self) -> GripperState:
        device = self._device
        try:
            width = device.width_m()
            touches = device.touches
        except OSError as exc:
            raise GripperError(f"the toy does not answer: {exc}; check its plug") from exc
        return GripperState(
            width=width,
            commanded_width=device.target_m,
            moving=width != device.target_m and not touches,
            force=device.force_n if touches else 0.0,
            object=HeldObject.HELD_INSIDE if touches else HeldObject.NONE,
            fault=device.fault,
        )

    @staticmethod
    def contract_rig(options: ToyOptions) -> ToyRig:
        return ToyRig(options)


class ToyRig:
    """The device for `cobot gripper test`. It has a simulated clock instead of waiting."""

    faults = frozenset({"disconnect", "fault"})

    def __init__(self, options: ToyOptions) -> None:
        self._options = options
        self._time_s = 0.0
        self._device = DEVICES[options.address] = ToyDevice(lambda: self._time_s)

    def gripper(self, port: IoPort) -> ToyGripper:
        """Create another driver for the same device."""
        return ToyGripper(self._options, port)

    def step(self, duration_s: float) -> None:
        """Advance the clock."""
        self._time_s += duration_s
        if not self._device.unplugged:
            self._device.width_m()

    def place(self, width_m: float | None) -> None:
        """Put an object between the fingers, or take it away."""
        self._device.object_m = width_m

    def inject(self, fault: str) -> None:
        """Start a fault, which lasts until `clear`."""
        self._device.unplugged = fault == "disconnect"
        self._device.fault = "its motor is too hot" if fault == "fault" else ""

    def clear(self, fault: str) -> None:
        """End a fault."""
        self._device.unplugged, self._device.fault = False, ""
