"""The backend that the checks examine, its arm, and a new device for each check."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from cobot.config import Settings
from cobot.contract_checks import ContractError
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode
from rtloop.contract.driver import Driver
from rtloop.contract.rig import rig_of

REST_S = 0.2


@dataclass(frozen=True, slots=True)
class CheckedBackend:
    """A backend under test.

    Attributes:
        kind: the backend's class.
        settings: settings with the backend's name, its options and a supported period.
        robot: the arm.
        realtime: whether to check durations.
    """

    kind: Any
    settings: Settings
    robot: RobotDescription
    realtime: bool = False

    @contextmanager
    def drive(self) -> Iterator[Driver]:
        """Context manager that opens the backend and its device. The arm is initially at rest."""
        with self.make_driver() as driver:
            driver.start()
            driver.until(
                "the arm is held", lambda: driver.mode == LoopMode.HOLD and bool(driver.heard.commands)
            )
            driver.run(REST_S)
            if driver.mode != LoopMode.HOLD:
                raise ContractError(
                    f"while the arm is at rest, the mode changes to {driver.mode.name}: {driver.reason}"
                )
            yield driver

    @contextmanager
    def make_driver(self) -> Iterator[Driver]:
        """Create a backend and its device, without opening the backend."""
        driver = Driver(self.settings, self.robot, rig_of(self.kind, self.settings, self.robot.limits))
        try:
            yield driver
        finally:
            driver.close()
