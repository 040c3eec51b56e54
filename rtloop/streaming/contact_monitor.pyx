"""Limits for the external efforts, above which a session ends."""

from libc.math cimport INFINITY, fabs

from cobot.arrays cimport checked_dof, doubles

import numpy as np

from cobot.reasons import Reason, ReasonCode

AXES = ("x", "y", "z", "rx", "ry", "rz")


cdef class ContactMonitor:
    """Compares the external efforts with the limits of a session."""

    def __init__(self, names):
        """names: joint names, for messages."""
        self.names = tuple(names)
        self.dof = checked_dof(len(self.names))
        self.worst = 0
        self.found = 0.0

    def begin(self, torques, wrench):
        """Set the limits for the joints, shape (dof,), N·m, and for the TCP, shape (6,), N and N·m."""
        for index, value in enumerate((*torques, *wrench)):
            self.largest[index] = value

    def reason(self):
        """Describe the last limit that was exceeded."""
        axis, unit = self.worst - self.dof, "N·m"
        name = self.names[self.worst] if axis < 0 else AXES[axis]
        if axis < 0:
            where = f"on {name}"
        elif axis < 3:
            where, unit = f"along {name} at the TCP", "N"
        else:
            where = f"about {name[1:]} at the TCP"
        limit = self.largest[self.worst]
        words = f"contact: {self.found:.1f} {unit} {where}, allowed: {limit:g}"
        return Reason(words, ReasonCode.CONTACT, of=(name,), value=self.found, limit=limit, unit=unit)

    def check(self, external):
        """Return whether the torques, (dof,), and the wrench, (6,), concatenated in one array, exceed the
        limits.
        """
        row = np.array(external, float)
        return self.c_check(doubles(row, self.dof + 6))

    cdef bint c_check(self, const double* external) noexcept nogil:
        """Like `check`, for compiled code."""
        cdef double excess, most = -INFINITY
        cdef int index, worst = 0
        for index in range(self.dof + 6):
            excess = fabs(external[index]) - self.largest[index]
            if excess > most:
                most = excess
                worst = index
        if not most > 0.0:
            return False
        self.worst = worst
        self.found = external[worst]
        return True
