"""Quaternions (w, x, y, z) and rotation vectors (rad) in C; the rules are those of `quaternion.pyx`.

Results come last and never share memory with an argument.
"""

from libc.math cimport atan2, cos, sin, sqrt, tan


cdef extern from *:
    """
    /* Below this angle a series of second order is exact to the last bit, and quotients of small
       numbers are not. */
    static const double COBOT_SMALL_RAD = 1e-4;
    """
    const double SMALL_ANGLE_RAD "COBOT_SMALL_RAD"


cdef inline void quat_product(const double* a, const double* b, double* out) noexcept nogil:
    """The rotation b followed by the rotation a."""
    out[0] = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3]
    out[1] = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2]
    out[2] = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1]
    out[3] = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0]


cdef inline void quat_conjugate(const double* q, double* out) noexcept nogil:
    out[0] = q[0]
    out[1] = -q[1]
    out[2] = -q[2]
    out[3] = -q[3]


cdef inline void quat_normalised(const double* q, double* out) noexcept nogil:
    cdef double scale = 1.0 / sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    cdef int i
    for i in range(4):
        out[i] = q[i] * scale


cdef inline void cross3(const double* a, const double* b, double* out) noexcept nogil:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


cdef inline void quat_exp(const double* r, double* out) noexcept nogil:
    """The unit quaternion that turns by a rotation vector."""
    cdef double angle = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
    cdef double half = 0.5 * angle
    cdef double scale = sin(half) / angle if angle > SMALL_ANGLE_RAD else 0.5 - angle * angle / 48.0
    out[0] = cos(half)
    out[1] = r[0] * scale
    out[2] = r[1] * scale
    out[3] = r[2] * scale


cdef inline void quat_log(const double* q, double* out) noexcept nogil:
    """The rotation vector, at most π long, of a quaternion of any sign and length."""
    cdef double sign = 1.0 if q[0] >= 0.0 else -1.0
    cdef double w = sign * q[0]
    cdef double x = sign * q[1]
    cdef double y = sign * q[2]
    cdef double z = sign * q[3]
    cdef double sine = sqrt(x * x + y * y + z * z)
    cdef double scale = 0.0
    if sine > SMALL_ANGLE_RAD * w:
        scale = 2.0 * atan2(sine, w) / sine
    elif w > 0.0:
        scale = 2.0 / w - 2.0 * sine * sine / (3.0 * w * w * w)
    out[0] = x * scale
    out[1] = y * scale
    out[2] = z * scale


cdef inline void quat_between(const double* start, const double* end, double* out) noexcept nogil:
    """The shorter rotation vector, in the base frame, from one orientation to the other."""
    cdef double back[4]
    cdef double turn[4]
    quat_conjugate(start, back)
    quat_product(end, back, turn)
    quat_log(turn, out)


cdef inline void rotation_series(
    const double* r, const double* v, double a, double b, double* out
) noexcept nogil:
    """v + a r × v + b r × (r × v)."""
    cdef double u[3]
    cdef double w[3]
    cdef int i
    cross3(r, v, u)
    cross3(r, u, w)
    for i in range(3):
        out[i] = v[i] + a * u[i] + b * w[i]


cdef inline void left_jacobian_factors(const double* r, double* a, double* b) noexcept nogil:
    """The factors of [r]× and [r]×² in the left Jacobian."""
    cdef double square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    cdef double angle = sqrt(square)
    if angle < 0.01:
        a[0] = 0.5 - square / 24.0
        b[0] = 1.0 / 6.0 - square / 120.0
    else:
        a[0] = (1.0 - cos(angle)) / square
        b[0] = (angle - sin(angle)) / (square * angle)


cdef inline void quat_angular_velocity(const double* r, const double* rate, double* out) noexcept nogil:
    """The angular velocity of exp(r) while r changes at a rate: the left Jacobian of SO(3) at r times the
    rate."""
    cdef double a, b
    left_jacobian_factors(r, &a, &b)
    rotation_series(r, rate, a, b, out)


