"""What `rtloop.streaming.collision_monitor` computes, in numpy, with all distances by MuJoCo and
the way to rest by Ruckig.
"""

from __future__ import annotations

import mujoco
import numpy as np
import ruckig

from cobot.config import StreamingSection
from cobot.robot.collision import CollisionChecker
from cobot.robot.model import RobotModel
from cobot.types import Array

LOOK_CYCLES = 4
LATE_CYCLES, LEAD = 6, 3.0
ON_THE_WAY = (0.18, 0.42)
MIN_SHARE = 0.1
APPROACH_M = 1e-5
PROBE_RAD, MIN_PROBE_RAD = 0.02, 0.002
MIN_HEADING_RAD = 1e-6
NEAR_M = 0.01
LINK_ROOM = 0.5


class CollisionMonitor:
    """The compiled monitor's attributes and methods."""

    def __init__(self, model: RobotModel, section: StreamingSection, period_s: float) -> None:
        self._mj = model.mj
        self._data = mujoco.MjData(self._mj)
        self._pairs = CollisionChecker(model).pairs
        self._tool = int(self._mj.body_weldid[self._mj.site_bodyid[model.tcp_site]])
        self._margin_m = section.collision_margin_m
        self._zone_m = section.slow_down_m
        self._limits = model.limits
        self._late_s = LATE_CYCLES * period_s
        self._braking = ruckig.Ruckig(model.limits.dof)
        self._problem = ruckig.InputParameter(model.limits.dof)
        self._problem.control_interface = ruckig.ControlInterface.Velocity
        self._problem.synchronization = ruckig.Synchronization.No
        self._problem.target_velocity = [0.0] * model.limits.dof
        self._problem.max_acceleration = model.limits.max_acceleration.tolist()
        self._problem.max_jerk = model.limits.max_jerk.tolist()
        self._profile = ruckig.Trajectory(model.limits.dof)
        self._way = np.zeros((3, model.limits.dof))
        self._watched: list[tuple[int, int]] = []
        self._here, self._zones_m = np.zeros((2, 0))
        self._ahead = np.zeros((3, 0))
        self._links = np.zeros(0, bool)
        self._blocking = np.zeros(0, bool)
        self._floor = np.zeros(0)
        self._cycle = 0
        self.share = 1.0
        self.blocked = self.inside = False

    def begin(self, command: Array, *, touching: bool) -> None:
        """A session begins.

        Args:
            command: where the arm is, shape (3, dof).
            touching: force control is on, so the tool may touch the surroundings: that is what it is for.
        """
        self._watched = [pair for pair in self._pairs if not (touching and self._is_tool_work(pair))]
        self._here = np.zeros(len(self._watched))
        self._ahead = np.zeros((3, len(self._watched)))
        self._blocking = np.zeros(len(self._watched), bool)
        # The arm's own links are always near each other: they only slow down where it is tight.
        self._links = np.array([not self._has_world(pair) for pair in self._watched], bool)
        self._zones_m = np.where(self._links, NEAR_M, self._zone_m)
        self._cycle = 0
        self.share = 1.0
        self.blocked = False
        self._find_distances(command[0], self._here)
        self._floor = np.full(len(self._watched), -np.inf)
        self._come_nearer()

    def _come_nearer(self) -> Array:
        """What is inside the margin, and nearer than where it was farthest inside."""
        within = self._here < self._margin_m
        self.inside = bool(within.any())
        self._floor = np.where(within, np.maximum(self._floor, self._here), -np.inf)
        return np.asarray(self._here < self._floor - APPROACH_M)

    def look(self, command: Array) -> None:
        """See where the command leads, shape (3, dof)."""
        self._cycle += 1
        phase = self._cycle % LOOK_CYCLES
        if phase == 1:
            self._find_distances(command[0], self._here)
            self._brake(*command)
        else:
            place = {2: 2, 3: 0, 0: 1}[phase]
            self._find_distances(self._way[place], self._ahead[place])
            if self._cycle >= LOOK_CYCLES:
                self._judge()

    def _brake(self, position: Array, velocity: Array, acceleration: Array) -> None:
        """Find where the arm is on its way to rest, and where it comes to rest."""
        late_s, speeds_up = self._late_s, velocity * acceleration >= 0.0
        gain = np.where(speeds_up, acceleration, 0.0)
        size = np.abs(acceleration)
        most = np.minimum(
            np.maximum(self._limits.max_acceleration, size), size + self._limits.max_jerk * late_s
        )
        self._problem.current_position = position + LEAD * late_s * velocity + 0.5 * late_s**2 * gain
        self._problem.current_velocity = velocity + late_s * gain
        self._problem.current_acceleration = np.where(
            speeds_up, np.clip(2.0 * acceleration, -most, most), acceleration
        )
        assert self._braking.calculate(self._problem, self._profile) == ruckig.Result.Working
        for place, share in zip(self._way, (*ON_THE_WAY, 1.0), strict=True):
            place[:] = self._profile.at_time(share * self._profile.duration)[0]

    def _judge(self) -> None:
        here, there = self._here, self._ahead.min(axis=0)
        nearer = there < here - APPROACH_M
        room = np.where(nearer, there - self._margin_m, np.inf)
        sunk = self._come_nearer()
        now = sunk | (room < 0.0)
        self.blocked = bool(now.any())
        if self.blocked:
            self._blocking[:] = now
            self._floor[sunk] = here[sunk]
        halves = np.where(self._links & nearer, LINK_ROOM * (here - self._margin_m), np.inf)
        shares = np.where(room < 0.0, 0.0, room / np.minimum(self._zones_m, halves))
        self.share = min(1.0, max(MIN_SHARE, float(shares.min(initial=1.0))))

    def leads_away(self, position: Array, heading: Array) -> bool:
        """Whether a joint step in this direction, shape (dof,), comes no nearer to what has blocked the way,
        nor to anything that is as near as that.
        """
        before, after = self._probe(position, heading)
        matters = self._blocking | (before < self._margin_m + NEAR_M)
        return bool((after >= before - APPROACH_M)[matters].all())

    def leads_deeper(self, position: Array, heading: Array) -> bool:
        """Whether a joint step in this direction, shape (dof,), brings parts nearer that are inside the
        margin already: these are blocking.
        """
        if np.abs(heading).max() < MIN_HEADING_RAD:
            return False
        before, after = self._probe(position, heading)
        seen = self._here < self._margin_m + NEAR_M  # at the last look
        self._blocking[:] = seen & (before < self._margin_m) & (after < before - APPROACH_M)
        return bool(self._blocking.any())

    def _probe(self, position: Array, heading: Array) -> tuple[Array, Array]:
        """Distances before and after a step that is neither too short nor too long."""
        longest = float(np.abs(heading).max())
        step = heading * (np.clip(longest, MIN_PROBE_RAD, PROBE_RAD) / longest) if longest else heading
        before, after = np.zeros((2, len(self._watched)))
        self._find_distances(position, before)
        self._find_distances(position + step, after)
        return before, after

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
