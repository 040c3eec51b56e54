"""The fence of a motion, which is checked in every cycle of the motion; see `cobot.motions.fence`."""

from libc.math cimport sqrt

from cobot.arrays cimport MAX_DOF
from cobot.robot.chain cimport Chain

import numpy as np

from cobot.motions.fence import Fence
from cobot.reasons import Reason, ReasonCode

# Tolerance, because the service has checked only samples of the motion. Between them, it may be slightly
# beyond the fence.
cdef double TOLERANCE_M = 1e-3
cdef double TOLERANCE = 0.01


cdef class Watch:
    """Checks whether the TCP is within the motion's fence.

    Attributes:
        fence: fence of the motion; None without one.
    """

    def __init__(self, Chain chain):
        self._chain = chain
        self.set(None)

    def set(self, values):
        """Set another fence.

        Args:
            values: `Fence.values`, from shared memory. None, or only NaN: no fence.

        Raises:
            ValueError: some of the values are NaN.
        """
        missing = values is None or np.isnan(values)
        self.active = not np.all(missing)
        if not self.active:
            self.fence = None
            return
        if np.any(missing):
            raise ValueError("the motion's fence is not complete")
        rows = [float(value) for value in values]
        self.fence = Fence(tuple(rows[:3]), tuple(rows[3:6]), rows[6])
        for axis in range(3):
            self._low[axis], self._high[axis] = rows[axis] - TOLERANCE_M, rows[axis + 3] + TOLERANCE_M
        self._speed_m_s = rows[6] * (1.0 + TOLERANCE)

    def said(self, row):
        """Describe the place and speed found by `c_beyond`."""
        words = f"the motion would leave its fence: {self.fence.beyond(np.array(row[:3]), row[3])}"
        return Reason(words, ReasonCode.FENCE)

    cdef bint c_beyond(self, const double* rows, double* place4) noexcept nogil:
        """Whether the TCP is outside the fence at these joint positions and velocities. `place4` is set to
        its place and speed.
        """
        cdef double pose[7]
        cdef double jacobian[6 * MAX_DOF]
        cdef double velocity
        cdef double square = 0.0
        cdef int axis, joint, dof = self._chain.dof
        cdef bint beyond = False
        self._chain.c_forward_jacobian(rows, pose, jacobian)
        for axis in range(3):
            velocity = 0.0
            for joint in range(dof):
                velocity += jacobian[axis * dof + joint] * rows[dof + joint]
            square += velocity * velocity
            place4[axis] = pose[axis]
            # Written so that NaN is considered beyond the fence.
            if not self._low[axis] <= pose[axis] <= self._high[axis]:
                beyond = True
        place4[3] = sqrt(square)
        return beyond or not place4[3] <= self._speed_m_s
