"""Executes a planned motion: calculates the position on its path in each cycle.

Most devices get a position in each cycle. A device that executes motions itself gets the whole path, and
reports its progress.
"""

from libc.math cimport fmin
from libc.string cimport memset

from cobot.arrays cimport MAX_DOF, doubles
from rtloop.planned.path cimport Path

from cobot.ipc.layout import MotionResult
from rtloop.backends import MovesByItself
from rtloop.results import ACCEPTED, Rejected

# How far ahead on the path the fence of a motion is checked, s. The arm can stop within this time at any
# speed.
cdef double FENCE_AHEAD_S = 0.5


cdef class PathFollower:
    """Follows one path at a time. Real-time safe, except for calls of a device.

    Attributes:
        path, clock, watch: the path, the progress along it, and the check of its fence.
        by_itself: whether the device executes the path itself; constant.
        left: whether the arm has left the path in order to stop off it.
    """

    def __init__(self, model, capacity, period_s, backend, desired):
        """desired: the array for the result, shape (3, dof): rad, rad/s, rad/s²."""
        limits = model.limits
        self.path = Path(capacity, limits.dof)
        self.clock = PathClock(limits, period_s)
        self.watch = Watch(model.chain)
        self.by_itself = isinstance(backend, MovesByItself)
        self._mover = backend if self.by_itself else None
        self._dof, self._rows = limits.dof, desired
        self._desired = doubles(desired, 3 * limits.dof)

    def begin(self, Path path not None):
        """Follow this path from its beginning."""
        self.path, self.left = path, False
        self.clock.c_reset()
        if self.by_itself:
            segments = path.segments
            times_s, coefficients = path.breakpoints_s[:segments + 1], path.coefficients[:segments]
            self._mover.begin(times_s.copy(), coefficients.copy(), self.clock.share)

    def check_continuation(self, Path path not None, double offset_s):
        """Check that the arm can continue with another path, which begins at a path time of this one.

        Both must be equal at the arm's current place, and as far ahead as the current change of the rate
        relies on the path.
        """
        cdef double here_s = self.clock.path_time_s - offset_s
        if not path.c_continues(self.path, offset_s, here_s, self.clock.c_committed_s() - offset_s):
            return Rejected(
                f"it differs from the current motion, which is already at {self.clock.path_time_s:.3f} s"
            )
        return ACCEPTED

    def continue_with(self, Path path not None, double offset_s):
        """Follow this path from the same place at the same rate. The fence of the motion stays."""
        self.path = path
        self.clock.c_shift(offset_s)

    def slow_down(self):
        """Begin to stop on the path."""
        if self.by_itself:
            self._mover.halt()
        else:
            self.clock.c_request(0.0)

    def is_halted(self):
        """Return whether the device is stopping as requested."""
        return self._mover.is_halted()

    def place(self):
        """Set the result to the place on the path that the device reports, with zero velocity."""
        self.clock.path_time_s = max(self.clock.path_time_s, self._mover.done_s())
        self.path.c_evaluate(self.clock.path_time_s, self.clock.rate, 0.0, self._desired)
        memset(self._desired + self._dof, 0, 2 * self._dof * sizeof(double))

    def result(self):
        """Return the result of a motion that has settled."""
        if self.left:
            return MotionResult.STOPPED_ASIDE
        at_end = self.clock.path_time_s >= self.path.duration_s
        return MotionResult.ARRIVED if at_end else MotionResult.STOPPED

    cdef Way c_follow(self, bint stopping) noexcept nogil:
        """Advance along the path, until its end or until the arm is at rest on it."""
        self.clock.c_advance(self.path)
        if stopping and self.clock.c_stuck():
            return NO_ROOM
        self.path.c_evaluate(self.clock.path_time_s, self.clock.rate, self.clock.rate_slope, self._desired)
        if self.clock.path_time_s >= self.path.duration_s or (stopping and self.clock.c_at_rest()):
            memset(self._desired + self._dof, 0, 2 * self._dof * sizeof(double))
            return DONE
        return UNDER_WAY

    cdef Way follow_device(self) except *:
        """Set the result to the place on the path that the device reports."""
        self.place()
        return DONE if self.clock.path_time_s >= self.path.duration_s else UNDER_WAY

    cdef bint c_leaves_fence(self, double* place4) noexcept nogil:
        """Whether the path leaves the motion's fence within the distance that is needed to stop, or has
        already left it. If so, `place4` is set to the place and the speed there.
        """
        cdef double rows[3 * MAX_DOF]
        cdef Py_ssize_t index = self.path.index
        cdef double ahead_s = fmin(self.clock.path_time_s + FENCE_AHEAD_S, self.path.duration_s)
        self.path.c_evaluate(ahead_s, self.clock.rate, 0.0, rows)
        self.path.index = index
        return self.watch.c_beyond(rows, place4) or self.watch.c_beyond(self._desired, place4)
