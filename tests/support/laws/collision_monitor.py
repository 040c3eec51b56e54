"""What `rtloop.streaming.collision_monitor` computes, in numpy, with all distances by MuJoCo."""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.config import StreamingSection
from cobot.robot.collision import CollisionChecker
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits

LOOK_CYCLES = 4
MIN_SHARE = 0.1
APPROACH_M = 1e-5
PROBE_RAD = 0.02
NEAR_M = 0.01
LINK_ROOM = 0.5


class CollisionMonitor:
    """The compiled monitor's attributes and methods."""

    def __init__(self, model: RobotModel, section: StreamingSection, limits: JointLimits) -> None:
        self._mj = model.mj
        self._data = mujoco.MjData(self._mj)
        self._pairs = CollisionChecker(model).pairs
        self._tool = int(self._mj.body_weldid[self._mj.site_bodyid[model.tcp_site]])
        self._margin_m = section.collision_margin_m
        self._zone_m = section.slow_down_m
        self._limits = limits
        self._watched: list[tuple[int, int]] = []
        self._here, self._there, self._zones_m = np.zeros((3, 0))
        self._links = np.zeros(0, bool)
        self._blocking = np.zeros(0, bool)
        self._cycle = 0
        self.share = 1.0
        self.blocked = False

    def begin(self, *, touching: bool) -> None:
        """A session begins.

        Args:
            touching: force control is on, so the tool may touch the surroundings: that is what it is for.
        """
        self._watched = [pair for pair in self._pairs if not (touching and self._is_tool_work(pair))]
        self._here, self._there = np.zeros((2, len(self._watched)))
        self._blocking = np.zeros(len(self._watched), bool)
        # The arm's own links are always near each other: they only slow down where it is tight.
        self._links = np.array([not self._has_world(pair) for pair in self._watched], bool)
        self._zones_m = np.where(self._links, NEAR_M, self._zone_m)
        self._cycle = 0
        self.share = 1.0
        self.blocked = False

    def look(self, command: Array) -> None:
        """See where the command leads, shape (3, dof)."""
        self._cycle += 1
        phase = self._cycle % LOOK_CYCLES
        if phase == LOOK_CYCLES // 2:  # half of the work, so that no cycle has all of it
            self._find_distances(command[0], self._here)
        if phase:
            return
        position, velocity = command[0], command[1]
        here, there = self._here, self._there
        limits = self._limits
        stopping_s = (
            np.abs(velocity) / (2.0 * limits.max_acceleration) + limits.max_acceleration / limits.max_jerk
        )
        self._find_distances(position + velocity * stopping_s, there)
        nearer = there < here - APPROACH_M
        room = np.where(nearer, there - self._margin_m, np.inf)
        self.blocked = bool((room < 0.0).any())
        if self.blocked:
            np.less(room, 0.0, out=self._blocking)
        halves = np.where(self._links & nearer, LINK_ROOM * (here - self._margin_m), np.inf)
        shares = np.where(room < 0.0, 0.0, room / np.minimum(self._zones_m, halves))
        self.share = min(1.0, max(MIN_SHARE, float(shares.min(initial=1.0))))

    def leads_away(self, position: Array, heading: Array) -> bool:
        """Whether a joint step in this direction, shape (dof,), comes no nearer to what has blocked the way,
        nor to anything that is as near as that.
        """
        longest = float(np.abs(heading).max())
        step = heading * (PROBE_RAD / longest) if longest > PROBE_RAD else heading
        self._find_distances(position, self._here)
        self._find_distances(position + step, self._there)
        matters = self._blocking | (self._here < self._margin_m + NEAR_M)
        return bool((self._there >= self._here - APPROACH_M)[matters].all())

    def _find_distances(self, joints: Array, out: Array) -> None:
        """Of the pairs, up to where they begin to matter."""
        data, mj, farthest = self._data, self._mj, self._margin_m + self._zone_m
        np.copyto(data.qpos, joints)
        mujoco.mj_kinematics(mj, data)
        for index, (first, second) in enumerate(self._watched):
            out[index] = mujoco.mj_geomDistance(mj, data, first, second, farthest, None)

    def _has_world(self, pair: tuple[int, int]) -> bool:
        return any(self._is_world(int(self._mj.geom_bodyid[geom])) for geom in pair)

    def _is_world(self, body: int) -> bool:
        """Whether it stands still, and no joint stands on it or on what it is fixed to."""
        stand = int(self._mj.body_parentid[self._mj.jnt_bodyid[0]])
        above = [body]
        while above[-1]:
            above.append(int(self._mj.body_parentid[above[-1]]))
        return bool(self._mj.body_weldid[body] == 0) and (stand == 0 or stand not in above)

    def _is_tool_work(self, pair: tuple[int, int]) -> bool:
        bodies = {int(self._mj.body_weldid[self._mj.geom_bodyid[geom]]) for geom in pair}
        return bodies == {0, self._tool}
