"""The steps of CHOMP (M. Zucker et al. 2013, doi 10.1177/0278364913488805), see descent.pyi."""

from libc.math cimport fabs, fmax, fmin, sqrt
from libc.string cimport memset

import numpy as np

from cobot.arrays cimport MAX_DOF, bytes_of, doubles
from cobot.robot.clearance cimport Clearance

cdef enum:
    CORRECTIONS = 20    # of a joint that leaves its range, before its points are clipped

cdef double NO_STEP = 1e-9


cdef class PathDescent:
    cdef Clearance _clearance
    cdef int _count      # points that move
    cdef double _low[MAX_DOF]
    cdef double _high[MAX_DOF]
    cdef double _pushed_m
    cdef double _width_m
    cdef object _kept
    cdef double* _points     # the first point that moves
    cdef double* _spread
    cdef double* _smoothest
    cdef double* _gradient
    cdef double* _change     # of all joints at all points; two rows of points while one joint is corrected
    cdef char* _near

    def __cinit__(
        self, Clearance clearance, points, smoothest, spread, low, high, double pushed_m, double width_m
    ):
        cdef int dof = clearance.dof, joint
        clearance.enclose()
        self._clearance, self._count = clearance, len(points) - 2
        self._pushed_m, self._width_m = pushed_m, width_m
        for joint in range(dof):
            self._low[joint], self._high[joint] = low[joint], high[joint]
        if self._count < 1 or not np.isfinite(points).all():
            raise ValueError("a path of at least three finite points is needed")
        gradient, change = np.empty((self._count, dof)), np.empty(self._count * max(2, dof))
        near = np.empty(self._count * clearance.count + 1, dtype=np.uint8)
        self._kept = points, smoothest, spread, gradient, change, near
        self._points = doubles(points, (self._count + 2) * dof) + dof
        self._smoothest = doubles(smoothest, self._count * dof)
        self._spread = doubles(spread, self._count * self._count)
        self._gradient, self._change = doubles(gradient, self._count * dof), doubles(change, self._count)
        self._near = bytes_of(near, len(near))

    @property
    def gradient(self):
        return self._kept[3].copy()

    def push(self):
        cdef double nearest_m
        with nogil:
            nearest_m = self._push(self._clearance)
        return nearest_m

    cdef double _push(self, Clearance clearance) noexcept nogil:
        cdef int dof = clearance.dof
        cdef const double* here = self._points
        cdef double* gradient = self._gradient
        cdef const char* near = self._near
        cdef double farthest_m = self._pushed_m + self._width_m
        cdef double nearest_m = farthest_m
        cdef double slopes[MAX_DOF]
        cdef double line[6]
        cdef double distance, speed, rate
        cdef int _point, pair, joint
        memset(gradient, 0, self._count * dof * sizeof(double))
        clearance.find_near(here, self._count, farthest_m, self._near)
        for _point in range(self._count):
            clearance.move_to(here)
            speed = 0.0
            for joint in range(dof):
                rate = (here[dof + joint] - here[joint - dof]) / 2.0 * (self._count + 1)
                speed += rate * rate
            speed = sqrt(speed)
            for pair in range(clearance.count):
                if not near[pair]:
                    continue
                distance = clearance.gap_of(pair, farthest_m, line)
                if distance >= farthest_m:
                    continue
                nearest_m = fmin(nearest_m, distance)
                memset(slopes, 0, sizeof(slopes))
                clearance.add_gradient(pair, 1.0, line, slopes)
                distance = fmax(distance - self._pushed_m, 0.0)
                for joint in range(dof):
                    gradient[joint] -= speed * (1.0 - distance / self._width_m) * slopes[joint]
            here += dof
            gradient += dof
            near += clearance.count
        return nearest_m

    def step(self, double weight, double longest):
        cdef bint moved
        with nogil:
            moved = self._step(weight, longest)
        return moved

    cdef bint _step(self, double weight, double longest) noexcept nogil:
        cdef int dof = self._clearance.dof
        cdef int size = self._count * dof
        cdef double largest = 0.0
        cdef double share
        cdef double* change = self._change
        cdef const double* push
        cdef int point, other, joint, i
        for i in range(size):
            change[i] = weight * (self._points[i] - self._smoothest[i])
        for point in range(self._count):
            push = self._gradient
            for other in range(self._count):
                share = self._spread[point * self._count + other]
                for joint in range(dof):
                    change[joint] += share * push[joint]
                push += dof
            for joint in range(dof):
                largest = fmax(largest, fabs(change[joint]))
            change += dof
        if not largest >= NO_STEP:
            return False
        share = fmin(longest / largest, 1.0 / weight)
        for i in range(size):
            self._points[i] -= share * self._change[i]
        for joint in range(dof):
            self._bring_into_range(joint)
        return True

    cdef void _bring_into_range(self, int joint) noexcept nogil:
        cdef int dof = self._clearance.dof
        cdef double low = self._low[joint]
        cdef double high = self._high[joint]
        cdef double* violation = self._change
        cdef double* correction = self._change + self._count
        cdef double* here = self._points + joint
        cdef int worst, point, other, _correction
        for _correction in range(CORRECTIONS):
            worst = 0
            for point in range(self._count):
                violation[point] = here[point * dof] - fmax(low, fmin(high, here[point * dof]))
                if fabs(violation[point]) > fabs(violation[worst]):
                    worst = point
            if violation[worst] == 0.0:
                return
            for point in range(self._count):
                correction[point] = 0.0
                for other in range(self._count):
                    correction[point] += self._spread[point * self._count + other] * violation[other]
            for point in range(self._count):
                here[point * dof] -= correction[point] * violation[worst] / correction[worst]
        for point in range(self._count):
            here[point * dof] = fmax(low, fmin(high, here[point * dof]))
