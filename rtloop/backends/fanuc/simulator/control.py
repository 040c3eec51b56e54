"""Control interface of a running simulated controller, for tests and users: one JSON object per line, over
TCP.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from cobot.strict import StrictModel, sentence, shown
from rtloop.backends.fanuc.messages import ContactStop
from rtloop.backends.fanuc.simulator.controller import CONTACT, E_STOP, FENCE, FanucController
from rtloop.backends.fanuc.simulator.network import FanucNetwork
from rtloop.backends.simulators.line_server import LineServer, Share
from rtloop.backends.simulators.network import MAX_DELAY

ALARMS = {"e_stop": E_STOP, "fence": FENCE, "collision": CONTACT}


class FanucControlRequest(StrictModel):
    """Changes to the controller. Omitted fields stay unchanged.

    Attributes:
        drop: number of the next packets to the client that are lost.
        spoil: how measured values are corrupted on their way to the client.
        e_stop, fence, collision: whether the cause of the alarm persists.
        alarm: text of another alarm, without a cause that persists.
        close: whether the connection of the Remote Motion Interface is closed.
        deaf: whether the Remote Motion Interface ignores requests.
        io: values of inputs and outputs by name.
    """

    loss: Share | None = None
    reorder: Share | None = None
    delay: Annotated[int, Field(ge=0, le=MAX_DELAY)] | None = None
    drop: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    spoil: Literal["", "frozen", "nan"] | None = None
    mode: Literal["AUTO", "T1", "T2"] | None = None
    e_stop: bool | None = None
    fence: bool | None = None
    collision: bool | None = None
    alarm: Annotated[str, Field(min_length=1, max_length=4000)] | None = None
    contact_stop: Annotated[int, Field(ge=0, le=4)] | None = None
    safety_scale: Annotated[float, Field(ge=0.0, le=1.0)] | None = None
    override: Annotated[int, Field(ge=1, le=100)] | None = None
    close: bool = False
    deaf: bool | None = None
    io: dict[str, Annotated[int, Field(ge=0, le=0xFFFF)]] = Field(default_factory=dict)


class FanucControl(LineServer):
    """The control interface.

    Attributes:
        close, deaf: see `FanucControlRequest`; the server evaluates them.
    """

    def __init__(
        self,
        port: int,
        controller: FanucController,
        network: FanucNetwork,
        more: Callable[[], dict[str, Any]],
    ) -> None:
        super().__init__(port)
        self._controller, self._network, self._more = controller, network, more
        self.closes = self.deaf = False

    def answer(self, line: bytes) -> dict[str, Any]:
        """Execute the request in a line. Returns the state after it, or an error."""
        try:
            request = FanucControlRequest.model_validate_json(line)
        except ValidationError as exc:
            return {"error": sentence(exc.errors()[0])}
        unknown = [name for name in request.io if name not in self._controller.io]
        if unknown:
            return {
                "error": f"io: {shown(unknown[0])} does not exist; valid names: {sorted(self._controller.io)}"
            }
        self._change(request)
        return self.status()

    def _change(self, request: FanucControlRequest) -> None:
        controller = self._controller
        for name in ("loss", "reorder", "delay", "drop", "spoil"):
            value = getattr(request, name)
            if value is not None:
                setattr(self._network, name, value)
        for name, alarm in ALARMS.items():
            pressed = getattr(request, name)
            if pressed is not None:
                (controller.press if pressed else controller.release)(alarm)
        if request.alarm is not None:
            controller.alarm(request.alarm)
        if request.mode is not None:
            controller.switch_mode(request.mode)
        if request.contact_stop is not None:
            controller.contact(ContactStop(request.contact_stop))
        if request.safety_scale is not None:
            controller.safety_scale = request.safety_scale
        if request.override is not None:
            controller.override = request.override
        if request.deaf is not None:
            self.deaf = request.deaf
        self.closes = request.close
        controller.io.update(request.io)

    def status(self) -> dict[str, Any]:
        controller = self._controller
        return {
            "program": controller.program,
            "motion_possible": controller.motion_possible,
            "streams": controller.streams,
            "mode": controller.mode,
            "alarms": controller.alarms,
            "override": controller.override,
            "period_ms": controller.options.period_ms,
            "sequence": controller.sequence,
            "moves": controller.moves,
            "commands": controller.commands,
            "missing": controller.missing,
            "lost": self._network.lost,
            "malformed": controller.malformed,
            "setpoint": controller.arm.setpoint.tolist(),
            "measured": controller.arm.measured.position.tolist(),
            "peaks": controller.peaks,
            "io": dict(controller.io),
            "events": list(controller.events),
        } | self._more()
