"""The twelve arms, each made once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from arm_kinds import KINDS
from converted_arms import Made, robot_of
from rig import Rig

from benchmarks.arms import JOINTS


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("robots")


@pytest.fixture(scope="session", params=sorted(KINDS))
def kind(request: pytest.FixtureRequest, folder: Path) -> Made:
    """Each of the twelve, for what every arm can do."""
    return robot_of(folder, str(request.param))


@pytest.fixture(scope="session", params=sorted(JOINTS))
def made(request: pytest.FixtureRequest, folder: Path) -> Made:
    """Four with six joints and more, for what needs all directions."""
    return robot_of(folder, str(request.param))


@pytest.fixture(scope="session")
def gantry(folder: Path) -> Made:
    return robot_of(folder, "gantry")


@pytest.fixture
def own_rig(made: Made) -> Iterator[Rig]:
    rig = Rig(made.settings, made.arm.robot, simulated=True, start=made.ready)
    yield rig
    rig.close()
