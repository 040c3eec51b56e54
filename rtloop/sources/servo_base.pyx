"""What all servo modes share: how a point is read and checked, and what is counted."""

from libc.math cimport fabs, isfinite
from libc.string cimport memcpy

from rtloop.inboxes.point_queue cimport PointQueue, ServoPoint
from rtloop.sources.source cimport FINE, LEAD_RAD, Source, flaw_of
from rtloop.sources.target_checks cimport c_is_finite, c_joint_jump

cdef double MAX_TIME_S = 10.0


cdef class ServoSource(Source):
    """A source that fetches its points itself. Real-time safe.

    Attributes:
        taken: points that the reference has gone for.
        dropped: points that were jumps.
        underruns: how often it had to wait for a point.
        buffered: points that it has read and not gone for yet.
    """

    def __init__(self, limits, safe_velocity, double period_s):
        """safe_velocity: what the robot itself can do, shape (dof,), rad/s: what needs more is a jump."""
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
        """Read what this cycle needs; NOT_FINITE if it makes no sense, None if it does."""
        return flaw_of(self.c_fetch(queue))

    cdef int c_fetch(self, PointQueue queue) noexcept nogil:
        """`fetch`."""
        return FINE

    cdef long long c_buffered(self) noexcept nogil:
        """`buffered`."""
        return 0

    cdef void c_heading(self, double* step) noexcept nogil:
        """A joint step to the point read last."""
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
        """Take over `target` and `time_s`; whether they make sense."""
        cdef int joint
        if not (isfinite(point.time_s) and isfinite(point.lookahead_s) and isfinite(point.gain)):
            return False
        if not c_is_finite(point.joints, self.dof):
            return False
        # Who writes to shared memory may write anything; the service refuses what is beyond these.
        for joint in range(self.dof):
            self.target[joint] = min(max(point.joints[joint], self.lowest[joint]), self.highest[joint])
        self.time_s = min(max(point.time_s, self.period_s), MAX_TIME_S)
        return True

    cdef bint c_jumps(self, double interval_s) noexcept nogil:
        """Whether the target is further from the last one than an arm can get; if not, it is the last one."""
        if c_joint_jump(self.target, self.last, self.dof, interval_s, self.safe_velocity) >= 0:
            self.dropped += 1
            return True
        memcpy(self.last, self.target, self.dof * sizeof(double))
        return False
