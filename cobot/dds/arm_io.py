"""Inputs and outputs of an arm's driver: of a GPIO controller, or of the driver of Universal Robots.

Interfaces of a GPIO controller are called GPIO/INTERFACE; those of Universal Robots digital_in/0,
digital_out/0 and analog_in/0, with the numbers of the driver. Its analog outputs are left out, because it
takes other units than it reports.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Collection
from typing import Protocol

from cobot.dds.caller import ServiceCaller
from cobot.dds.gpio_values import GPIO, message_of, values_of
from cobot.dds.node import DdsNode, Message
from cobot.errors import CobotError
from cobot.robot.sent_outputs import SentOutputs

IO_STATES, SET_IO = "ur_msgs/msg/IOStates", "ur_msgs/srv/SetIO"
SET_DIGITAL_OUT = 1
"""Value of `fun` in a request of SetIO."""
UR_KINDS = ("digital_in", "digital_out", "analog_in")


class ArmIo(Protocol):
    """Inputs and outputs of a driver.

    Attributes:
        values: last values of the used interfaces, by their names.
        heard_s: when they came, on the monotonic clock.
        problem: reason why an output was not set although `set_output` has sent it, or was set late; "" if
            none is known.
    """

    values: dict[str, float]
    heard_s: float
    problem: str

    def set_output(self, interface: str, value: float) -> None:
        """Send the value of an output, without a wait for the driver: a stop may be the next request.

        Raises:
            CobotError: it cannot be sent; the error has the reason.
        """
        ...


class GpioIo:
    """An `ArmIo` of a GPIO controller."""

    def __init__(self, node: DdsNode, controller: str, interfaces: Collection[str], timeout_s: float) -> None:
        """timeout_s: timeout for the report of a value that was set, s."""
        self.values: dict[str, float] = {}
        self.heard_s, self.problem = -math.inf, ""
        self._controller, self._interfaces = controller, interfaces
        self._outputs: dict[str, float] = {}
        self._sent = SentOutputs(timeout_s)
        node.subscription(f"{controller}/gpio_states", GPIO, self._take, reliable=False)
        self._commands = node.publisher(f"{controller}/commands", GPIO, lifespan_s=timeout_s)

    def set_output(self, interface: str, value: float) -> None:
        """Send all outputs that were set so far: the controller keeps only the newest message of its cycle,
        so earlier values must be in it too. A value that was not set in time is not sent again.
        """
        if not self._commands.readers:
            raise CobotError(
                f"{interface} cannot be set: {self._controller}/commands has no subscriber; activate the "
                "GPIO controller, or correct robot.backend.gpio_controller"
            )
        self.problem, now_s = "", time.monotonic()
        self._outputs = {
            name: each for name, each in self._outputs.items() if not self._sent.is_overdue(name, now_s)
        }
        self._outputs[interface] = value
        self._sent.add(interface, value, now_s)
        self._commands.publish(message_of(self._outputs))

    def _take(self, message: Message) -> None:
        found = values_of(message)
        self.values = {each: value for each, value in found.items() if each in self._interfaces}
        self.heard_s = time.monotonic()
        self.problem = self._sent.explain(self.values, self.heard_s) or self.problem


class UrIo:
    """An `ArmIo` of the driver of Universal Robots."""

    def __init__(self, node: DdsNode, controller: str, interfaces: Collection[str], timeout_s: float) -> None:
        """timeout_s: timeout for the answer of the driver, s."""
        self.values: dict[str, float] = {}
        self.heard_s, self.problem = -math.inf, ""
        self._name, self._interfaces, self._timeout_s = f"{controller}/set_io", interfaces, timeout_s
        self._sent = SentOutputs(timeout_s)
        node.subscription(f"{controller}/io_states", IO_STATES, self._take, reliable=False)
        self._service = ServiceCaller(node, self._name, SET_IO, lifespan_s=timeout_s)
        self._calls: set[asyncio.Task[None]] = set()

    def set_output(self, interface: str, value: float) -> None:
        begin = f"{interface} cannot be set: the service {self._name}"
        if not self._service.is_ready:
            raise CobotError(
                f"{begin} has no server; start the driver's io_and_status_controller, or correct "
                "robot.backend.gpio_controller"
            )
        self.problem = ""
        call = asyncio.create_task(self._call(begin, interface, value))
        self._calls.add(call)
        call.add_done_callback(self._calls.discard)

    async def _call(self, begin: str, interface: str, value: float) -> None:
        pin = int(interface.rpartition("/")[2])
        request: Message = {"fun": SET_DIGITAL_OUT, "pin": pin, "state": value}
        sent = self._sent.add(interface, value, time.monotonic())
        try:
            answer = await asyncio.wait_for(self._service.call(request), self._timeout_s)
            if not answer["success"]:
                self._sent.drop(interface, sent)
                self.problem = f"{begin} has rejected it; see the driver's log"
        except TimeoutError:
            sent.is_late = True
            self.problem = f"{begin} has not answered within {self._timeout_s:g} s"
        except CobotError as exc:
            self.problem = f"{begin}: {exc}"

    def _take(self, message: Message) -> None:
        self.values = {
            name: float(each["state"])
            for kind in UR_KINDS
            for each in message[f"{kind}_states"]
            if (name := f"{kind}/{each['pin']}") in self._interfaces
        }
        self.heard_s = time.monotonic()
        self.problem = self._sent.explain(self.values, self.heard_s) or self.problem
