"""A suction cup that is connected to an output of the robot. It is an ejector, with or without blow-off and a
vacuum sensor.
"""

from __future__ import annotations

import math
from typing import Annotated, Self

from pydantic import Field, model_validator

from cobot.clock import SYSTEM
from cobot.grippers.modbus_points import ModbusOptions, check_names, port_of
from cobot.grippers.point_rigs import VacuumRig
from cobot.grippers.positions import FingerGoal, Name, Seconds, TwoPositions
from cobot.grippers.protocol import (
    GripperCapabilities,
    GripperError,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    Now,
    PowerLoss,
)
from cobot.motions.fields import Finite

REPORT_S = 0.02
"""Time after a command in which an input may still have its previous value, s."""
OF_SENSOR = ("threshold", "hysteresis", "inverted_sensor")
OF_BLOW = ("blow_value", "blow_time_s")


class VacuumOptions(GripperOptions):
    """Options of `VacuumGripper`. Names are those of GET /robot/io, or of `modbus_points`."""

    output: Annotated[
        Name, Field(description="Output that switches the ejector or the pump: boolean or analog.")
    ]
    on_value: Annotated[Finite, Field(description="Value of the output for vacuum.")] = 1.0
    off_value: Annotated[Finite, Field(description="Value of the output for no vacuum.")] = 0.0
    blow_output: Annotated[Name | None, Field(description="Output that blows the part off at a release.")] = (
        None
    )
    blow_value: Annotated[
        Finite, Field(description="Value of blow_output during the blow-off; otherwise it is 0.")
    ] = 1.0
    blow_time_s: Annotated[Seconds, Field(description="Duration of the blow-off, s.")] = 0.2
    sensor: Annotated[Name | None, Field(description="Input with a vacuum switch or a pressure sensor.")] = (
        None
    )
    threshold: Annotated[
        Finite, Field(description="A part is held while the sensor is at this value or above.")
    ] = 0.5
    hysteresis: Annotated[
        Finite,
        Field(ge=0.0, description="A part is lost when the sensor is below the threshold by more than this."),
    ] = 0.0
    inverted_sensor: Annotated[
        bool,
        Field(
            description="true: a part is held at or below the threshold, as with an absolute pressure sensor."
        ),
    ] = False
    grasp_time_s: Annotated[
        Seconds,
        Field(description="Time for the vacuum to build up, s; otherwise no part is held."),
    ] = 1.0
    release_time_s: Annotated[Seconds, Field(description="Time in which the part comes off, s.")] = 0.3
    on_power_loss: PowerLoss = PowerLoss.UNKNOWN
    modbus: Annotated[
        ModbusOptions | None,
        Field(description="Modbus device whose points are used instead of those of the robot."),
    ] = None

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.output == self.blow_output:
            raise ValueError("output and blow_output are the same output; leave blow_output out")
        if self.on_value == self.off_value:
            raise ValueError(f"on_value and off_value are both {self.on_value:g}; they must differ")
        if self.blow_value == 0.0:
            raise ValueError(
                "blow_value is 0, which is the value of the output when it does not blow; give another value"
            )
        for needed, names in (("sensor", OF_SENSOR), ("blow_output", OF_BLOW)):
            alone = [name for name in names if name in self.model_fields_set]
            if alone and getattr(self, needed) is None:
                raise ValueError(f"{alone[0]} needs {needed}: the name of a point of GET /robot/io")
        check_names(self.modbus, (self.output, self.blow_output), (self.sensor,))
        return self


