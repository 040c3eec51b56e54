"""The arm of these tests."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from crx_arm import crx_settings

from cobot.config import Settings
from cobot.robot.description import RobotDescription, load_robot

Made = Callable[..., Settings]


@pytest.fixture(scope="session")
def crx(tmp_path_factory: pytest.TempPathFactory) -> Settings:
    return crx_settings(tmp_path_factory.mktemp("crx"))


@pytest.fixture(scope="session")
def arm(crx: Settings) -> RobotDescription:
    return load_robot(crx)


@pytest.fixture
def made(crx: Settings) -> Made:
    """The settings with other options."""

    def settings(period_ms: int = 8, **options: object) -> Settings:
        backend = crx.robot.backend.model_copy(update={"options": options})
        return crx.model_copy(
            update={
                "robot": crx.robot.model_copy(update={"backend": backend}),
                "rt": crx.rt.model_copy(update={"period_s": period_ms * 1e-3}),
            }
        )

    return settings
