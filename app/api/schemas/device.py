"""Documents about the device behind a robot: what it can do, and how it is."""

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
    """The checks that the acknowledging client confirms."""

    model_config = example({"payload_checked": True})

    payload_checked: bool = Field(
        False,
        description="Tool and load of the arm are those of the model. Not needed if POST /robot/tool has "
        "set them.",
    )


class AcknowledgeAnswer(BaseModel):
    """What was acknowledged."""

    success: Literal[True] = Field(description="Always true.")
    message: str = Field(description="What applies from now on, in words.")
    found: str = Field(
        description='What the first contact had found; "" if there was nothing to acknowledge.'
    )


class DeviceStatusAnswer(BaseModel):
    """State that the device reports; "" and null where it reports nothing."""

    connection: str = Field(description='Such as "connected", or the state of its session.')
    quality: str = Field(description="Of the connection.")
    operation_mode: str = Field(description="T1 (reduced speed, by hand), T2 (by hand) or AUT.")
    safety_stop: str = Field(description='What prevents motions; "" for nothing.')
    drives: str = Field(description="Whether they are on.")
    brakes: str = Field(description="Whether they hold the arm.")
    speed_scaling: float = Field(description="Its own speed override, 0 to 1, which planned motions follow.")
    packets_lost: int = Field(description="Since it was opened.")
    device_time_s: float | None = Field(description="On its own clock, s.")
    text: str = Field(description="Anything else, as a sentence.")


class IoAnswer(BaseModel):
    """An input or output, as the device has reported it."""

    name: str = Field(description="As the device, or the program in its cabinet, calls it.")
    kind: IoKind = Field(description="boolean, digital (a whole number) or analog.")
    direction: Literal["input", "output"] = Field(description="An output can be set.")
    value: bool | int | float | None = Field(
        description="Of its kind; null where the device reports what is no number."
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
    periods_s: list[float] = Field(description="Possible periods of the cycle, s; empty: any.")
    measured: list[str] = Field(description="Which measured values are real.")
    able: list[str] = Field(description=f"Which of {', '.join(FLAGS)} it has.")
    stops: dict[int, bool] = Field(
        description="Stop categories (IEC 60204-1), each with whether the device itself confirms it."
    )
    status: DeviceStatusAnswer | None = Field(description="Report of the device; null: it reports nothing.")
    speed_share: float = Field(description="Share of the planned speed with which it moves now.")
    unacknowledged: str = Field(
        description='What the first contact has found, until it is acknowledged; "" when it is.'
    )
    drives_off: bool = Field(description="Whether a stop of category 1 has switched the drives off.")
    io: list[IoAnswer] = Field(description="Its inputs and outputs, in its own order.")

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
