"""The connection to a controller's RTDE server. If it is lost, it is set up again."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from enum import Enum, auto
from typing import Any

from rtloop.backends.ur.rtde import (
    PORT,
    PROTOCOL,
    Kind,
    Package,
    Recipe,
    RtdeError,
    Splitter,
    decode_setup,
    decode_text,
    encode,
    encode_inputs_setup,
    encode_outputs_setup,
)
from rtloop.backends.ur.transport import ByteStream, UrTransport

REPLY_S = 2.0
"""Timeout for the controller's answer to each step of the set-up, s."""
RETRY_S = 0.5
DEAD_S = 1.0
"""Time without data after which the connection is closed, s, because the other end may not have closed it."""
_VERSION = struct.Struct(">4I")


class _Step(Enum):
    AWAY = auto()
    CONNECTING = auto()
    PROTOCOL = auto()
    VERSION = auto()
    OUTPUTS = auto()
    INPUTS = auto()
    STARTING = auto()
    STREAMING = auto()


class RtdeLink:
    """
    Attributes:
        version: version of the controller's software, four numbers; None before it is known.
        inputs: recipes for the groups of variables that can be set, by the first variable of each group.
        problem: reason why no data arrives; "" while data arrives.
        lasting: whether a further attempt would fail for the same reason.
        malformed: number of data packages that could not be decoded.
    """

    def __init__(
        self,
        transport: UrTransport,
        address: str,
        frequency_hz: float,
        needed: Sequence[str],
        useful: Sequence[str],
        groups: Sequence[Sequence[str]],
    ) -> None:
        """
        Args:
            needed, useful: variables to read. The controller may lack those in `useful`.
            groups: groups of variables that are set together.
        """
        self._transport, self._address, self._frequency_hz = transport, address, frequency_hz
        self._needed, self._useful, self._groups = tuple(needed), tuple(useful), [tuple(g) for g in groups]
        self.version: tuple[int, ...] | None = None
        self.inputs: dict[str, Recipe] = {}
        self.problem, self.lasting = "not connected yet", False
        self.malformed = 0
        self._stream: ByteStream | None = None
        self._step = _Step.AWAY
        self._since_s = self._heard_s = -RETRY_S
        self._splitter = Splitter()
        self._recipe: Recipe | None = None
        self._names: tuple[str, ...] = ()
        self._left: list[tuple[str, ...]] = []
        self._said = ""

    @property
    def is_streaming(self) -> bool:
        return self._step is _Step.STREAMING

    @property
    def streams(self) -> list[ByteStream]:
        return [self._stream] if self._stream is not None else []

    @property
    def local(self) -> str:
        """Address of this computer on the connection."""
        return self._stream.local if self._stream is not None else ""

    def poll(self) -> list[dict[str, Any]]:
        """Continue the setup as far as possible without waiting, and return the data packages that have
        arrived.
        """
        now_s = self._transport.clock()
        try:
            if self._step is _Step.AWAY:
                if now_s - self._since_s >= RETRY_S:
                    self._connect(now_s)
                return []
            return self._progress(now_s)
        except RtdeError as exc:
            self._give_up(f"the data from port {PORT} of {self._address} are not valid RTDE: {exc}")
        except OSError as exc:
            self._give_up(self._no_answer(exc.strerror or str(exc)))
        return []

    def send(self, group: str, values: Mapping[str, Any]) -> bool:
        """Set the variables of a group. Return whether they were sent."""
        recipe = self.inputs.get(group)
        if recipe is None or self._stream is None or not self.is_streaming:
            return False
        try:
            self._stream.send(recipe.encode(values))
        except OSError as exc:
            self._give_up(self._no_answer(exc.strerror or str(exc)))
            return False
        return True

    def close(self) -> None:
        if self._stream is not None:
            self._stream.close()
        self._stream, self._step, self._since_s = None, _Step.AWAY, self._transport.clock()

    def _connect(self, now_s: float) -> None:
        self._since_s = self._heard_s = now_s
        self._stream = self._transport.connect(self._address, PORT)
        self._splitter, self._said = Splitter(), ""
        self._step = _Step.CONNECTING

    def _give_up(self, problem: str, *, lasting: bool = False) -> None:
        if self._stream is not None:
            self._stream.abort()
        self.close()
        self.problem, self.lasting = problem, lasting

    def _no_answer(self, why: str) -> str:
        return (
            f"no answer from {self._address}, port {PORT}: {why}: check that the controller is on and in "
            "this network, and that RTDE is enabled (Settings, Security, Services)"
        )

    def _progress(self, now_s: float) -> list[dict[str, Any]]:
        stream = self._stream
        assert stream is not None
        if self._step is _Step.CONNECTING:
            if stream.is_connected():
                self._ask(_Step.PROTOCOL, encode(Kind.REQUEST_PROTOCOL_VERSION, struct.pack(">H", PROTOCOL)))
            elif now_s - self._since_s > REPLY_S:
                self._give_up(self._no_answer(f"nothing within {REPLY_S:g} s"))
            return []
        received = stream.receive()
        if received:
            self._heard_s = now_s
        data: list[dict[str, Any]] = []
        for package in self._splitter.split(received):
            if package.kind == Kind.TEXT_MESSAGE:
                self._said = decode_text(package.payload)
            elif self.is_streaming:
                self._take(package, data)
            else:
                self._set_up(package)
            if self._step is _Step.AWAY:
                return data
        limit_s = DEAD_S if self.is_streaming else REPLY_S
        if now_s - self._heard_s > limit_s:
            self._give_up(self._no_answer(f"silence for {now_s - self._heard_s:.1f} s"))
        return data

    def _take(self, package: Package, data: list[dict[str, Any]]) -> None:
        if package.kind == Kind.DATA and self._recipe is not None:
            try:
                data.append(self._recipe.decode(package.payload))
            except RtdeError:
                self.malformed += 1
                raise

    def _ask(self, step: _Step, package: bytes) -> None:
        assert self._stream is not None
        self._heard_s = self._transport.clock()
        self._stream.send(package)
        self._step = step

    def _set_up(self, package: Package) -> None:
        """Process the answer to the current step, and begin the next step."""
        step, payload = self._step, package.payload
        expected = _ANSWERS[step]
        if package.kind == Kind.DATA:
            return  # answer to an earlier start
        if package.kind != expected:
            raise RtdeError(
                f"the controller has answered {expected.name} with a package of type {package.kind}"
            )
        if step is _Step.PROTOCOL:
            if payload[:1] != b"\x01":
                self._give_up(
                    f"the controller rejects version {PROTOCOL} of RTDE's protocol{self._quoted}: its "
                    "software is older than PolyScope 3.4; update it",
                    lasting=True,
                )
            else:
                self._ask(_Step.VERSION, encode(Kind.GET_CONTROL_VERSION))
        elif step is _Step.VERSION:
            if len(payload) < _VERSION.size:
                raise RtdeError(f"the version has {len(payload)} bytes, but {_VERSION.size} are needed")
            self.version = _VERSION.unpack_from(payload)
            self._ask_outputs(self._needed + self._useful)
        elif step is _Step.OUTPUTS:
            self._outputs(*decode_setup(payload))
        elif step is _Step.INPUTS:
            self._inputs(*decode_setup(payload))
        elif payload[:1] != b"\x01":
            self._give_up(f"the controller does not start to send data{self._quoted}")
        else:
            self._step, self.problem, self.lasting = _Step.STREAMING, "", False

    def _ask_outputs(self, names: tuple[str, ...]) -> None:
        self._names = names
        self._ask(_Step.OUTPUTS, encode_outputs_setup(self._frequency_hz, names))

    def _outputs(self, number: int, types: list[str]) -> None:
        missing = [name for name, kind in zip(self._names, types, strict=False) if kind == "NOT_FOUND"]
        lacking = [name for name in missing if name in self._needed]
        if lacking:
            self._give_up(
                f"the controller's RTDE has no variable {', '.join(lacking)} (NOT_FOUND); its software "
                f"{self.version_text} is too old",
                lasting=True,
            )
        elif missing:
            self._ask_outputs(tuple(name for name in self._names if name not in missing))
        else:
            self._recipe = Recipe(number, self._names, types)
            self.inputs, self._left = {}, list(self._groups)
            self._ask_inputs()

    def _ask_inputs(self) -> None:
        if self._left:
            self._ask(_Step.INPUTS, encode_inputs_setup(self._left[0]))
        else:
            self._ask(_Step.STARTING, encode(Kind.START))

    def _inputs(self, number: int, types: list[str]) -> None:
        names = self._left.pop(0)
        used = [name for name, kind in zip(names, types, strict=False) if kind == "IN_USE"]
        missing = [name for name, kind in zip(names, types, strict=False) if kind == "NOT_FOUND"]
        if used:
            self._give_up(
                f"another client of the controller sets {', '.join(used)} (IN_USE): another RTDE client or a "
                "fieldbus, such as EtherNet/IP or PROFINET. End it, or leave the outputs to it with "
                "robot.backend.outputs: false"
            )
            return
        if not missing:
            self.inputs[names[0]] = Recipe(number, names, types)
        self._ask_inputs()

    @property
    def version_text(self) -> str:
        return ".".join(map(str, self.version)) if self.version else "of unknown version"

    @property
    def _quoted(self) -> str:
        return f" ({self._said[:200]})" if self._said else ""


_ANSWERS = {
    _Step.PROTOCOL: Kind.REQUEST_PROTOCOL_VERSION,
    _Step.VERSION: Kind.GET_CONTROL_VERSION,
    _Step.OUTPUTS: Kind.SETUP_OUTPUTS,
    _Step.INPUTS: Kind.SETUP_INPUTS,
    _Step.STARTING: Kind.START,
}
