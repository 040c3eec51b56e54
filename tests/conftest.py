"""What many tests need: the robot that ships with cobot."""

from __future__ import annotations

import gc
import os

from cobot.__main__ import BLAS_THREADS

os.environ.setdefault(BLAS_THREADS, "1")  # before numpy is imported

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import hypothesis
import pytest
from rig import Rig

from cobot.config import Settings, load_settings
from cobot.robot.description import RobotDescription, load_robot

if TYPE_CHECKING:
    from virtual_service import VirtualService

# The same examples in every run, on every computer: a test that fails by chance teaches nobody.
hypothesis.settings.register_profile("cobot", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("cobot")

# Each client of httpx reads all certificates that the computer trusts, which takes up to 50 ms. Tests ask
# often, and trust nobody in the web: there is none in this folder.
os.environ.pop("SSL_CERT_FILE", None)
os.environ["SSL_CERT_DIR"] = str(Path(__file__).parent)

# Half a million objects come into being while tests are imported and collected, and stay until all have run:
# the collector walks through them neither then nor with each of its turns later.
gc.disable()

LONG = (
    "test_panel.py",
    "test_panel_basics.py",
    "test_ros2_control.py",
    "test_how_to.py",
    "test_crashes.py",
    "test_sanitizers.py",
    "test_schema.py",
    "test_panel_cell.py",
    "test_pick_and_place.py",
    "test_studies.py",
    "test_force_step.py",
    "test_supervisor.py",
    "test_lua_program.py",
    "test_fleet_commands.py",
    "test_fleet_panel.py",
    "test_force_motions.py",
)
"""What takes longest begins first, or one process would be busy with it when all others have ended."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of whole processes wait most of their time, the others compute: among each other they take
    both, where one kind after the other would leave the computer idle and then be waited for.
    """
    kinds: dict[bool, list[Path]] = {True: [], False: []}
    for path in dict.fromkeys(item.path for item in items):
        kinds["e2e" in path.parts].append(path)
    places = {path: index / len(paths) for paths in kinds.values() for index, path in enumerate(paths)}
    items.sort(key=lambda item: (item.path.name not in LONG, places[item.path], item.path))


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    gc.freeze()
    gc.enable()


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


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """The service with default settings on virtual time, one for all tests of a module."""
    from virtual_service import virtual_service  # imports the whole application

    with virtual_service(tmp_path_factory.mktemp("robot")) as started:
        yield started


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """As `service`, with two robots, the first of which is the default one."""
    from virtual_service import virtual_service

    with virtual_service(tmp_path_factory.mktemp("pair"), robots=2) as started:
        yield started
