"""The simulated arm in a cell, driven without rtloop: whole motions, and what becomes of the parts."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import yaml

from cobot.cell import load_cell
from cobot.cell.plant_hands import FINGERS
from cobot.cell.surroundings import cup_as_tool, hand_as_tool
from cobot.config import Settings
from cobot.planners import MotionRequest, plan
from cobot.robot.description import RobotDescription
from cobot.robot.tool import Tool
from cobot.types import Array, PlannerName, Pose, Scaling
from rtloop.backends import Measured, make_backend

EXAMPLE = Path(__file__).parents[2] / "examples" / "pick_and_place"
DOWN = np.array([0.0, 0.0, 1.0, 0.0])
"""The hand points down, its fingers move along the base frame's x axis."""


def with_cell(settings: Settings, cell: Path) -> Settings:
    return settings.model_copy(update={"robot": settings.robot.model_copy(update={"cell": cell})})


def write_cell(folder: Path, content: dict[str, Any]) -> Path:
    """Write a cell file."""
    file = folder / "cell.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


class CellArm:
    """The arm with its hand as the tool.

    Args:
        robot: a description of its own, because the tool changes it.
    """

    def __init__(self, settings: Settings, robot: RobotDescription, cell: Path = EXAMPLE) -> None:
        self.robot = robot
        self.backend: Any = self.made(with_cell(settings, cell))
        self.cell = load_cell(cell)
        if self.cell.hand is not None:
            tool = hand_as_tool(self.cell.hand)
            self.carry(tool)
        if self.cell.cup is not None:
            self.carry(cup_as_tool(self.cell.cup))
        self.joints = np.array(robot.positions["home"].joints)
        self.backend.open(self.joints)
        self.measured = Measured(robot.limits.dof)
        self._command = np.zeros((3, robot.limits.dof))
        self._command[0] = self.joints

    def made(self, settings: Settings) -> Any:
        return make_backend(settings, self.robot.limits)

    def carry(self, tool: Tool) -> None:
        """Have the arm, its model and the plant carry a tool."""
        self.robot.model.carry(tool)
        self.backend.set_tool(tool)
        self.backend.mount(tool)

    def hold(self, cycles: int = 1) -> None:
        for _ in range(cycles):
            self._step()

    def go(self, goal: Pose | Array, planner: PlannerName = PlannerName.PTP, speed: float = 1.0) -> None:
        """Move there and come to rest."""
        motion = plan(self.robot, MotionRequest(self.joints, goal, planner, Scaling(speed)))
        assert motion is not None
        times_s = np.arange(0.0, motion.duration_s, 0.001)
        for rows in zip(*(motion.sample(times_s, derivative) for derivative in range(3)), strict=True):
            self._command[:] = rows
            self._step()
        self.joints = motion.end.copy()
        self._command[:] = 0.0
        self._command[0] = self.joints
        self.hold(100)

    def go_to(self, x: float, y: float, z: float, planner: PlannerName = PlannerName.PTP) -> None:
        """Have the TCP there, the hand pointing down."""
        self.go(Pose(np.array([x, y, z]), DOWN), planner, 1.0 if planner is PlannerName.PTP else 0.4)

    def move_hand(self, width: float, force: float = 40.0, speed: float = 0.1) -> int:
        """Command the hand and wait until it rests; the number of cycles."""
        for name, value in (("force", force), ("speed", speed), ("width", width)):
            self.backend.set_output(f"hand.{name}", value)
        for cycle in range(5000):
            if not self.read("hand.moving"):
                return cycle
            self.hold()
        raise AssertionError("the hand does not come to rest")

    def pick(self, name: str, height: float = 0.12) -> None:
        """Grasp a part from above and lift it."""
        x, y, z = self.part(name).position
        self.go_to(x, y, z + height)
        self.go_to(x, y, z, PlannerName.LIN)
        self.move_hand(0.0)
        self.go_to(x, y, z + height, PlannerName.LIN)

    def read(self, name: str) -> float:
        value: float = self.backend.read_input(name)
        return value

    def part(self, name: str) -> Pose:
        """The pose of a part in the base frame."""
        poses = np.zeros((len(self.cell.parts), 7))
        self.backend.part_poses(poses)
        return Pose.from_numbers(poses[list(self.cell.parts).index(name)])

    def part_in_tcp(self, name: str) -> Pose:
        return self.robot.model.forward(self.measured.position).inverse() @ self.part(name)

    def finger_forces(self, part: str) -> list[float]:
        """Normal force between each finger and the part, N: MuJoCo's contact forces."""
        mj, data = self.backend.plant.mj, self.backend._plant_data
        forces = dict.fromkeys(FINGERS, 0.0)
        for index, contact in enumerate(data.contact):
            names = {mj.geom(contact.geom1).name, mj.geom(contact.geom2).name}
            finger = names & forces.keys()
            if part in names and finger:
                force = np.zeros(6)
                mujoco.mj_contactForce(mj, data, index, force)
                forces[finger.pop()] += force[0]
        return list(forces.values())

    def _step(self) -> None:
        assert self.backend.try_write(self._command)
        assert self.backend.try_read(self.measured)
