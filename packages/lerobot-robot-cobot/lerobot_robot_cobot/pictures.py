"""Pictures of LeRobot's cameras."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lerobot.cameras import Camera


def latest_pictures(cameras: Mapping[str, Any]) -> dict[str, Any]:
    """Return one picture from each camera, by name.

    Raises:
        TimeoutError: a camera has no picture, or its latest picture is too old.
    """
    return {name: _latest(camera) for name, camera in cameras.items()}


def _latest(camera: Any) -> Any:
    # `read_latest` does not wait for the next picture, so a slow camera does not delay the arm. LeRobot 0.4.2
    # does not have it. For a camera that does not implement it, LeRobot's base class warns and waits.
    own = getattr(type(camera), "read_latest", None)
    if own is None or own is getattr(Camera, "read_latest", None):
        return camera.async_read()
    return camera.read_latest()


def picture_shapes(configs: Mapping[str, Any]) -> dict[str, tuple[int, int, int]]:
    """Return the height, width and channels of each camera's pictures, by name."""
    return {name: (each.height, each.width, 3) for name, each in configs.items()}
