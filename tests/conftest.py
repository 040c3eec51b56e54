"""What many tests need: the robot that ships with cobot."""

from __future__ import annotations

from collections.abc import Iterator

import hypothesis
import pytest
from rig import Rig

from cobot.config import Settings, load_settings
from cobot.robot.description import RobotDescription, load_robot

# The same examples in every run, on every computer: a test that fails by chance teaches nobody.
hypothesis.settings.register_profile("cobot", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("cobot")


LONG = ("test_sanitizers.py", "test_schema.py", "test_supervisor.py", "test_ros2.py")
"""What takes longest begins first, or one process would be busy with it when all others have ended."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=lambda item: item.path.name not in LONG)


@pytest.fixture(scope="session")
def settings() -> Settings:
    return load_settings()


@pytest.fixture(scope="session")
def robot(settings: Settings) -> RobotDescription:
    return load_robot(settings)


@pytest.fixture
def rig(settings: Settings, robot: RobotDescription) -> Iterator[Rig]:
    """The cycle with a backend that is always where it is told to be."""
    made = Rig(settings, robot)
    yield made
    made.close()
