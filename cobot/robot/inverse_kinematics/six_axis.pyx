"""Inverse kinematics of six-axis arms in closed form: those with a spherical wrist, or three parallel axes.

With a wrist of three axes through one point, the first three joints move that point to its place, and the
wrist turns the hand (Pieper 1968). There are three kinds of the first three axes: the second and third axis
are parallel, as in most arms; the first two axes meet; or the first two axes are parallel. With three
parallel axes in the middle, as in the arms of Universal Robots, the last two axes must meet: the distance of
that point from the plane of the arm gives the first joint (Hawkins 2013), the last two and the sum of the
middle three turn the hand, and a triangle is left. Apart from this, all axes may have any direction.

Longer than other modules, because four kinds of arms share their parts.
"""

from libc.math cimport fabs, sqrt
from libc.string cimport memcpy

from cobot.robot.inverse_kinematics.arm cimport Arm, Candidate, Problem
from cobot.robot.inverse_kinematics.triple cimport (
    ALIGNED,
    UNREACHABLE,
    Angles,
    settle_triple,
    solve_triple,
    triple_of,
)
from cobot.robot.inverse_kinematics.vectors cimport (
    angle_about,
    cross3,
    dot3,
    hinge_angle,
    hinge_gap,
    length3,
    minus3,
    plus3,
    set_hinge,
    settled,
    times,
    transposed_product,
    trigonometric_roots,
    turn_about,
    turned_by,
)

from cobot.errors import InputError

cdef extern from *:
    """
    static const double COBOT_WIDER_SLOP = 1e-8;
    """
    const double WIDER_SLOP "COBOT_WIDER_SLOP"

cdef enum:
    IN_A_PLANE = 0
    CROSSING = 1
    STACKED = 2
    PARALLEL = 3
    # Number of angles tried for a joint whose angle is free, besides the one nearest to the seed.
    TRIED = 24
    OTHER_SHOULDER = 1
    OTHER_ELBOW = 2
    OTHER_WRIST = 4

KINDS = {
    "second and third axis parallel": IN_A_PLANE,
    "first and second axis meet": CROSSING,
    "first and second axis parallel": STACKED,
    "three parallel axes": PARALLEL,
}


cdef int turns_to_height(
    const double* up, const double* axis, const double* arm, const double* goal, double slop, double* angles
) noexcept nogil:
    """Up to two angles about an axis that move an arm as far along `up` as the goal is."""
    cdef double aside[3]
    cdef double kept = dot3(up, axis) * dot3(axis, arm)
    cross3(axis, arm, aside)
    return trigonometric_roots(dot3(up, arm) - kept, dot3(up, aside), dot3(up, goal) - kept, slop, angles)


