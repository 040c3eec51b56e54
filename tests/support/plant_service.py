"""A service on virtual time with the cell of examples/pick_and_place, which MuJoCo steps."""

from __future__ import annotations

from typing import Any

from physical_cell import EXAMPLE
from rig import Rig
from virtual_service import VirtualService

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop import main as rtloop
from rtloop.backends import make_backend
from rtloop.backends.cell import CellBackend
from rtloop.clock import RealtimeClock

THE_CELL = f"cell: {EXAMPLE}"
"""The key of the section `robot`, as `cobot run --cell` sets it."""


class ServiceOfPlant(VirtualService):
    """Attributes:
    plant: the backend, with the bodies that MuJoCo steps.
    """

    plant: CellBackend

    def _rig(self, settings: Settings, robot: RobotDescription, capacity: int, several: bool) -> Rig:
        made = make_backend(settings, robot.limits)
        assert isinstance(made, CellBackend)
        self.plant = made
        tool = rtloop._load_tool(settings, robot)
        clock = RealtimeClock(settings.rt.period_s)
        rig = self._rig_with(made, "mujoco", settings, robot, capacity, tool=tool, clock=clock)
        rig.loop.controller.tool_and_scene.watch_scene()
        rtloop.describe(rig.memory, robot, made)  # with the version of the scene
        return rig

    def positions(self) -> dict[str, list[float]]:
        """Of the parts, as GET /cell reports them."""
        return {each["name"]: each["position"] for each in self.get("/cell").json()["parts"]}

    def switches(self) -> dict[str, Any]:
        """The values of the switches, as GET /cell reports them."""
        return {each["name"]: each["value"] for each in self.get("/cell").json()["switches"]}
