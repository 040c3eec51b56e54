"""Command line and start of the ROS 2 node."""

from __future__ import annotations

import argparse
import asyncio
import gc
import logging
import os
import re
import signal
from pathlib import Path
from typing import Any

import uvloop

from cobot.access.authentication import ROS_TOKEN_VARIABLE, rights_of_ros, ros_access
from cobot.access.roles import Role
from cobot.config import Settings, load_settings
from cobot.dds.gateway import DdsGateway
from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode
from cobot.dds.options import options
from cobot.dds.parameters import Parameters
from cobot.dds.rosout import RosoutHandler
from cobot.dds.rtps import NetworkError, Participant, ParticipantRecord
from cobot.dds.telemetry import Telemetry
from cobot.errors import CobotError
from cobot.logs import start_logging
from cobot.ros.fingers import gripper_states
from cobot.ros.messages import Messages
from cobot.ros.robot_messages import STRING, TRANSFORMS

NODE = NodeName("cobot")
ROS_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")

log = logging.getLogger("cobot.ros2")


def main() -> int:
    """Serve until SIGTERM. Returns the exit status: 0, or 2 if the process could not start."""
    parser = argparse.ArgumentParser(prog="python -m cobot.dds", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file; by default the one that is part of cobot")
    parser.add_argument(
        "--url",
        default="",
        help="URL of the web service; without a URL, only robot states are published",
    )
    parser.add_argument(
        "--participant-record",
        type=int,
        help="descriptor of the file for the record that announces the end of this process if it is killed",
    )
    arguments = parser.parse_args()
    start_logging("ros2")
    logging.getLogger("websockets").setLevel(logging.WARNING)
    try:
        settings = load_settings(arguments.config)
        start_logging("ros2", settings.logging)
        uvloop.run(_serve(settings, arguments.url, arguments.participant_record))
    except NetworkError as exc:
        log.error("ros.domain_id, ros.interfaces: %s", exc)
        return 2
    except CobotError as exc:
        log.error("%s", exc)
        return 2
    return 0


async def _serve(settings: Settings, url: str, participant_record: int | None) -> None:
    loop = asyncio.get_running_loop()
    ended = asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)
    ros = settings.ros
    participant = Participant(
        ros.domain_id,
        ros.interfaces or None,
        localhost_only=ros.localhost_only,
        peers=ros.peers,
        name=NODE.full,
        user_data=ENCLAVE,
    )
    if participant_record is not None:
        participant.record_in(ParticipantRecord(participant_record))
    node = DdsNode(participant, NODE, Messages(), None if ros.gid_bytes == "auto" else ros.gid_bytes, loop)
    rosout = RosoutHandler(node)
    log.addHandler(rosout)
    log.setLevel(logging.DEBUG if ros.debug else logging.INFO)
    try:
        robots = _robots(node, settings)
        own = {"/tf", "/tf_static", "/robot_description"}.union(*(robot.topics for robot in robots))
        token = os.environ.get(ROS_TOKEN_VARIABLE, "")
        gateway = DdsGateway(node, url, own, token, rights_of_ros(ros, settings.web)) if url else None
        if gateway is not None:
            gateway.listeners = {gripper_states(robot.robot): robot.take_fingers for robot in robots}
        Parameters(node, options(settings, robots, gateway))
        _announce(settings, participant)
        gc.freeze()
        gc.enable()  # `cobot.dds.__main__` has disabled the garbage collection
        work: list[asyncio.Task[Any]] = [asyncio.create_task(ended.wait())]
        if gateway is not None:
            work.append(asyncio.create_task(gateway.run()))
        done, _ = await asyncio.wait(work, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()  # the gateway ends only with an error, which this line raises
        for robot in robots:
            robot.close()
    finally:
        log.removeHandler(rosout)
        node.close()
        participant.close()


def _robots(node: DdsNode, settings: Settings) -> list[Telemetry]:
    """Start the topics of each robot, and the topics that all robots share."""
    transforms = node.publisher("/tf", TRANSFORMS, depth=100)
    prefixes = {name: f"{name}/" if len(settings.each) > 1 else "" for name in settings.each}
    robots = [Telemetry(node, each, prefixes[name], transforms) for name, each in settings.each.items()]
    static = node.publisher("/tf_static", TRANSFORMS, latched=True)
    described = node.publisher("/robot_description", STRING, latched=True)

    def tell() -> None:
        static.publish({"transforms": [each for robot in robots for each in robot.static_transforms]})
        described.publish_cdr(robots[0].description)

    tell()
    for robot in robots:
        robot.on_tool = tell
        robot.start()
    return robots


def _announce(settings: Settings, participant: Participant) -> None:
    ros = settings.ros
    rights = rights_of_ros(ros, settings.web)
    where = "this computer only" if ros.localhost_only else "all networks"
    log.info("ROS 2 on domain %d, %s, as node %s", ros.domain_id, where, NODE.full)
    tokens_needed = settings.web.authentication == "required"
    risky = rights > Role.OBSERVER and (tokens_needed or not ros.localhost_only)
    log.log(logging.WARNING if risky else logging.INFO, "%s", ros_access(ros, settings.web))
    if not participant.multicast:
        log.warning(
            "multicast is not available; only the first participants on this computer and on ros.peers "
            "are found"
        )
    for name in settings.each:
        if not ROS_NAME.fullmatch(name):
            log.warning(
                "the robot's name %r is not a valid ROS name, so ROS tools will reject the robot's "
                "topics; change robot.name",
                name,
            )
