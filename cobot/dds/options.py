"""The options in the vendor's manual (its chapter 2.5) and cobot's own options, as parameters of the node."""

from __future__ import annotations

import json
import logging
from collections.abc import Awaitable, Callable
from typing import Any

from cobot.config import Settings
from cobot.dds.gateway import DdsGateway
from cobot.dds.parameters import Parameter, Value
from cobot.dds.rosbridge import AWAY
from cobot.dds.telemetry import Telemetry
from cobot.errors import UnavailableError
from cobot.ros.robot_messages import STRING
from cobot.servo.protocol import MAX_PERIOD_S, MAX_TIME_S

MAX_HZ = 1000.0
FIXED = "the value is only read at the start; change ros.{} in the settings file and restart cobot"
NO_ROS = "the value has no effect, because cobot implements DDS itself and needs no ROS installation"

log = logging.getLogger("cobot.ros2")


def options(settings: Settings, robots: list[Telemetry], gateway: DdsGateway | None) -> list[Parameter]:
    """All parameters, and the effect of setting each. This function is long because it is the table of all
    parameters.
    """
    ros = settings.ros

    async def set_debug(value: bool) -> None:
        log.setLevel(logging.DEBUG if value else logging.INFO)

    async def set_rate(value: float) -> None:
        for robot in robots:
            robot.joint_states.rate_hz = value

    def later(key: str) -> Callable[[Any], Awaitable[None]]:
        async def tell(value: Value) -> None:
            """Send the value on joint_cmd, as a client would. The latest value is then used."""
            command = json.dumps({"type": "fjt_control", key: value})
            for name in settings.each:
                if gateway is None or not gateway.publish(f"/{name}/joint_cmd", STRING, {"data": command}):
                    raise UnavailableError(AWAY)

        return tell

    def fixed(name: str, value: Value, doc: str, key: str | None = None) -> Parameter:
        return Parameter(name, value, doc, fixed=FIXED.format(key or name))

    domain = "the domain, ROS_DOMAIN_ID"
    return [
        fixed("domain_id", ros.domain_id, domain),
        fixed("domin_id", ros.domain_id, f"{domain}; spelled as in the manual", "domain_id"),
        fixed("localhost_only", int(ros.localhost_only), "1: this computer only; ROS_LOCALHOST_ONLY"),
        Parameter("rmw_imp", "", "the implementation of the ROS middleware", fixed=NO_ROS),
        Parameter("rmw_qos_file", "", "profiles of Fast DDS", fixed=NO_ROS),
        Parameter("ament_prefix_env", "", "path of the ROS installation", fixed=NO_ROS),
        Parameter("ld_library_env", "", "path of the ROS libraries", fixed=NO_ROS),
        Parameter(
            "legacy_names",
            False,
            "whether older names are used too",
            fixed="there have never been other names",
        ),
        Parameter(
            "use_sim_time",
            False,
            "whether the time of /clock is used",
            fixed="measurements have the time of the system clock",
        ),
        Parameter("debug", ros.debug, "whether the log is more detailed", set_debug),
        Parameter(
            "joint_states_rate_hz",
            ros.joint_states_rate_hz,
            "rate of joint states, messages per second",
            set_rate,
            low=1.0,
            high=MAX_HZ,
        ),
        Parameter(
            "enable_fjt_action",
            ros.enable_fjt_action,
            "whether follow_joint_trajectory accepts goals",
            later("enable_fjt_action"),
        ),
        Parameter(
            "fjt_mode",
            ros.fjt_mode,
            "servo mode of follow_joint_trajectory, 0 for none",
            later("fjt_mode"),
            low=0,
            high=7,
        ),
        Parameter(
            "fjt_time",
            ros.fjt_time,
            "time of each servo point, s; 0: fjt_send_period",
            later("fjt_time"),
            low=0.0,
            high=MAX_TIME_S,
        ),
        Parameter(
            "fjt_send_period",
            ros.fjt_send_period,
            "period between servo points, s; 0: 0.01",
            later("fjt_send_period"),
            low=0.0,
            high=MAX_PERIOD_S,
        ),
    ]
