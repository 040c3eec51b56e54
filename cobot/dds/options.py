"""The options in the vendor's manual (its chapter 2.5) and cobot's own options, as parameters of the node."""

from __future__ import annotations

import json
import logging
import math

from cobot.config import RosSection, Settings
from cobot.dds.gateway import DdsGateway
from cobot.dds.parameters import Parameter, Value
from cobot.dds.rosbridge import AWAY
from cobot.dds.telemetry import Telemetry
from cobot.errors import UnavailableError
from cobot.ros.robot_messages import STRING
from cobot.servo.protocol import MAX_PERIOD_S, MAX_TIME_S

MAX_HZ = 1000.0
FIXED = "the value is only read at the start; change ros.{} in the settings file and restart cobot"
SYSTEM_TIME = "measurements have the time of the system clock"
NO_ROS = "the value has no effect, because cobot implements DDS itself and needs no ROS installation"

log = logging.getLogger("cobot.ros2")


def options(settings: Settings, robots: list[Telemetry], gateway: DdsGateway | None) -> list[Parameter]:
    """All parameters, and the effect of setting each."""
    ros = settings.ros

    async def set_debug(value: bool) -> None:
        log.setLevel(logging.DEBUG if value else logging.INFO)

    async def set_rate(value: float) -> None:
        for robot in robots:
            robot.joint_states.rate_hz = value

    def sent(name: str, value: Value, doc: str, low: float = -math.inf, high: float = math.inf) -> Parameter:
        async def tell(value: Value) -> None:
            """Send the value on joint_cmd, as a client would. The latest value is then used."""
            command = json.dumps({"type": "fjt_control", name: value})
            for robot in settings.each:
                if gateway is None or not gateway.publish(f"/{robot}/joint_cmd", STRING, {"data": command}):
                    raise UnavailableError(AWAY)

        return Parameter(name, value, doc, tell, low=low, high=high)

    rate, rate_doc = "joint_states_rate_hz", "rate of joint states, messages per second"
    return [
        *_unchangeable(ros),
        Parameter("debug", ros.debug, "whether the log is more detailed", set_debug),
        Parameter(rate, ros.joint_states_rate_hz, rate_doc, set_rate, low=1.0, high=MAX_HZ),
        sent("enable_fjt_action", ros.enable_fjt_action, "whether follow_joint_trajectory accepts goals"),
        sent("fjt_mode", ros.fjt_mode, "servo mode of follow_joint_trajectory, 0 for none", 0, 7),
        sent("fjt_time", ros.fjt_time, "time of each servo point, s; 0: fjt_send_period", 0.0, MAX_TIME_S),
        sent(
            "fjt_send_period",
            ros.fjt_send_period,
            "period between servo points, s; 0: 0.01",
            0.0,
            MAX_PERIOD_S,
        ),
    ]


def _unchangeable(ros: RosSection) -> list[Parameter]:
    """The parameters that cannot be set, each with the reason."""
    domain, localhost = "the domain, ROS_DOMAIN_ID", "1: this computer only; ROS_LOCALHOST_ONLY"
    as_spelled = f"{domain}; spelled as in the manual"
    return [
        Parameter(name, value, doc, fixed=why)
        for name, value, doc, why in (
            ("domain_id", ros.domain_id, domain, FIXED.format("domain_id")),
            ("domin_id", ros.domain_id, as_spelled, FIXED.format("domain_id")),
            ("localhost_only", int(ros.localhost_only), localhost, FIXED.format("localhost_only")),
            ("rmw_imp", "", "the implementation of the ROS middleware", NO_ROS),
            ("rmw_qos_file", "", "profiles of Fast DDS", NO_ROS),
            ("ament_prefix_env", "", "path of the ROS installation", NO_ROS),
            ("ld_library_env", "", "path of the ROS libraries", NO_ROS),
            ("legacy_names", False, "whether older names are used too", "there have never been other names"),
            ("use_sim_time", False, "whether the time of /clock is used", SYSTEM_TIME),
        )
    ]
