"""Creates the graph with all topics, services and actions that this service offers."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import AsyncIterator, Mapping
from functools import partial

from app.actions.gripper_action import gripper_actions
from app.actions.servo_action import ServoModeAction
from app.aubo.interfaces import PACKAGE, interface_definitions
from app.aubo.registry import REGISTRY, call
from app.graph.ends import Publisher
from app.graph.graph import Graph
from app.offers.robot_topics import RobotTopics
from app.robot_services import Services
from app.rosbridge.rosapi import add_rosapi
from cobot.clock import Clock
from cobot.ros.messages import Message, Messages, ros_time

LOG = "rcl_interfaces/msg/Log"


@contextlib.asynccontextmanager
async def serving(
    robots: Mapping[str, Services], tcps: Mapping[str, str], clock: Clock
) -> AsyncIterator[Graph]:
    """Serve a graph while the context is open.

    Args:
        robots: the services of each robot by name.
        tcps: the name of each robot's TCP.
    """
    messages = Messages()
    messages.add_lazily(interface_definitions())
    graph = Graph(messages, clock)
    add_rosapi(graph)
    graph.warn = partial(_warn, graph.advertise("/rosout", LOG, owner=graph), clock)
    topics = []
    for name, services in robots.items():
        prefix = f"{name}/" if len(robots) > 1 else ""
        topics.append(RobotTopics(graph, services, name, tcps[name], prefix))
        for (robot_class, method), service in REGISTRY.items():
            graph.add_service(
                f"/{name}/{robot_class}/{method}",
                f"{PACKAGE}/srv/{service.type_name}",
                partial(_call, services, robot_class, method),
                owner=graph,
                role=service.role,
            )
        take = partial(_take_control, services)
        graph.add_service(f"/{name}/take_control", "std_srvs/srv/SetBool", take, owner=graph)
        graph.add_action(ServoModeAction(name, services.servo))
        graph.add_action(services.fjt)
        for action in gripper_actions(name, services.gripper, services.ownership):
            graph.add_action(action)
    try:
        yield graph
    finally:
        await graph.close()
        for each in topics:
            each.close()


def _warn(rosout: Publisher, clock: Clock, text: str) -> None:
    """Publish a warning on /rosout, where ROS 2 shows warnings from nodes."""
    if rosout.subscribers:
        stamp = ros_time(clock.wall_ns())
        rosout.publish({"stamp": stamp, "level": logging.WARNING, "name": "cobot", "msg": text})


async def _take_control(services: Services, request: Message) -> Message:
    """Give control to the client if it sends true. It keeps control until it disconnects or the lease
    expires. If the client sends false, release control.
    """
    success, message = await services.control.set_control(request["data"])
    return {"success": success, "message": message}


async def _call(services: Services, robot_class: str, method: str, request: Message) -> Message:
    answer = await call(services, robot_class, method, request)
    return {"code": int(answer.code), "message": answer.message, "result": answer.result}
