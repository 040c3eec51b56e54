"""Inputs and outputs of an arm's driver, through a GPIO controller or through the driver's services.

The interfaces of a GPIO controller are called GPIO/INTERFACE. The names of those that use services are
defined in `cobot.ros.driver_io`.
"""

from __future__ import annotations

import asyncio
import math
import time
from collections.abc import Collection, Coroutine
from typing import Protocol

from cobot.dds.caller import ServiceCaller
from cobot.dds.gpio_values import GPIO, message_of, values_of
from cobot.dds.node import DdsNode, Message
from cobot.errors import CobotError
from cobot.foreign import joined_text
from cobot.robot.sent_outputs import SentOutput, SentOutputs
from cobot.ros.driver_io import DRIVERS, MAX_AGE_S, DriverIoKind, DriverIoService

IO_STATES = "ur_msgs/msg/IOStates"
READ_S = 0.2
"""Time between two readings of all inputs and outputs of one kind, s."""


class ArmIo(Protocol):
    """Inputs and outputs of a driver.

    Attributes:
        values: latest values of the interfaces in use, by name.
        heard_s: time at which the values arrived, on the monotonic clock.
        problem: the reason why an output that `set_output` has sent was not set or was set late, or why an
            interface cannot be read; "" if there is no known problem.
    """

    @property
    def values(self) -> dict[str, float]: ...

    @property
    def heard_s(self) -> float: ...

    @property
    def problem(self) -> str: ...

    def set_output(self, interface: str, value: float) -> None:
        """Send an output value. This call does not wait for the driver, because the next request may be a
        stop.

        Raises:
            CobotError: the value cannot be sent; the error gives the reason.
        """
        ...


