"""Inverse kinematics of arms with a shoulder and a wrist of three axes each through one point, and an elbow
between (S-R-S), in closed form over the arm angle.

The elbow's angle follows from the distance of the wrist centre from the shoulder's; the arm may then turn
about the line through both, by the arm angle, and the shoulder and the wrist have two solutions each (Shimizu
et al. 2008, doi 10.1109/TRO.2008.2003266, for axes of any direction here). The joints reach a limit where a
linear equation of the arm angle's cosine and sine holds, so the feasible arm angles are known exactly.

The arm angle is 0 where the elbow's axis is that of a frame which is carried from the first joint's axis to
the direction of the wrist on the shortest way. Only a wrist straight behind the shoulder has no such way
(compare Elias and Wen 2024, doi 10.1016/j.mechmachtheory.2024.105766); against the vertical plane, as Shimizu
has it, the place straight above would be another one. The angle stays smooth through a straight elbow.

Longer than other modules: one concept, and its parts share the frames.
"""

from libc.math cimport NAN, atan2, cos, isnan, sin, sqrt
from libc.string cimport memcpy

import numpy as np

from cobot.arrays cimport doubles
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
    /* By which limits are passed to find an arm angle that is the only one; and the longest step, rad, in
       which the best arm angle is looked for at first. */
    static const double COBOT_SRS_SLACK = 1e-9, COBOT_SRS_STEP = 0.35;
    static const double COBOT_GOLDEN = 0.6180339887498949;
    """
    const double SLACK "COBOT_SRS_SLACK"
    const double LONGEST_STEP "COBOT_SRS_STEP"
    const double GOLDEN "COBOT_GOLDEN"

cdef enum:
    REFINEMENTS = 8
    SHOULDER = 1
    ELBOW = 2
    WRIST = 4


cdef class SrsArm(Arm):
    """Poses are arrays (7,), x, y, z (m) and w, x, y, z of the TCP in the base frame; joints (7,), rad.

    A branch is a number from 0 to 7, a sum: 1 for the other shoulder, 2 elbow, 4 wrist. It changes where the
    first and third axis, or the fifth and seventh, align, and where the elbow is straight or folded.
    """

    BRANCHES = 8

    def __init__(self, chain, limits, rest, root, double reach, double slop, axes, shoulder, wrist, elbow):
        """Axes, shape (7, 3), of the joints at rest, the two points in which three of them meet, and one on
        the fourth, m, in the base frame.

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
        """The pole is the first axis, in the sense that leads away from the base's origin."""
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

    @property
    def arm_angle(self):
        """Itself: the one that has an arm angle."""
        return self

    # The geometry of one elbow angle.

    cdef bint _elbow(self, const Problem* problem, bint minus, Elbow* out) noexcept nogil:
        """What does not depend on the arm angle; False if the elbow cannot bend so."""
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
        """From the shoulder to the wrist of a pose."""
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
        if c < -1.0 + 1e-12:  # straight behind: no way is the shortest, this is one of them
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
        """Columns x, y, z in the upper arm at rest: z from shoulder to wrist, y by the elbow's axis."""
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
        return self.c_verified(&problem, joints)

    cdef double _cost_at(
        self, const Problem* problem, const Elbow* elbow, double angle, int branch, double* joints
    ) noexcept nogil:
        """NaN if there are no joints within the limits."""
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
        """Where one of three joints may pass a limit: lᵀ R m is then what the other axes' angles make it.

        The rotation is R = left Z(angle) rightᵀ of the shoulder (`sense` 1), left Z(-angle) right of the
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

    cdef int _segments(self, const Elbow* elbow, double* out) noexcept nogil:
        """Points from -π to π, ascending: all at which a joint may pass a limit, and some between them; the
        number of stretches between them.
        """
        cdef double breaks[MAX_BREAKS + 1]
        cdef int count = self._breaks(elbow, breaks)
        cdef int segments = 0
        cdef int i, k, parts
        cdef double begin = -0.5 * TURN
        breaks[count] = 0.5 * TURN
        for i in range(count + 1):
            if breaks[i] - begin < 1e-13:
                continue
            parts = <int>((breaks[i] - begin) / LONGEST_STEP) + 1
            for k in range(parts):
                out[segments] = begin + (breaks[i] - begin) * k / parts
                segments += 1
            begin = breaks[i]
        out[segments] = 0.5 * TURN
        return segments

    # The best arm angles.

    cdef int c_closed_form(self, const Problem* problem, Candidate* found) noexcept nogil:
        cdef Problem exact = problem[0]
        cdef Elbow elbow
        cdef double far[2]
        cdef int count, i, first, attempt
        cdef bint near
        for i in range(2):
            far[i] = self._elbow_cost(problem, &elbow) if self._elbow(problem, i, &elbow) else 1e300
        # The elbow that is nearer to the seed comes first: it may show that the other one is too far.
        first = 1 if far[1] < far[0] else 0
        for attempt in range(2):
            exact.slack = problem.slack if attempt else 2.0 * SLACK
            count = self._candidates(&exact, first, found, 0)
            near = False
            for i in range(count):
                near = near or found[i].cost < far[1 - first]
            if problem.every or problem.criterion != NEAREST or not near:
                count = self._candidates(&exact, 1 - first, found, count)
            if count > 0:
                break
        return count

    cdef double _elbow_cost(self, const Problem* problem, const Elbow* elbow) noexcept nogil:
        """What this elbow costs at least, where the nearest joints are asked for."""
        cdef double off = elbow.angle + self.c_rest[3] - problem.seed[3]
        return off * off

    cdef int _candidates(
        self, const Problem* problem, bint minus, Candidate* found, int count
    ) noexcept nogil:
        """Of one elbow: the best arm angle of each feasible interval of each branch, roughly."""
        cdef double points[MAX_SEGMENTS + 1]
        cdef Turned turned[MAX_SEGMENTS]
        cdef Elbow elbow
        cdef int segments, i, branch
        if not self._elbow(problem, minus, &elbow):
            return count
        segments = self._segments(&elbow, points)
        for i in range(segments):
            self._turn(problem, &elbow, 0.5 * (points[i] + points[i + 1]), &turned[i])
        for branch in range(8):
            if (branch & ELBOW != 0) == minus:
                count = self._runs(problem, &elbow, points, turned, segments, branch, found, count)
        return count

    cdef int _runs(
        self, const Problem* problem, const Elbow* elbow, const double* points, const Turned* turned,
        int segments, int branch, Candidate* found, int count
    ) noexcept nogil:
        """Feasible segments that follow each other, once round, are one interval."""
        cdef int shoulder = branch & SHOULDER
        cdef int wrist = 1 if branch & WRIST else 0
        cdef int first = 0
        cdef int i, k
        cdef bint open = False
        cdef double turn, cost
        cdef double joints[7]
        # Begin where nothing is feasible, so that no interval is cut in two.
        while first < segments and turned[first].shoulder_fits[shoulder] and turned[first].wrist_fits[wrist]:
            first += 1
        for k in range(segments):
            i, turn = first + k, 0.0
            if i >= segments:
                i, turn = i - segments, TURN
            if not (turned[i].shoulder_fits[shoulder] and turned[i].wrist_fits[wrist]):
                open = False
                continue
            if not open:
                if count == MAX_CANDIDATES:
                    return count
                open, count = True, count + 1
                found[count - 1].branch, found[count - 1].refined = branch, False
                found[count - 1].begin, found[count - 1].cost = points[i] + turn, 1e300
            found[count - 1].end = points[i + 1] + turn
            self._assemble(elbow, &turned[i], branch, joints)
            cost = self.c_cost(problem, joints)
            if cost < found[count - 1].cost:
                found[count - 1].cost = cost
                found[count - 1].angle = 0.5 * (points[i] + points[i + 1]) + turn
                memcpy(found[count - 1].joints, joints, sizeof(joints))
        return count

    cdef void c_refine(self, const Problem* problem, Candidate* candidate) noexcept nogil:
        """Golden sections around the best arm angle that is known, then parabolas."""
        cdef Problem exact = problem[0]
        cdef double joints[7]
        cdef double inner[2]
        cdef double cost[2]
        cdef double begin = max(candidate.begin, candidate.angle - LONGEST_STEP)
        cdef double end = min(candidate.end, candidate.angle + LONGEST_STEP)
        cdef double width
        cdef Elbow elbow
        cdef int i, _i, _step, lower
        candidate.refined = True
        exact.slack = max(problem.slack, 2.0 * SLACK)
        if not self._elbow(&exact, candidate.branch & ELBOW, &elbow):
            return
        for i in range(2):
            inner[i] = begin + (end - begin) * (GOLDEN if i else 1.0 - GOLDEN)
            cost[i] = self._try(&exact, &elbow, inner[i], candidate, joints)
        for _step in range(REFINEMENTS):
            lower = 0 if cost[0] < cost[1] else 1
            if lower == 0:
                end, inner[1], cost[1] = inner[1], inner[0], cost[0]
                inner[0] = begin + (end - begin) * (1.0 - GOLDEN)
            else:
                begin, inner[0], cost[0] = inner[0], inner[1], cost[1]
                inner[1] = begin + (end - begin) * GOLDEN
            cost[lower] = self._try(&exact, &elbow, inner[lower], candidate, joints)
        width = end - begin
        for i in range(2):  # which may be the best because they are the last
            self._try(&exact, &elbow, candidate.end if i else candidate.begin, candidate, joints)
        for _i in range(3):
            self._parabola(&exact, &elbow, candidate, width)
            width *= 0.05

    cdef double _try(
        self, const Problem* problem, const Elbow* elbow, double angle, Candidate* candidate, double* joints
    ) noexcept nogil:
        """The cost at an arm angle, which becomes the candidate's if it is less."""
        cdef double cost = self._cost_at(problem, elbow, angle, candidate.branch, joints)
        if isnan(cost):
            return 1e300
        if cost < candidate.cost:
            candidate.cost, candidate.angle = cost, angle
            memcpy(candidate.joints, joints, 7 * sizeof(double))
        return cost

    cdef void _parabola(
        self, const Problem* problem, const Elbow* elbow, Candidate* candidate, double width
    ) noexcept nogil:
        """The lowest point of a parabola through the best arm angle and two beside it."""
        cdef double joints[7]
        cdef double angle = candidate.angle
        cdef double middle = candidate.cost
        cdef double before = self._try(problem, elbow, angle - width, candidate, joints)
        cdef double after = self._try(problem, elbow, angle + width, candidate, joints)
        cdef double bend = before - 2.0 * middle + after
        if bend > 0.0 and before < 1e300 and after < 1e300:
            self._try(problem, elbow, angle + 0.5 * width * (before - after) / bend, candidate, joints)

    cdef double c_gap(self, const Problem* problem) noexcept nogil:
        """How far the wrist centre is beyond, or short of, what the elbow reaches within its limits."""
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

        Begins are from -π to π, ends at the most a full turn later.
        """
        cdef Problem problem
        cdef Candidate found[MAX_CANDIDATES]
        cdef int count, i
        self.refresh()
        self._given[:7] = pose
        self.c_state(self.c_given, NULL, LIMITS, &problem)
        problem.slack = 2.0 * SLACK
        count = self._candidates(&problem, (checked(branch) & ELBOW) != 0, found, 0)
        rows = [
            (wrapped(found[i].begin, 0.0), wrapped(found[i].begin, 0.0) + found[i].end - found[i].begin)
            for i in range(count)
            if found[i].branch == branch
        ]
        return np.array(sorted(rows), dtype=np.float64).reshape(-1, 2)

    def grid(self, poses, angles, only=range(8)):
        """Joints, shape (n, m, 8, 7), of poses (n, 7) at arm angles (m,) in all branches, or `only` some; NaN
        where there are none within the limits.
        """
        rows = np.array(poses, dtype=np.float64).reshape(-1, 7)
        columns = np.array(angles, dtype=np.float64).reshape(-1)
        out = np.full((len(rows), len(columns), 8, 7), np.nan)
        if out.size == 0:
            return out
        self.refresh()
        cdef Py_ssize_t n = len(rows), m = len(columns)
        cdef double* pose = doubles(rows, 7 * n)
        cdef double* angle = doubles(columns, m)
        cdef double* joints = doubles(out, n * m * 56)
        cdef int wanted = 0
        for branch in only:
            wanted |= 1 << checked(branch)
        with nogil:
            self._grid(pose, n, angle, m, wanted, joints)
        return out

    cdef void _grid(
        self, const double* poses, Py_ssize_t n, const double* angles, Py_ssize_t m, int wanted, double* out
    ) noexcept nogil:
        """`wanted` has a bit for each branch."""
        cdef Problem problem
        cdef Elbow elbow
        cdef Turned turned
        cdef double joints[7]
        cdef Py_ssize_t row, column
        cdef int branch, minus
        for row in range(n):
            self.c_state(poses + 7 * row, NULL, LIMITS, &problem)
            problem.slack = 2.0 * SLACK
            for minus in range(2):
                if not wanted & (0xCC if minus else 0x33) or not self._elbow(&problem, minus, &elbow):
                    continue
                for column in range(m):
                    self._turn(&problem, &elbow, angles[column], &turned)
                    for branch in range(8):
                        if not wanted >> branch & 1 or (1 if branch & ELBOW else 0) != minus or not (
                            turned.shoulder_fits[branch & SHOULDER]
                            and turned.wrist_fits[1 if branch & WRIST else 0]
                        ):
                            continue
                        self._assemble(&elbow, &turned, branch, joints)
                        if self.c_verified(&problem, joints):
                            memcpy(out + ((row * m + column) * 8 + branch) * 7, joints, sizeof(joints))


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
