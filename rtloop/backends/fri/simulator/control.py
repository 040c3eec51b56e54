"""Control interface of a running simulated cabinet, for tests and users: one JSON object per line, over
TCP.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationError

from cobot.errors import LimitError
from cobot.robot.io_points import require_number
from cobot.strict import StrictModel, sentence, shown
from rtloop.backends.fri.messages import OperationMode
from rtloop.backends.fri.outputs import point_of
from rtloop.backends.fri.simulator.cabinet import Cabinet
from rtloop.backends.simulators.line_server import Exerted, LineServer, Share
from rtloop.backends.simulators.network import MAX_DELAY, Network


class ControlRequest(StrictModel):
    """Changes to the cabinet. Omitted fields stay unchanged.

    Attributes:
        safety_stop: level of a safety stop, -1 for none.
        drop: number of the next messages to the client that are lost.
        spoil: how measured values are corrupted on their way to the client.
        close: whether the program ends the session, to open another one.
        push: wrench of the surroundings at the TCP, N and N·m, base frame.
        io: values of inputs and outputs by name.
    """

    loss: Share | None = None
    reorder: Share | None = None
    delay: Annotated[int, Field(ge=0, le=MAX_DELAY)] | None = None
    drop: Annotated[int, Field(ge=0, le=1_000_000)] | None = None
    spoil: Literal["", "frozen", "nan"] | None = None
    safety_stop: Annotated[int, Field(ge=-1, le=2)] | None = None
    mode: Literal["T1", "T2", "AUT"] | None = None
    close: bool = False
    push: Annotated[list[Exerted], Field(min_length=6, max_length=6)] | None = None
    io: dict[str, float] = Field(default_factory=dict)


class ControlServer(LineServer):
    """The control interface of a cabinet with FRI."""

    def __init__(
        self, port: int, cabinet: Cabinet, network: Network, more: Callable[[], dict[str, Any]]
    ) -> None:
        """
        Args:
            more: function that adds data of the server to each answer.
        """
        super().__init__(port)
        self._cabinet, self._network, self._more = cabinet, network, more

    def answer(self, line: bytes) -> dict[str, Any]:
        """Execute the request in a line. Returns the state after it, or an error."""
        try:
            request = ControlRequest.model_validate_json(line)
        except ValidationError as exc:
            return {"error": sentence(exc.errors()[0])}
        for name, value in request.io.items():
            if name not in self._cabinet.io:
                return {
                    "error": f"io: {shown(name)} is not registered; valid names: {sorted(self._cabinet.io)}"
                }
            try:
                require_number(point_of(self._cabinet.io[name]), value)
            except LimitError as exc:
                return {"error": f"io: {exc}"}
        self._apply(request)
        return self.status()

    def _apply(self, request: ControlRequest) -> None:
        for name in ("loss", "reorder", "delay", "drop", "spoil"):
            value = getattr(request, name)
            if value is not None:
                setattr(self._network, name, value)
        if request.safety_stop is not None:
            self._cabinet.stop_safely(request.safety_stop)
        if request.mode is not None:
            self._cabinet.switch_mode(OperationMode[request.mode])
        if request.push is not None:
            self._cabinet.arm.push[:] = request.push
        for name, value in request.io.items():
            self._cabinet.io[name].value = value
        if request.close:
            self._cabinet.close_session("its program has closed the session")

    def status(self) -> dict[str, Any]:
        cabinet, connection = self._cabinet, self._cabinet.connection
        return {
            "state": cabinet.state.name,
            "quality": cabinet.quality.name,
            "safety": cabinet.safety.name,
            "mode": cabinet.mode.name,
            "period_ms": cabinet.options.period_ms,
            "sequence": cabinet.sequence,
            "motions": cabinet.motions,
            "below_good": cabinet.below_good,
            "answered": connection.answered,
            "missing": connection.missing,
            "late": connection.late,
            "lost": self._network.lost,
            "malformed": cabinet.malformed,
            "setpoint": cabinet.arm.setpoint.tolist(),
            "measured": cabinet.arm.measured.position.tolist(),
            "io": {name: value.value for name, value in cabinet.io.items()},
            "events": list(cabinet.events),
        } | self._more()