class GpioIo:
    """An `ArmIo` that uses a GPIO controller."""

    def __init__(self, node: DdsNode, controller: str, interfaces: Collection[str], timeout_s: float) -> None:
        """
        Args:
            timeout_s: time within which the controller must report a value that was set, s.
        """
        self.values: dict[str, float] = {}
        self.heard_s, self.problem = -math.inf, ""
        self._controller, self._interfaces = controller, interfaces
        self._outputs: dict[str, float] = {}
        self._sent = SentOutputs(timeout_s)
        node.subscription(f"{controller}/gpio_states", GPIO, self._take, reliable=False)
        self._commands = node.publisher(f"{controller}/commands", GPIO, lifespan_s=timeout_s)

    def set_output(self, interface: str, value: float) -> None:
        """Send all outputs that were set so far. A value that was not set in time is not sent again.

        The controller uses only the newest message of its cycle, so each message must also contain the
        earlier values.
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


class ServiceIo:
    """The outputs of an `ArmIo` that uses the services of a driver."""

    def __init__(
        self, node: DdsNode, driver: str, below: str, interfaces: Collection[str], timeout_s: float
    ) -> None:
        """
        Args:
            driver: driver name in `DRIVERS`.
            below: prefix of the names of the services.
            timeout_s: timeout for an answer from the driver, s.
        """
        self._driver, self._below, self._timeout_s = DRIVERS[driver], below, timeout_s
        self._places = {each: self._place(each) for each in interfaces}
        self._problem = ""
        self._sent = SentOutputs(timeout_s)
        used = [each for kind, _ in self._places.values() for each in (kind.read, kind.write)]
        self._services = {
            each.name: ServiceCaller(node, f"{below}/{each.name}", each.type, lifespan_s=timeout_s)
            for each in {each.name: each for each in used if each is not None}.values()
        }
        self._tasks: set[asyncio.Task[None]] = set()

    @property
    def problem(self) -> str:
        return self._problem

    def set_output(self, interface: str, value: float) -> None:
        kind, number = self._places[interface]
        assert kind.write is not None, "this output is not in the options"
        begin = self._begin(f"{interface} cannot be set", kind.write)
        if not self._services[kind.write.name].is_ready:
            raise CobotError(self._without_server(begin))
        self._problem = ""
        self._start(self._set(begin, interface, kind.write, number, value))

    def _place(self, interface: str) -> tuple[DriverIoKind, int]:
        found = self._driver.kind(interface)
        assert found is not None, "this interface is not in the options"
        return found

    def _start(self, work: Coroutine[None, None, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def _begin(self, failed: str, service: DriverIoService) -> str:
        """The beginning of a message about a service."""
        return f"{failed}: the service {self._below}/{service.name}"

    def _without_server(self, begin: str) -> str:
        return f"{begin} has no server; {self._driver.remedy}, or correct robot.backend.gpio_controller"

    async def _set(
        self, begin: str, interface: str, service: DriverIoService, number: int, value: float
    ) -> None:
        sent = self._sent.add(interface, value, time.monotonic())
        request = {**service.fixed, service.number: number, service.value: int(value)}
        try:
            answer = await self._ask(begin, service, request)
        except CobotError as exc:
            sent.is_late = isinstance(exc.__cause__, TimeoutError)
            self._problem = str(exc)
            return
        if problem := _rejection(begin, service, answer):
            self._problem = problem
            self._sent.drop(interface, sent)
        else:
            self._confirm(interface, value, sent)

    def _confirm(self, interface: str, value: float, sent: SentOutput) -> None:
        """Record that the driver has set an output."""

    async def _ask(self, begin: str, service: DriverIoService, request: Message) -> Message:
        """Call one of the driver's services, and return its answer.

        Raises:
            CobotError: there is no answer (the cause is then a TimeoutError), or it cannot be read.
        """
        try:
            async with asyncio.timeout(self._timeout_s):  # wait_for may ignore the cancellation of the task
                return await self._services[service.name].call(request)
        except TimeoutError as exc:
            raise CobotError(f"{begin} has not answered within {self._timeout_s:g} s") from exc
        except CobotError as exc:
            raise CobotError(f"{begin}: {exc}") from exc


def _rejection(begin: str, service: DriverIoService, answer: Message) -> str:
    """The reason why a request was not carried out; "" after success."""
    name, done = service.done
    if answer[name] in done:
        return ""
    parts = [f"{name} is {answer[name]}", joined_text(answer.get("message", ""), 200)]
    return (
        f"{begin} has rejected the request; see the driver's log "
        f"({': '.join(each for each in parts if each)})"
    )


class UrIo(ServiceIo):
    """An `ArmIo` for the driver of Universal Robots, which publishes the values."""

    def __init__(self, node: DdsNode, controller: str, interfaces: Collection[str], timeout_s: float) -> None:
        super().__init__(node, "ur", controller, interfaces, timeout_s)
        self.values: dict[str, float] = {}
        self.heard_s = -math.inf
        node.subscription(f"{controller}/io_states", IO_STATES, self._take, reliable=False)

    def _take(self, message: Message) -> None:
        self.values = {
            name: float(each["state"])
            for kind in self._driver.kinds
            for each in message[f"{kind}_states"]
            if (name := f"{kind}/{each['pin']}") in self._places
        }
        self.heard_s = time.monotonic()
        self._problem = self._sent.explain(self.values, self.heard_s) or self._problem


class PolledIo(ServiceIo):
    """An `ArmIo` for a driver whose values must be read repeatedly.

    If the driver cannot read an output, the value is the last one that the driver confirmed.
    """

    def __init__(
        self, node: DdsNode, driver: str, below: str, interfaces: Collection[str], timeout_s: float
    ) -> None:
        super().__init__(node, driver, below, interfaces, timeout_s)
        self._found: dict[str, tuple[float, float]] = {}
        self._unread: dict[str, str] = {}
        groups: dict[str, list[str]] = {}
        for name, (kind, _) in self._places.items():
            if kind.read is not None:
                groups.setdefault(kind.read.name, []).append(name)
        for names in groups.values():
            self._start(self._keep_reading(names))

    def set_output(self, interface: str, value: float) -> None:
        super().set_output(interface, value)
        if self._places[interface][0].read is None:
            self._found.pop(interface, None)

    @property
    def values(self) -> dict[str, float]:
        """The values that are not too old.

        When the driver disappears, the values that it has confirmed are dropped, because a controller that is
        switched on again starts with its own values.
        """
        now_s = time.monotonic()
        self._found = {
            name: (value, at_s)
            for name, (value, at_s) in self._found.items()
            if at_s < math.inf or self._can_set(name)
        }
        return {name: value for name, (value, at_s) in self._found.items() if now_s - at_s <= MAX_AGE_S}

    @property
    def heard_s(self) -> float:
        """The current time, because `values` contains no old values."""
        return time.monotonic()

    @property
    def problem(self) -> str:
        return self._problem or next(iter(self._unread.values()), "")

    async def _keep_reading(self, names: list[str]) -> None:
        """Read the interfaces that use one common service, repeatedly."""
        service = self._places[names[0]][0].read
        assert service is not None
        ready_s = time.monotonic()
        while True:
            await asyncio.sleep(READ_S)
            if self._services[service.name].is_ready:
                ready_s = time.monotonic()
                await self._read(service, names)
            elif time.monotonic() - ready_s > self._timeout_s:
                begin = self._begin(f"{names[0]} cannot be read", service)
                self._unread[names[0]] = self._without_server(begin)

    async def _read(self, service: DriverIoService, names: list[str]) -> None:
        answer: Message | None = None
        for name in names:
            number = self._places[name][1]
            begin = self._begin(f"{name} cannot be read", service)
            try:
                if answer is None or service.number:
                    request = {service.number: number} if service.number else {}
                    answer = await self._ask(begin, service, request)
            except CobotError as exc:
                self._unread[name] = str(exc)
                return  # otherwise the other interfaces of this service would wait as long
            if problem := _rejection(begin, service, answer):
                self._unread[name] = problem
                continue
            listed = [answer[service.value]] if service.number else answer[service.value]
            place = 0 if service.number else number
            if place >= len(listed):
                self._unread[name] = f"{begin} knows only the numbers 0 to {len(listed) - 1}"
            elif not self._places[name][0].is_analog and listed[place] not in (0, 1):
                self._unread[name] = f"{begin} has answered {listed[place]}; valid values: 0 and 1"
            else:
                self._found[name] = float(listed[place]), time.monotonic()
                self._unread.pop(name, None)
        self._problem = self._sent.explain(self.values, time.monotonic()) or self._problem

    def _can_set(self, interface: str) -> bool:
        """Whether the service that sets an output has a server."""
        write = self._places[interface][0].write
        return write is not None and self._services[write.name].is_ready

    def _confirm(self, interface: str, value: float, sent: SentOutput) -> None:
        if self._places[interface][0].read is None and self._sent.is_newest(interface, sent):
            self._found[interface] = value, math.inf
            self._sent.drop(interface, sent)


def arm_io(node: DdsNode, driver: str, below: str, interfaces: Collection[str], timeout_s: float) -> ArmIo:
    """The inputs and outputs of a driver.

    Args:
        driver: value of `robot.backend.io`.
        below: the GPIO controller's name, or name prefix of the driver's services.
    """
    if driver == "gpio":
        return GpioIo(node, below, interfaces, timeout_s)
    if driver == "ur":
        return UrIo(node, below, interfaces, timeout_s)
    return PolledIo(node, driver, below, interfaces, timeout_s)