cdef class SixAxisArm(Arm):
    """See `Arm`. A branch is a sum: 1 for the other shoulder, 2 for the other elbow, 4 for the other
    wrist."""

    def __init__(self, chain, limits, rest, root, double reach, double slop, axes, points, wrist, str kind):
        """Axes at rest and a point on each, shape (6, 3), in the base frame, and the point where the last
        three axes meet. With three parallel axes it is the point where the last two axes meet.

        Raises:
            InputError: two axes that have to turn the hand are parallel.
        """
        Arm.__init__(self, chain, limits, rest, root, reach, slop)
        cdef int i, k
        cdef double before[3]
        cdef double after[3]
        self.kind = KINDS[kind]
        for i in range(3):
            self.wrist[i] = wrist[i]
            for k in range(6):
                self.axes[k][i], self.points[k][i] = axes[k][i], points[k][i]
        cdef int first = 1 if self.kind == PARALLEL else 3
        cdef int bent = 1 if self.kind == STACKED else 2
        if not triple_of(self.axes[first], self.axes[4], self.axes[5], &self.triple):
            raise InputError("two axes that have to turn the hand are parallel")
        # The hinge's points: where the arm stands (shoulder), and what it moves (wrist, or fourth axis).
        minus3(self.points[bent - 1], self.points[bent], before)
        minus3(&self.points[3][0] if self.kind == PARALLEL else &self.wrist[0], self.points[bent], after)
        set_hinge(self.axes[bent], before, after, &self.hinge)
        for i in range(2):
            self.sense[i] = 1.0 if dot3(self.axes[1], self.axes[2 + i]) > 0.0 else -1.0

    @property
    def closed_form(self):
        """Whether all solutions are known."""
        return True

    cdef int c_closed_form(self, const Problem* problem, Candidate* found) noexcept nogil:
        cdef Problem wider = problem[0]
        cdef int count = self._solutions(problem, found)
        if count == 0:
            # If the hand's axes almost align, rounding may have moved a stretched arm out of reach.
            wider.slop = max(problem.slop, WIDER_SLOP)
            count = self._solutions(&wider, found)
        return count

    cdef int _solutions(self, const Problem* problem, Candidate* found) noexcept nogil:
        cdef double wrist[3]
        self._wrist_of(problem, wrist)
        if self.kind == CROSSING:
            return self._crossing(problem, wrist, found)
        if self.kind == STACKED:
            return self._solve_stack(problem, wrist, found)
        if self.kind == PARALLEL:
            return self._parallel(problem, wrist, found)
        return self._in_a_plane(problem, wrist, found)

    # The required place of the wrist, and the effect of each joint on a point.

    cdef void _wrist_of(self, const Problem* problem, double* out) noexcept nogil:
        cdef double there[3]
        times(problem.moved, self.wrist, there)
        plus3(there, problem.shift, out)

    cdef void _about(self, int joint, double angle, const double* point, double* out) noexcept nogil:
        """A point, turned about the rest position of an axis."""
        cdef double arm[3]
        cdef double there[3]
        minus3(point, self.points[joint], arm)
        turned_by(self.axes[joint], angle, arm, there)
        plus3(there, self.points[joint], out)

    cdef double _across(self, int joint, const double* point) noexcept nogil:
        """The distance of a point from an axis at rest."""
        cdef double arm[3]
        cdef double out[3]
        minus3(point, self.points[joint], arm)
        cross3(self.axes[joint], arm, out)
        return length3(out)

    cdef int _base_angles(
        self, const Problem* problem, const double* wrist, double* angles, int* ways
    ) noexcept nogil:
        """Find the angles of the first joint at which the wrist is in the plane in which the next joints move
        it, and the number of each angle's branch, 0 or 1. If the wrist is on the first axis, every angle is
        valid, and a few of them are returned.
        """
        cdef double arm[3]
        cdef double aside[3]
        cdef double offset, across, along
        cdef int i
        minus3(self.wrist, self.points[0], arm)
        offset = dot3(self.axes[1], arm)
        minus3(wrist, self.points[0], arm)
        across = dot3(self.axes[0], self.axes[1])
        along = dot3(self.axes[0], arm)
        cross3(self.axes[0], self.axes[1], aside)
        ways[0], ways[1] = 0, 1
        if self._across(0, wrist) < 1e-10 and fabs(offset - across * along) < 1e-9:
            angles[0] = problem.near[0]
            for i in range(TRIED):
                angles[1 + i] = self.c_least[0] + (self.c_most[0] - self.c_least[0]) * i / (TRIED - 1)
            for i in range(TRIED + 1):
                ways[i] = 0
            return TRIED + 1
        return trigonometric_roots(
            dot3(self.axes[1], arm) - across * along,
            dot3(aside, arm),
            offset - across * along,
            problem.slop,
            angles,
        )

    # The kinds.

    cdef int _in_a_plane(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil:
        cdef double angles[TRIED + 1]
        cdef int ways[TRIED + 1]
        cdef double theta[2][6]
        cdef double there[3]
        cdef int count = 0
        cdef int i, k
        for i in range(self._base_angles(problem, wrist, angles, ways)):
            if not settled(&angles[i], self.c_least[0], self.c_most[0], problem.near[0], problem.slack):
                continue
            self._about(0, -angles[i], wrist, there)
            for k in range(self._planar(problem, angles[i], there, theta)):
                count = self._with_wrist(
                    problem, theta[k], ways[i] + (OTHER_ELBOW if k else 0), found, count
                )
        return count

    cdef int _planar(
        self, const Problem* problem, double first, const double* there, double theta[2][6]
    ) noexcept nogil:
        """The second and third joint, which move a point of the third link to a place in their plane."""
        cdef double elbow[3]
        cdef double arm[3]
        cdef double goal[3]
        cdef double bend
        cdef int i
        if not hinge_angle(&self.hinge, self._across(1, there), problem.slop, &bend):
            return 0
        for i in range(2):
            theta[i][0] = first
            theta[i][2] = self.hinge.folded + (-bend if i else bend)
            turned_by(self.axes[2], theta[i][2], self.hinge.after, arm)
            plus3(arm, self.points[2], elbow)
            minus3(elbow, self.points[1], arm)
            minus3(there, self.points[1], goal)
            theta[i][1] = angle_about(self.axes[1], arm, goal)
        return 2

    cdef int _crossing(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil:
        """Solve an arm whose first two axes meet in `points[1]`: the third joint sets the distance from that
        point."""
        cdef double theta[6]
        cdef double roots[2]
        cdef double there[3]
        cdef double arm[3]
        cdef double aside[3]
        cdef double goal[3]
        cdef double square, bend
        cdef int count = 0
        cdef int i, k
        minus3(wrist, self.points[1], goal)
        square = dot3(goal, goal) - self.hinge.offset * self.hinge.offset
        if square < -problem.slop or not hinge_angle(
            &self.hinge, sqrt(max(square, 0.0)), problem.slop, &bend
        ):
            return 0
        for i in range(2):
            theta[2] = self.hinge.folded + (-bend if i else bend)
            turned_by(self.axes[2], theta[2], self.hinge.after, there)
            minus3(there, self.hinge.before, arm)
            for k in range(turns_to_height(self.axes[0], self.axes[1], arm, goal, problem.slop, roots)):
                theta[1] = roots[k]
                turned_by(self.axes[1], theta[1], arm, there)
                cross3(self.axes[0], goal, aside)
                count = self._turn_to(
                    problem, theta, there, goal, length3(aside) < 1e-10, 2 * i + k, found, count
                )
        return count

    cdef int _turn_to(
        self, const Problem* problem, double* theta, const double* start, const double* goal, bint any_angle,
        int branch, Candidate* found, int count
    ) noexcept nogil:
        """Turn the first joint from one direction to another. If the directions are along its axis, some
        angles are tried."""
        cdef int i
        theta[0] = problem.near[0] if any_angle else angle_about(self.axes[0], start, goal)
        count = self._with_wrist(problem, theta, branch, found, count)
        for i in range(TRIED if any_angle else 0):
            theta[0] = self.c_least[0] + (self.c_most[0] - self.c_least[0]) * i / (TRIED - 1)
            count = self._with_wrist(problem, theta, branch, found, count)
        return count

    cdef int _solve_stack(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil:
        """Solve an arm whose first two axes are parallel: the third joint sets the height, a triangle the
        other two."""
        cdef double theta[6]
        cdef double roots[2]
        cdef double there[3]
        cdef double arm[3]
        cdef double aside[3]
        cdef double goal[3]
        cdef double bend
        cdef int count = 0
        cdef int i, k
        cdef Hinge hinge
        minus3(self.wrist, self.points[2], arm)
        minus3(wrist, self.points[2], goal)
        for i in range(turns_to_height(self.axes[0], self.axes[2], arm, goal, problem.slop, roots)):
            theta[2] = roots[i]
            self._about(2, theta[2], self.wrist, there)
            minus3(there, self.points[1], aside)
            set_hinge(self.axes[1], self.hinge.before, aside, &hinge)
            if not hinge_angle(&hinge, self._across(0, wrist), problem.slop, &bend):
                continue
            for k in range(2):
                theta[1] = hinge.folded + (-bend if k else bend)
                self._about(1, theta[1], there, arm)
                minus3(arm, self.points[0], aside)
                minus3(wrist, self.points[0], goal)
                count = self._turn_to(
                    problem, theta, aside, goal, self._across(0, wrist) < 1e-10, 2 * i + k, found, count
                )
            minus3(wrist, self.points[2], goal)
        return count

    cdef int _with_wrist(
        self, const Problem* problem, double* theta, int branch, Candidate* found, int count
    ) noexcept nogil:
        """Complete a candidate with known first three angles: the last three turn the hand."""
        cdef double turns[2][9]
        cdef double rotation[9]
        cdef Angles angles
        cdef int i
        memcpy(rotation, problem.moved, sizeof(rotation))
        for i in range(3):
            if not settled(&theta[i], self.c_least[i], self.c_most[i], problem.near[i], problem.slack):
                return count
            turn_about(self.axes[i], theta[i], turns[0])
            transposed_product(turns[0], rotation, turns[1])
            memcpy(rotation, turns[1], sizeof(rotation))
        solve_triple(&self.triple, rotation, &angles)
        for i in range(2):
            if settle_triple(
                &angles, i, &self.c_least[3], &self.c_most[3], &problem.near[3], problem.slack, &theta[3]
            ):
                count = self._offer(problem, theta, branch + (OTHER_WRIST if i else 0), found, count)
        return count

    cdef int _parallel(self, const Problem* problem, const double* wrist, Candidate* found) noexcept nogil:
        """Solve an arm with three parallel axes. The triple's first angle is the sum of their three turns."""
        cdef double angles[TRIED + 1]
        cdef int ways[TRIED + 1]
        cdef double turn[9]
        cdef double rotation[9]
        cdef double five[3]   # the first, fifth and sixth joint
        cdef const double* solution
        cdef Angles hand
        cdef int count = 0
        cdef int i, k, tried
        for i in range(self._base_angles(problem, wrist, angles, ways)):
            five[0] = angles[i]
            turn_about(self.axes[0], five[0], turn)
            transposed_product(turn, problem.moved, rotation)
            solve_triple(&self.triple, rotation, &hand)
            if hand.kind == UNREACHABLE:
                continue
            if hand.kind == ALIGNED:
                for tried in range(TRIED + 1):
                    five[1] = hand.plus[1]
                    five[2] = problem.near[5]
                    if tried < TRIED:
                        five[2] = self.c_least[5] + (self.c_most[5] - self.c_least[5]) * tried / (TRIED - 1)
                    count = self._with_plane(
                        problem, five, hand.sense * (hand.plus[2] - five[2]), ways[i], found, count
                    )
                continue
            for k in range(2):
                solution = &hand.minus[0] if k else &hand.plus[0]
                five[1], five[2] = solution[1], solution[2]
                count = self._with_plane(
                    problem, five, solution[0], ways[i] + (OTHER_WRIST if k else 0), found, count
                )
        return count

    cdef int _with_plane(
        self, const Problem* problem, const double* five, double turn, int branch, Candidate* found, int count
    ) noexcept nogil:
        """Solve the parallel axes: they move the fourth axis to its place, and together turn by `turn`."""
        cdef double theta[2][6]
        cdef double near[3]
        cdef double there[3]
        cdef int i, k
        cdef bint fits
        # Calculated back from the hand: the point through which the fourth axis must pass, in the plane.
        self._about_wrist(4, -five[1], self.points[3], near)
        self._about_wrist(5, -five[2], near, there)
        times(problem.moved, there, near)
        plus3(near, problem.shift, there)
        self._about(0, -five[0], there, near)
        for i in range(self._planar(problem, five[0], near, theta)):
            theta[i][4], theta[i][5] = five[1], five[2]
            theta[i][3] = self.sense[1] * (turn - theta[i][1] - self.sense[0] * theta[i][2])
            fits = True
            for k in range(6):
                fits = fits and settled(
                    &theta[i][k], self.c_least[k], self.c_most[k], problem.near[k], problem.slack
                )
            if fits:
                count = self._offer(problem, theta[i], branch + (OTHER_ELBOW if i else 0), found, count)
        return count

    cdef void _about_wrist(self, int joint, double angle, const double* point, double* out) noexcept nogil:
        cdef double arm[3]
        cdef double there[3]
        minus3(point, self.wrist, arm)
        turned_by(self.axes[joint], angle, arm, there)
        plus3(there, self.wrist, out)

    cdef int _offer(
        self, const Problem* problem, const double* theta, int branch, Candidate* found, int count
    ) noexcept nogil:
        """Keep a candidate, unless a better one of its branch is known."""
        cdef double joints[6]
        cdef double cost
        cdef int place = 0
        cdef int i
        for i in range(6):
            joints[i] = theta[i] + self.c_rest[i]
        cost = self.c_cost(problem, joints)
        while place < count and found[place].branch != branch:
            place += 1
        if place == count or cost < found[place].cost:
            found[place].cost, found[place].branch, found[place].refined = cost, branch, True
            memcpy(found[place].joints, joints, sizeof(joints))
        return max(count, place + 1)

    cdef double c_gap(self, const Problem* problem) noexcept nogil:
        """The distance of the wrist from the range that the elbow can reach within its limits, if that is
        known.
        """
        cdef double angles[TRIED + 1]
        cdef int ways[TRIED + 1]
        cdef double wrist[3]
        cdef double arm[3]
        cdef double gap = 1e300
        cdef double offset
        cdef int count, i
        self._wrist_of(problem, wrist)
        if self.kind == CROSSING:
            minus3(wrist, self.points[1], arm)
            return hinge_gap(&self.hinge, length3(arm), self.c_least[2], self.c_most[2], problem.near[2])
        if self.kind != IN_A_PLANE:
            return Arm.c_gap(self, problem)
        count = self._base_angles(problem, wrist, angles, ways)
        for i in range(count):
            self._about(0, -angles[i], wrist, arm)
            offset = self._across(1, arm)
            offset = sqrt(offset * offset + self.hinge.offset * self.hinge.offset)
            gap = min(
                gap, hinge_gap(&self.hinge, offset, self.c_least[2], self.c_most[2], problem.near[2])
            )
        return gap if count else Arm.c_gap(self, problem)
