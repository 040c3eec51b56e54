"""Angles about three axes through one point, such as those of a shoulder or a wrist, for a given rotation, in
C.

The axes may have any directions: R = R₁(a) R₂(b) R₃(c) (Davenport's angles; Shuster and Markley,
"Generalization of the Euler angles", 2003). The angle between the first axis and the rotated third axis
depends on b only. It is the third side of a spherical triangle, so there are two solutions for b. Half angles
keep the digits that a cosine loses where the axes align.
"""

from libc.math cimport atan2, cos, fabs, sin, sqrt

from cobot.robot.inverse_kinematics.vectors cimport (
    TURN,
    angle_about,
    cross3,
    dot3,
    length3,
    settled,
    times,
    transposed_times,
    turned,
    turned_by,
)

cdef enum:
    UNREACHABLE = 0
    REGULAR = 1
    ALIGNED = 2  # the first axis coincides with the third one, so one of their two angles is free

cdef extern from *:
    """
    static const double COBOT_ALIGNED = 1e-10, COBOT_NEARLY_ALIGNED = 1e-3;
    """
    const double ALIGNED_RAD "COBOT_ALIGNED"
    const double NEARLY_ALIGNED_RAD "COBOT_NEARLY_ALIGNED"


cdef struct Triple:
    double first[3]
    double second[3]
    double third[3]
    double across[3]  # at a right angle to the third one
    double rest       # the angle b at which the third axis is nearest to the first one, rad
    double least      # the smallest and the largest angle between them, rad
    double largest
    bint square       # both axes at right angles to the second one
    # the directions to which the second axis turns the first one, and the third one back, if they align
    double before[3]
    double after[3]


cdef struct Angles:
    int kind
    double plus[3]    # the solution beyond `rest`, and the one before it
    double minus[3]
    double sense      # if they are ALIGNED: 1 for the same direction, -1 for opposite directions


cdef inline bint triple_of(
    const double* first, const double* second, const double* third, Triple* out
) noexcept nogil:
    """Prepare three axes. False if two neighbouring axes are parallel, because these cannot produce every
    rotation."""
    cdef double cross[3]
    cdef double one, two, sine_one, sine_two
    cdef int i, least = 0
    for i in range(3):
        out.first[i], out.second[i], out.third[i], out.across[i] = first[i], second[i], third[i], 0.0
        if fabs(third[i]) < fabs(third[least]):
            least = i
    cross3(first, second, cross)
    sine_one = length3(cross)
    one = atan2(sine_one, dot3(first, second))
    cross3(second, third, cross)
    sine_two = length3(cross)
    two = atan2(sine_two, dot3(second, third))
    out.rest = atan2(dot3(first, cross), dot3(first, third) - dot3(first, second) * dot3(second, third))
    out.least, out.largest = one - two, one + two
    out.square = fabs(dot3(first, second)) < 1e-14 and fabs(dot3(second, third)) < 1e-14
    cross3(second, first, out.before)
    cross3(third, second, out.after)
    cross[0] = cross[1] = cross[2] = 0.0
    cross[least] = 1.0
    cross3(third, cross, out.across)
    return sine_one > 1e-6 and sine_two > 1e-6


cdef inline void rest_of_triple(const Triple* triple, const double* rotation, double* angles) noexcept nogil:
    """The second and the third angle of a rotation whose first one is given."""
    cdef double there[3]
    cdef double back[3]
    times(rotation, triple.third, there)
    turned_by(triple.first, -angles[0], there, back)
    angles[1] = angle_about(triple.second, triple.third, back)
    times(rotation, triple.across, there)
    turned_by(triple.first, -angles[0], there, back)
    turned_by(triple.second, -angles[1], back, there)
    angles[2] = angle_about(triple.third, triple.across, there)


cdef inline bint solve_square(
    const Triple* triple, const double* rotation, const double* there, Angles* out
) noexcept nogil:
    """Euler angles for axes at right angles. False near the rotations at which the first and the third axis
    align.


    There the rounding errors of the first and the third angle would add up.
    """
    cdef double back[3]
    cdef double one = dot3(triple.second, there)
    cdef double two = dot3(triple.before, there)
    cdef double sine = sqrt(one * one + two * two)
    if sine < NEARLY_ALIGNED_RAD:
        return False
    transposed_times(rotation, triple.first, back)
    out.kind = REGULAR
    out.plus[0] = atan2(one, two)
    out.plus[1] = triple.rest + atan2(sine, dot3(triple.first, there))
    out.plus[2] = atan2(dot3(triple.second, back), dot3(triple.after, back))
    out.minus[0] = out.plus[0] + 0.5 * TURN
    out.minus[1] = 2.0 * triple.rest - out.plus[1]
    out.minus[2] = out.plus[2] + 0.5 * TURN
    return True


