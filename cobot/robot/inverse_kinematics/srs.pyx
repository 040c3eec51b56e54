"""Inverse kinematics of S-R-S arms in closed form over the arm angle. Shoulder and wrist have three axes
each, which meet in one point; between them is an elbow.

The elbow's angle follows from the distance between the centres of wrist and shoulder. The arm may then turn
about the line through both, by the arm angle, and the shoulder and the wrist have two solutions each (Shimizu
et al. 2008, doi 10.1109/TRO.2008.2003266, extended here to axes of any direction). A joint reaches a limit
where a linear equation of the arm angle's cosine and sine holds, so the feasible arm angles are known
exactly.

The arm angle is measured from a frame that is turned from the first joint's axis to the direction of the
wrist by the shortest rotation. Only a wrist straight behind the shoulder has no such rotation (compare Elias
and Wen 2024, doi 10.1016/j.mechmachtheory.2024.105766). If the angle were measured from the vertical plane,
as by Shimizu, a wrist straight above the shoulder would be singular too. The angle stays smooth through a
straight elbow.

Longer than other modules, because the parts of this one concept share the frames.
"""

from libc.math cimport NAN, atan2, cos, fabs, isnan, sin, sqrt
from libc.string cimport memcpy, memmove

import numpy as np

from cobot.arrays cimport bytes_of, doubles
from cobot.robot.inverse_kinematics.arm cimport (
    LIMITS,
    NEAREST,
    MAX_CANDIDATES,
    Arm,
    Candidate,
    Problem,
)
from cobot.robot.inverse_kinematics.triple cimport (
    Angles,
    Triple,
    settle_triple,
    solve_triple,
    triple_of,
)
from cobot.robot.inverse_kinematics.vectors cimport (
    TURN,
    cross3,
    dot3,
    length3,
    hinge_angle,
    hinge_gap,
    minus3,
    plus3,
    product,
    product_transposed,
    set_hinge,
    settled,
    times,
    transposed_product,
    transposed_times,
    trigonometric_roots,
    turn_about,
    turned_by,
    wrapped,
)

from cobot.errors import InputError

cdef extern from *:
    """
    /* Slack of the limits, so that a single feasible arm angle is found; and the longest step, rad, of the
       first search for the best arm angle. */
    static const double COBOT_SRS_SLACK = 1e-9, COBOT_SRS_STEP = 0.35;
    static const double COBOT_GOLDEN = 0.6180339887498949;
    /* If a joint turns further than this between two arm angles, rad, one more is added between them, but
       never closer than the minimum step. */
    static const double COBOT_SRS_TURN = 0.6, COBOT_SRS_MIN_STEP = 2e-12;
    /* An interval is also examined this close to its ends, rad. */
    static const double COBOT_SRS_EDGE = 1e-10;
    /* Distance from a break, rad, below which rounding decides whether an arm angle is feasible. */
    static const double COBOT_SRS_AT_BREAK = 1e-6;
    /* Largest distance of three joints, rad, from the nearer of two neighbours between them, and largest
       ratio of the arc between two neighbours to its chord. */
    /* The search for the best arm angle ends when its bracket is smaller than this share of the first one,
       or than this angle, rad, or when its costs differ by less than this share. Where joints turn fast along
       the arm angle, the first two bounds alone would be too coarse. */
    static const double COBOT_REFINED_TO = 1e-12, COBOT_MIN_TOLERANCE = 1e-15, COBOT_SAME_COST = 1e-12;
    static const double COBOT_NEARLY_STRAIGHT = 1e-3;
    static const double COBOT_SRS_BETWEEN = 0.6, COBOT_SRS_ARC = 1.2;
    """
    const double MAX_TURN "COBOT_SRS_TURN"
    const double MIN_STEP "COBOT_SRS_MIN_STEP"
    const double EDGE "COBOT_SRS_EDGE"
    const double AT_BREAK "COBOT_SRS_AT_BREAK"
    const double NEARLY_STRAIGHT_RAD "COBOT_NEARLY_STRAIGHT"
    const double SAME_COST "COBOT_SAME_COST"
    const double MIN_TOLERANCE "COBOT_MIN_TOLERANCE"
    const double REFINED_TO "COBOT_REFINED_TO"
    const double BETWEEN "COBOT_SRS_BETWEEN"
    const double ARC "COBOT_SRS_ARC"
    const double SLACK "COBOT_SRS_SLACK"
    const double MAX_STEP "COBOT_SRS_STEP"
    const double GOLDEN "COBOT_GOLDEN"

cdef enum:
    REFINEMENTS = 40
    # What to find in an interval of feasible arm angles: all local minima, only the best angle, or its ends.
    MINIMA = 0
    BEST = 1
    WHOLE = 2
    SHOULDER = 1
    ELBOW = 2
    WRIST = 4