class VacuumGripper(TwoPositions):
    """The driver for a suction cup, see the module. A cup has no width: `grasp` switches the vacuum on, and
    `release` switches it off.

    With a sensor, a grasp ends as soon as there is vacuum, and a release as soon as there is none. Without a
    sensor both take the configured times, and it is not known whether a part is held. A stop does not change
    the vacuum.
    """

    Options = VacuumOptions

    def __init__(self, options: VacuumOptions, port: IoPort, clock: Now = SYSTEM) -> None:
        super().__init__(port_of(options.modbus, port), None, clock)
        self._options = options
        self._vacuum = False
        self.capabilities = GripperCapabilities(
            width_m=None,
            object_detection=options.sensor is not None,
            continuous=False,
            on_power_loss=options.on_power_loss,
        )

    @staticmethod
    def contract_rig(options: VacuumOptions) -> VacuumRig:
        """A rig with a simulated cup that is connected to this output. A part can close the cup."""
        return VacuumRig(options.model_copy(update={"modbus": None}))

    def connect(self) -> None:
        """Connect. The output shows the last command, even if an earlier run of cobot sent it."""
        options = self._options
        self._require_points(options.output, options.blow_output, options.sensor)
        if self.goal is FingerGoal.NEITHER:
            value = self._port.read(options.output)
            sucks = abs(value - options.on_value) < abs(value - options.off_value)
            self._adopt(FingerGoal.CLOSED if sucks else FingerGoal.OPEN)

    def stop(self) -> None:
        """End the blow-off. A held part stays held."""
        if self._options.blow_output is not None:
            self._port.set(self._options.blow_output, 0.0)
        if self.goal is FingerGoal.OPEN:
            self._adopt(FingerGoal.OPEN, max(self._since_s, self._release_s))

    def state(self) -> GripperState:
        vacuum = self._has_vacuum()
        self._end_blow()
        late_s = self.LATE * self._release_s
        moving = self._since_s < REPORT_S or self._is_under_way(vacuum, late_s)
        fault = ""
        if self.goal is FingerGoal.OPEN and vacuum and not moving:
            fault = (
                f"there is still vacuum {late_s:g} s after the release: {self._options.sensor} reports it; "
                "check the valve, the cup, its filter and the threshold"
            )
        held: HeldObject | None = None
        if vacuum is not None:
            holds = self.goal is FingerGoal.CLOSED and vacuum and not moving
            held = HeldObject.HELD_INSIDE if holds else HeldObject.NONE
        return GripperState(None, None, moving, object=held, fault=fault)

    def _is_under_way(self, vacuum: bool | None, late_s: float) -> bool:
        options = self._options
        if self.goal is FingerGoal.CLOSED:
            return not vacuum and self._since_s < options.grasp_time_s
        if vacuum is not None:
            return (vacuum and self._since_s < late_s) or self._since_s < self._blow_time_s
        return self._since_s < self._release_s

    def _has_vacuum(self) -> bool | None:
        """Whether the vacuum is strong enough to hold a part, with hysteresis; None without a sensor."""
        options = self._options
        if options.sensor is None:
            return None
        value = self._port.read(options.sensor)
        if not math.isfinite(value):
            raise GripperError(f"the sensor {options.sensor} reports {value:g}; check its wire")
        beyond = options.threshold - value if options.inverted_sensor else value - options.threshold
        self._vacuum = beyond >= (-options.hysteresis if self._vacuum else 0.0)
        return self._vacuum

    def _end_blow(self) -> None:
        name = self._options.blow_output
        if name is not None and self._since_s >= self._blow_time_s and self._port.read(name) != 0.0:
            self._port.set(name, 0.0)

    def _drive(self, goal: FingerGoal) -> None:
        options, grasps = self._options, goal is FingerGoal.CLOSED
        if options.blow_output is not None and grasps:
            self._port.set(options.blow_output, 0.0)
        self._port.set(options.output, options.on_value if grasps else options.off_value)
        if options.blow_output is not None and not grasps:
            self._port.set(options.blow_output, options.blow_value)

    @property
    def _blow_time_s(self) -> float:
        return 0.0 if self._options.blow_output is None else self._options.blow_time_s

    @property
    def _release_s(self) -> float:
        """Duration of a release, s."""
        return max(self._options.release_time_s, self._blow_time_s)
