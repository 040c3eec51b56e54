"""Options of `type: ur` in `robot.backend`."""

from __future__ import annotations

from typing import Annotated

from pydantic import ConfigDict, Field

from rtloop.backends.protocols import BackendOptions

DEFAULT_PORT = 50010
Host = Annotated[str, Field(min_length=1, max_length=253)]


class UrOptions(BackendOptions):
    """Options of a Universal Robots arm.

    Attributes:
        address: the controller's IP address or host name.
        port: TCP port of this computer that the program on the controller connects to; 0 for a free one.
        callback: address of this computer as the controller sees it; None for the address that the connection
            to the controller uses.
        dashboard: whether a start or a reset switches on the arm, releases its brakes and unlocks a
            protective stop. If false, a person must do so at the teach pendant.
        robot_api_port: TCP port of the Robot API, which PolyScope X provides instead of the dashboard server.
        outputs: whether outputs and the speed slider can be set. If true, other RTDE clients cannot set them.
        connect_s: timeout for the connection to the controller, s.
        enable_s: timeout for each step of switching on, s.
        silence_s: time without a package after which cobot enters FAULT, s.
        timeout_s: time without a command after which the program on the controller stops the arm, s.
        stop_rad_s2: deceleration of that stop, rad/s².
        lookahead_s, gain: parameters of `servoj`, which smooths the positions and follows them.
        entry_rad: maximum distance of a joint from the controller's target when commands begin, rad.
        freedrive: whether cobot's program can release the arm for hand guiding. If it is false, the program
            contains none of the URScript functions for hand guiding.
        torque: whether sessions can use an impedance or torques, through the controller's `direct_torque`.
        torque_timeout_s: time without torques after which the program on the controller stops the arm, s.
        check_pose: whether to check that the controller reports the model's pose.
    """

    model_config = ConfigDict(allow_inf_nan=False)

    address: Host
    port: Annotated[int, Field(ge=0, le=65_535)] = DEFAULT_PORT
    callback: Host | None = None
    dashboard: bool = True
    robot_api_port: Annotated[int, Field(ge=1, le=65_535)] = 80
    outputs: bool = True
    connect_s: Annotated[float, Field(ge=0.1, le=15.0)] = 5.0
    enable_s: Annotated[float, Field(ge=0.5, le=60.0)] = 15.0
    silence_s: Annotated[float, Field(ge=0.02, le=60.0)] = 0.1
    timeout_s: Annotated[float, Field(ge=0.02, le=0.2)] = 0.05
    stop_rad_s2: Annotated[float, Field(ge=1.0, le=40.0)] = 10.0
    lookahead_s: Annotated[float, Field(ge=0.03, le=0.2)] = 0.03
    gain: Annotated[float, Field(ge=100.0, le=2000.0)] = 1000.0
    entry_rad: Annotated[float, Field(gt=0.0, le=0.2)] = 0.05
    freedrive: bool = True
    torque: bool = False
    torque_timeout_s: Annotated[float, Field(ge=0.01, le=0.05)] = 0.02
    check_pose: bool = True
