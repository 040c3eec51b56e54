"""Keeps a stream out of the arm itself and its surroundings."""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.collision import CollisionChecker
from cobot.config import StreamingSection
from cobot.model import RobotModel
from cobot.types import Array, JointLimits

LOOK_CYCLES = 4
"""The distances are looked at every so many cycles: at 1 m/s, every 4 mm."""
LEAST_SHARE = 0.1
"""Of the velocities, next to an obstacle."""
APPROACH_M = 1e-5
"""By which a distance has to shrink to count as an approach."""
PROBE_RAD = 0.02


class Guard:
    """Looks at the place where the arm could come to rest. Real-time safe.

    Attributes:
        share: of the velocities that is permitted, from `LEAST_SHARE` to 1.
        blocked: whether the arm would come to rest nearer than the margin.
    """

    def __init__(self, model: RobotModel, section: StreamingSection, limits: JointLimits) -> None:
        self._mj = model.mj
        self._data = mujoco.MjData(self._mj)
        self._pairs = CollisionChecker(model).pairs
        self._tool = int(self._mj.body_weldid[self._mj.site_bodyid[model.tcp_site]])
        self._margin_m = section.collision_margin_m
        self._zone_m = section.slow_down_m
        self._limits = limits
        self._watched = self._pairs
        self._cycle = 0
        self.share = 1.0
        self.blocked = False

    def begin(self, *, touching: bool) -> None:
        """A session begins.

        Args:
            touching: force control is on, so the tool may touch the surroundings: that is what it is for.
        """
        self._watched = [pair for pair in self._pairs if not (touching and self._is_tool_work(pair))]
        self._cycle = 0
        self.share = 1.0
        self.blocked = False

    def look(self, command: Array) -> None:
        """See where the command leads, shape (3, dof)."""
        self._cycle += 1
        if self._cycle % LOOK_CYCLES:
            return
        position, velocity = command[0], command[1]
        limits = self._limits
        stopping_s = (
            np.abs(velocity) / (2.0 * limits.max_acceleration) + limits.max_acceleration / limits.max_jerk
        )
        here = self._distance_m(position)
        there = self._distance_m(position + velocity * stopping_s)
        nearer = there < here - APPROACH_M
        self.blocked = nearer and there < self._margin_m
        share = (there - self._margin_m) / self._zone_m if nearer else 1.0
        self.share = min(1.0, max(LEAST_SHARE, share))

    def leads_away(self, position: Array, heading: Array) -> bool:
        """Whether a joint step in this direction, shape (dof,), does not come nearer."""
        longest = float(np.abs(heading).max())
        step = heading * (PROBE_RAD / longest) if longest > PROBE_RAD else heading
        return self._distance_m(position + step) >= self._distance_m(position) - APPROACH_M

    def _distance_m(self, joints: Array) -> float:
        """The smallest distance, up to where it begins to matter."""
        data, least = self._data, self._margin_m + self._zone_m
        np.copyto(data.qpos, joints)
        mujoco.mj_kinematics(self._mj, data)
        for first, second in self._watched:
            least = min(least, mujoco.mj_geomDistance(self._mj, data, first, second, least, None))
        return least

    def _is_tool_work(self, pair: tuple[int, int]) -> bool:
        bodies = {int(self._mj.body_weldid[self._mj.geom_bodyid[geom]]) for geom in pair}
        return bodies == {0, self._tool}
