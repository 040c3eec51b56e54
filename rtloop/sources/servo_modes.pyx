"""The servo modes, which convert the points of a servo session into a joint reference for every cycle."""

from libc.math cimport fabs, rint
from libc.string cimport memcpy, memset

from rtloop.generators.online_trajectory cimport OnlineTrajectory
from rtloop.inboxes.point_queue cimport PointQueue, ServoPoint
from rtloop.sources.servo_base cimport MAX_POINTS, ServoSource
from rtloop.sources.source cimport FINE, NOT_FINITE
from rtloop.sources.target_checks cimport c_clamped_interval

from cobot.ipc.layout import ServoMode
from rtloop.generators.target_range import TargetRange
from rtloop.sources.servo_law import ServoLaw
from rtloop.sources.servo_through_points import ThroughPoints

# A buffered mode begins when points for this time, and at least two, have arrived, because a sender's
# intervals vary.
cdef double JITTER_S = 0.01
# Maximum wait for these points, as a multiple of that time.
cdef double BEFORE_TIMEOUT = 2.0


cdef class Newest(ServoSource):
    """Modes 1 and 2: the reference follows only the newest point."""

    def __init__(self, limits, safe_velocity, double period_s, *, bint planned):
        """`planned` states whether a profile leads to each target (mode 1) or the targets are the reference
        (mode 2).
        """
        super().__init__(limits, safe_velocity, period_s)
        rates = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        self.planned = planned
        self.planner = OnlineTrajectory(limits.dof, period_s, *rates)
        self.law = ServoLaw(limits.dof, period_s)
        self.targets = TargetRange(limits.dof, period_s, period_s)
        memset(self.aim, 0, sizeof(self.aim))
        self.since_s = self.every_s = 0.0

    cdef void c_begin(self, const double* command) noexcept nogil:
        memcpy(self.ref, command, 3 * self.dof * sizeof(double))
        memcpy(self.last, command, self.dof * sizeof(double))
        memset(self.aim, 0, sizeof(self.aim))
        memcpy(self.aim, command, self.dof * sizeof(double))
        self.law.c_begin(command)
        self.targets.c_begin(command)
        self.since_s = 0.0
        self.planner.c_begin(command)

    cdef int c_fetch(self, PointQueue queue) noexcept nogil:
        cdef ServoPoint point
        cdef double interval_s
        cdef bint aimed = False
        cdef int _count
        self.since_s += self.period_s
        for _count in range(MAX_POINTS):
            if not queue.c_next(&point):
                break
            if not self.c_read(&point):
                return NOT_FINITE
            interval_s = c_clamped_interval(self.since_s)
            if self.planned:  # a profile accepts any target and takes as long as it needs
                self.c_accept_far(interval_s)
            elif self.c_jumps(interval_s):
                continue
            self.law.c_tune(point.lookahead_s, point.gain)
            self.targets.c_update(self.last)
            self.targets.c_expect(max(self.time_s, self.since_s))
            if not aimed:
                self.every_s = self.since_s
            self.since_s = 0.0
            self.taken += 1
            aimed = True
        if aimed and self.planned:
            self.planner.c_aim(self.last, NULL, self.time_s)
        elif aimed:
            self.c_step_to(self.every_s)
        elif self.since_s > 1.5 * self.every_s:
            memset(self.aim + self.dof, 0, 2 * self.dof * sizeof(double))
        return FINE

    cdef void c_step_to(self, double time_s) noexcept nogil:
        """Move to the last target, to be reached in the time since the previous one. A stream's rates are
        calculated from differences.
        """
        cdef double velocity
        cdef int joint, dof = self.dof
        for joint in range(dof):
            velocity = (self.last[joint] - self.aim[joint]) / time_s
            self.aim[2 * dof + joint] = (velocity - self.aim[dof + joint]) / time_s
            self.aim[dof + joint] = velocity
            self.aim[joint] = self.last[joint]

    cdef void c_accept_far(self, double interval_s) noexcept nogil:
        """Move to a target that is too far away to belong to the stream's motion."""
        cdef double time_s = 2.0 * max(interval_s, self.time_s)
        cdef int joint
        for joint in range(self.dof):
            if fabs(self.target[joint] - self.last[joint]) > self.safe_velocity[joint] * time_s:
                self.planner.c_forget()
                break
        memcpy(self.last, self.target, self.dof * sizeof(double))

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        self.targets.c_advance()
        if self.planned:
            self.planner.c_advance()
            memcpy(self.ref, self.planner.ref, 3 * self.dof * sizeof(double))
        else:
            self.law.c_follow(self.aim)
            memcpy(self.ref, self.law.ref, 3 * self.dof * sizeof(double))


