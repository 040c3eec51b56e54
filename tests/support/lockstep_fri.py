"""A simulated cabinet and the backend in one process, as the tests ask for them."""

from __future__ import annotations

from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends.fri import FriBackend
from rtloop.backends.fri.simulator.cabinet import Cabinet
from rtloop.backends.fri.simulator.network import FriNetwork
from rtloop.backends.fri.simulator.options import CabinetOptions
from rtloop.backends.simulators.arm import ControllerArm
from rtloop.backends.simulators.lockstep import LockStep
from rtloop.backends.simulators.network import Network


def fri_settings(settings: Settings, period_ms: int = 5, **options: Any) -> Settings:
    """The shipped ones with the backend `fri`."""
    backend = settings.robot.backend.model_copy(update={"type": "fri", "options": options})
    return settings.model_copy(
        update={
            "robot": settings.robot.model_copy(update={"backend": backend}),
            "rt": settings.rt.model_copy(update={"period_s": period_ms * 1e-3}),
        }
    )


def made_cabinet(
    settings: Settings, robot: RobotDescription, options: CabinetOptions | None = None
) -> Cabinet:
    """With the shipped arm where its start position is."""
    options = options or CabinetOptions()
    start = np.array(robot.positions[settings.robot.start_position].joints)
    return Cabinet(ControllerArm(settings, robot.limits, start, options.springs), options)


def joined(
    settings: Settings,
    robot: RobotDescription,
    cabinet: CabinetOptions | None = None,
    network: Network | None = None,
    **options: Any,
) -> tuple[FriBackend, LockStep]:
    """A backend that is not open yet, and its way to a cabinet."""
    cell = cabinet or CabinetOptions()
    channel = LockStep(made_cabinet(settings, robot, cell), network or FriNetwork())
    own = fri_settings(settings, cell.period_ms, **options)
    return FriBackend(own, robot.limits, channel=channel, clock=channel.clock), channel