cdef class SrsArm(Arm):
    """Inverse kinematics of an S-R-S arm. Poses are arrays (7,), x, y, z (m) and w, x, y, z of the TCP in the
    base frame; joints are (7,), rad.

    A branch is a sum: 1 for the other shoulder, 2 for the other elbow, 4 for the other wrist. It can change
    where the first and third axis, or the fifth and seventh, align, and where the elbow is straight or
    folded.
    """

    BRANCHES = 8

    def __init__(self, chain, limits, rest, root, double reach, double slop, axes, shoulder, wrist, elbow):
        """Axes at rest, shape (7, 3), the two points in which three of them meet, and a point on the fourth
        axis, m, in the base frame.

        Raises:
            InputError: two axes of the shoulder or the wrist are parallel, or the elbow does not bend.
        """
        Arm.__init__(self, chain, limits, rest, root, reach, slop)
        work = np.array(axes, dtype=np.float64)
        cdef double* axis = doubles(work, 21)
        cdef int i
        if not (triple_of(axis, axis + 3, axis + 6, &self.shoulder) and triple_of(
            axis + 12, axis + 15, axis + 18, &self.wrist
        )):
            raise InputError("two axes of the shoulder or the wrist that follow each other are parallel")
        cdef double before[3]
        cdef double after[3]
        for i in range(3):
            self.centre[i] = shoulder[i]
            before[i], after[i] = shoulder[i] - elbow[i], wrist[i] - elbow[i]
            self.wrist_centre[i] = wrist[i]
        set_hinge(axis + 9, before, after, &self.elbow)
        if min(self.elbow.lengths[0], self.elbow.lengths[1]) < 1e-6:
            raise InputError("the elbow's axis passes through the shoulder or the wrist")
        self._set_pole(np.asarray(work[0]), np.asarray(shoulder))

    def _set_pole(self, axis, away):
        """Set the pole: the direction of the first axis that points away from the base's origin."""
        cdef int i, j
        z = axis if axis @ away >= 0.0 else -axis
        x = np.eye(3)[np.argmin(np.abs(z))]
        x = x - (x @ z) * z
        x /= np.linalg.norm(x)
        y = np.cross(z, x)
        for i in range(3):
            for j, column in enumerate((x, y, z)):
                self.pole[3 * i + j] = column[i]

    @property
    def closed_form(self):
        """Whether all solutions are known."""
        return True

    def is_vague(self, joints):
        """Whether the elbow is nearly straight or folded."""
        return fabs(sin(joints[3] - self.c_rest[3] - self.elbow.folded)) < NEARLY_STRAIGHT_RAD

    @property
    def arm_angle(self):
        """This object, because it has an arm angle."""
        return self

    # The geometry of one elbow angle.

    cdef bint _elbow(self, const Problem* problem, bint minus, Elbow* out) noexcept nogil:
        """Compute everything that does not depend on the arm angle. False if the elbow cannot reach the
        pose."""
        cdef double direction[3]
        cdef double turn[9]
        cdef double side, bend, square
        cdef int i
        self._to_wrist(problem, direction)
        side = length3(direction)
        square = side * side - self.elbow.offset * self.elbow.offset
        if side < 1e-9 or square < -problem.slop or not hinge_angle(
            &self.elbow, sqrt(max(square, 0.0)), problem.slop, &bend
        ):
            return False
        out.angle = self.elbow.folded - bend if minus else self.elbow.folded + bend
        if not settled(&out.angle, self.c_least[3], self.c_most[3], problem.near[3], 1e-6):
            return False
        out.angle = self.c_least[3] if out.angle < self.c_least[3] else out.angle
        out.angle = self.c_most[3] if out.angle > self.c_most[3] else out.angle
        for i in range(3):
            direction[i] /= side
        self._frame(direction, out.front)
        if not self._upper_frame(out.angle, out.back):
            return False
        turn_about(self.elbow.axis, out.angle, turn)
        transposed_product(out.back, turn, out.inner)
        transposed_product(out.front, problem.moved, out.kept)
        return True

    cdef void _to_wrist(self, const Problem* problem, double* out) noexcept nogil:
        """The vector from the shoulder to the wrist of a pose."""
        cdef double there[3]
        cdef double wrist[3]
        times(problem.moved, self.wrist_centre, there)
        plus3(there, problem.shift, wrist)
        minus3(wrist, self.centre, out)

    cdef void _frame(self, const double* direction, double* out) noexcept nogil:
        """The pole's frame, carried to a direction the shortest way: I cos + [k]× + k kᵀ / (1 + cos)."""
        cdef double z[3]
        cdef double k[3]
        cdef double turn[9]
        cdef double c, share
        cdef int i, j
        for i in range(3):
            z[i] = self.pole[3 * i + 2]
        c = dot3(z, direction)
        if c < -1.0 + 1e-12:  # straight behind: all ways have the same length, this is one of them
            for i in range(3):
                out[3 * i], out[3 * i + 1], out[3 * i + 2] = self.pole[3 * i], -self.pole[3 * i + 1], -z[i]
            return
        cross3(z, direction, k)
        share = 1.0 / (1.0 + c)
        for i in range(3):
            for j in range(3):
                turn[3 * i + j] = share * k[i] * k[j] + (c if i == j else 0.0)
        turn[1] -= k[2]
        turn[2] += k[1]
        turn[3] += k[2]
        turn[5] -= k[0]
        turn[6] -= k[1]
        turn[7] += k[0]
        product(turn, self.pole, out)

    cdef bint _upper_frame(self, double angle, double* out) noexcept nogil:
        """A frame of the upper arm at rest: column z points from shoulder to wrist, y follows the elbow's
        axis."""
        cdef double z[3]
        cdef double y[3]
        cdef double x[3]
        cdef double along, length
        cdef int i
        turned_by(self.elbow.axis, angle, self.elbow.after, x)
        minus3(x, self.elbow.before, z)
        length = length3(z)
        if length < 1e-9:
            return False
        for i in range(3):
            z[i] /= length
        along = dot3(self.elbow.axis, z)
        for i in range(3):
            y[i] = self.elbow.axis[i] - along * z[i]
        length = length3(y)
        if length < 1e-9:
            return False
        for i in range(3):
            y[i] /= length
        cross3(y, z, x)
        for i in range(3):
            out[3 * i], out[3 * i + 1], out[3 * i + 2] = x[i], y[i], z[i]
        return True

    # The joints at one arm angle.

    cdef void _turn(
        self, const Problem* problem, const Elbow* elbow, double angle, Turned* out
    ) noexcept nogil:
        """Both solutions of the shoulder and of the wrist."""
        cdef double mixed[9]
        cdef double rotation[9]
        cdef double c = cos(angle)
        cdef double s = sin(angle)
        cdef Angles angles
        cdef int i
        for i in range(3):
            mixed[3 * i] = c * elbow.front[3 * i] + s * elbow.front[3 * i + 1]
            mixed[3 * i + 1] = c * elbow.front[3 * i + 1] - s * elbow.front[3 * i]
            mixed[3 * i + 2] = elbow.front[3 * i + 2]
        product_transposed(mixed, elbow.back, rotation)
        solve_triple(&self.shoulder, rotation, &angles)
        for i in range(2):
            out.shoulder_fits[i] = settle_triple(
                &angles, i, self.c_least, self.c_most, problem.near, problem.slack, out.shoulder[i]
            )
        if not (out.shoulder_fits[0] or out.shoulder_fits[1]):
            out.wrist_fits[0] = out.wrist_fits[1] = False
            return
        for i in range(3):
            mixed[i] = c * elbow.kept[i] + s * elbow.kept[3 + i]
            mixed[3 + i] = c * elbow.kept[3 + i] - s * elbow.kept[i]
            mixed[6 + i] = elbow.kept[6 + i]
        transposed_product(elbow.inner, mixed, rotation)
        solve_triple(&self.wrist, rotation, &angles)
        for i in range(2):
            out.wrist_fits[i] = settle_triple(
                &angles, i, &self.c_least[4], &self.c_most[4], &problem.near[4], problem.slack, out.wrist[i]
            )

    cdef void _assemble(
        self, const Elbow* elbow, const Turned* turned, int branch, double* joints
    ) noexcept nogil:
        cdef int shoulder = 1 if branch & SHOULDER else 0
        cdef int wrist = 1 if branch & WRIST else 0
        cdef int i
        for i in range(3):
            joints[i] = turned.shoulder[shoulder][i] + self.c_rest[i]
            joints[4 + i] = turned.wrist[wrist][i] + self.c_rest[4 + i]
        joints[3] = elbow.angle + self.c_rest[3]

    cdef bint c_joints(self, const double* pose, double angle, int branch, double* joints) noexcept nogil:
        """Joints at an arm angle; False if there are none within the limits."""
        cdef Problem problem
        cdef Elbow elbow
        self.c_state(pose, NULL, LIMITS, &problem)
        problem.slack = 2.0 * SLACK
        if not self._elbow(&problem, branch & ELBOW, &elbow):
            return False
        if isnan(self._cost_at(&problem, &elbow, angle, branch, joints)):
            return False
        return self.c_verify(&problem, joints)

    cdef double _cost_at(
        self, const Problem* problem, const Elbow* elbow, double angle, int branch, double* joints
    ) noexcept nogil:
        """The cost at an arm angle; NaN if there are no joints within the limits."""
        cdef Turned turned
        self._turn(problem, elbow, angle, &turned)
        if not (turned.shoulder_fits[branch & SHOULDER] and turned.wrist_fits[1 if branch & WRIST else 0]):
            return NAN
        self._assemble(elbow, &turned, branch, joints)
        return self.c_cost(problem, joints)

    # The feasible arm angles.

    cdef int _breaks(self, const Elbow* elbow, double* out) noexcept nogil:
        """Arm angles, from -π to π and ascending, at which a joint may pass a limit."""
        cdef int count = self._breaks_of(&self.shoulder, 0, elbow.front, elbow.back, 1.0, out)
        cdef int i, j
        cdef double value
        cdef double forearm[9]
        for i in range(3):
            for j in range(3):
                forearm[3 * i + j] = elbow.inner[3 * j + i]
        count += self._breaks_of(&self.wrist, 4, forearm, elbow.kept, -1.0, out + count)
        for i in range(count):
            out[i] = wrapped(out[i], 0.0)
        for i in range(1, count):
            value, j = out[i], i
            while j > 0 and out[j - 1] > value:
                out[j] = out[j - 1]
                j -= 1
            out[j] = value
        return count

    cdef int _breaks_of(
        self, const Triple* triple, int joint, const double* left, const double* right, double sense,
        double* out
    ) noexcept nogil:
        """Arm angles at which one of three joints may pass a limit. There lᵀ R m has the value that follows
        from the limit.

        The rotation R is left Z(angle) rightᵀ for the shoulder (`sense` 1), and left Z(-angle) right for the
        wrist.
        """
        cdef double l[3]
        cdef double m[3]
        cdef double limit, value
        cdef int count = 0
        cdef int i, k
        for i in range(3):
            if self.c_most[joint + i] - self.c_least[joint + i] + 2.0 * SLACK >= TURN:
                continue
            for k in range(2):
                limit = self.c_most[joint + i] + SLACK if k else self.c_least[joint + i] - SLACK
                memcpy(l, triple.first, sizeof(l))
                memcpy(m, triple.third, sizeof(m))
                if i == 0:
                    turned_by(triple.first, limit, triple.second, l)
                    value = dot3(triple.second, triple.third)
                elif i == 1:
                    turned_by(triple.second, limit, triple.third, m)
                    value = dot3(triple.first, m)
                    memcpy(m, triple.third, sizeof(m))
                else:
                    turned_by(triple.third, -limit, triple.second, m)
                    value = dot3(triple.first, triple.second)
                count += roots_of(l, m, left, right, sense, value, out + count)
        if not triple.square:
            for k in range(2):
                value = cos(triple.largest if k else triple.least)
                count += roots_of(triple.first, triple.third, left, right, sense, value, out + count)
        return count

    cdef void _look(self, const Problem* problem, const Elbow* elbow, Places* places) noexcept nogil:
        """Compute the joints in the middle of each segment, from -π to π.

        A joint can pass a limit only at certain arm angles. Each interval between two of them is feasible or
        not as a whole. A feasible interval is divided into segments, with short ones at its ends.
        """
        cdef double breaks[MAX_BREAKS + 1]
        cdef int count = self._breaks(elbow, breaks)
        cdef double begin = -0.5 * TURN
        cdef Turned middle
        cdef int i
        breaks[count] = 0.5 * TURN
        places.count = 0
        for i in range(count + 1):
            if breaks[i] - begin < 1e-13:
                continue
            self._turn(problem, elbow, 0.5 * (begin + breaks[i]), &middle)
            if feasible(&middle):
                self._look_along(problem, elbow, begin, breaks[i], &middle, places)
            else:
                places.begins[places.count], places.turned[places.count] = begin, middle
                places.count += 1
            begin = breaks[i]
            places.begins[places.count] = begin

    cdef void _look_along(
        self, const Problem* problem, const Elbow* elbow, double begin, double end, const Turned* middle,
        Places* places
    ) noexcept nogil:
        """Divide an interval into two edges and an odd number of segments, so that the middle one has the
        known joints."""
        cdef double edge = EDGE if end - begin > 100.0 * EDGE else 0.0
        cdef int parts = 2 * <int>(0.5 * ((end - begin) / MAX_STEP + 1.0)) + 1
        cdef int first = places.count
        cdef int i
        if edge > 0.0:
            places.begins[first] = begin
            first += 1
        for i in range(parts):
            places.begins[first + i] = begin + edge + (end - begin - 2.0 * edge) * i / parts
        places.begins[first + parts] = end - edge
        places.begins[first + parts + 1] = end
        i, places.count = places.count, first + parts + (1 if edge > 0.0 else 0)
        for i in range(i, places.count):
            if i == first + parts // 2:
                places.turned[i] = middle[0]
            else:
                self._look_at(problem, elbow, places, i, middle)

    cdef void _look_at(
        self, const Problem* problem, const Elbow* elbow, Places* places, int segment, const Turned* whole
    ) noexcept nogil:
        """Examine a segment. Joints that violate limits on the whole interval also violate them on a part of
        it."""
        cdef double angle = 0.5 * (places.begins[segment] + places.begins[segment + 1])
        cdef Turned* turned = &places.turned[segment]
        cdef int i
        self._turn(problem, elbow, angle, turned)
        for i in range(2):
            turned.shoulder_fits[i] = turned.shoulder_fits[i] and whole.shoulder_fits[i]
            turned.wrist_fits[i] = turned.wrist_fits[i] and whole.wrist_fits[i]

    cdef void _divide(
        self, const Problem* problem, const Elbow* elbow, double best, Places* places
    ) noexcept nogil:
        """Add segments where joints turn fast along the arm angle because axes are nearly aligned, unless the
        other joints alone cost more than the best known solution.
        """
        cdef int i, after
        for i in range(places.count):
            best = min(best, self._least_cost(problem, elbow, &places.turned[i], 0, 0.0))
        i = 0
        while i < places.count and places.count < MAX_SEGMENTS:
            after = i + 1 if i + 1 < places.count else 0
            if self._is_coarse(problem, elbow, places, i, after, best):
                if width(places, after) > width(places, i):
                    i = after
                self._split(problem, elbow, places, i)
                for after in range(i, i + 2):
                    best = min(best, self._least_cost(problem, elbow, &places.turned[after], 0, 0.0))
                i = max(i - 1, 0)
            else:
                i += 1

    cdef bint _is_coarse(
        self, const Problem* problem, const Elbow* elbow, const Places* places, int one, int other,
        double best
    ) noexcept nogil:
        """Whether there may be joints between two neighbouring segments that are better than `best`."""
        cdef int part = racing(&places.turned[one], &places.turned[other])
        return part != 0 and max(width(places, one), width(places, other)) > MIN_STEP and best > min(
            self._least_cost(problem, elbow, &places.turned[one], part, BETWEEN),
            self._least_cost(problem, elbow, &places.turned[other], part, BETWEEN),
        )

    cdef void _split(
        self, const Problem* problem, const Elbow* elbow, Places* places, int segment
    ) noexcept nogil:
        cdef size_t after = places.count - segment - 1
        cdef Turned whole = places.turned[segment]
        memmove(&places.turned[segment + 2], &places.turned[segment + 1], after * sizeof(Turned))
        memmove(&places.begins[segment + 2], &places.begins[segment + 1], (after + 1) * sizeof(double))
        places.begins[segment + 1] = 0.5 * (places.begins[segment] + places.begins[segment + 2])
        places.count += 1
        self._look_at(problem, elbow, places, segment, &whole)
        self._look_at(problem, elbow, places, segment + 1, &whole)

    cdef double _least_cost(
        self, const Problem* problem, const Elbow* elbow, const Turned* turned, int without, double slack
    ) noexcept nogil:
        """The squared distance of the nearest branch to the seed, without the shoulder (1) or the wrist (2).
        The distance of either is first reduced by `slack`.
        """
        cdef double cost = self._elbow_cost(problem, elbow)
        cdef double part
        if not feasible(turned):
            return 1e300
        if not without & 1:
            part = self._triple_cost(problem, 0, turned.shoulder_fits, turned.shoulder[0], turned.shoulder[1])
            cost += max(part - slack, 0.0) ** 2
        if not without & 2:
            part = self._triple_cost(problem, 4, turned.wrist_fits, turned.wrist[0], turned.wrist[1])
            cost += max(part - slack, 0.0) ** 2
        return cost

    cdef double _triple_cost(
        self, const Problem* problem, int joint, const bint* fits, const double* one, const double* other
    ) noexcept nogil:
        """The distance to the seed, rad, of the nearer one of the two solutions within the limits."""
        cdef double least = 1e300
        cdef double sum, off
        cdef const double* angles
        cdef int i, k
        for i in range(2):
            if not fits[i]:
                continue
            angles, sum = other if i else one, 0.0
            for k in range(3):
                off = angles[k] + self.c_rest[joint + k] - problem.seed[joint + k]
                sum += off * off
            least = min(least, sum)
        return sqrt(least)

    # The best arm angles.

    cdef int c_closed_form(self, const Problem* problem, Candidate* found) noexcept nogil:
        cdef Problem exact = problem[0]
        cdef Elbow elbow
        cdef double far[2]
        cdef int count, i, first, attempt
        cdef int kind = MINIMA if problem.criterion == NEAREST and not problem.every else BEST
        cdef bint near
        for i in range(2):
            far[i] = self._elbow_cost(problem, &elbow) if self._elbow(problem, i, &elbow) else 1e300
        # The elbow that is nearer to the seed comes first: it may show that the other one is too far.
        first = 1 if far[1] < far[0] else 0
        for attempt in range(2):
            exact.slack = problem.slack if attempt else 2.0 * SLACK
            count = self._candidates(&exact, first, kind, found, 0)
            near = False
            for i in range(count):
                near = near or found[i].cost < far[1 - first]
            if problem.every or problem.criterion != NEAREST or not near:
                count = self._candidates(&exact, 1 - first, kind, found, count)
            if count > 0:
                break
        return count

    cdef double _elbow_cost(self, const Problem* problem, const Elbow* elbow) noexcept nogil:
        """A lower bound of the cost with this elbow, if the nearest joints are requested."""
        cdef double off = elbow.angle + self.c_rest[3] - problem.seed[3]
        return off * off

    cdef int _candidates(
        self, const Problem* problem, bint minus, int kind, Candidate* found, int count
    ) noexcept nogil:
        """Append approximate best arm angles in each feasible interval of each branch, for one of the two
        elbows.
        """
        cdef double best = 1e300
        cdef Places places
        cdef Elbow elbow
        cdef int branch
        if not self._elbow(problem, minus, &elbow):
            return count
        self._look(problem, &elbow, &places)
        if kind == MINIMA:
            for branch in range(count):
                best = min(best, found[branch].cost)
            self._divide(problem, &elbow, best, &places)
        for branch in range(8):
            if (branch & ELBOW != 0) == minus:
                count = self._runs(problem, &elbow, &places, branch, kind, found, count)
        return count

    cdef int _runs(
        self, const Problem* problem, const Elbow* elbow, const Places* places, int branch, int kind,
        Candidate* found, int count
    ) noexcept nogil:
        """Find the intervals of a branch: consecutive feasible segments, across ±π too, are one interval."""
        cdef int segments = places.count
        cdef int first = 0
        cdef int k, length
        # Begin where nothing is feasible, so that no interval is cut in two.
        while first < segments and fits(&places.turned[first], branch):
            first += 1
        k = 0
        while k < segments and count < MAX_CANDIDATES:
            length = 0
            while k + length < segments and fits(&places.turned[(first + k + length) % segments], branch):
                length += 1
            if length > 0:
                count = self._run(problem, elbow, places, branch, kind, first + k, length, found, count)
            k += length + 1
        return count

    cdef int _run(
        self, const Problem* problem, const Elbow* elbow, const Places* places, int branch, int kind,
        int first, int length, Candidate* found, int count
    ) noexcept nogil:
        """Append the candidates of one interval, which consists of `length` segments from `first` on."""
        cdef double joints[MAX_SEGMENTS][7]
        cdef double cost[MAX_SEGMENTS]
        cdef int i, best = 0
        for i in range(length):
            self._assemble(elbow, &places.turned[(first + i) % places.count], branch, joints[i])
            cost[i] = self.c_cost(problem, joints[i])
            best = i if cost[i] < cost[best] else best
        for i in range(length):
            if count == MAX_CANDIDATES:
                break
            if kind == MINIMA:
                if (i > 0 and cost[i - 1] < cost[i]) or (i + 1 < length and cost[i + 1] < cost[i]):
                    continue
            elif i != best:
                continue
            found[count].branch, found[count].refined = branch, False
            found[count].cost, found[count].angle = cost[i], middle(places, first + i)
            memcpy(found[count].joints, joints[i], sizeof(joints[i]))
            found[count].begin, found[count].end = begin_of(places, first), begin_of(places, first + length)
            if kind != WHOLE and i > 0:
                found[count].begin = middle(places, first + i - 1)
            if kind != WHOLE and i + 1 < length:
                found[count].end = middle(places, first + i + 1)
            found[count].bound = bound_of(cost[i], joints[0], i, length)
            count += 1
        return count

    cdef void c_refine(self, const Problem* problem, Candidate* candidate) noexcept nogil:
        """Find the lowest cost within the candidate's bracket, by parabolas and golden sections (Brent,
        "Algorithms for minimization without derivatives", 1973, chapter 5).
        """
        cdef Problem exact = problem[0]
        cdef double joints[7]
        cdef double begin = candidate.begin
        cdef double end = candidate.end
        cdef double tolerance = max(REFINED_TO * (end - begin), MIN_TOLERANCE)
        cdef double x[3]     # the best arm angle so far, the second best, and the previous second best
        cdef double cost[3]
        cdef double step = 0.0
        cdef double before = 0.0
        cdef double angle, value
        cdef Elbow elbow
        cdef int i, _step
        candidate.refined = True
        exact.slack = max(problem.slack, 2.0 * SLACK)
        if not self._elbow(&exact, candidate.branch & ELBOW, &elbow):
            return
        for i in range(3):
            x[i], cost[i] = candidate.angle, candidate.cost
        for i in range(2):  # the end, which may be the best because nothing is feasible beyond it
            self._try(&exact, &elbow, end if i else begin, candidate, joints)
        for _step in range(REFINEMENTS):
            if fabs(x[0] - 0.5 * (begin + end)) + 0.5 * (end - begin) <= 2.0 * tolerance or (
                x[2] != x[0] and x[1] != x[2] and cost[2] - cost[0] <= SAME_COST * cost[0]
            ):
                break
            if not parabola(x, cost, begin, end, tolerance, &step, &before):
                before = end - x[0] if x[0] < 0.5 * (begin + end) else begin - x[0]
                step = (1.0 - GOLDEN) * before
            if fabs(step) < tolerance:
                step = tolerance if step > 0.0 else -tolerance
            angle = x[0] + step
            value = self._try(&exact, &elbow, angle, candidate, joints)
            if value <= cost[0]:
                begin, end = (begin, x[0]) if step < 0.0 else (x[0], end)
                x[2], x[1], x[0] = x[1], x[0], angle
                cost[2], cost[1], cost[0] = cost[1], cost[0], value
                continue
            begin, end = (angle, end) if step < 0.0 else (begin, angle)
            if value <= cost[1] or x[1] == x[0]:
                x[2], x[1] = x[1], angle
                cost[2], cost[1] = cost[1], value
            elif value <= cost[2] or x[2] == x[0] or x[2] == x[1]:
                x[2], cost[2] = angle, value

    cdef double _try(
        self, const Problem* problem, const Elbow* elbow, double angle, Candidate* candidate, double* joints
    ) noexcept nogil:
        """The cost at an arm angle. If it is lower, it becomes that of the candidate."""
        cdef double cost = self._cost_at(problem, elbow, angle, candidate.branch, joints)
        if isnan(cost):
            return 1e300
        if cost < candidate.cost:
            candidate.cost, candidate.angle = cost, angle
            memcpy(candidate.joints, joints, 7 * sizeof(double))
        return cost

    cdef double c_gap(self, const Problem* problem) noexcept nogil:
        """The distance of the wrist centre from the range that the elbow can reach within its limits."""
        cdef double direction[3]
        self._to_wrist(problem, direction)
        return hinge_gap(
            &self.elbow, length3(direction), self.c_least[3], self.c_most[3], problem.near[3]
        )

    # For Python.

    def joints(self, pose, double angle, int branch):
        """Joints (7,), rad, at an arm angle (rad) of a branch; None if there are none within the limits."""
        self.refresh()
        self._given[:7] = pose
        if not self.c_joints(self.c_given, angle, checked(branch), self.c_found):
            return None
        return self._found.copy()

    def of(self, joints):
        """The arm angle (rad, from -π to π) and the branch of joints, shape (7,)."""
        self._found[...] = joints
        cdef double turns[3][9]
        cdef double rotation[9]
        cdef double back[9]
        cdef double front[9]
        cdef double direction[3]
        cdef double theta[7]
        cdef int i
        for i in range(7):
            theta[i] = self.c_found[i] - self.c_rest[i]
        turn_about(self.shoulder.first, theta[0], turns[0])
        turn_about(self.shoulder.second, theta[1], turns[1])
        turn_about(self.shoulder.third, theta[2], turns[2])
        product(turns[1], turns[2], back)
        product(turns[0], back, rotation)
        if not self._upper_frame(theta[3], back):
            raise InputError("the wrist is in the shoulder: there is no arm angle")
        product(rotation, back, turns[0])
        for i in range(3):
            direction[i] = turns[0][3 * i + 2]
        self._frame(direction, front)
        transposed_product(front, turns[0], turns[1])
        return atan2(turns[1][3], turns[1][0]), (
            (SHOULDER if sin(theta[1] - self.shoulder.rest) < 0.0 else 0)
            + (ELBOW if sin(theta[3] - self.elbow.folded) < 0.0 else 0)
            + (WRIST if sin(theta[5] - self.wrist.rest) < 0.0 else 0)
        )

    def intervals(self, pose, int branch):
        """The feasible arm angles within the joint limits: rows of begin and end, rad, shape (n, 2).

        The begins are from -π to π, the ends up to a full turn later.
        """
        cdef Problem problem
        cdef Candidate found[MAX_CANDIDATES]
        cdef int count, i
        self.refresh()
        self._given[:7] = pose
        self.c_state(self.c_given, NULL, LIMITS, &problem)
        problem.slack = 2.0 * SLACK
        count = self._candidates(&problem, (checked(branch) & ELBOW) != 0, WHOLE, found, 0)
        rows = [
            (wrapped(found[i].begin, 0.0), wrapped(found[i].begin, 0.0) + found[i].end - found[i].begin)
            for i in range(count)
            if found[i].branch == branch
        ]
        return np.array(sorted(rows), dtype=np.float64).reshape(-1, 2)

    def grid(self, poses, angles, only=range(8)):
        """Joints, shape (n, m, k, 7), for poses (n, 7) at arm angles (m,) in the k branches of `only`; NaN if
        there are none within the limits.
        """
        rows = np.array(poses, dtype=np.float64).reshape(-1, 7)
        columns = np.array(angles, dtype=np.float64).reshape(-1)
        branches = np.array([checked(branch) for branch in only], dtype=np.float64)
        out = np.full((len(rows), len(columns), len(branches), 7), np.nan)
        if out.size == 0:
            return out
        self.refresh()
        cdef Py_ssize_t n = len(rows), m = len(columns)
        cdef int count = len(branches)
        cdef double* pose = doubles(rows, 7 * n)
        cdef double* angle = doubles(columns, m)
        cdef double* joints = doubles(out, n * m * count * 7)
        cdef double* wanted = doubles(branches, count)
        with nogil:
            self._grid(pose, n, angle, m, wanted, count, joints)
        return out

    cdef void _grid(
        self, const double* poses, Py_ssize_t n, const double* angles, Py_ssize_t m, const double* only,
        int count, double* out
    ) noexcept nogil:
        """`only` has the `count` branches, which are the columns of `out`."""
        cdef Problem problem
        cdef Elbow elbow
        cdef double* joints
        cdef double* first
        cdef Py_ssize_t row, column
        cdef int branch, index
        for row in range(n):
            self.c_state(poses + 7 * row, NULL, LIMITS, &problem)
            problem.slack = 2.0 * SLACK
            for index in range(count):
                branch = <int>only[index]
                if not self._elbow(&problem, (branch & ELBOW) != 0, &elbow):
                    continue
                first = out + (row * m * count + index) * 7
                self._fill(&problem, &elbow, angles, m, branch, NULL, first, count)
                for column in range(m):
                    joints = first + column * count * 7
                    if not isnan(joints[0]) and not self.c_verify(&problem, joints):
                        set_nan(joints)

    def leading_on(self, poses, angles, start, int branch, int window, double step_rad):
        """The joints of `grid` in one branch, shape (n, m, 7), that can be reached from `start`, shape (7,);
        NaN elsewhere. They are the solutions of the closed form, without the descent that makes them exact.

        No joint turns further than `step_rad` from pose to pose, and from the second pose on the index of the
        arm angle changes by at most `window`; the last angle is next to the first.
        """
        rows = np.array(poses, dtype=np.float64).reshape(-1, 7)
        columns = np.array(angles, dtype=np.float64).reshape(-1)
        begin = np.array(start, dtype=np.float64)
        out = np.full((len(rows), len(columns), 7), np.nan)
        if out.size == 0:
            return out
        self.refresh()
        cdef Py_ssize_t n = len(rows), m = len(columns)
        cdef double* pose = doubles(rows, 7 * n)
        cdef double* angle = doubles(columns, m)
        cdef double* joints = doubles(out, n * m * 7)
        cdef double* first = doubles(begin, 7)
        flags = np.ones(m, dtype=np.uint8)
        cdef char* near = bytes_of(flags, m)
        checked(branch)
        window = min(max(window, 0), m // 2)
        with nogil:
            self._lead_on(pose, n, angle, m, first, branch, window, step_rad, near, joints)
        return out

    cdef void _lead_on(
        self, const double* poses, Py_ssize_t n, const double* angles, Py_ssize_t m, const double* start,
        int branch, int window, double step_rad, char* near, double* out
    ) noexcept nogil:
        """`near` contains, for each arm angle, whether the row before has joints within the window."""
        cdef Problem problem
        cdef Elbow elbow
        cdef double* joints
        cdef Py_ssize_t row, column
        cdef bint any
        for row in range(n):
            self.c_state(poses + 7 * row, NULL, LIMITS, &problem)
            problem.slack = 2.0 * SLACK
            if not self._elbow(&problem, (branch & ELBOW) != 0, &elbow):
                return
            if row > 0:
                mark_near(out + (row - 1) * m * 7, m, window, near)
            self._fill(&problem, &elbow, angles, m, branch, near, out + row * m * 7, 1)
            any = False
            for column in range(m):
                joints = out + (row * m + column) * 7
                if isnan(joints[0]):
                    continue
                if is_step(start, joints, step_rad) if row == 0 else has_step(
                    out + (row - 1) * m * 7, m, column, window, joints, step_rad
                ):
                    any = True
                else:
                    set_nan(joints)
            if not any:
                return

    cdef void _fill(
        self, const Problem* problem, const Elbow* elbow, const double* angles, Py_ssize_t m, int branch,
        const char* near, double* out, int every
    ) noexcept nogil:
        """Set the joints of one pose and branch at the arm angles that are feasible and `near` (NULL: all),
        each `every` times seven numbers after the one before.
        """
        cdef Turned turned
        cdef double breaks[MAX_BREAKS + 1]
        cdef int count = self._breaks(elbow, breaks)  # between two of them all angles are feasible, or none
        cdef int segment = 0, known = -1
        cdef bint feasible = False
        cdef double angle, begin = -0.5 * TURN
        cdef Py_ssize_t column
        breaks[count] = 0.5 * TURN
        for column in range(m):
            if near != NULL and not near[column]:
                continue
            angle = wrapped(angles[column], 0.0)
            if angle < begin:
                segment, begin = 0, -0.5 * TURN
            while segment < count and breaks[segment] <= angle:
                segment, begin = segment + 1, breaks[segment]
            if segment != known:
                self._turn(problem, elbow, 0.5 * (begin + breaks[segment]), &turned)
                known, feasible = segment, fits(&turned, branch)
            if not feasible and begin + AT_BREAK < angle < breaks[segment] - AT_BREAK:
                continue
            self._turn(problem, elbow, angles[column], &turned)
            if fits(&turned, branch):
                self._assemble(elbow, &turned, branch, out + column * every * 7)


cdef inline void set_nan(double* joints) noexcept nogil:
    cdef int joint
    for joint in range(7):
        joints[joint] = NAN


cdef inline bint is_step(const double* begin, const double* end, double step_rad) noexcept nogil:
    """Whether no joint turns further than `step_rad`; not if the joints at the beginning are NaN."""
    cdef int joint
    for joint in range(7):
        if not fabs(end[joint] - begin[joint]) <= step_rad:
            return False
    return True


cdef void mark_near(const double* row, Py_ssize_t m, int window, char* near) noexcept nogil:
    """Mark the columns with joints within `window` columns of a row."""
    cdef Py_ssize_t i, ahead = m, behind = m
    for i in range(m):
        near[i] = 0
    for i in range(2 * m):
        ahead = ahead + 1 if isnan(row[7 * (i % m)]) else 0
        behind = behind + 1 if isnan(row[7 * (m - 1 - i % m)]) else 0
        if ahead <= window:
            near[i % m] = 1
        if behind <= window:
            near[m - 1 - i % m] = 1


cdef bint has_step(
    const double* row, Py_ssize_t m, Py_ssize_t column, int window, const double* joints, double step_rad
) noexcept nogil:
    """Whether a row has joints within `window` columns from which a step leads to `joints`."""
    cdef int shift
    for shift in range(window + 1):
        if is_step(row + 7 * ((column + shift) % m), joints, step_rad) or is_step(
            row + 7 * ((column - shift + m) % m), joints, step_rad
        ):
            return True
    return False


cdef bint parabola(
    const double* x, const double* cost, double begin, double end, double tolerance, double* step,
    double* before
) noexcept nogil:
    """The step to the lowest point of the parabola through three points, if it is at most half of the last
    but one, and within the bracket.
    """
    cdef double one = (x[0] - x[1]) * (cost[0] - cost[2])
    cdef double two = (x[0] - x[2]) * (cost[0] - cost[1])
    cdef double over = (x[0] - x[2]) * two - (x[0] - x[1]) * one
    cdef double under = 2.0 * (two - one)
    cdef double last = before[0]
    if under > 0.0:
        over = -over
    under = fabs(under)
    if not fabs(last) > tolerance or not fabs(over) < fabs(0.5 * under * last) or not (
        under * (begin - x[0]) < over < under * (end - x[0])
    ):
        return False
    before[0], step[0] = step[0], over / under
    if x[0] + step[0] - begin < 2.0 * tolerance or end - x[0] - step[0] < 2.0 * tolerance:
        step[0] = tolerance if x[0] < 0.5 * (begin + end) else -tolerance
    return True


cdef inline bint feasible(const Turned* turned) noexcept nogil:
    """Whether some branch is within the limits."""
    return (turned.shoulder_fits[0] or turned.shoulder_fits[1]) and (
        turned.wrist_fits[0] or turned.wrist_fits[1]
    )


cdef inline bint fits(const Turned* turned, int branch) noexcept nogil:
    return turned.shoulder_fits[branch & SHOULDER] and turned.wrist_fits[1 if branch & WRIST else 0]


cdef inline double width(const Places* places, int segment) noexcept nogil:
    return places.begins[segment + 1] - places.begins[segment]


cdef inline double begin_of(const Places* places, int segment) noexcept nogil:
    """The beginning of a segment. Numbers beyond the last segment continue with a full turn added."""
    if segment < places.count:
        return places.begins[segment]
    return places.begins[segment - places.count] + TURN


cdef inline double middle(const Places* places, int segment) noexcept nogil:
    cdef int i = segment if segment < places.count else segment - places.count
    return 0.5 * (places.begins[i] + places.begins[i + 1]) + (TURN if segment > i else 0.0)


cdef inline int racing(const Turned* one, const Turned* other) noexcept nogil:
    """Whether a joint of the shoulder (1) or the wrist (2) turns far from one segment to the next."""
    cdef int part = 0
    cdef int i, k
    if not (feasible(one) and feasible(other)):
        return 0
    for i in range(2):
        for k in range(3):
            if one.shoulder_fits[i] and other.shoulder_fits[i] and (
                fabs(wrapped(one.shoulder[i][k] - other.shoulder[i][k], 0.0)) > MAX_TURN
            ):
                part |= 1
            if one.wrist_fits[i] and other.wrist_fits[i] and (
                fabs(wrapped(one.wrist[i][k] - other.wrist[i][k], 0.0)) > MAX_TURN
            ):
                part |= 2
    return part


cdef double bound_of(double cost, const double* joints, int i, int length) noexcept nogil:
    """A lower bound of the cost between the neighbours of a segment. A neighbour to which joints turn far
    is ignored: it is too far from the seed, or the segment would have been divided.
    """
    cdef double farthest = 0.0
    cdef double sum, off, largest
    cdef int side, k
    for side in range(-1, 2, 2):
        if not 0 <= i + side < length:
            continue
        sum = largest = 0.0
        for k in range(7):
            off = fabs(wrapped(joints[7 * (i + side) + k] - joints[7 * i + k], 0.0))
            sum, largest = sum + off * off, max(largest, off)
        if largest <= MAX_TURN:
            farthest = max(farthest, sqrt(sum))
    return max(sqrt(cost) - ARC * farthest, 0.0) ** 2


cdef int checked(int branch) except -1:
    if not 0 <= branch < 8:
        raise InputError(f"the branch is a number from 0 to 7, not {branch}")
    return branch


cdef int roots_of(
    const double* l, const double* m, const double* left, const double* right, double sense, double value,
    double* out
) noexcept nogil:
    """The arm angles at which lᵀ R m has a value; for R see `_breaks_of`."""
    cdef double p[3]
    cdef double r[3]
    transposed_times(left, l, p)
    if sense > 0.0:
        transposed_times(right, m, r)
    else:
        times(right, m, r)
    return trigonometric_roots(
        p[0] * r[0] + p[1] * r[1], sense * (p[1] * r[0] - p[0] * r[1]), value - p[2] * r[2], 1e-14, out
    )
