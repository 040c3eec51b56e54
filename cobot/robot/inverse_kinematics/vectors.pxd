"""Vectors, matrices (3 × 3, row by row) and rotations about axes, in C.

Axes have length 1. Results come last and never share memory with an argument.
"""

from libc.math cimport atan2, cos, fabs, floor, sin, sqrt

from cobot.robot.quaternion cimport cross3

cdef extern from *:
    """
    static const double COBOT_TURN = 6.283185307179586476925;
    """
    const double TURN "COBOT_TURN"


cdef inline double dot3(const double* a, const double* b) noexcept nogil:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


cdef inline void minus3(const double* a, const double* b, double* out) noexcept nogil:
    out[0] = a[0] - b[0]
    out[1] = a[1] - b[1]
    out[2] = a[2] - b[2]


cdef inline void plus3(const double* a, const double* b, double* out) noexcept nogil:
    out[0] = a[0] + b[0]
    out[1] = a[1] + b[1]
    out[2] = a[2] + b[2]


cdef inline double length3(const double* a) noexcept nogil:
    return sqrt(dot3(a, a))


cdef inline void times(const double* m, const double* v, double* out) noexcept nogil:
    """m v."""
    out[0] = m[0] * v[0] + m[1] * v[1] + m[2] * v[2]
    out[1] = m[3] * v[0] + m[4] * v[1] + m[5] * v[2]
    out[2] = m[6] * v[0] + m[7] * v[1] + m[8] * v[2]


cdef inline void transposed_times(const double* m, const double* v, double* out) noexcept nogil:
    """mᵀ v."""
    out[0] = m[0] * v[0] + m[3] * v[1] + m[6] * v[2]
    out[1] = m[1] * v[0] + m[4] * v[1] + m[7] * v[2]
    out[2] = m[2] * v[0] + m[5] * v[1] + m[8] * v[2]


cdef inline void product(const double* a, const double* b, double* out) noexcept nogil:
    """a b."""
    cdef int i, j
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = a[3 * i] * b[j] + a[3 * i + 1] * b[3 + j] + a[3 * i + 2] * b[6 + j]


cdef inline void transposed_product(const double* a, const double* b, double* out) noexcept nogil:
    """aᵀ b."""
    cdef int i, j
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = a[i] * b[j] + a[3 + i] * b[3 + j] + a[6 + i] * b[6 + j]


cdef inline void product_transposed(const double* a, const double* b, double* out) noexcept nogil:
    """a bᵀ."""
    cdef int i, j
    for i in range(3):
        for j in range(3):
            out[3 * i + j] = dot3(&a[3 * i], &b[3 * j])


cdef inline void turned(const double* axis, double c, double s, const double* v, double* out) noexcept nogil:
    """v, turned about an axis by the angle of this cosine and sine (Rodrigues)."""
    cdef double along = (1.0 - c) * dot3(axis, v)
    cdef double across[3]
    cdef int i
    cross3(axis, v, across)
    for i in range(3):
        out[i] = c * v[i] + s * across[i] + along * axis[i]


cdef inline void turned_by(const double* axis, double angle, const double* v, double* out) noexcept nogil:
    turned(axis, cos(angle), sin(angle), v, out)


cdef inline void turn_about(const double* axis, double angle, double* out) noexcept nogil:
    """The rotation matrix for an axis and an angle."""
    cdef double c = cos(angle)
    cdef double s = sin(angle)
    cdef double x = axis[0]
    cdef double y = axis[1]
    cdef double z = axis[2]
    cdef double r = 1.0 - c
    out[0] = c + r * x * x
    out[4] = c + r * y * y
    out[8] = c + r * z * z
    out[1], out[3] = r * x * y - s * z, r * x * y + s * z
    out[2], out[6] = r * x * z + s * y, r * x * z - s * y
    out[5], out[7] = r * y * z - s * x, r * y * z + s * x


cdef inline double angle_about(const double* axis, const double* start, const double* end) noexcept nogil:
    """The angle by which `start` must be turned about the axis to come as near as possible to the direction
    `end`."""
    # The parts at right angles to the axis are calculated first. For directions close to the axis, only these
    # parts matter.
    cdef double across[3]
    cdef double one[3]
    cdef double two[3]
    cross3(axis, start, one)
    cross3(axis, end, two)
    cross3(one, two, across)
    return atan2(dot3(axis, across), dot3(one, two))


