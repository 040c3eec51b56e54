"""A camera that a plug-in adds to LeRobot, made from LeRobot's own base class: its picture never changes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from lerobot.cameras import Camera, CameraConfig


@CameraConfig.register_subclass("still")
@dataclass(kw_only=True)
class StillCameraConfig(CameraConfig):  # type: ignore[misc, unused-ignore]
    """A camera without options of its own."""


class StillCamera(Camera):  # type: ignore[misc, unused-ignore]
    """Its number of pictures is in `waited` and `looked`, by the way in which they were read."""

    def __init__(self, config: StillCameraConfig) -> None:
        super().__init__(config)
        self.connected = False
        self.waited = self.looked = 0

    @property
    def is_connected(self) -> bool:
        return self.connected

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        return []

    def connect(self, warmup: bool = True) -> None:
        self.connected = True

    def disconnect(self) -> None:
        self.connected = False

    def read(self) -> Any:
        return np.zeros((self.height, self.width, 3), np.uint8)

    def async_read(self, timeout_ms: float = 200) -> Any:
        self.waited += 1
        return self.read()

    def read_latest(self, max_age_ms: int = 500) -> Any:
        self.looked += 1
        return self.read()
