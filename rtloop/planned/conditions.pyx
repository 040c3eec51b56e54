"""A condition of a motion, which is evaluated in each cycle while it is active; see
`cobot.motions.signals`.
"""

from libc.math cimport fabs, isnan, sqrt

from cobot.arrays cimport doubles
from cobot.ipc.state_block cimport EXTERNAL_EFFORT_ROW, MEASURED_ROWS, count_measured
from cobot.robot.chain cimport Chain

import numpy as np

from cobot.ipc.layout import CONDITION, text
from cobot.motions.signals import Quantity

cdef int NONE = Quantity.NONE
cdef int INPUT = Quantity.INPUT
cdef int FORCE = Quantity.FORCE
cdef int JOINT = Quantity.JOINT


cdef class CycleCondition:
    """A condition that the cycle evaluates. Real-time safe, except for inputs of a device that is called in
    Python.
    """

    def __init__(self, Chain chain, read):
        """
        Args:
            chain: kinematic chain of the arm, for directions that turn with the tool.
            read: returns an input value.
        """
        self._chain, self._read, self._dof = chain, read, chain.dof
        self._record = np.zeros((), CONDITION)
        self.active = False

    def set(self, record):
        """Set a new condition.

        Args:
            record: record of the type `cobot.ipc.layout.CONDITION`, from shared memory.

        Raises:
            ValueError: the record is not a valid condition.
        """
        quantity = int(record["quantity"])
        self.active = False
        self._quantity, self._joint = Quantity(quantity), int(record["joint"])
        self._record = record.copy()
        if quantity == NONE:
            return
        if not self._joint < self._dof:
            raise ValueError(f"a condition refers to joint {self._joint + 1}, but there are only {self._dof}")
        self._name = text(record["name"])
        self._edge, self._in_tool = bool(record["edge"]), bool(record["in_tool"])
        self._low, self._high = float(record["low"]), float(record["high"])
        self._from_s, self._to_s = float(record["from_s"]), float(record["to_s"])
        if isnan(self._low) or isnan(self._high) or isnan(self._from_s) or isnan(self._to_s):
            raise ValueError("a condition has a bound that is not a number")
        direction, zero = record["direction"], record["zero"]
        self._directed = bool(np.isfinite(direction).all())
        self._zeroed = bool(np.isfinite(zero[:1 if quantity == JOINT else 6]).all())
        cdef int axis
        for axis in range(3):
            self._direction[axis] = direction[axis]
        for axis in range(6):
            self._zero[axis] = zero[axis]
        self._outside = False
        self.value = 0.0
        self.active = True

    def continue_with(self, record):
        """Continue with the same condition between other path times, and keep its zero and its edge; or set a
        new condition.

        Raises:
            ValueError: see `set`.
        """
        times_s = float(record["from_s"]), float(record["to_s"])
        same = record.copy()
        for name in ("from_s", "to_s"):
            same[name] = self._record[name]
        if not self.active or same.tobytes() != self._record.tobytes():
            self.set(record)
            return
        if isnan(times_s[0]) or isnan(times_s[1]):
            raise ValueError("a condition has a bound that is not a number")
        self._from_s, self._to_s = times_s

    def holds(self, measured):
        """Return whether the condition is met for `rtloop.backends.Measured.values`."""
        return self.c_holds(doubles(measured, count_measured(self._dof)))

    cdef bint c_watches(self, double path_time_s) noexcept nogil:
        """Whether the condition is active at this path time."""
        return self.active and self._from_s <= path_time_s <= self._to_s

    cdef bint c_holds(self, const double* measured) except -1:
        """Evaluate the condition. The first call stores the zero of a force and, for an edge, the first
        value.
        """
        cdef bint inside
        if self._quantity == INPUT:
            self.value = self._read(self._name)
        elif self._zeroed:
            self.value = self._amount(measured)
        else:
            self._take_zero(measured)
            self.value = 0.0
        inside = self._low < self.value < self._high
        if self._edge:
            if not inside:
                self._outside = True
            elif not self._outside:
                return False
        return inside

    cdef void c_relative(self, const double* measured, double* wrench6) noexcept nogil:
        """Calculate the force and torque at the TCP, minus the zero if this condition has one."""
        cdef const double* wrench = measured + MEASURED_ROWS * self._dof
        cdef bint has_zero = self._zeroed and self._quantity != INPUT and self._quantity != JOINT
        cdef int axis
        for axis in range(6):
            wrench6[axis] = wrench[axis] - (self._zero[axis] if has_zero else 0.0)

    cdef void _take_zero(self, const double* measured) noexcept nogil:
        cdef int axis
        if self._quantity == JOINT:
            self._zero[0] = measured[EXTERNAL_EFFORT_ROW * self._dof + self._joint]
        else:
            for axis in range(6):
                self._zero[axis] = measured[MEASURED_ROWS * self._dof + axis]
        self._zeroed = True

    cdef double _amount(self, const double* measured) noexcept nogil:
        cdef double pose[7]
        cdef double part[3]
        cdef double direction[3]
        cdef double along = 0.0
        cdef int axis, first = 0 if self._quantity == FORCE else 3
        if self._quantity == JOINT:
            return fabs(measured[EXTERNAL_EFFORT_ROW * self._dof + self._joint] - self._zero[0])
        for axis in range(3):
            part[axis] = measured[MEASURED_ROWS * self._dof + first + axis] - self._zero[first + axis]
        if not self._directed:
            return sqrt(part[0] * part[0] + part[1] * part[1] + part[2] * part[2])
        if self._in_tool:
            self._chain.c_forward(measured, pose)
            _turn(pose + 3, self._direction, direction)
        for axis in range(3):
            along += part[axis] * (direction[axis] if self._in_tool else self._direction[axis])
        return fabs(along)


cdef void _turn(const double* quaternion, const double* vector, double* out) noexcept nogil:
    """Rotate a vector by a unit quaternion (w, x, y, z)."""
    cdef double w = quaternion[0], x = quaternion[1], y = quaternion[2], z = quaternion[3]
    cdef double tx = 2.0 * (y * vector[2] - z * vector[1])
    cdef double ty = 2.0 * (z * vector[0] - x * vector[2])
    cdef double tz = 2.0 * (x * vector[1] - y * vector[0])
    out[0] = vector[0] + w * tx + y * tz - z * ty
    out[1] = vector[1] + w * ty + z * tx - x * tz
    out[2] = vector[2] + w * tz + x * ty - y * tx
