"""See derivatives.pyi. The TCP's linear and angular motions are vectors whose lengths are limited."""

from libc.math cimport fabs, sqrt

import numpy as np

from cobot.arrays cimport doubles
from cobot.robot.chain cimport Chain

cdef double NONE = 1e-12  # A shorter vector has no direction.


cdef inline double _dot(const double* a, const double* b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


cdef inline void _frame(
    const double* motion, double* tangent, double* normal, double* amounts
) noexcept nogil:
    """Compute the tangent and the normal of a motion; each is 0 if it is undefined.

    `motion` contains a velocity and, 6 numbers later, its derivative. `amounts` becomes the length of the
    velocity and that of the derivative's part normal to it.
    """
    cdef double along
    cdef int i
    amounts[0] = sqrt(_dot(motion, motion))
    for i in range(3):
        tangent[i] = motion[i] / max(amounts[0], NONE)
    along = _dot(&motion[6], tangent)
    for i in range(3):
        normal[i] = motion[6 + i] - along * tangent[i]
    amounts[1] = sqrt(_dot(normal, normal))
    for i in range(3):
        normal[i] /= max(amounts[1], NONE)


def speeds_and_bends(Chain chain, derivatives):
    given = np.array(derivatives, dtype=np.float64, order="C")
    cdef Py_ssize_t n = given.shape[1], dof = chain.dof, place
    out = np.empty((2, 2, n))
    cdef const double* joints = doubles(given, 4 * n * dof)
    cdef double* found = doubles(out, 4 * n)
    cdef double motion[18]
    cdef double tangent[3]
    cdef double normal[3]
    cdef double amounts[2]
    cdef int part
    with nogil:
        for place in range(n):
            chain.c_motion(&joints[place * dof], n * dof, motion)
            for part in range(2):
                _frame(&motion[3 * part], tangent, normal, amounts)
                found[2 * part * n + place] = amounts[0]
                found[(2 * part + 1) * n + place] = amounts[1]
    return out


def coordinates_at(Chain chain, derivatives, fastest, directions):
    given = np.array(derivatives, dtype=np.float64, order="C")
    bounds = np.array(fastest, dtype=np.float64, order="C")
    cdef Py_ssize_t n = given.shape[1], dof = chain.dof, place, j
    if given.shape != (4, n, dof) or bounds.shape != (n, dof + 2):
        raise ValueError(f"joints of shape {given.shape}, velocities of shape {bounds.shape}")
    angles = np.concatenate([np.zeros(0), *directions])
    cdef Py_ssize_t m = dof + len(angles)
    rows, times = np.empty((3, n, m)), np.empty(n)
    if n == 0:
        return rows, times
    turns = np.array([np.cos(angles), np.sin(angles)]) if len(angles) else np.zeros((2, 1))
    cdef Py_ssize_t parts = len(directions)
    cdef Py_ssize_t begin[3]
    begin[0] = begin[1] = begin[2] = dof
    for j in range(parts):
        begin[j + 1] = begin[j] + len(directions[j])
    cdef const double* joints = doubles(given, 4 * n * dof)
    cdef const double* bound = doubles(bounds, n * (dof + 2))
    cdef const double* turn = doubles(turns, 2)
    cdef double* row = doubles(rows, 3 * n * m)
    cdef double* slowness = doubles(times, n)
    cdef double motion[18]
    cdef double tangent[3]
    cdef double normal[3]
    cdef double amounts[2]
    cdef double along, across
    cdef int part, order
    with nogil:
        for place in range(n):
            slowness[place] = 0.0
            for j in range(dof):
                along = fabs(joints[(n + place) * dof + j]) / bound[place * (dof + 2) + j]
                slowness[place] = max(slowness[place], along)
                for order in range(3):
                    row[(order * n + place) * m + j] = joints[((order + 1) * n + place) * dof + j]
            if parts == 0:
                continue
            chain.c_motion(&joints[place * dof], n * dof, motion)
            for part in range(parts):
                _frame(&motion[3 * part], tangent, normal, amounts)
                slowness[place] = max(slowness[place], amounts[0] / bound[place * (dof + 2) + dof + part])
                for order in range(3):
                    along = _dot(&motion[6 * order + 3 * part], tangent)
                    across = _dot(&motion[6 * order + 3 * part], normal)
                    for j in range(begin[part], begin[part + 1]):
                        row[(order * n + place) * m + j] = (
                            along * turn[j - dof] + across * turn[m - dof + j - dof]
                        )
    return rows, times


def chained(derivatives, law, limits=None):
    given = np.array(derivatives, dtype=np.float64, order="C")
    times = np.array(law, dtype=np.float64, order="C")
    cdef Py_ssize_t n = given.shape[1], m = given.shape[2], place, j
    if given.shape != (3, n, m) or times.shape != (4, n):
        raise ValueError(f"derivatives of shape {given.shape}, a law of shape {times.shape}")
    out = np.empty((3, n, m))
    if out.size == 0:
        return out
    bounds = np.ones((3, m))
    if limits is not None:
        bounds[...] = limits
    cdef const double* row = doubles(given, 3 * n * m)
    cdef const double* s = doubles(times, 4 * n)
    cdef const double* bound = doubles(bounds, 3 * m)
    cdef double* found = doubles(out, 3 * n * m)
    cdef double u, v, w, first, second, third
    cdef Py_ssize_t all = n * m, at
    with nogil:
        for place in range(n):
            u, v, w = s[n + place], s[2 * n + place], s[3 * n + place]
            for j in range(m):
                at = place * m + j
                first, second, third = row[at], row[all + at], row[2 * all + at]
                found[at] = first * u / bound[j]
                found[all + at] = (second * (u * u) + first * v) / bound[m + j]
                found[2 * all + at] = third * (u * u * u) + 3.0 * second * u * v + first * w
                found[2 * all + at] /= bound[2 * m + j]
    return out