cdef class Buffered(ServoSource):
    """Modes 3 and 4: the reference moves from point to point on straight lines, to each in the point's own
    time.

    Each cycle takes the points that are due, so the time between two points need not be a multiple of the
    period. Later points wait in the queue.
    """

    def __init__(self, limits, safe_velocity, double period_s, double fixed_s):
        """`fixed_s` is the time of each point, s, regardless of the stated time; 0: the stated time."""
        super().__init__(limits, safe_velocity, period_s)
        self.fixed_s = fixed_s
        self.law = ServoLaw(limits.dof, period_s)
        self.targets = TargetRange(limits.dof, period_s, period_s)
        memset(self.line, 0, sizeof(self.line))
        memset(self.start, 0, sizeof(self.start))
        memset(self.way, 0, sizeof(self.way))
        self.elapsed_s = self.waited_s = self.since_s = 0.0
        self.playing = False

    cdef void c_begin(self, const double* command) noexcept nogil:
        memcpy(self.ref, command, 3 * self.dof * sizeof(double))
        memcpy(self.last, command, self.dof * sizeof(double))
        memset(self.line, 0, sizeof(self.line))
        memcpy(self.line, command, self.dof * sizeof(double))
        memcpy(self.start, command, self.dof * sizeof(double))
        memset(self.way, 0, sizeof(self.way))
        self.law.c_begin(command)
        self.targets.c_begin(command)
        self.time_s = self.fixed_s if self.fixed_s > 0.0 else self.period_s
        self.elapsed_s = self.waited_s = self.since_s = 0.0
        self.playing = False

    cdef int c_fetch(self, PointQueue queue) noexcept nogil:
        """Take points from the queue, up to the one whose time includes this cycle."""
        cdef ServoPoint point
        cdef double stated_s
        cdef int _count
        self.since_s += self.period_s
        if self.waits or not (self.playing or self.c_may_begin(queue)):
            return FINE
        self.elapsed_s += self.period_s
        for _count in range(MAX_POINTS):
            if self.elapsed_s <= self.time_s * (1.0 + 1e-9):
                return FINE
            if not queue.c_next(&point):
                if queue.c_waiting() == 0:
                    self.underruns += 1
                    self.playing = False
                    self.waited_s = 0.0
                    self.elapsed_s = self.time_s
                return FINE
            self.elapsed_s -= self.time_s
            if not self.c_read(&point):
                return NOT_FINITE
            stated_s = self.time_s
            if self.fixed_s > 0.0:
                self.time_s = self.fixed_s
            memcpy(self.start, self.last, self.dof * sizeof(double))
            # The point is dropped; during its time the arm does not move.
            if self.c_jumps(max(stated_s, self.since_s)):
                memset(self.way, 0, sizeof(self.way))
                memset(self.line + self.dof, 0, 2 * self.dof * sizeof(double))
                continue
            self.since_s = 0.0
            self.c_turn_to_last()
            self.targets.c_update(self.last)
            self.targets.c_expect(self.time_s)
            self.law.c_tune(point.lookahead_s, point.gain)
            self.taken += 1
        return FINE

    cdef void c_turn_to_last(self) noexcept nogil:
        """Begin the segment to the last point. It takes the point's time."""
        cdef double velocity
        cdef int joint, dof = self.dof
        for joint in range(dof):
            self.way[joint] = self.last[joint] - self.start[joint]
            velocity = self.way[joint] / self.time_s
            self.line[2 * dof + joint] = (velocity - self.line[dof + joint]) / self.time_s
            self.line[dof + joint] = velocity

    cdef bint c_may_begin(self, PointQueue queue) noexcept nogil:
        """Whether enough points are waiting to hide the client's jitter, or no more points are expected."""
        cdef double time_s = self.fixed_s if self.fixed_s > 0.0 else self.time_s
        cdef long long waiting = queue.c_waiting()
        if not waiting:
            self.waited_s = 0.0
            return False
        self.waited_s += self.period_s
        self.playing = (
            waiting >= max(2.0, rint(JITTER_S / time_s))
            or self.waited_s >= BEFORE_TIMEOUT * max(time_s, JITTER_S)
        )
        if self.playing:
            self.elapsed_s = self.time_s  # The motion to the last point has ended.
        return self.playing

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        cdef double share = min(self.elapsed_s / self.time_s, 1.0)
        cdef int joint
        self.targets.c_advance()
        for joint in range(self.dof):
            self.line[joint] = self.way[joint] * share + self.start[joint]
        if not self.playing or self.waits:
            memset(self.line + self.dof, 0, 2 * self.dof * sizeof(double))
        self.law.c_follow(self.line)
        memcpy(self.ref, self.law.ref, 3 * self.dof * sizeof(double))


def make_servo(mode, limits, safe_velocity, double period_s):
    """Make the joint source of a mode. The modes with force control have the same sources as those
    without.
    """
    match mode:
        case ServoMode.NONE:
            return None
        case ServoMode.REPLANNED | ServoMode.REPLANNED_FORCE:
            return Newest(limits, safe_velocity, period_s, planned=True)
        case ServoMode.DIRECT:
            return Newest(limits, safe_velocity, period_s, planned=False)
        case ServoMode.BUFFERED:
            return Buffered(limits, safe_velocity, period_s, 0.0)
        case ServoMode.BUFFERED_1MS:
            return Buffered(limits, safe_velocity, period_s, 1e-3)
        case _:
            return ThroughPoints(limits, period_s)
