"""Options of `type: rsi` in `robot.backend`."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import ConfigDict, Field, model_validator

from cobot.types import JointLimits
from rtloop.backends.addresses import Address
from rtloop.backends.protocols import BackendOptions
from rtloop.results import ACCEPTED, Accepted, Rejected

DEFAULT_PORT = 59152
KUKA_LIMIT = 5.0
"""KUKA's default for the limits in AXISCORR and AXISCORREXT, degrees or mm."""
ROBOT_AXES = tuple(f"A{number}" for number in range(1, 7))
EXTERNAL_AXES = tuple(f"E{number}" for number in range(1, 7))
MAX_IO = 16
PERIODS_S = {0.004: "#IPO_FAST", 0.012: "#IPO"}
"""The cycle times of RSI, s, with KRL's name for each mode."""

Axis = Literal["A1", "A2", "A3", "A4", "A5", "A6", "E1", "E2", "E3", "E4", "E5", "E6"]
Tag = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,30}$")]
Positive = Annotated[float, Field(gt=0.0, le=100_000.0)]
Name = Annotated[str, Field(pattern=r"^[^/\s\x00-\x1f][^/\x00-\x1f]{0,62}$")]
"""The name of an input or output, at most 63 printable characters."""
Number = Annotated[int, Field(ge=1, le=8192)]


class RsiOptions(BackendOptions):
    """Options of the RobotSensorInterface.

    Attributes:
        address: address of the robot controller; null for the first controller that sends RSI.
        listen: address of this computer that the controller sends to; 0.0.0.0 for any.
        port: UDP port of this computer that the controller sends to (PORT in its Ethernet configuration).
        sen_type: SENTYPE in the controller's Ethernet configuration.
        correction: mode of RSI_ON in the controller's program: #ABSOLUTE or #RELATIVE.
        max_correction: maximum correction of each axis, degrees or mm: one value, or one per joint. It must
            not exceed the limits of AXISCORR, AXISCORREXT and AXISCORRMON in the RSI context.
        axes: the controller's axis for each joint of the model, in the joints' order; null for A1 to A6, then
            E1 and so on.
        axis_tag, external_tag: elements with the corrections, in the controller's Ethernet configuration.
        inputs, outputs: names of digital inputs and outputs, with their numbers in $IN and $OUT.
        timeout_packets: Timeout of the ETHERNET object: number of late answers after which RSI ends.
        connect_s: timeout for the first packet.
        enable_s: timeout for the controller to be ready.
        silence_s: time without a packet after which the connection is lost, which is a fault.
        entry_rad: maximum distance of the arm from the controller's set position when commands begin.
        follow_rad: maximum distance of the arm from the path of the last `FOLLOW_S`.
        check_pose: whether to check that the controller, if it reports a pose, reports the model's pose.
    """

    model_config = ConfigDict(strict=True)

    address: Address | None = None
    listen: Address = "0.0.0.0"
    port: Annotated[int, Field(ge=1, le=65_535)] = DEFAULT_PORT
    sen_type: Tag = "cobot"
    correction: Literal["absolute", "relative"] = "absolute"
    max_correction: Positive | list[Positive] = KUKA_LIMIT
    axes: list[Axis] | None = None
    axis_tag: Tag = "AK"
    external_tag: Tag = "EK"
    inputs: dict[Name, Number] = Field(default_factory=dict, max_length=MAX_IO)
    outputs: dict[Name, Number] = Field(default_factory=dict, max_length=MAX_IO)
    timeout_packets: Annotated[int, Field(ge=1, le=10_000)] = 10
    connect_s: Annotated[float, Field(ge=0.1, le=15.0)] = 10.0
    enable_s: Annotated[float, Field(ge=0.1, le=15.0)] = 3.0
    silence_s: Annotated[float, Field(ge=0.04, le=60.0)] = 0.06
    entry_rad: Annotated[float, Field(gt=0.0, le=0.2)] = 0.02
    follow_rad: Annotated[float, Field(gt=0.0, le=0.5)] = 0.03
    check_pose: bool = True

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.axes is not None and len(set(self.axes)) < len(self.axes):
            twice = next(axis for axis in self.axes if self.axes.count(axis) > 1)
            raise ValueError(f"axes: {twice} is listed twice; each axis must be listed once")
        both = sorted(set(self.inputs) & set(self.outputs))
        if both:
            raise ValueError(f"{both[0]!r} is the name of both an input and an output; rename one of them")
        if self.axis_tag == self.external_tag:
            raise ValueError(f"axis_tag and external_tag are both {self.axis_tag!r}; they must differ")
        return self

    def axes_of(self, limits: JointLimits) -> tuple[str, ...]:
        """Return the controller's axis for each joint."""
        return tuple(self.axes) if self.axes is not None else (ROBOT_AXES + EXTERNAL_AXES)[: limits.dof]

    def limits_of(self, limits: JointLimits) -> list[float]:
        """Return the maximum correction of each joint, degrees or mm."""
        given = self.max_correction
        return list(given) if isinstance(given, list) else [given] * limits.dof

    def check_model(self, limits: JointLimits) -> Accepted | Rejected:
        """Check that these options match a model with the given joints."""
        axes, allowed = self.axes_of(limits), self.limits_of(limits)
        if len(axes) != limits.dof:
            return Rejected(
                f"robot.backend.axes has {len(axes)} axes, but the model has {limits.dof} joints: name "
                f"one axis (A1 to A6, E1 to E6) for each of {', '.join(limits.names)}"
            )
        if len(allowed) != limits.dof:
            return Rejected(
                f"robot.backend.max_correction has {len(allowed)} values, but the model has "
                f"{limits.dof} joints"
            )
        for axis, name, slides in zip(axes, limits.names, limits.slides, strict=False):
            if slides and axis in ROBOT_AXES:
                return Rejected(
                    f"robot.backend.axes: joint {name} is prismatic, but {axis} is a rotary axis of the "
                    "robot; a linear axis is one of E1 to E6"
                )
        return ACCEPTED


def is_external(axis: str) -> bool:
    return axis in EXTERNAL_AXES
