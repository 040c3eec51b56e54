"""Options of `type: fri` in `robot.backend`."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from rtloop.backends.addresses import Address
from rtloop.backends.fri.messages import CommandMode
from rtloop.backends.protocols import BackendOptions

DEFAULT_PORT = 30200
COMMAND_MODES = {
    "position": CommandMode.POSITION,
    "torque": CommandMode.TORQUE,
    "wrench": CommandMode.WRENCH,
}


class FriOptions(BackendOptions):
    """Options of the Fast Robot Interface.

    Attributes:
        address: address of the robot controller; null for the first controller that sends FRI.
        listen: address of this computer that the controller sends to; 0.0.0.0 for any.
        port: UDP port of this computer that the controller sends to (`setPortOnRemote` in its program).
        version: version of FRI. "2" includes 2.7, "auto" accepts all versions.
        overlay: command type of the motion in the cabinet's program.
        connect_s: timeout for the first packet.
        enable_s: timeout for the controller to accept commands.
        silence_s: time without a packet after which the connection is lost, which is a fault.
        entry_rad: maximum distance of the arm from the controller's interpolator when commands begin.
        check_pose: whether to check that the controller, if it reports a pose, reports the model's pose.
        min_tracking: minimum tracking performance when commands begin, 0 to 1.
    """

    model_config = ConfigDict(strict=True)

    address: Address | None = None
    listen: Address = "0.0.0.0"
    port: Annotated[int, Field(ge=1, le=65_535)] = DEFAULT_PORT
    version: Literal["auto", "1", "2", "2.7"] = "auto"
    overlay: Literal["position", "torque", "wrench"] = "position"
    connect_s: Annotated[float, Field(ge=0.1, le=15.0)] = 10.0
    enable_s: Annotated[float, Field(ge=0.1, le=15.0)] = 3.0
    silence_s: Annotated[float, Field(ge=0.01, le=60.0)] = 0.1
    entry_rad: Annotated[float, Field(gt=0.0, le=0.2)] = 0.05
    check_pose: bool = True
    min_tracking: Annotated[float, Field(ge=0.0, le=1.0)] = 0.3
