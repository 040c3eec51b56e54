"""Keeps a stream out of the arm itself and its surroundings."""

from libc.math cimport fabs, fmax, fmin

import numpy as np

from cobot.arrays cimport MAX_DOF, bytes_of, checked_dof, doubles
from cobot.robot.distances cimport GeomDistances

from cobot.robot.collision import body_or_geom, geom_pairs

cdef enum:
    # The distances are looked at every so many cycles: at 1 m/s, every 4 mm.
    LOOK_CYCLES = 4

# The share of the velocities that is permitted next to an obstacle.
cdef double MIN_SHARE = 0.1
# A distance has to shrink by as much to count as an approach.
cdef double APPROACH_M = 1e-5
# No joint goes further in the step with which a way out is tried.
cdef double PROBE_RAD = 0.02
# So near beyond the margin links slow down for each other, and count when a way out is looked for.
cdef double NEAR_M = 0.01
# Links slow down for each other only where stopping would take more than this share of their room: many pass
# each other closely all the time, and none is approached by that.
cdef double LINK_ROOM = 0.5


cdef class CollisionMonitor:
    """Looks at the place where the arm could come to rest. Real-time safe.

    Attributes:
        share: of the velocities that is permitted, from `MIN_SHARE` to 1.
        blocked: whether the arm would come to rest nearer than the margin.
    """

    def __init__(self, model, section, limits, mj=None, apart=frozenset()):
        """mj: the model with what else stands around it; apart: pairs of names that may touch."""
        cdef int joint, room
        self._mj = mj or model.mj
        self._dof = checked_dof(limits.dof)
        for joint in range(self._dof):
            self._max_acceleration[joint] = limits.max_acceleration[joint]
            self._jerk_s[joint] = limits.max_acceleration[joint] / limits.max_jerk[joint]
        self._tool = self._mj.body_weldid[self._mj.site_bodyid[model.tcp_site]]
        self._stand = _stand(model.mj)
        self._margin_m = section.collision_margin_m
        self._zone_m = section.slow_down_m
        self._pairs = [
            pair
            for pair in geom_pairs(self._mj)
            if not apart or frozenset(body_or_geom(self._mj, geom) for geom in pair) not in apart
        ]
        self._distances = GeomDistances(self._mj, len(self._pairs), self._margin_m + self._zone_m)
        room = max(1, len(self._pairs))
        self._rows, self._blocking = np.zeros((3, room)), np.zeros(room, np.int8)
        self._links = np.zeros(room, np.int8)
        self._c_zones_m = doubles(self._rows, 3 * room)
        self._c_here, self._c_there = &self._c_zones_m[room], &self._c_zones_m[2 * room]
        self._c_links = bytes_of(self._links, room)
        self._c_blocking = bytes_of(self._blocking, room)
        self._watched = []
        self.share = 1.0
        self.blocked = False

    def begin(self, *, touching):
        """A session begins.

        Args:
            touching: force control is on, so the tool may touch the surroundings: that is what it is for.
        """
        watched = [pair for pair in self._pairs if not (touching and self._is_tool_work(pair))]
        self._distances.watch(watched)
        self._watched = watched
        self._rows[...] = 0.0
        self._blocking[...] = False
        for index, pair in enumerate(watched):
            # The arm's own links are always near each other: they only slow down where it is tight.
            self._links[index] = not self._has_world(pair)
            self._rows[0, index] = NEAR_M if self._links[index] else self._zone_m
        self._cycle = 0
        self.share = 1.0
        self.blocked = False

    def blocking(self):
        """What would come too near to what, in words; "" if nothing has."""
        found = dict.fromkeys(
            " and ".join(body_or_geom(self._mj, geom) for geom in pair)
            for index, pair in enumerate(self._watched)
            if self._blocking[index]
        )
        return ", ".join(found)

    def look(self, command):
        """See where the command leads, shape (3, dof)."""
        rows = np.array(command, dtype=np.float64)
        self.c_look(doubles(rows, 3 * self._dof))

    cdef void c_look(self, const double* command) noexcept nogil:
        """See where the command, 3 × dof, leads."""
        cdef const double* velocity = &command[self._dof]
        cdef double rest[MAX_DOF]
        cdef double stopping_s
        cdef int joint, phase
        self._cycle += 1
        phase = self._cycle % LOOK_CYCLES
        if phase == LOOK_CYCLES // 2:  # half of the work, so that no cycle has all of it
            self._distances.c_find(command, self._c_here)
        if phase:
            return
        for joint in range(self._dof):
            stopping_s = fabs(velocity[joint]) / (2.0 * self._max_acceleration[joint]) + self._jerk_s[joint]
            rest[joint] = command[joint] + velocity[joint] * stopping_s
        self._distances.c_find(rest, self._c_there)
        self._judge()

    cdef void _judge(self) noexcept nogil:
        """What follows from the distances here and where the arm could come to rest."""
        cdef const double* here = self._c_here
        cdef const double* there = self._c_there
        cdef double share = 1.0
        cdef double left_m, zone_m
        cdef bint blocked = False
        cdef int index
        for index in range(self._distances.count):
            if there[index] < here[index] - APPROACH_M:
                left_m, zone_m = there[index] - self._margin_m, self._c_zones_m[index]
                if left_m < 0.0:
                    blocked, share = True, 0.0
                    continue
                if self._c_links[index]:
                    zone_m = fmin(zone_m, LINK_ROOM * (here[index] - self._margin_m))
                share = fmin(share, left_m / zone_m)
        self.blocked = blocked
        self.share = fmax(MIN_SHARE, share)
        if blocked:
            for index in range(self._distances.count):
                self._c_blocking[index] = (
                    there[index] < here[index] - APPROACH_M and there[index] < self._margin_m
                )

    def leads_away(self, position, heading):
        """`c_leads_away`, for a position and a joint step of shape (dof,), rad."""
        here, step = np.array(position, dtype=np.float64), np.array(heading, dtype=np.float64)
        return self.c_leads_away(doubles(here, self._dof), doubles(step, self._dof))

    cdef bint c_leads_away(self, const double* position, const double* heading) noexcept nogil:
        """Whether a joint step in this direction comes no nearer to what has blocked the way, nor to anything
        that is as near as that.
        """
        cdef double there[MAX_DOF]
        cdef double longest = PROBE_RAD
        cdef double before
        cdef int index
        for index in range(self._dof):
            longest = max(longest, fabs(heading[index]))
        for index in range(self._dof):
            there[index] = position[index] + heading[index] * (PROBE_RAD / longest)
        if not self._distances.c_find(position, self._c_here):
            return False
        if not self._distances.c_find(there, self._c_there):
            return False
        for index in range(self._distances.count):
            before = self._c_here[index]
            if self._c_blocking[index] or before < self._margin_m + NEAR_M:
                if not self._c_there[index] >= before - APPROACH_M:
                    return False
        return True

    def _has_world(self, pair):
        return any(
            self._mj.body_weldid[body] == 0 and self._mj.body(body).name not in self._stand
            for body in (self._mj.geom_bodyid[geom] for geom in pair)
        )

    def _is_tool_work(self, pair):
        bodies = {int(self._mj.body_weldid[self._mj.geom_bodyid[geom]]) for geom in pair}
        return bodies == {0, self._tool}


def _stand(mj):
    """Names of the bodies that the first joint stands on, with what is fixed to it: they are the arm's own,
    although they stand still like the world. What is below them is not.
    """
    first = int(mj.body_parentid[mj.jnt_bodyid[0]])
    bodies = {first} if first else set()
    for body in range(first + 1, mj.nbody):  # MuJoCo lists parents before their children.
        if mj.body_weldid[body] == 0 and mj.body_parentid[body] in bodies:
            bodies.add(body)
    return {mj.body(body).name for body in bodies}
