"""The common base of all servo modes: reads and checks the points, and counts them."""

from libc.math cimport fabs, isfinite
from libc.string cimport memcpy

from rtloop.inboxes.point_queue cimport PointQueue, ServoPoint
from rtloop.sources.source cimport FINE, LEAD_RAD, Source, flaw_of
from rtloop.sources.target_checks cimport c_is_finite, c_joint_jump

cdef double MAX_TIME_S = 10.0


cdef class ServoSource(Source):
    """A source that fetches its points itself. Real-time safe.

    Attributes:
        taken: number of points that became targets of the reference.
        dropped: number of points that were dropped because they were jumps.
        underruns: number of times that the source had to wait for a point.
        buffered: number of points that have been read but are not targets yet.
    """

    def __init__(self, limits, safe_velocity, double period_s):
        """`safe_velocity` is the maximum velocity of the robot itself, shape (dof,), rad/s. A step that needs
        a higher velocity is a jump.
        """
        super().__init__(limits.dof)
        self.period_s = self.time_s = period_s
        for joint in range(self.dof):
            self.lowest[joint], self.highest[joint] = limits.min_position[joint], limits.max_position[joint]
            self.safe_velocity[joint] = safe_velocity[joint]
            self.last[joint] = self.target[joint] = 0.0
        self.waits = False
        self.taken = self.dropped = self.underruns = 0

    def explain(self):
        return "a servo point is not finite"

    @property
    def buffered(self):
        return self.c_buffered()

    def fetch(self, PointQueue queue not None):
        """Read the points for this cycle. Returns NOT_FINITE if a point is invalid, otherwise None."""
        return flaw_of(self.c_fetch(queue))

    cdef int c_fetch(self, PointQueue queue) noexcept nogil:
        """Like `fetch`, for compiled code."""
        return FINE

    cdef long long c_buffered(self) noexcept nogil:
        """Like `buffered`, for compiled code."""
        return 0

    cdef void c_heading(self, double* step) noexcept nogil:
        """Calculate a joint step towards the last point read."""
        cdef int joint
        for joint in range(self.dof):
            step[joint] = self.last[joint] - self.ref[joint]

    cdef void c_follow(self, const double* command) noexcept nogil:
        cdef double ahead = 0.0
        cdef int joint
        for joint in range(self.dof):
            ahead = max(ahead, fabs(self.ref[joint] - command[joint]))
        self.waits = ahead > LEAD_RAD

    cdef bint c_read(self, const ServoPoint* point) noexcept nogil:
        """Copy a point into `target` and `time_s`. Returns whether its values are valid."""
        cdef int joint
        if not (isfinite(point.time_s) and isfinite(point.lookahead_s) and isfinite(point.gain)):
            return False
        if not c_is_finite(point.joints, self.dof):
            return False
        # The service rejects values beyond these bounds, but another writer of shared memory may write any
        # value.
        for joint in range(self.dof):
            self.target[joint] = min(max(point.joints[joint], self.lowest[joint]), self.highest[joint])
        self.time_s = min(max(point.time_s, self.period_s), MAX_TIME_S)
        return True

    cdef bint c_jumps(self, double interval_s) noexcept nogil:
        """Whether the target is further from the last one than an arm can move. If it is not, it becomes the
        last target.
        """
        if c_joint_jump(self.target, self.last, self.dof, interval_s, self.safe_velocity) >= 0:
            self.dropped += 1
            return True
        memcpy(self.last, self.target, self.dof * sizeof(double))
        return False
