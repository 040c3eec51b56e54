"""The parts of pylibfranka that the backend uses, except `Robot`, for the stand-in."""

from __future__ import annotations

from enum import Enum
from types import SimpleNamespace

import numpy as np

from rtloop.backends.franka import kinematics


class FrankaException(RuntimeError): ...


class ControlException(FrankaException): ...


class NetworkException(FrankaException): ...


class CommandException(FrankaException): ...


class InvalidOperationException(FrankaException): ...


class RealtimeException(FrankaException): ...


class RobotMode(Enum):
    Other, Idle, Move, Guiding, Reflex, UserStopped = range(6)


class RealtimeConfig(Enum):
    kEnforce = 0  # noqa: N815 - theirs
    kIgnore = 1  # noqa: N815


class ControllerMode(Enum):
    JointImpedance, CartesianImpedance = range(2)


class Duration:
    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def to_sec(self) -> float:
        return self._seconds


class JointPositions:
    def __init__(self, q: list[float]) -> None:
        self.q, self.motion_finished = list(q), False


class Torques:
    def __init__(self, tau_J: list[float]) -> None:
        self.tau_J, self.motion_finished = list(tau_J), False


class State(SimpleNamespace):
    """A state of the robot. Its matrices are computed when they are read."""

    q: list[float]

    @property
    def O_T_EE(self) -> list[float]:  # noqa: N802 - theirs
        found: list[float] = kinematics.flange(self.q).ravel(order="F").tolist()
        return found

    @property
    def F_T_EE(self) -> list[float]:  # noqa: N802
        found: list[float] = np.eye(4).ravel().tolist()
        return found
