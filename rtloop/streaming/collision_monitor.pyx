"""Prevents a stream from colliding the arm with itself or its surroundings."""

from libc.math cimport INFINITY, fabs, fmax, fmin

import numpy as np

from cobot.arrays cimport MAX_DOF, bytes_of, doubles
from cobot.robot.distances cimport GeomDistances
from rtloop.generators.otg cimport OTG_OK, Problem, Profile, otg_velocity, profile_at
from rtloop.generators.rates cimport take_rates

from cobot.robot.collision import body_or_geom, geom_pairs

cdef enum:
    # The distances are checked once per this number of cycles: at 1 m/s, every 4 mm.
    LOOK_CYCLES = 4

# Maximum age of the motion on which a decision is based, in cycles. Each place is checked once per
# LOOK_CYCLES, a few cycles after the motion was read. The decision takes effect in the next cycle, and the
# arm continues until then.
cdef double LATE_CYCLES = LOOK_CYCLES + 2.0
# The arm continues for T s before it decelerates: at the velocity v it moves v T further. At the beginning of
# a motion, the acceleration may also grow, which adds up to 2 v T.
cdef double LEAD = 3.0
# Joints stop one after another, so the arm does not decelerate along a straight line. After these shares of
# the stopping time, it has moved about a third and two thirds of the way.
cdef double FIRST_THIRD = 0.18
cdef double SECOND_THIRD = 0.42

# The permitted share of the velocities next to an obstacle.
cdef double MIN_SHARE = 0.1
# A distance that decreases by at least this is an approach.
cdef double APPROACH_M = 1e-5
# The value of `_c_floor` for two parts that are outside the margin.
cdef double OUTSIDE = -1e9
# Maximum motion of a joint in the step that tests a way out.
cdef double PROBE_RAD = 0.02
# A smaller step has no direction: it is only rounding of an arm that must not move.
cdef double MIN_HEADING_RAD = 1e-6
# A shorter step is extended to this length, because a step of a few µm changes a distance too little.
cdef double MIN_PROBE_RAD = 0.002
# Links slow down for each other if they are this close to the margin. These pairs are also checked when a way
# out is tested.
cdef double NEAR_M = 0.01
# Links of the arm often pass close to each other. They slow the stream down only if stopping takes more than
# this share of the space between them. So pairs that are further than NEAR_M / LINK_ROOM beyond the margin
# have no effect and are not measured.
cdef double LINK_ROOM = 0.5


