"""The arm of these tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from ur_arm import ur_settings, with_options

from cobot.config import Settings
from cobot.robot.description import RobotDescription, load_robot
from rtloop.backends.ur import UrBackend
from rtloop.backends.ur.simulator.lockstep import UrLockStep, joined
from rtloop.backends.ur.simulator.options import UrControllerOptions

PERIOD_MS = 8


@pytest.fixture(scope="session")
def ur(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return ur_settings(tmp_path_factory.mktemp("ur"), PERIOD_MS)


@pytest.fixture(scope="session")
def arm(ur: Settings) -> RobotDescription:
    return load_robot(ur)


@pytest.fixture
def connect(ur: Settings, arm: RobotDescription) -> Callable[..., tuple[UrBackend, UrLockStep]]:
    """A backend that is not open, and the way to its controller."""

    def made(
        controller: UrControllerOptions | None = None, period_ms: int = PERIOD_MS, **options: object
    ) -> tuple[UrBackend, UrLockStep]:
        settings = with_options(ur, period_ms, **options)
        way = joined(settings, arm.limits, controller or UrControllerOptions())
        return UrBackend(settings, arm.limits, transport=way), way

    return made
