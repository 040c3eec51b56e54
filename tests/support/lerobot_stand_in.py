"""A stand-in for the parts of LeRobot that the plug-in uses. LeRobot itself brings PyTorch and gigabytes, and
is not installed here. tests/e2e/realtime/test_several_robots.py uses LeRobot's own base classes.
"""

from __future__ import annotations

import sys
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, ClassVar

import numpy as np
import pytest
from wheels import ROOT

PLUGIN = ROOT / "packages" / "lerobot-robot-cobot"


@dataclass(kw_only=True)
class RobotConfig:
    id: str | None = None
    calibration_dir: Path | None = None
    kinds: ClassVar[dict[str, type]] = {}

    @classmethod
    def register_subclass(cls, name: str) -> Any:
        return lambda kind: cls.kinds.setdefault(name, kind)


class LeRobot(ABC):
    def __init__(self, config: RobotConfig) -> None:
        self.id = config.id

    def __str__(self) -> str:
        return f"{self.id} {type(self).__name__}"

    @property
    @abstractmethod
    def observation_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def action_features(self) -> dict[str, Any]: ...

    @property
    @abstractmethod
    def is_connected(self) -> bool: ...

    @abstractmethod
    def connect(self, calibrate: bool = True) -> None: ...

    @property
    @abstractmethod
    def is_calibrated(self) -> bool: ...

    @abstractmethod
    def calibrate(self) -> None: ...

    @abstractmethod
    def configure(self) -> None: ...

    @abstractmethod
    def get_observation(self) -> dict[str, Any]: ...

    @abstractmethod
    def send_action(self, action: dict[str, Any]) -> dict[str, Any]: ...

    @abstractmethod
    def disconnect(self) -> None: ...


class DeviceNotConnectedError(ConnectionError): ...


class DeviceAlreadyConnectedError(ConnectionError): ...


class BaseCamera:
    """As LeRobot's base class of cameras: it does not implement `read_latest`, but has it from 0.4.3 on."""

    def async_read(self, timeout_ms: float = 200) -> np.ndarray:
        raise NotImplementedError

    def read_latest(self, max_age_ms: int = 500) -> np.ndarray:
        raise AssertionError("this only warns and waits")


class Camera(BaseCamera):
    """One of LeRobot's kinds, without `read_latest`."""

    height, width = 6, 8

    def __init__(self) -> None:
        self.is_connected = False

    def connect(self, warmup: bool = True) -> None:
        self.is_connected = True

    def disconnect(self) -> None:
        self.is_connected = False

    def async_read(self, timeout_ms: float = 200) -> np.ndarray:
        return np.full((6, 8, 3), 7, np.uint8)


class LatestCamera(Camera):
    """One that has the latest picture without waiting.

    Attributes:
        stale: whether its latest picture is too old.
    """

    stale = False

    def read_latest(self, max_age_ms: int = 500) -> np.ndarray:
        if self.stale:
            raise TimeoutError("the latest picture is too old")
        return np.full((6, 8, 3), 9, np.uint8)


class Dataset:
    made: Dataset

    def __init__(self, **options: Any) -> None:
        Dataset.made = self
        self.options = options
        self.frames: list[dict[str, Any]] = []
        self.num_episodes, self.finalized = 0, False

    @classmethod
    def create(cls, **options: Any) -> Dataset:
        return cls(**options)

    @property
    def num_frames(self) -> int:
        return len(self.frames)

    def add_frame(self, frame: dict[str, Any]) -> None:
        assert set(frame) == {*self.options["features"], "task"}
        self.frames.append(frame)

    def save_episode(self) -> None:
        self.num_episodes += 1

    def finalize(self) -> None:
        self.finalized = True


@contextmanager
def plugin_beside_it(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """The plug-in, in an environment that the stand-in is in."""
    contents = {
        "lerobot": {},
        "lerobot.cameras": {"Camera": BaseCamera, "CameraConfig": Camera},
        "lerobot.cameras.utils": {"make_cameras_from_configs": dict},
        "lerobot.robots": {"Robot": LeRobot, "RobotConfig": RobotConfig},
        "lerobot.utils": {},
        "lerobot.utils.errors": {
            "DeviceNotConnectedError": DeviceNotConnectedError,
            "DeviceAlreadyConnectedError": DeviceAlreadyConnectedError,
        },
        "lerobot.datasets": {},
        "lerobot.datasets.lerobot_dataset": {"LeRobotDataset": Dataset},
    }
    for name, content in contents.items():
        module = ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.syspath_prepend(str(PLUGIN))
    import lerobot_robot_cobot

    yield lerobot_robot_cobot
    for name in [name for name in sys.modules if name.startswith("lerobot_robot_cobot")]:
        del sys.modules[name]
