"""`python -m cobot.dds.description SETTINGS`: prints the URDF on the topic robot_description of a namespace.

SETTINGS is a JSON object: `domain_id`, `interfaces`, `localhost_only`, `peers`, `namespace`, `timeout_s`. The
topic is latched (transient local). The exit status is 0. If the URDF cannot be read, it is 1, and a sentence
on standard error gives the reason.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from cobot.dds.arm_client import make_participant
from cobot.dds.names import NodeName, topic_name
from cobot.dds.node import LATCHED_QOS, DdsNode, Message, NodeSubscription
from cobot.errors import CobotError, UnavailableError
from cobot.ros.messages import Messages
from cobot.ros.robot_messages import STRING

NAME = NodeName("cobot_new_robot")
TOPIC = "/robot_description"


async def read_description(settings: dict[str, Any]) -> str:
    """Wait for the URDF and return it.

    Raises:
        UnavailableError: the URDF does not arrive; the message lists the topics of this name that exist.
    """
    loop = asyncio.get_running_loop()
    participant = make_participant(settings, NAME)
    node = DdsNode(participant, NAME, Messages(), None, loop)
    came: asyncio.Future[str] = loop.create_future()

    def take(message: Message) -> None:
        if not came.done():
            came.set_result(message["data"])

    topic = f"{settings['namespace']}{TOPIC}"
    try:
        NodeSubscription(node, topic, STRING, take, LATCHED_QOS)
        return await asyncio.wait_for(came, settings["timeout_s"])
    except TimeoutError as exc:
        ends = participant.discovered()
        there = {end.topic for end in ends if end.kind == "writer" and end.topic.endswith(TOPIC)}
        known = ", ".join(sorted(name.removeprefix(topic_name("")) for name in there)) or "none"
        raise UnavailableError(
            f"nothing was received on {topic} within {settings['timeout_s']:g} s; topics of this name in "
            "domain "
            f"{settings['domain_id']}: {known}. Start the robot_state_publisher, and compare the namespace, "
            "ROS_DOMAIN_ID and ROS_LOCALHOST_ONLY"
        ) from exc
    finally:
        node.close()
        participant.close()


if __name__ == "__main__":
    try:
        sys.stdout.write(asyncio.run(read_description(json.loads(sys.argv[1]))))
    except CobotError as exc:
        print(exc, file=sys.stderr)
        sys.exit(1)
