"""A robot's recording memory without a robot: cycles are written as rtloop writes them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from recorded_cycles import Cycles

from cobot.config import Settings
from cobot.robot.description import RobotDescription


@pytest.fixture
def cycles(settings: Settings, robot: RobotDescription, tmp_path: Path) -> Iterator[Cycles]:
    made = Cycles(settings, robot, tmp_path)
    yield made
    made.close()
