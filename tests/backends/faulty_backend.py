"""`rt.backend: faulty_backend:FaultyBackend`, with this folder on PYTHONPATH: it breaks on demand."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np

from cobot.types import Array
from rtloop.backends import Measured
from rtloop.backends.mujoco import MujocoBackend

LOOK_CYCLES = 10


class FaultyBackend(MujocoBackend):
    """The simulation, whose faults stand in the JSON file that COBOT_FAULTS names: attributes and values."""

    _cycle = 0
    _text = ""

    def read(self, measured: Measured) -> None:
        self._cycle += 1
        if self._cycle % LOOK_CYCLES == 0:
            self._look()
        super().read(measured)

    def enable(self) -> None:
        self._look()
        super().enable()

    def _look(self) -> None:
        text = Path(os.environ["COBOT_FAULTS"]).read_text(encoding="utf-8")
        if text == self._text:
            return
        self._text = text
        for name, value in json.loads(text or "{}").items():
            is_array = isinstance(getattr(self, name), np.ndarray)
            setattr(self, name, _array(value) if is_array else value)


def _array(value: list[float]) -> Array:
    return np.array(value, dtype=np.float64)
