"""A condition of a motion, evaluated in the cycles in which it is watched."""

from collections.abc import Callable

import numpy as np

from cobot.robot.chain import Chain
from cobot.types import Array

class Condition:
    @property
    def active(self) -> bool: ...
    @property
    def value(self) -> float: ...
    def __init__(self, chain: Chain, read: Callable[[str], float]) -> None: ...
    def set(self, record: np.ndarray) -> None: ...
    def holds(self, measured: Array) -> bool: ...