cdef inline bint triangle(
    double first, double second, double third, double slack, double* angle
) noexcept nogil:
    """The angle between two sides of a triangle, opposite to the third side.


    Half angles keep the digits that a cosine loses where the triangle is flat. False if there is no such
    triangle, because the third side is too long or too short by more than the slack.
    """
    cdef double short_of = (first + second - third) * (first + second + third)
    cdef double beyond = (third - first + second) * (third + first - second)
    if short_of < 0.0:
        if third - first - second > slack:
            return False
        short_of = 0.0
    if beyond < 0.0:
        if fabs(first - second) - third > slack:
            return False
        beyond = 0.0
    angle[0] = 2.0 * atan2(sqrt(beyond), sqrt(short_of))
    return True


cdef inline int trigonometric_roots(double a, double b, double c, double slack, double* roots) noexcept nogil:
    """The angles at which a cos x + b sin x = c: two or none. Both are equal if c is too large, but by no
    more than the slack.
    """
    cdef double amplitude = sqrt(a * a + b * b)
    cdef double rest = (amplitude - c) * (amplitude + c)
    cdef double middle, half
    if not fabs(c) - amplitude <= slack or amplitude < 1e-12:
        return 0
    middle, half = atan2(b, a), atan2(sqrt(rest if rest > 0.0 else 0.0), c)
    roots[0], roots[1] = middle - half, middle + half
    return 2


cdef inline double wrapped(double angle, double near) noexcept nogil:
    """The same angle, shifted by full turns to less than half a turn from `near`."""
    return angle - TURN * floor((angle - near) / TURN + 0.5)


cdef inline bint settled(double* angle, double low, double high, double near, double slack) noexcept nogil:
    """Shift the angle by full turns into the limits, as near as possible to `near`, which is within them. The
    limits may be passed by the slack. False if no such angle exists.
    """
    cdef double value = wrapped(angle[0], near)
    if value > high and (value > high + slack or value - TURN >= low):
        value -= TURN
    elif value < low and (value < low - slack or value + TURN <= high):
        value += TURN
    angle[0] = value
    return low - slack <= value <= high + slack


cdef struct Hinge:
    double axis[3]
    # from the axis to a point on the fixed side, and to a point on the turning side, at rest
    double before[3]
    double after[3]
    double folded      # the angle at which they are nearest to each other
    double lengths[2]  # of the triangle that they form, seen along the axis ...
    double offset      # ... and the distance of the second one from its plane


cdef inline void set_hinge(
    const double* axis, const double* before, const double* after, Hinge* out
) noexcept nogil:
    cdef double across[3]
    cdef double one = dot3(axis, before)
    cdef double two = dot3(axis, after)
    cdef int i
    for i in range(3):
        out.axis[i], out.before[i], out.after[i] = axis[i], before[i], after[i]
    cross3(axis, after, across)
    out.offset = two - one
    out.lengths[0] = sqrt(max(dot3(before, before) - one * one, 0.0))
    out.lengths[1] = sqrt(max(dot3(after, after) - two * two, 0.0))
    out.folded = atan2(dot3(before, across), dot3(before, after) - one * two)


cdef inline bint hinge_angle(const Hinge* hinge, double across, double slack, double* bend) noexcept nogil:
    """The turn from `folded`, in either direction, at which the hinge's points have the distance `across`,
    seen along the axis. False if they cannot have it.
    """
    return triangle(hinge.lengths[0], hinge.lengths[1], across, slack, bend)


cdef inline double hinge_distance(const Hinge* hinge, double angle) noexcept nogil:
    """The distance between the hinge's points, m."""
    cdef double there[3]
    cdef double between[3]
    turned_by(hinge.axis, angle, hinge.after, there)
    minus3(there, hinge.before, between)
    return length3(between)


cdef inline double hinge_gap(
    const Hinge* hinge, double distance, double low, double high, double near
) noexcept nogil:
    """The amount, m, by which a distance is outside the range that the hinge's points can have within
    limits."""
    cdef double least = 1e300
    cdef double most = 0.0
    cdef double angle, value
    cdef int i
    for i in range(4):
        angle = low if i == 0 else high
        if i > 1:
            angle = hinge.folded + (0.5 * TURN if i == 3 else 0.0)
            if not settled(&angle, low, high, near, 0.0):
                continue
        value = hinge_distance(hinge, angle)
        least = value if value < least else least
        most = value if value > most else most
    value = distance - most if distance > most else least - distance
    return value if value > 0.0 else 0.0
