"""One client of a simulated controller's RTDE server."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from typing import Any

from rtloop.backends.ur.fields import INPUTS, OUTPUTS
from rtloop.backends.ur.rtde import (
    PROTOCOL,
    Kind,
    Package,
    Recipe,
    RtdeError,
    Splitter,
    encode,
    encode_text,
)
from rtloop.backends.ur.simulator.controller import UrController
from rtloop.backends.ur.simulator.network import DataNetwork
from rtloop.backends.ur.torques import MOTOR_TORQUE

MAX_OUT = 1 << 20
MAX_RECIPES = 255
MAX_NAMES_BYTES = 2048
ERROR, INFO = 1, 3


class RtdeSession:
    """A `UrSession` for a client of the RTDE server."""

    def __init__(self, controller: UrController, network: DataNetwork) -> None:
        self._controller, self._network = controller, network
        self.out, self.is_over = bytearray(), False
        self._splitter = Splitter()
        self._output: Recipe | None = None
        self._periods = 1
        self._inputs: dict[int, Recipe] = {}
        self._is_started = False

    def feed(self, received: bytes) -> None:
        try:
            for package in self._splitter.split(received):
                self._take(package)
        except (RtdeError, struct.error, UnicodeDecodeError) as exc:
            self.out += encode_text(f"malformed package: {exc}", "RTDE", ERROR)
            self.is_over = True

    def tick(self) -> None:
        if not self._is_started or self._output is None or self._controller.steps % self._periods:
            return
        for values in self._network.to_client(self._controller.values()):
            self._send(values)

    def _send(self, values: Mapping[str, Any]) -> None:
        assert self._output is not None
        if len(self.out) < MAX_OUT:  # a client that does not read misses packages
            self.out += self._output.encode(values)

    def close(self) -> None:
        owners = self._controller.owners
        for name in [name for name, owner in owners.items() if owner is self]:
            del owners[name]

    def _take(self, package: Package) -> None:
        kind, payload = package.kind, package.payload
        if kind == Kind.REQUEST_PROTOCOL_VERSION:
            (wanted,) = struct.unpack(">H", payload)
            self.out += encode(Kind.REQUEST_PROTOCOL_VERSION, bytes([wanted == PROTOCOL]))
        elif kind == Kind.GET_CONTROL_VERSION:
            version = struct.pack(">4I", *self._controller.options.version)
            self.out += encode(Kind.GET_CONTROL_VERSION, version)
        elif kind == Kind.SETUP_OUTPUTS:
            self._set_up_outputs(payload)
        elif kind == Kind.SETUP_INPUTS:
            self._set_up_inputs(payload)
        elif kind == Kind.START:
            self._is_started = self._output is not None
            self.out += encode(Kind.START, bytes([self._is_started]))
        elif kind == Kind.PAUSE:
            self._is_started = False
            self.out += encode(Kind.PAUSE, b"\x01")
        elif kind == Kind.DATA:
            recipe = self._inputs.get(payload[0] if payload else 0)
            if recipe is None:
                raise RtdeError(f"there is no input recipe {payload[0] if payload else 0}")
            self._controller.set_inputs(recipe.decode(payload))
        else:
            self.out += encode_text(f"unknown package type {kind}", "RTDE", ERROR)

    def _set_up_outputs(self, payload: bytes) -> None:
        (frequency_hz,) = struct.unpack_from(">d", payload)
        names = _names(payload[8:])
        absent = () if self._controller.options.has_torque else (MOTOR_TORQUE,)
        types = ["NOT_FOUND" if name in absent else OUTPUTS.get(name, "NOT_FOUND") for name in names]
        top_hz = 1.0 / self._controller.period_s
        if not (math.isfinite(frequency_hz) and frequency_hz > 0.0):
            frequency_hz = top_hz
        self._periods = max(1, round(top_hz / min(frequency_hz, top_hz)))
        number = 0 if "NOT_FOUND" in types else 1
        self._output = Recipe(1, names, types) if number else None
        self._is_started = False
        self.out += encode(Kind.SETUP_OUTPUTS, bytes([number]) + ",".join(types).encode())

    def _set_up_inputs(self, payload: bytes) -> None:
        names, owners = _names(payload), self._controller.owners
        types = [
            "IN_USE" if owners.get(name, self) is not self else INPUTS.get(name, "NOT_FOUND")
            for name in names
        ]
        number = 0
        if not {"IN_USE", "NOT_FOUND"} & set(types) and len(self._inputs) < MAX_RECIPES:
            number = len(self._inputs) + 1
            self._inputs[number] = Recipe(number, names, types)
            owners.update(dict.fromkeys(names, self))
        self.out += encode(Kind.SETUP_INPUTS, bytes([number]) + ",".join(types).encode())


def _names(payload: bytes) -> list[str]:
    if len(payload) > MAX_NAMES_BYTES:
        raise RtdeError(f"the names have {len(payload)} bytes, allowed: {MAX_NAMES_BYTES}")
    return [name.strip() for name in payload.decode("ascii").split(",") if name.strip()]
