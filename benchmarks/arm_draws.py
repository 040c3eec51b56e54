"""Random postures of any arm, a measure of how still the arm holds them in the simulation, and lines that it
can follow.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.robot.tool import BARE, Tool
from cobot.types import FREE_AXES, Array, FreeAxis, Pose, vector
from rtloop.backends import Measured
from rtloop.backends.mujoco import MujocoBackend

DRAWS = 20_000
"""Random postures among which free ones are looked for that the drives can hold."""
HOLDABLE = 0.9
"""Share of the efforts that gravity may need in a posture that counts as holdable."""
CARRIES = 0.95
"""Share of the postures in which the drives hold the payload, of those in which they hold the arm."""
SINGULAR = 1e-3
"""What moves or turns the TCP by less, as a share of the reach or in rad per rad, counts as nothing."""
DISTURBANCE = 1e-3
"""Initial distance of each joint from the commanded posture, rad; of a slide, as a share of the reach."""
HOLDS_S = 1.0
LINE = (0.02, 0.15)
"""Length of a line, as a share of the reach."""


class Arm:
    """An arm, and the random numbers for it.

    Attributes:
        size: by which the positions of its joints are divided: 1, of a slide the reach.
    """

    def __init__(self, settings: Settings, robot: RobotDescription, random: np.random.Generator) -> None:
        self.settings, self.robot, self.random = settings, robot, random
        self.home = vector(robot.positions[settings.robot.start_position].joints)
        limits = robot.limits
        drawn = random.uniform(limits.min_position, limits.max_position, (DRAWS, limits.dof))
        self._drawn = np.vstack([self.home, drawn])
        places = [robot.model.forward(joints).position for joints in drawn[:200]]
        self.reach_m = float(np.linalg.norm(places, axis=1).max())
        slides = np.array(limits.slides or [False] * limits.dof)
        self.size = np.where(slides, self.reach_m, 1.0)

    def payload(self) -> Tool:
        """The permitted payload. It is halved until the drives can hold it in nearly every posture in which
        they can hold the arm.
        """
        mass = self.settings.robot.max_payload_kg
        drawn = [joints for joints in self._drawn[:300] if self._holds(joints)]
        while mass > 1e-3:
            tool = Tool(version=1, mass=mass, centre=(0.0, 0.0, 0.05 * self.reach_m))
            self.robot.model.carry(tool)
            held = sum(self._holds(joints) for joints in drawn)
            self.robot.model.carry(BARE)
            if held >= CARRIES * len(drawn):
                return tool
            mass /= 2.0
        return BARE

    def holdable(self, tool: Tool, count: int) -> list[Array]:
        """Collision-free postures that the drives can hold. The first one is home, if the drives can hold
        home.
        """
        self.robot.model.carry(tool)
        found: list[Array] = []
        for joints in self._drawn:
            if len(found) < count and self._holds(joints) and self.robot.collision.is_free(joints):
                found.append(joints)
        self.robot.model.carry(BARE)
        return found

    def speeds(self, postures: Sequence[Array], tool: Tool) -> Array:
        """For each posture, the largest joint velocity after the arm has held the posture for some time.
        Shape: (n,).
        """
        backend = MujocoBackend(self.settings, self.robot.limits)
        backend.set_tool(tool)
        measured, command = Measured(self.robot.limits.dof), np.zeros((3, self.robot.limits.dof))
        cycles = round(HOLDS_S / self.settings.rt.period_s)
        found = []
        for joints in postures:
            backend.open(joints + DISTURBANCE * self.size * self.random.choice([-1.0, 1.0], len(joints)))
            command[0] = joints
            for _ in range(cycles):
                backend.write(command)
            backend.read(measured)
            velocity = np.abs(measured.velocity / self.size).max()
            found.append(float(velocity) if np.isfinite(velocity) else np.inf)
        return np.array(found)

    def line(self, start: Array) -> tuple[Pose, tuple[FreeAxis, ...]]:
        """The end of a line in a direction that the joints permit, and the rotations that must be free. For
        an arm with few joints, as many rotations are free as the TCP needs to move in most directions;
        otherwise none.
        """
        here = self.robot.model.forward(start)
        _, rotation, jacobian = self.robot.model.forward_and_jacobian(start)
        moving, turning = jacobian[:3].copy(), rotation.T @ jacobian[3:]
        choices: list[tuple[FreeAxis, ...]] = [()]
        if len(start) < len(jacobian):
            choices += [*((axis,) for axis in FREE_AXES), FREE_AXES]
        ways = [(free, self._directions(moving, turning, free)) for free in choices]
        free, directions = max(ways, key=lambda each: each[1].shape[1])
        way = directions @ self.random.normal(size=directions.shape[1])
        way *= self.random.uniform(*LINE) * self.reach_m / max(float(np.linalg.norm(way)), 1e-9)
        return Pose(here.position + way, here.quaternion), free

    def _directions(self, moving: Array, turning: Array, free: tuple[FreeAxis, ...]) -> Array:
        """The orthonormal directions in which the TCP can move if only the free rotations change. Shape: (3,
        n).
        """
        held = turning[[index for index, axis in enumerate(FREE_AXES) if axis not in free]]
        within = np.eye(moving.shape[1])
        if len(held):
            _, values, rows = np.linalg.svd(held)
            within = rows[int((values > SINGULAR).sum()) :].T
        columns, values, _ = np.linalg.svd(moving @ within)
        return columns[:, : int((values > SINGULAR * self.reach_m).sum())]

    def _holds(self, joints: Array) -> bool:
        needed = np.abs(self.robot.model.gravity_torques(joints))
        return bool((needed <= HOLDABLE * self.robot.limits.max_effort).all())
