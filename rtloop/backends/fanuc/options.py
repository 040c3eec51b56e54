"""Options of `type: fanuc` in `robot.backend`."""

from __future__ import annotations

import re
from typing import Annotated, Literal

from pydantic import AfterValidator, ConfigDict, Field

from rtloop.backends.fanuc.messages import PORT, PointType
from rtloop.backends.protocols import BackendOptions

RMI_PORT = 16001
MAX_IO = 64
Port = Annotated[int, Field(ge=1, le=65_535)]
_IO = re.compile(r"([A-Z]{1,2})\[([1-9][0-9]{0,4})\]")


def an_io_point(value: str) -> str:
    """Check the name of an input or output in FANUC's notation."""
    found = _IO.fullmatch(value)
    if found is None or found.group(1) not in PointType.__members__:
        valid = ", ".join(PointType.__members__)
        raise ValueError(f"is not an input or output such as DO[1]; its kind is one of {valid}")
    return value


IoName = Annotated[str, AfterValidator(an_io_point)]


class FanucOptions(BackendOptions):
    """Options of a FANUC controller.

    Attributes:
        address: address of the controller, an IP address or a name.
        rmi_port, stream_port: ports of its Remote Motion Interface (TCP) and of Stream Motion (UDP).
        program: TP program that the controller runs while cobot drives the arm.
        j3: reference of joint 3 in the stream. "relative" means joint 2, as in ROS models; "horizon" means
            the horizon, as on the teach pendant; "auto" determines the reference.
        limits: source of the limits. "table" reads the controller's own limits and compares them with the
            model's; "model" uses only the model's limits, for controllers without a table.
        rated_payload_kg: full payload to which the limits table refers; null to use the tighter of the limits
            without load and at full payload.
        override: speed override to set when the controller is enabled, per cent; null to leave it unchanged.
        payload_schedule: number of the payload schedule to select when the controller is enabled; null to
            leave it unchanged.
        io: inputs and outputs to read and set, such as DI[1], DO[3], RO[1], AI[1] or F[2].
        check_pose: whether to check that the controller reports the model's pose.
        world_z_m: height of the controller's world frame above the model's base, m; null to accept any
            height.
        connect_s: timeout for each part of connecting.
        enable_s: timeout for the controller to permit motion.
        silence_s: time without a packet after which the connection is lost, which is a fault.
        entry_rad: maximum distance of the arm from the first command.
    """

    model_config = ConfigDict(strict=True, allow_inf_nan=False)

    address: Annotated[str, Field(min_length=1, max_length=253)] | None = None
    rmi_port: Port = RMI_PORT
    stream_port: Port = PORT
    program: Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]{0,35}$")] = "STREAM_MOTN"
    j3: Literal["auto", "relative", "horizon"] = "auto"
    limits: Literal["table", "model"] = "table"
    rated_payload_kg: Annotated[float, Field(gt=0.0, le=5000.0)] | None = None
    override: Annotated[int, Field(ge=1, le=100)] | None = 100
    payload_schedule: Annotated[int, Field(ge=1, le=32)] | None = None
    io: Annotated[list[IoName], Field(max_length=MAX_IO)] = Field(default_factory=list)
    check_pose: bool = True
    world_z_m: Annotated[float, Field(ge=-10.0, le=10.0)] | None = None
    connect_s: Annotated[float, Field(ge=0.1, le=15.0)] = 5.0
    enable_s: Annotated[float, Field(ge=0.1, le=30.0)] = 10.0
    silence_s: Annotated[float, Field(ge=0.01, le=60.0)] = 0.1
    entry_rad: Annotated[float, Field(gt=0.0, le=0.2)] = 0.02