cdef inline void quat_rotation_rate(const double* r, const double* velocity, double* out) noexcept nogil:
    """The rate of r at which exp(r) turns with an angular velocity: the inverse of `quat_angular_velocity`,
    for |r| < 2π."""
    cdef double square = r[0] * r[0] + r[1] * r[1] + r[2] * r[2]
    cdef double angle = sqrt(square)
    cdef double c = 1.0 / 12.0
    if angle >= SMALL_ANGLE_RAD:
        c = 1.0 / square - 0.5 / (angle * tan(0.5 * angle))
    rotation_series(r, velocity, -0.5, c, out)


cdef inline void quat_angular_acceleration(
    const double* r, const double* rate, const double* second, double* out
) noexcept nogil:
    """The angular acceleration of exp(r) from the first two derivatives of r, approximated as in
    `angular_acceleration`."""
    cdef double a, b
    cdef double along[3]
    cdef double u[3]
    cdef double w[3]
    cdef int i
    left_jacobian_factors(r, &a, &b)
    rotation_series(r, second, a, b, along)
    cross3(r, rate, u)
    cross3(rate, u, w)
    for i in range(3):
        out[i] = along[i] + b * w[i]


cdef inline void quat_rotated(const double* q, const double* v, double* out) noexcept nogil:
    """A vector, turned by a unit quaternion."""
    cdef double u[3]
    cdef double w[3]
    cdef int i
    cross3(&q[1], v, u)
    cross3(&q[1], u, w)
    for i in range(3):
        out[i] = v[i] + 2.0 * q[0] * u[i] + 2.0 * w[i]


cdef inline void quat_to_matrix(const double* q, double* out) noexcept nogil:
    """The rotation matrix, row by row, of a unit quaternion."""
    cdef double w = q[0]
    cdef double x = q[1]
    cdef double y = q[2]
    cdef double z = q[3]
    out[0] = w * w + x * x - y * y - z * z
    out[4] = w * w - x * x + y * y - z * z
    out[8] = w * w - x * x - y * y + z * z
    out[1] = 2.0 * (x * y - w * z)
    out[2] = 2.0 * (x * z + w * y)
    out[3] = 2.0 * (x * y + w * z)
    out[5] = 2.0 * (y * z - w * x)
    out[6] = 2.0 * (x * z - w * y)
    out[7] = 2.0 * (y * z + w * x)


cdef inline void quat_from_matrix(const double* m, double* out) noexcept nogil:
    """The unit quaternion of a rotation matrix (row by row), with the same sign as MuJoCo's: w is positive,
    or if w is 0, the first of the largest other numbers.
    """
    cdef double q[4]
    if m[0] + m[4] + m[8] > 0.0:
        q[0] = 0.5 * sqrt(1.0 + m[0] + m[4] + m[8])
        q[1] = 0.25 * (m[7] - m[5]) / q[0]
        q[2] = 0.25 * (m[2] - m[6]) / q[0]
        q[3] = 0.25 * (m[3] - m[1]) / q[0]
    elif m[0] > m[4] and m[0] > m[8]:
        q[1] = 0.5 * sqrt(1.0 + m[0] - m[4] - m[8])
        q[0] = 0.25 * (m[7] - m[5]) / q[1]
        q[2] = 0.25 * (m[1] + m[3]) / q[1]
        q[3] = 0.25 * (m[2] + m[6]) / q[1]
    elif m[4] > m[8]:
        q[2] = 0.5 * sqrt(1.0 - m[0] + m[4] - m[8])
        q[0] = 0.25 * (m[2] - m[6]) / q[2]
        q[1] = 0.25 * (m[1] + m[3]) / q[2]
        q[3] = 0.25 * (m[5] + m[7]) / q[2]
    else:
        q[3] = 0.5 * sqrt(1.0 - m[0] - m[4] + m[8])
        q[0] = 0.25 * (m[3] - m[1]) / q[3]
        q[1] = 0.25 * (m[2] + m[6]) / q[3]
        q[2] = 0.25 * (m[5] + m[7]) / q[3]
    quat_normalised(q, out)
