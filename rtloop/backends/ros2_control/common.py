"""The common parts of both ros2_control backends."""

from __future__ import annotations

import logging
from dataclasses import replace

import numpy as np

from cobot.config import Settings
from cobot.robot.device import Capabilities, DeviceStatus
from cobot.robot.io_points import IoPoint
from cobot.types import JointLimits
from rtloop.backends.protocols import BackendError
from rtloop.backends.ros2_control import words
from rtloop.backends.ros2_control.gpio import GpioPoints
from rtloop.backends.ros2_control.link import ControllerLink, Facts
from rtloop.backends.ros2_control.options import Ros2ControlOptions, ros_names

LOOK_S = 0.05
log = logging.getLogger("cobot.rtloop")


class ControllerClient:
    """A client of an arm's controllers. It checks their reports, and makes the status."""

    capabilities: Capabilities
    way = words.GOALS

    def __init__(self, options: Ros2ControlOptions, limits: JointLimits, link: ControllerLink) -> None:
        self._options, self._names, self._link = options, ros_names(options, limits), link
        self._gpio = GpioPoints(options)
        self._expected = words.Expectation(
            options.below(options.joint_states),
            self._names,
            limits.min_position,
            limits.max_position,
            tuple(options.measured),
            options.state_timeout_s,
            options.min_rate_hz,
        )
        self.capabilities = replace(
            type(self).capabilities, measured=frozenset({"position", *options.measured}), io=self._gpio.exist
        )
        self._facts = Facts()
        self._percent = False

    def status(self) -> DeviceStatus:
        facts = self._facts
        state = next(
            (each["state"] for each in facts.controllers or () if each["name"] == facts.controller), ""
        )
        share = 1.0 if facts.scaling is None else facts.scaling / self._full_speed(facts.scaling)
        return DeviceStatus(
            connection="connected" if facts.ready else "not connected",
            quality=f"joint states {facts.rate_hz:.0f} Hz" if facts.rate_hz else "",
            drives=f"{facts.controller} {state}".strip() if facts.controller else "",
            speed_scaling=min(max(share, 0.0), 1.0) if np.isfinite(share) else 0.0,
            text=facts.gpio_problem,
        )

    def io(self) -> list[IoPoint]:
        return self._gpio.points(self._facts)

    def set_output(self, name: str, value: float) -> None:
        self._link.set_output(self._gpio.place_of(name), value)

    def _look_at_facts(self) -> Facts:
        """Get the facts. Log outputs that were not set or set late, and inputs that cannot be read."""
        before, self._facts = self._facts, self._link.facts()
        if (problem := self._facts.gpio_problem) and problem != before.gpio_problem:
            log.warning("inputs and outputs of the device: %s", problem)
        return self._facts

    def _full_speed(self, scaling: float) -> float:
        """Return the value of the speed slider that means full speed."""
        if self._options.speed_scaling_full is not None:
            return self._options.speed_scaling_full
        self._percent = self._percent or scaling > 1.0
        return 100.0 if self._percent else 1.0

    def _await(self) -> None:
        """Wait until the driver can be used.

        Raises:
            BackendError: the driver cannot be used within `connect_s`; the error gives the reason.
        """
        problem = ""
        for _ in range(max(int(self._options.connect_s / LOOK_S), 1)):
            facts = self._look_at_facts()
            problem = self._of_driver(facts)
            if not problem:
                return
            self._link.pause(LOOK_S)
        raise BackendError(problem)

    def _of_driver(self, facts: Facts) -> str:
        """Return the reason why the driver cannot be used; "" if it can be used."""
        return (
            words.of_connection(facts, self._options.namespace, self.way)
            or words.of_joints_of_controller(facts, self._names)
            or words.of_joint_states(facts, self._expected)
            or words.disagreement(facts, self._names, self._expected.topic)
        )


def options_of(settings: Settings, kind: type[Ros2ControlOptions]) -> Ros2ControlOptions:
    """Return the options from the settings."""
    options = settings.backend_options(kind)
    assert isinstance(options, Ros2ControlOptions)
    return options
