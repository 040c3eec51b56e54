"""Settings of the shipped arm behind ros2_control."""

from __future__ import annotations

from typing import Any

from cobot.config import Settings, load_settings


def settings_with(**options: Any) -> Settings:
    """With these options of the backend."""
    settings = load_settings()
    chosen = {"type": "ros2_control", "options": options}
    robot = settings.robot.model_copy(update={"backend": settings.robot.backend.model_copy(update=chosen)})
    return settings.model_copy(update={"robot": robot})