cdef class CollisionMonitor:
    """Checks the distances at the position where the arm could come to rest, and at two positions on the way
    there. Real-time safe.

    Attributes:
        share: permitted share of the velocities, from `MIN_SHARE` to 1.
        blocked: whether the arm would stop inside the margin, or is inside it and moving closer.
        inside: whether an obstacle is already inside the margin.
    """

    def __init__(self, model, section, double period_s, mj=None, apart=frozenset()):
        """`mj` is a model that includes the surroundings, `apart` are pairs of names that may touch."""
        cdef int room
        self._mj = mj or model.mj
        self._dof = take_rates(model.limits, &self._rates)
        self._late_s = LATE_CYCLES * period_s
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
        self._rows, self._blocking = np.zeros((8, room)), np.zeros(room, np.int8)
        self._links = np.zeros(room, np.int8)
        self._c_zones_m = doubles(self._rows, 8 * room)
        self._c_here, self._c_there = &self._c_zones_m[room], &self._c_zones_m[2 * room]
        self._c_first, self._c_second = &self._c_zones_m[3 * room], &self._c_zones_m[4 * room]
        self._c_before, self._c_after = &self._c_zones_m[5 * room], &self._c_zones_m[6 * room]
        self._c_floor = &self._c_zones_m[7 * room]
        self._c_links = bytes_of(self._links, room)
        self._c_blocking = bytes_of(self._blocking, room)
        self._watched = []
        self.share = 1.0
        self.blocked = self.inside = False

    def begin(self, command, *, touching):
        """Begin a session.

        Args:
            command: state of the arm, shape (3, dof).
            touching: whether force control is on. Then the tool may touch the surroundings.
        """
        watched = [pair for pair in self._pairs if not (touching and self._is_tool_work(pair))]
        links = [not self._has_world(pair) for pair in watched]
        everywhere_m = self._margin_m + self._zone_m
        links_m = min(everywhere_m, self._margin_m + NEAR_M / LINK_ROOM)
        self._distances.watch(watched, [links_m if link else everywhere_m for link in links])
        self._watched = watched
        self._rows[...] = 0.0
        self._rows[7] = OUTSIDE
        self._blocking[...] = False
        for index in range(len(watched)):
            # The arm's own links are always close to each other. They slow the arm down only if there is
            # little room to stop.
            self._links[index] = links[index]
            self._rows[0, index] = NEAR_M if self._links[index] else self._zone_m
        self._cycle = 0
        self.share = 1.0
        self.blocked = self.inside = False
        rows = np.array(command, dtype=np.float64)
        if self._distances.c_find(doubles(rows, 3 * self._dof), self._c_here):
            self._rows[2:5] = self._rows[1]  # the arm is at rest here
            self._see_inside()

    def blocking(self):
        """The pairs of parts that would come too close to each other."""
        found = dict.fromkeys(
            tuple(body_or_geom(self._mj, geom) for geom in pair)
            for index, pair in enumerate(self._watched)
            if self._blocking[index]
        )
        return tuple(found)

    def look(self, command):
        """Check where the command, shape (3, dof), leads."""
        rows = np.array(command, dtype=np.float64)
        self.c_look(doubles(rows, 3 * self._dof))

    cdef void c_look(self, const double* command) noexcept nogil:
        """Like `look`, for compiled code; 3 × dof."""
        self._cycle += 1
        # One position per cycle, to distribute the work.
        cdef int phase = self._cycle % LOOK_CYCLES
        if phase == 1:
            self._distances.c_find(command, self._c_here)
            self._find_way_to_rest(command)
        elif phase == 2:
            self._distances.c_find(self._way[2], self._c_there)
        elif phase == 3:
            self._distances.c_find(self._way[0], self._c_first)
        else:
            self._distances.c_find(self._way[1], self._c_second)
        if phase != 1 and self._cycle >= LOOK_CYCLES:
            self._judge()

    cdef void _find_way_to_rest(self, const double* command) noexcept nogil:
        """Calculate the position where the arm comes to rest if it decelerates now, and positions on the way
        there.
        """
        cdef Profile profiles[MAX_DOF]
        cdef double there[3]
        cdef double longest_s = 0.0
        cdef Problem problem
        cdef int joint
        for joint in range(self._dof):
            self._extrapolate(joint, command, &problem)
            problem.target_position = problem.target_velocity = 0.0
            problem.max_velocity = self._rates.velocity[joint]
            problem.min_velocity = -problem.max_velocity
            problem.max_acceleration = self._rates.acceleration[joint]
            problem.min_acceleration = -problem.max_acceleration
            if otg_velocity(&problem, &profiles[joint]) == OTG_OK:
                longest_s = fmax(longest_s, profiles[joint].duration)
                self._way[2][joint] = profiles[joint].end_position
            else:  # numbers close to zero, for which there may be no profile
                profiles[joint].duration = -1.0
                self._way[0][joint] = self._way[1][joint] = self._way[2][joint] = problem.position
        for joint in range(self._dof):
            if profiles[joint].duration >= 0.0:
                profile_at(&profiles[joint], FIRST_THIRD * longest_s, there)
                self._way[0][joint] = there[0]
                profile_at(&profiles[joint], SECOND_THIRD * longest_s, there)
                self._way[1][joint] = there[0]

    cdef void _extrapolate(self, int joint, const double* command, Problem* problem) noexcept nogil:
        """Calculate the state that a joint may reach before the result of this check takes effect.

        An accelerating joint continues to accelerate, and its acceleration may grow. It is assumed at most to
        double, so that the joints keep their proportions at the beginning of a motion.
        """
        cdef double velocity = command[self._dof + joint], acceleration = command[2 * self._dof + joint]
        cdef double most = self._rates.acceleration[joint], time_s = self._late_s
        problem.max_jerk = self._rates.jerk[joint]
        problem.position = command[joint] + LEAD * time_s * velocity
        problem.velocity, problem.acceleration = velocity, acceleration
        if velocity * acceleration >= 0.0:
            problem.position += 0.5 * time_s * time_s * acceleration
            problem.velocity += time_s * acceleration
            most = fmin(fmax(most, fabs(acceleration)), fabs(acceleration) + problem.max_jerk * time_s)
            problem.acceleration = fmax(-most, fmin(2.0 * acceleration, most))

    cdef void _judge(self) noexcept nogil:
        """Evaluate the distances at the arm's current position and where it could come to rest."""
        cdef const double* here = self._c_here
        cdef double share = 1.0
        cdef double nearest_m, left_m, zone_m
        cdef bint blocked = self._see_inside()
        cdef int index
        for index in range(self._distances.count):
            nearest_m = self._nearest(index)
            if nearest_m < here[index] - APPROACH_M:
                left_m, zone_m = nearest_m - self._margin_m, self._c_zones_m[index]
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
                nearest_m = self._nearest(index)
                self._c_blocking[index] = here[index] < self._c_floor[index] - APPROACH_M or (
                    nearest_m < here[index] - APPROACH_M and nearest_m < self._margin_m
                )
                if here[index] < self._c_floor[index] - APPROACH_M:
                    self._c_floor[index] = here[index]

    cdef bint _see_inside(self) noexcept nogil:
        """Check which pairs are inside the margin, and whether any of them has approached since its largest
        distance.

        The largest distance is used because a slow arm approaches by less than `APPROACH_M` between two
        checks.
        """
        cdef double here
        cdef bint nearer = False
        cdef int index
        self.inside = False
        for index in range(self._distances.count):
            here = self._c_here[index]
            if here >= self._margin_m:
                self._c_floor[index] = OUTSIDE
                continue
            self.inside = True
            self._c_floor[index] = fmax(self._c_floor[index], here)
            if here < self._c_floor[index] - APPROACH_M:
                nearer = True
        return nearer

    cdef double _nearest(self, int index) noexcept nogil:
        """Return the smallest distance of a pair on the way to rest."""
        return fmin(self._c_there[index], fmin(self._c_first[index], self._c_second[index]))

    def leads_away(self, position, heading):
        """Like `c_leads_away`, for a position and a joint step of shape (dof,), rad."""
        here, step = np.array(position, dtype=np.float64), np.array(heading, dtype=np.float64)
        return self.c_leads_away(doubles(here, self._dof), doubles(step, self._dof))

    cdef bint c_leads_away(self, const double* position, const double* heading) noexcept nogil:
        """Whether a joint step in this direction approaches neither the blocking obstacle nor others that are
        as close.
        """
        cdef double before
        cdef int index
        if not self._probe(position, heading, INFINITY):
            return False
        for index in range(self._distances.count):
            before = self._c_before[index]
            if self._c_blocking[index] or before < self._margin_m + NEAR_M:
                if not self._c_after[index] >= before - APPROACH_M:
                    return False
        return True

    def leads_deeper(self, position, heading):
        """Like `c_leads_deeper`, for a position and a joint step of shape (dof,), rad."""
        here, step = np.array(position, dtype=np.float64), np.array(heading, dtype=np.float64)
        return self.c_leads_deeper(doubles(here, self._dof), doubles(step, self._dof))

    cdef bint c_leads_deeper(self, const double* position, const double* heading) noexcept nogil:
        """Whether a joint step in this direction brings parts closer that are already inside the margin. If
        it does, they are `blocking`.
        """
        cdef bint deeper = False
        cdef double longest = 0.0
        cdef int index
        for index in range(self._dof):
            longest = max(longest, fabs(heading[index]))
        if longest < MIN_HEADING_RAD:
            return False
        # This runs in the cycle of each target, so pairs that were far away at the last check are omitted. No
        # pair can come closer by NEAR_M in the few cycles since then, and the next check blocks a pair that
        # enters the margin.
        if not self._probe(position, heading, self._margin_m + NEAR_M):
            return True
        for index in range(self._distances.count):
            self._c_blocking[index] = (
                self._c_before[index] < self._margin_m
                and not self._c_after[index] >= self._c_before[index] - APPROACH_M
            )
            if self._c_blocking[index]:
                deeper = True
        return deeper

    cdef bint _probe(self, const double* position, const double* heading, double near_m) noexcept nogil:
        """Calculate the distances before and after a joint step in this direction, for pairs whose last
        distance was below `near_m`. Returns False if the step is not finite.
        """
        cdef double there[MAX_DOF]
        cdef double longest = 0.0, scale = 0.0
        cdef int index
        for index in range(self._dof):
            longest = max(longest, fabs(heading[index]))
        if longest > 0.0:
            scale = max(MIN_PROBE_RAD, min(longest, PROBE_RAD)) / longest
        for index in range(self._dof):
            there[index] = position[index] + heading[index] * scale
        return self._distances.c_find_near(
            position, self._c_here, near_m, self._c_before
        ) and self._distances.c_find_near(there, self._c_here, near_m, self._c_after)

    def _has_world(self, pair):
        return any(
            self._mj.body_weldid[body] == 0 and self._mj.body(body).name not in self._stand
            for body in (self._mj.geom_bodyid[geom] for geom in pair)
        )

    def _is_tool_work(self, pair):
        bodies = {int(self._mj.body_weldid[self._mj.geom_bodyid[geom]]) for geom in pair}
        return bodies == {0, self._tool}


def _stand(mj):
    """Return the names of the bodies on which the first joint is mounted, including bodies fixed to them.
    They are part of the arm, although like the world they do not move. Bodies below them are not.
    """
    first = int(mj.body_parentid[mj.jnt_bodyid[0]])
    bodies = {first} if first else set()
    for body in range(first + 1, mj.nbody):  # MuJoCo lists parents before their children.
        if mj.body_weldid[body] == 0 and mj.body_parentid[body] in bodies:
            bodies.add(body)
    return {mj.body(body).name for body in bodies}
