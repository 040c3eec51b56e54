"""Control interface of a running simulated controller, for tests and users."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, ValidationError

from cobot.strict import StrictModel, sentence, shown
from rtloop.backends.rsi.simulator.controller import RsiController
from rtloop.backends.simulators.line_server import Exerted, LineServer, Share
from rtloop.backends.simulators.network import MAX_DELAY, Network


class RsiControlRequest(StrictModel):
    """Changes to the controller. Omitted fields stay unchanged.

    Attributes:
        drop: number of the next packets to the client that are lost.
        spoil: how measured values are corrupted on their way to the client.
        estop: whether the emergency stop is pressed.
        override: program override, percent.
        runs: whether the operator restarts the program as soon as nothing prevents it.
        off: whether to end RSI now.
        push: wrench of the surroundings at the TCP, N and N·m, base frame.
        inputs: values of inputs by name.
    """

    loss: Share | None = None
    reorder: Share | None = None
    delay: Annotated[int, Field(ge=0, le=MAX_DELAY)] | None = None
    drop: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    spoil: Literal["", "frozen", "nan"] | None = None
    estop: bool | None = None
    mode: Literal["T1", "T2", "AUT", "EXT"] | None = None
    override: Annotated[int, Field(ge=0, le=100)] | None = None
    runs: bool | None = None
    off: bool = False
    push: Annotated[list[Exerted], Field(min_length=6, max_length=6)] | None = None
    inputs: dict[str, bool] = Field(default_factory=dict)


class RsiControlServer(LineServer):
    """The control interface of a simulated RSI controller."""

    def __init__(
        self, port: int, controller: RsiController, network: Network, more: Callable[[], dict[str, Any]]
    ) -> None:
        """
        Args:
            more: function that adds data of the server to each answer.
        """
        super().__init__(port)
        self._controller, self._network, self._more = controller, network, more

    def answer(self, line: bytes) -> dict[str, Any]:
        try:
            request = RsiControlRequest.model_validate_json(line)
        except ValidationError as exc:
            return {"error": sentence(exc.errors()[0])}
        names = self._controller.layout.inputs
        for name in request.inputs:
            if name not in names:
                return {"error": f"inputs: {shown(name)} is not an input; valid names: {sorted(names)}"}
        self._apply(request)
        return self.status()

    def _apply(self, request: RsiControlRequest) -> None:
        controller = self._controller
        for name in ("loss", "reorder", "delay", "drop", "spoil"):
            value = getattr(request, name)
            if value is not None:
                setattr(self._network, name, value)
        if request.estop is not None:
            controller.stop_safely(active=request.estop)
        if request.mode is not None:
            controller.switch_mode(request.mode)
        if request.override is not None:
            controller.override = request.override
        if request.runs is not None:
            controller.starts_again = request.runs
        if request.off:
            controller.switch_off("its program has ended")
        if request.push is not None:
            controller.arm.push[:] = request.push
        for name, on in request.inputs.items():
            controller.inputs[controller.layout.inputs.index(name)] = on

    def status(self) -> dict[str, Any]:
        controller, layout = self._controller, self._controller.layout
        values = [*controller.inputs, *controller.outputs]
        return {
            "is_on": controller.is_on,
            "ipoc": controller.ipoc,
            "mode": controller.mode,
            "estop": controller.is_stopped,
            "period_ms": controller.options.period_ms,
            "delay": controller.delay,
            "correction": np.multiply(controller.correction, layout.scale).tolist(),
            "setpoint": controller.arm.setpoint.tolist(),
            "measured": controller.arm.measured.position.tolist(),
            "lost": self._network.lost,
            "io": dict(zip((*layout.inputs, *layout.outputs), values, strict=True)),
            "events": list(controller.events),
        } | asdict(controller.counters) | self._more()  # fmt: skip
