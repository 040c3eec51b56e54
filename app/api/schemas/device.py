"""Models about the device behind a robot: its capabilities and its status."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Literal, Self

from pydantic import BaseModel, Field

from cobot.ipc.device_record import DeviceReport
from cobot.ipc.state_fields import MEASURED_NAMES
from cobot.loose_lists import RequestModel
from cobot.motions.fields import example
from cobot.robot.device import FLAGS
from cobot.robot.io_points import IoKind, IoPoint


class Acknowledge(RequestModel):
    """The checks that a client confirms."""

    model_config = example({"payload_checked": True})

    payload_checked: bool = Field(
        False,
        description="true: the model has the tool and load that the arm really carries. Not needed if POST "
        "/robot/tool has set them.",
    )


class AcknowledgeAnswer(BaseModel):
    """What was acknowledged."""

    success: Literal[True] = Field(description="Always true.")
    message: str = Field(description="The result in words.")
    found: str = Field(description='Findings of the first contact; "" if there was nothing to acknowledge.')


class DeviceStatusAnswer(BaseModel):
    """Status that the device reports; "" and null for values that it does not report."""

    connection: str = Field(description='State of the connection or of the session, such as "connected".')
    quality: str = Field(description="Quality of the connection.")
    operation_mode: str = Field(
        description="Operating mode: T1 (manual, reduced speed), T2 (manual) or AUT (automatic)."
    )
    safety_stop: str = Field(description='Reason why the device permits no motion; "" if it permits motions.')
    drives: str = Field(description="Whether the drives are on.")
    brakes: str = Field(description="Whether the brakes hold the arm.")
    speed_scaling: float = Field(
        description="Speed override of the device, 0 to 1. Planned motions follow it."
    )
    packets_lost: int = Field(description="Number of packets lost since the connection was opened.")
    device_time_s: float | None = Field(description="Time on the device's clock, s.")
    text: str = Field(description="Further information, as a sentence.")


class IoAnswer(BaseModel):
    """An input or output, with the value that the device has reported."""

    name: str = Field(description="Name that the device, or the program in its cabinet, uses.")
    kind: IoKind = Field(description="boolean, digital (a whole number) or analog.")
    direction: Literal["input", "output"] = Field(description="input or output; an output can be set.")
    value: bool | int | float | None = Field(
        description="The value; null if the device reports no finite number."
    )

    @classmethod
    def of(cls, point: IoPoint) -> Self:
        return cls(
            name=point.name,
            kind=point.kind,
            direction="output" if point.is_output else "input",
            value=point.shown,
        )


class DeviceAnswer(BaseModel):
    """The device that moves the robot."""

    backend: str = Field(description="The setting robot.backend.")
    hardware: bool = Field(description="Whether a real device moves.")
    periods_s: list[float] = Field(description="Possible cycle periods, s; empty: any period.")
    measured: list[str] = Field(description="The quantities that are really measured.")
    able: list[str] = Field(description=f"Capabilities of the device, out of: {', '.join(FLAGS)}.")
    stops: dict[int, bool] = Field(
        description="Stop categories (IEC 60204-1), each with whether the device itself confirms it."
    )
    status: DeviceStatusAnswer | None = Field(
        description="Status that the device reports; null: it reports none."
    )
    speed_share: float = Field(description="Current speed, as a share of the planned speed.")
    unacknowledged: str = Field(
        description='Findings of the first contact that are not acknowledged yet; "" without any.'
    )
    drives_off: bool = Field(description="Whether a stop of category 1 has switched the drives off.")
    io: list[IoAnswer] = Field(description="Inputs and outputs, in the device's order.")

    @classmethod
    def of(cls, backend: str, device: DeviceReport, points: Sequence[IoPoint]) -> Self:
        able = device.capabilities
        return cls(
            backend=backend,
            hardware=able.hardware,
            periods_s=list(able.periods_s),
            measured=[name for name in MEASURED_NAMES if name in able.measured],
            able=[name for name in FLAGS if getattr(able, name)],
            stops=dict(able.stops),
            status=None if device.status is None else DeviceStatusAnswer(**asdict(device.status)),
            speed_share=device.share,
            unacknowledged=device.unacknowledged,
            drives_off=device.drives_off,
            io=[IoAnswer.of(each) for each in points],
        )
