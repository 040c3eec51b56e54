"""A backend of somebody's own is found by module and class, and driven through the Python protocol.

Oracle: what the backend itself has kept.
"""

from __future__ import annotations

import numpy as np
import pytest
from own_arm import Arm
from running import unique_name

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.ipc.shm import RobotMemory
from cobot.robot.description import RobotDescription
from rtloop.backends import make_backend
from rtloop.clock import FastClock
from rtloop.loop import ControlLoop

CYCLES = 20


def with_backend(settings: Settings, name: str) -> Settings:
    return settings.model_copy(update={"rt": settings.rt.model_copy(update={"backend": name})})


def test_an_arm_of_ones_own_is_loaded_by_its_name_and_held(
    settings: Settings, robot: RobotDescription
) -> None:
    arm = make_backend(with_backend(settings, "own_arm:Arm"), robot.limits)
    assert isinstance(arm, Arm)
    memory = RobotMemory.create(unique_name(), robot.limits.dof, settings.rt.period_s, 100)
    home = np.array(robot.positions["home"].joints)
    try:
        loop = ControlLoop(settings, robot.model, memory, arm, FastClock(settings.rt.period_s))
        loop.open(home)
        for _ in range(CYCLES):
            loop.step()
        loop.close()
    finally:
        memory.unlink()
        memory.close()
    assert arm.calls == ["open", "enable", "disable", "close"]
    assert len(arm.commands) == CYCLES
    for command in arm.commands:
        assert np.array_equal(command, [home, np.zeros(7), np.zeros(7)])


@pytest.mark.parametrize("name", ["own_arm", "own_arm:Leg", "no_such_module:Arm"])
def test_a_backend_that_is_not_there_is_refused_by_its_name(
    settings: Settings, robot: RobotDescription, name: str
) -> None:
    with pytest.raises(ConfigError, match=f"rt.backend: .*{name}"):
        make_backend(with_backend(settings, name), robot.limits)