cdef inline void solve_triple(const Triple* triple, const double* rotation, Angles* out) noexcept nogil:
    """The two solutions. Each angle is known up to a full turn. If the axes are ALIGNED, the first angle is
    0."""
    cdef double there[3]
    cdef double cross[3]
    cdef double moved[3]
    cdef double bend, apart, sine, beyond, short_of
    cdef int i
    times(rotation, triple.third, there)
    if triple.square and solve_square(triple, rotation, there, out):
        return
    cross3(triple.first, there, cross)
    sine = length3(cross)
    bend = apart = atan2(sine, dot3(triple.first, there))
    out.kind = REGULAR
    if not triple.square:
        beyond = sin(0.5 * (apart + triple.least)) * sin(0.5 * (apart - triple.least))
        short_of = sin(0.5 * (triple.largest + apart)) * sin(0.5 * (triple.largest - apart))
        if beyond < -1e-9 or short_of < -1e-9:
            out.kind = UNREACHABLE
            return
        bend = 2.0 * atan2(sqrt(beyond if beyond > 0.0 else 0.0), sqrt(short_of if short_of > 0.0 else 0.0))
    if sine < ALIGNED_RAD:
        out.kind, out.sense = ALIGNED, 1.0 if apart < 1.0 else -1.0
        out.plus[0] = 0.0
        rest_of_triple(triple, rotation, out.plus)
        for i in range(3):
            out.minus[i] = out.plus[i]
        return
    turned_by(triple.second, triple.rest + bend, triple.third, moved)
    out.plus[0] = angle_about(triple.first, moved, there)
    rest_of_triple(triple, rotation, out.plus)
    if triple.square:
        out.minus[0] = out.plus[0] + 0.5 * TURN
        out.minus[1] = 2.0 * triple.rest - out.plus[1]
        out.minus[2] = out.plus[2] + 0.5 * TURN
    else:
        turned_by(triple.second, triple.rest - bend, triple.third, moved)
        out.minus[0] = angle_about(triple.first, moved, there)
        rest_of_triple(triple, rotation, out.minus)


cdef inline bint settle_triple(
    const Angles* found, bint minus, const double* low, const double* high, const double* near,
    double slack, double* out
) noexcept nogil:
    """The angles of one solution within the limits, the nearest to `near`; False if there are none."""
    cdef int i
    if found.kind == UNREACHABLE:
        return False
    for i in range(3):
        out[i] = found.minus[i] if minus else found.plus[i]
    if not settled(&out[1], low[1], high[1], near[1], slack):
        return False
    if found.kind == REGULAR:
        return settled(&out[0], low[0], high[0], near[0], slack) and settled(
            &out[2], low[2], high[2], near[2], slack
        )
    return settle_sum(out[2], found.sense, low, high, near, slack, out)


cdef inline bint settle_sum(
    double total, double sense, const double* low, const double* high, const double* near,
    double slack, double* out
) noexcept nogil:
    """Split total = third + sense · first (up to turns) into both, within their limits, nearest to `near`."""
    cdef double best = 1e300
    cdef double least, largest, value, first, third, cost
    cdef int turns
    for turns in range(-4, 5):
        value = total + turns * TURN
        least = value - high[2] if sense > 0.0 else low[2] - value
        largest = value - low[2] if sense > 0.0 else high[2] - value
        least = least if least > low[0] else low[0]
        largest = largest if largest < high[0] else high[0]
        if least > largest + slack:
            continue
        first = 0.5 * (near[0] + sense * (value - near[2]))
        first = largest if first > largest else (least if first < least else first)
        third = value - sense * first
        cost = (first - near[0]) * (first - near[0]) + (third - near[2]) * (third - near[2])
        if cost < best:
            best, out[0], out[2] = cost, first, third
    return best < 1e300
