"""What many tests need: the robot that ships with cobot."""

from __future__ import annotations

import pytest

from cobot.config import Settings, load_settings
from cobot.robot import Robot, load_robot


@pytest.fixture(scope="session")
def settings() -> Settings:
    return load_settings()


@pytest.fixture(scope="session")
def robot(settings: Settings) -> Robot:
    return load_robot(settings)
