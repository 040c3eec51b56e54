"""A gripper that one or two outputs of the robot open and close. Up to two inputs report its finger
positions.
"""

from __future__ import annotations

from typing import Annotated, Self

from pydantic import Field, model_validator

from cobot.clock import SYSTEM
from cobot.grippers.modbus_points import ModbusOptions, check_names, port_of
from cobot.grippers.point_rigs import DigitalRig
from cobot.grippers.positions import FingerGoal, Name, Seconds, TwoPositions
from cobot.grippers.protocol import (
    GripperCapabilities,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    Now,
    PowerLoss,
)


class DigitalOptions(GripperOptions):
    """Options of `DigitalGripper`. Names are those of GET /robot/io, or of `modbus_points`."""

    close_output: Annotated[
        Name | None, Field(description="Output that closes the fingers while it is on.")
    ] = None
    open_output: Annotated[
        Name | None, Field(description="Output that opens the fingers while it is on.")
    ] = None
    closed_input: Annotated[
        Name | None,
        Field(description="Input that is on if the fingers are closed, with nothing between them."),
    ] = None
    opened_input: Annotated[Name | None, Field(description="Input that is on if the fingers are open.")] = (
        None
    )
    inverted_inputs: Annotated[
        bool, Field(description="true: both inputs are inverted, so that off means on.")
    ] = False
    close_time_s: Annotated[Seconds, Field(description="Time in which the fingers close, s.")] = 0.3
    open_time_s: Annotated[Seconds, Field(description="Time in which the fingers open, s.")] = 0.3
    open_width: Annotated[float, Field(gt=0.0, le=1.0, description="Width between open fingers, m.")] = 0.05
    closed_width: Annotated[float, Field(ge=0.0, le=1.0, description="Width between closed fingers, m.")] = (
        0.0
    )
    on_power_loss: PowerLoss = PowerLoss.UNKNOWN
    modbus: Annotated[
        ModbusOptions | None,
        Field(description="Modbus device whose points are used instead of those of the robot."),
    ] = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.close_output is None and self.open_output is None:
            raise ValueError("close_output or open_output is needed: the name of an output of GET /robot/io")
        if self.close_output == self.open_output:
            raise ValueError("close_output and open_output are the same output; leave one of them out")
        if not self.closed_width < self.open_width:
            raise ValueError(
                f"closed_width is {self.closed_width:g}; it must be below open_width, {self.open_width:g}"
            )
        check_names(
            self.modbus, (self.close_output, self.open_output), (self.closed_input, self.opened_input)
        )
        return self


class DigitalGripper(TwoPositions):
    """The driver for a gripper that digital outputs open and close. If there are two outputs (a valve with
    two coils), exactly one of them is on.

    Without inputs a command is considered finished after `close_time_s` or `open_time_s`. With
    `opened_input`, it is a fault if opening takes three times as long. With `closed_input`, the fingers hold
    an object if they have closed and the input is off.
    """

    Options = DigitalOptions

    def __init__(self, options: DigitalOptions, port: IoPort, clock: Now = SYSTEM) -> None:
        super().__init__(port_of(options.modbus, port), (options.closed_width, options.open_width), clock)
        self._options = options
        self.capabilities = GripperCapabilities(
            width_m=(options.closed_width, options.open_width),
            object_detection=options.closed_input is not None,
            continuous=False,
            on_power_loss=options.on_power_loss,
        )

    @staticmethod
    def contract_rig(options: DigitalOptions) -> DigitalRig:
        """Simulated fingers, driven by the outputs in the options and reporting to the inputs in the
        options.
        """
        return DigitalRig(options.model_copy(update={"modbus": None}))

    def connect(self) -> None:
        """Connect. The outputs show the last command, even if an earlier run of cobot sent it."""
        options = self._options
        self._require_points(
            options.close_output, options.open_output, options.closed_input, options.opened_input
        )
        if self.goal is FingerGoal.NEITHER:
            closes = self._input(options.close_output, False)
            opens = self._input(options.open_output, False)
            if closes is None:
                closes = not opens
            elif opens is None:
                opens = not closes
            if closes is not opens:
                self._adopt(FingerGoal.CLOSED if closes else FingerGoal.OPEN)

    def stop(self) -> None:
        """Stop. These fingers cannot stop between their end positions: two outputs are switched off, and a
        single output does not change.
        """
        options = self._options
        if options.close_output and options.open_output and self._moves():
            self._port.set(options.close_output, 0.0)
            self._port.set(options.open_output, 0.0)
            self.goal = FingerGoal.NEITHER

    def state(self) -> GripperState:
        options = self._options
        closed = self._input(options.closed_input, options.inverted_inputs)
        opened = self._input(options.opened_input, options.inverted_inputs)
        late = self._since_s > self.LATE * self._time_s
        fault = ""
        if self.goal is FingerGoal.OPEN and opened is False and late:
            fault = (
                f"the fingers have not opened within {self.LATE * self._time_s:g} s: {options.opened_input} "
                "is off; check the air, the output and the sensor"
            )
        moving = self._moves() and not fault
        held: HeldObject | None = None
        if closed is not None:
            holds = self.goal is FingerGoal.CLOSED and not moving and not closed
            held = HeldObject.HELD_INSIDE if holds else HeldObject.NONE
        commanded = {FingerGoal.OPEN: options.open_width, FingerGoal.CLOSED: options.closed_width}.get(
            self.goal
        )
        width = options.closed_width if closed else options.open_width if opened else None
        return GripperState(width, commanded, moving, object=held, fault=fault)

    def _drive(self, goal: FingerGoal) -> None:
        options, closes = self._options, goal is FingerGoal.CLOSED
        pairs = [(options.close_output, closes), (options.open_output, not closes)]
        for name, value in sorted(pairs, key=lambda each: each[1]):  # the one switched off comes first
            if name is not None:
                self._port.set(name, float(value))

    @property
    def _time_s(self) -> float:
        return self._options.close_time_s if self.goal is FingerGoal.CLOSED else self._options.open_time_s

    def _moves(self) -> bool:
        if self.goal is FingerGoal.NEITHER:
            return False
        if self.goal is FingerGoal.OPEN and self._options.opened_input is not None:
            opened = self._input(self._options.opened_input, self._options.inverted_inputs)
            return not opened and self._since_s <= self.LATE * self._time_s
        if self.goal is FingerGoal.CLOSED and self._input(
            self._options.closed_input, self._options.inverted_inputs
        ):
            return False
        return self._since_s < self._time_s
