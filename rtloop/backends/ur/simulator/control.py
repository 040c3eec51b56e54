"""Control interface of a running simulated controller, for tests and users: one JSON object per line, over
TCP.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from cobot.strict import StrictModel, sentence
from rtloop.backends.ur.fields import SafetyMode
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.network import DataNetwork

MAX_LINE = 65_536
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Exerted = Annotated[float, Field(ge=-1000.0, le=1000.0)]


class UrControlRequest(StrictModel):
    """Changes to the controller. Omitted fields stay unchanged.

    Attributes:
        loss: share of the data packages that the controller omits.
        silent: whether the controller sends and receives nothing, as if the cable were disconnected.
        delay_s: delay before the controller reads a command, s.
        spoil: how measured values are corrupted on their way to the client.
        safety: the safety mode.
        blocked: reason with which the controller refuses to unlock a protective stop; "" if it unlocks it.
        remote: whether Remote Control is selected.
        program: what a person does with the program at the teach pendant.
        power: what a person does with the arm's power at the teach pendant.
        push: wrench of the surroundings at the TCP, N and N·m, base frame.
        inputs: digital inputs, as bits 0 to 17.
    """

    loss: Share | None = None
    silent: bool | None = None
    delay_s: Annotated[float, Field(ge=0.0, le=5.0)] | None = None
    spoil: Literal["", "frozen", "nan"] | None = None
    safety: Annotated[int, Field(ge=1, le=13)] | None = None
    blocked: Annotated[str, Field(max_length=200)] | None = None
    remote: bool | None = None
    slider: Share | None = None
    program: Literal["stop", "pause", "play"] | None = None
    power: Literal["on", "off", "start"] | None = None
    push: Annotated[list[Exerted], Field(min_length=6, max_length=6)] | None = None
    inputs: Annotated[int, Field(ge=0, lt=1 << 18)] | None = None


class ControlSession:
    """A `UrSession` for a client of the control interface."""

    def __init__(
        self,
        controller: UrController,
        network: DataNetwork,
        more: Callable[[UrControlRequest], dict[str, Any]],
    ) -> None:
        """
        Args:
            more: function that executes the parts of a request that concern the server, and returns data to
                add to the answer.
        """
        self._controller, self._network, self._more = controller, network, more
        self.out, self.is_over = bytearray(), False
        self._buffer = b""

    def feed(self, received: bytes) -> None:
        *lines, self._buffer = (self._buffer + received).split(b"\n")
        self.is_over = len(self._buffer) > MAX_LINE
        for line in lines:
            self.out += json.dumps(self.answer(line)).encode() + b"\n"

    def tick(self) -> None:
        """Do nothing, because this session only answers requests."""

    def close(self) -> None:
        """Do nothing, because requested changes stay in effect."""

    def answer(self, line: bytes) -> dict[str, Any]:
        """Execute the request in a line. Returns the state after it, or an error."""
        try:
            request = UrControlRequest.model_validate_json(line)
        except ValidationError as exc:
            return {"error": sentence(exc.errors()[0])}
        self._apply(request)
        return self._status() | self._more(request)

    def _apply(self, request: UrControlRequest) -> None:
        controller, network = self._controller, self._network
        for name in ("loss", "spoil"):
            if (value := getattr(request, name)) is not None:
                setattr(network, name, value)
        for name, attribute in (
            ("blocked", "blocked"),
            ("remote", "is_remote"),
            ("slider", "slider"),
            ("inputs", "digital_in"),
        ):
            if (value := getattr(request, name)) is not None:
                setattr(controller, attribute, value)
        if request.safety is not None:
            controller.set_safety(SafetyMode(request.safety), "by the control interface")
        if request.push is not None:
            controller.arm.push[:] = request.push
        actions: dict[str | None, Callable[[], object]] = {
            "stop": lambda: controller.stop_program("at the teach pendant"),
            "pause": controller.pause_program,
            "play": controller.play_program,
            "on": controller.power_on,
            "off": controller.power_off,
            "start": controller.release_brakes,
        }
        for chosen in (request.program, request.power):
            if chosen is not None:
                actions[chosen]()

    def _status(self) -> dict[str, Any]:
        controller = self._controller
        return {
            "time_s": controller.time_s,
            "robot_mode": controller.robot_mode.name,
            "safety": controller.safety.name,
            "runtime": controller.runtime.name,
            "program": controller.program_name,
            "remote": controller.is_remote,
            "slider": controller.slider,
            "payload": controller.payload,
            "lost": self._network.lost,
            "setpoint": controller.arm.setpoint.tolist(),
            "measured": controller.arm.measured.position.tolist(),
            "digital_out": controller.digital_out,
            "analog_out": controller.analog_out,
            "events": list(controller.events),
        }
