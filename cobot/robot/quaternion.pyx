"""Quaternions (w, x, y, z) and rotation vectors (rad), for Python and, as `quat_*`, for compiled code.

Rotations are applied from the left, q = exp(r) q0: rotation vectors and angular velocities are in the base
frame. Source of the Jacobian: J. Solà, J. Deray, D. Atchuthan, "A micro Lie theory for state estimation in
robotics", 2018, equations 145 and 146.
"""

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

SMALL_RAD = SMALL_ANGLE_RAD


cdef inline int _read3(object values, double* out) except -1:
    out[0], out[1], out[2] = values
    return 0


cdef inline int _read4(object values, double* out) except -1:
    out[0], out[1], out[2], out[3] = values
    return 0


cdef inline tuple _vector(const double* v):
    return v[0], v[1], v[2]


cdef inline tuple _quaternion(const double* q):
    return q[0], q[1], q[2], q[3]


def product(a, b):
    """The rotation b followed by the rotation a."""
    cdef double[4] first, second, out
    _read4(a, first)
    _read4(b, second)
    quat_product(first, second, out)
    return _quaternion(out)


def conjugate(q):
    """The inverse of a unit quaternion."""
    cdef double[4] given, out
    _read4(q, given)
    quat_conjugate(given, out)
    return _quaternion(out)


def normalised(q):
    """A quaternion that is not zero, scaled to length 1."""
    cdef double[4] given, out
    _read4(q, given)
    if given[0] == given[1] == given[2] == given[3] == 0.0:
        raise ZeroDivisionError("a quaternion of zeros has no direction")
    quat_normalised(given, out)
    return _quaternion(out)


def cross(a, b):
    """The vector product."""
    cdef double[3] first, second, out
    _read3(a, first)
    _read3(b, second)
    cross3(first, second, out)
    return _vector(out)


def exp(r):
    """The unit quaternion that turns by a rotation vector."""
    cdef double[3] vector
    cdef double[4] out
    _read3(r, vector)
    quat_exp(vector, out)
    return _quaternion(out)


def log(q):
    """The rotation vector, at most π long, of a quaternion of any sign and length."""
    cdef double[4] given
    cdef double[3] out
    _read4(q, given)
    quat_log(given, out)
    return _vector(out)


def between(start, end):
    """The shorter rotation vector, in the base frame, from one orientation to the other."""
    cdef double[4] first, second
    cdef double[3] out
    _read4(start, first)
    _read4(end, second)
    quat_between(first, second, out)
    return _vector(out)


def angular_velocity(r, rate):
    """The angular velocity of exp(r) while r changes at a rate: the left Jacobian of SO(3) at r times the
    rate."""
    cdef double[3] vector, first, out
    _read3(r, vector)
    _read3(rate, first)
    quat_angular_velocity(vector, first, out)
    return _vector(out)


def rotation_rate(r, velocity):
    """The rate of r at which exp(r) turns with an angular velocity: the inverse of `angular_velocity`, for
    |r| < 2π."""
    cdef double[3] vector, turning, out
    _read3(r, vector)
    _read3(velocity, turning)
    quat_rotation_rate(vector, turning, out)
    return _vector(out)


def angular_acceleration(r, rate, second):
    """The angular acceleration of exp(r), from the first two derivatives of r.

    The terms of second order in r from the change of the Jacobian are left out. They are below |r|² |rate|² /
    12, and zero for a fixed axis."""
    cdef double[3] vector, first, then, out
    _read3(r, vector)
    _read3(rate, first)
    _read3(second, then)
    quat_angular_acceleration(vector, first, then, out)
    return _vector(out)


def rotated(q, v):
    """A vector, turned by a unit quaternion."""
    cdef double[4] turn
    cdef double[3] vector, out
    _read4(q, turn)
    _read3(v, vector)
    quat_rotated(turn, vector, out)
    return _vector(out)


def to_matrix(q):
    """The rotation matrix of a unit quaternion, row by row, nine numbers."""
    cdef double[4] turn
    cdef double[9] out
    cdef int i
    _read4(q, turn)
    quat_to_matrix(turn, out)
    return tuple([out[i] for i in range(9)])


def from_matrix(matrix):
    """The unit quaternion of a rotation matrix, nine numbers row by row, with the same sign as MuJoCo's."""
    cdef double[9] given
    cdef double[4] out
    cdef int i
    for i in range(9):
        given[i] = matrix[i]
    quat_from_matrix(given, out)
    return _quaternion(out)
