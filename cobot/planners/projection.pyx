"""Configurations that keep path constraints of the TCP, and steps between them, see projection.pyi.

A search projects ten thousands of configurations, so only the results are allocated.
"""

from libc.math cimport atan2, fabs, fmax, fmin, sqrt
from libc.string cimport memcpy, memset

import numpy as np

from cobot.arrays cimport MAX_DOF, doubles
from cobot.robot.chain cimport Chain
from cobot.robot.clearance cimport Clearance
from cobot.robot.linear cimport cholesky_solve

cdef enum:
    TURNS = 25
    MAX_ROWS = 4         # the tool's axis, and three sides of a box

cdef double MAX_STEP_RAD = 0.3
cdef double DAMPING = 1e-6
cdef double PROGRESS = 0.2   # share of a step by which it must bring the arm nearer to its target
cdef double SIDESTEP = 3.0   # factor by which a projected step may be longer than the requested one
cdef double STRAIGHT = 1e-9  # sine of an angle from which two axes do not define a third one


cdef class Projection:
    cdef Chain _chain
    cdef double _low[MAX_DOF]
    cdef double _high[MAX_DOF]
    cdef bint _has_cone, _has_box
    cdef double _axis[3]
    cdef double _direction[3]
    cdef double _within
    cdef double _cone_room
    cdef double _box_low[3]
    cdef double _box_high[3]
    cdef double _box_room[3]

    def __cinit__(self, Chain chain, low, high, cone, box, double inside, double inside_share):
        cdef int i
        self._chain = chain
        for i in range(chain.dof):
            self._low[i], self._high[i] = low[i], high[i]
        self._has_cone, self._has_box = cone is not None, box is not None
        if cone is not None:
            axis, direction, self._within = cone
            self._cone_room = fmin(inside, inside_share * self._within)
            for i in range(3):
                self._axis[i], self._direction[i] = axis[i], direction[i]
        if box is not None:
            lowest, highest = box
            for i in range(3):
                self._box_low[i], self._box_high[i] = lowest[i], highest[i]
                self._box_room[i] = fmin(inside, inside_share * (self._box_high[i] - self._box_low[i]))

    def keeps(self, joints):
        cdef double given[MAX_DOF]
        self._take(joints, given)
        return self._keeps(given)

    def project(self, joints):
        cdef double here[MAX_DOF]
        self._take(joints, here)
        return self._array(here) if self._project(here) else None

    def is_step(self, Clearance clearance, begin, end, double step_rad):
        cdef double ends[2][MAX_DOF]
        self._take(begin, ends[0])
        self._take(end, ends[1])
        clearance.enclose()
        return self._is_step(clearance, ends[0], ends[1], step_rad)

    def steps_toward(self, Clearance clearance, begin, target, double step_rad):
        cdef double here[MAX_DOF]
        cdef double there[MAX_DOF]
        cdef double place[MAX_DOF]
        cdef double left_rad
        cdef int dof = self._chain.dof
        cdef int joint
        self._take(begin, here)
        self._take(target, there)
        clearance.enclose()
        places = []
        while True:
            left_rad = _apart(here, there, dof)
            if left_rad == 0.0:
                return places, True
            if left_rad <= step_rad:
                if not (self._keeps(there) and self._is_step(clearance, here, there, step_rad)):
                    return places, False
                places.append(self._array(there))
                return places, True
            for joint in range(dof):
                place[joint] = here[joint] + (there[joint] - here[joint]) * (step_rad / left_rad)
            if (
                not self._project(place)
                or _apart(place, there, dof) > left_rad - PROGRESS * step_rad
                or not self._is_step(clearance, here, place, step_rad)
            ):
                return places, False
            places.append(self._array(place))
            memcpy(here, place, dof * sizeof(double))

    cdef int _take(self, object joints, double* out) except -1:
        cdef int joint
        for joint in range(self._chain.dof):
            out[joint] = joints[joint]
        return 0

    cdef object _array(self, const double* joints):
        out = np.empty(self._chain.dof)
        memcpy(doubles(out, self._chain.dof), joints, self._chain.dof * sizeof(double))
        return out

    cdef bint _keeps(self, const double* joints) noexcept nogil:
        cdef double rows[MAX_ROWS * MAX_DOF]
        cdef double missing[MAX_ROWS]
        cdef int joint
        for joint in range(self._chain.dof):
            if not self._low[joint] <= joints[joint] <= self._high[joint]:
                return False
        return self._violations(joints, 0.0, rows, missing) == 0

    cdef bint _is_step(
        self, Clearance clearance, const double* begin, const double* end, double step_rad
    ) noexcept nogil:
        cdef double middle[MAX_DOF]
        cdef int joint
        if _apart(begin, end, self._chain.dof) > SIDESTEP * step_rad:
            return False
        for joint in range(self._chain.dof):
            middle[joint] = 0.5 * (begin[joint] + end[joint])
        return self._keeps(middle) and clearance.c_is_edge_free(begin, end)

    cdef bint _project(self, double* here) noexcept nogil:
        cdef double rows[MAX_ROWS * MAX_DOF]
        cdef double missing[MAX_ROWS]
        cdef double square[MAX_ROWS * MAX_ROWS]
        cdef double step[MAX_DOF]
        cdef double longest
        cdef int dof = self._chain.dof
        cdef int count, _turn, i, k, joint
        for joint in range(dof):
            here[joint] = fmax(self._low[joint], fmin(self._high[joint], here[joint]))
        for _turn in range(TURNS):
            count = self._violations(here, 1.0, rows, missing)
            if count == 0:
                return True
            for i in range(count):
                for k in range(count):
                    square[i * count + k] = DAMPING if i == k else 0.0
                    for joint in range(dof):
                        square[i * count + k] += rows[i * dof + joint] * rows[k * dof + joint]
            if not cholesky_solve(square, count, missing):
                return False
            longest = 0.0
            for joint in range(dof):
                step[joint] = 0.0
                for i in range(count):
                    step[joint] += rows[i * dof + joint] * missing[i]
                longest = fmax(longest, fabs(step[joint]))
            if not longest > 0.0:
                return False
            for joint in range(dof):
                here[joint] = fmax(self._low[joint], fmin(
                    self._high[joint], here[joint] + step[joint] * fmin(1.0, MAX_STEP_RAD / longest)
                ))
        return False

    cdef int _violations(
        self, const double* joints, double inside, double* rows, double* missing
    ) noexcept nogil:
        """Return the number of violated constraints. For each, set its gradient by the joints in `rows` and
        the required change in `missing`. `inside` is 1 with the constraints' margin, 0 without it.
        """
        cdef double pose[7]
        cdef double turn[9]
        cdef double jacobian[6 * MAX_DOF]
        cdef double axis[3]
        cdef double tilt[3]
        cdef double sine, angle, cosine, room, below, above
        cdef int dof = self._chain.dof
        cdef int count = 0
        cdef int i, k, n, joint
        self._chain.c_place(joints, pose, turn, jacobian)
        if self._has_cone:
            for i in range(3):
                axis[i] = 0.0
                for k in range(3):
                    axis[i] += turn[3 * i + k] * self._axis[k]
            sine, cosine = 0.0, 0.0
            for i in range(3):
                k, n = (i + 1) % 3, (i + 2) % 3
                tilt[i] = axis[k] * self._direction[n] - axis[n] * self._direction[k]
                sine += tilt[i] * tilt[i]
                cosine += axis[i] * self._direction[i]
            sine = sqrt(sine)
            angle, room = atan2(sine, cosine), inside * self._cone_room
            if not angle <= self._within - room:
                if sine > STRAIGHT:
                    for i in range(3):
                        tilt[i] /= sine
                else:
                    _across(axis, tilt)
                for joint in range(dof):
                    rows[joint] = 0.0
                    for i in range(3):
                        rows[joint] += tilt[i] * jacobian[(3 + i) * dof + joint]
                missing[0] = angle - self._within + 2.0 * room
                count = 1
        if self._has_box:
            for i in range(3):
                room = inside * self._box_room[i]
                below, above = self._box_low[i] + room - pose[i], pose[i] - self._box_high[i] + room
                if not fmax(below, above) <= 0.0:
                    for joint in range(dof):
                        rows[count * dof + joint] = jacobian[i * dof + joint]
                    missing[count] = below + room if below > above else -above - room
                    count += 1
        return count


cdef void _across(const double* axis, double* out) noexcept nogil:
    """A direction at a right angle to an axis."""
    cdef double other[3]
    cdef double length = 0.0
    cdef int least = 0
    cdef int i
    for i in range(1, 3):
        if fabs(axis[i]) < fabs(axis[least]):
            least = i
    memset(other, 0, sizeof(other))
    other[least] = 1.0
    for i in range(3):
        out[i] = axis[(i + 1) % 3] * other[(i + 2) % 3] - axis[(i + 2) % 3] * other[(i + 1) % 3]
        length += out[i] * out[i]
    for i in range(3):
        out[i] /= sqrt(length)


cdef double _apart(const double* one, const double* other, int dof) noexcept nogil:
    cdef double square = 0.0
    cdef int joint
    for joint in range(dof):
        square += (one[joint] - other[joint]) * (one[joint] - other[joint])
    return sqrt(square)
