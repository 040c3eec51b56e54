"""python -m benchmarks.ros.stream_client backend|echo DOMAIN: answers each joint state with a command of the
same positions, by the backend `ros2_control_stream`, or by the least node that can do so."""

from __future__ import annotations

import asyncio
import select
import sys

import numpy as np

from benchmarks.ros.controllers import ECHO
from cobot.config import load_settings
from cobot.dds.controller_simulator import COMMANDS
from cobot.dds.names import ENCLAVE, NodeName
from cobot.dds.node import DdsNode, Message
from cobot.dds.rtps import Participant
from cobot.robot.description import load_robot
from cobot.ros.messages import Messages
from cobot.ros.robot_messages import JOINT_STATES
from rtloop.backends import Measured
from rtloop.backends.ros2_control import Ros2ControlStream
from rtloop.realtime import freeze_garbage, prepare


def backend(domain: int) -> None:
    """Run the backend, as punctually as rtloop, until the process is ended."""
    settings = load_settings()
    chosen = settings.robot.backend.model_copy(
        update={"type": "ros2_control_stream", "options": {"connect_s": 20.0, "state_timeout_s": 5.0}}
    )
    ros = settings.ros.model_copy(update={"domain_id": domain, "localhost_only": True})
    robot = settings.robot.model_copy(update={"backend": chosen})
    settings = settings.model_copy(update={"ros": ros, "robot": robot})
    limits = load_robot(settings).limits
    arm = Ros2ControlStream(settings, limits)
    arm.open(np.zeros(limits.dof))
    arm.enable()
    prepare(settings.rt.priority, settings.rt.cpu, settings.rt.cpu_latency_us)
    freeze_garbage()
    measured, command = Measured(limits.dof), np.zeros((3, limits.dof))
    link = arm._stream
    while True:
        select.select([link._socket], [], [], 1.0)  # type: ignore[attr-defined]
        arm.read(measured)
        command[0] = measured.position
        arm.write(command)


async def echo(domain: int) -> None:
    """Echo the positions until the process is ended."""
    name = NodeName("echo")
    participant = Participant(domain, localhost_only=True, name=name.full, user_data=ENCLAVE)
    node = DdsNode(participant, name, Messages(), None, asyncio.get_running_loop())
    commands = node.publisher(ECHO, COMMANDS, depth=1)

    def answer(message: Message) -> None:
        commands.publish({"data": message["position"]})

    node.subscription("/joint_states", JOINT_STATES, answer, reliable=False)
    await asyncio.Event().wait()


if __name__ == "__main__":
    if sys.argv[1] == "backend":
        backend(int(sys.argv[2]))
    asyncio.run(echo(int(sys.argv[2])))
