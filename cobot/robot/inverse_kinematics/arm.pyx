"""Inverse kinematics of any serial arm: numeric, by damped least squares with joint limits and restarts.

The step is Levenberg-Marquardt's with the damping of Sugihara (doi 10.1109/TRO.2011.2148230): it shrinks with
the remaining error, so that the last steps are Newton's. Arms with a suitable geometry are subclasses, which
give candidates in closed form. The candidates are verified here by forward kinematics. If rounding makes one
pass a limit or miss the pose, the same steps make it exact.

Longer than other modules, because one class has everything that all kinds of arms share.
"""

from libc.math cimport atan2, fabs
from libc.string cimport memcpy

import numpy as np

from cobot.arrays cimport MAX_DOF, bytes_of, doubles
from cobot.robot.chain cimport Chain
from cobot.robot.inverse_kinematics.vectors cimport (
    dot3,
    length3,
    minus3,
    product_transposed,
    times,
    wrapped,
)
from cobot.robot.linear cimport cholesky_factor, cholesky_substitute
from cobot.robot.quaternion cimport cross3, quat_to_matrix

cdef extern from *:
    """
    /* A descent ends at this distance, m and rad; rounding errors are a thousand times smaller. The
       second value is accepted if it cannot continue, at a singularity at the end of its reach. */
    static const double COBOT_IK_TOLERANCE = 1e-10, COBOT_IK_ACCEPTED = 5e-10;
    /* Largest step, rad or m; and the bias and damping that keep a step finite at a singularity. */
    static const double COBOT_IK_LARGEST_STEP = 0.5, COBOT_IK_BIAS = 1e-5;
    static const double COBOT_IK_MIN_DAMPING = 1e-13;
    /* Minimum tolerance for poses out of reach, m or rad: only rounding keeps a stretched arm from them. */
    static const double COBOT_IK_MIN_SLOP = 2e-11;
    /* A joint at a limit that has moved by less than this, rad or m, was at the limit before. */
    static const double COBOT_IK_MOVED = 1e-9;
    /* An arm that cannot move its TCP in all six directions is at a pose if it is within 0.05 mm and 0.01
       degrees, the tolerance of lin; the rest is rounding of these two. */
    static const double COBOT_IK_NEAR_M = 5.0000001e-5, COBOT_IK_NEAR_RAD = 1.74532929e-4;
    """
    const double TOLERANCE "COBOT_IK_TOLERANCE"
    const double ACCEPTED "COBOT_IK_ACCEPTED"
    const double MAX_STEP "COBOT_IK_LARGEST_STEP"
    const double BIAS "COBOT_IK_BIAS"
    const double MIN_DAMPING "COBOT_IK_MIN_DAMPING"
    const double MIN_SLOP "COBOT_IK_MIN_SLOP"
    const double MOVED "COBOT_IK_MOVED"
    const double NEAR_M "COBOT_IK_NEAR_M"
    const double NEAR_RAD "COBOT_IK_NEAR_RAD"

cdef enum:
    STEPS = 60
    PATIENCE = 12
    # Steps that remove rounding errors from a solution in closed form.
    STEPS_TO_VERIFY = 12
    # Maximum number of descents from random starts, and number of solutions after which they end.
    ATTEMPTS = 1500
    ENOUGH = 2
    # Number of the best candidates with a free angle that are refined and compared.
    REFINED = 3
    # Number of descents if a closed form exists but has found nothing: the pose may be singular, and the form
    # has not tried the right angle of the free joint.
    ATTEMPTS_AFTER_CLOSED_FORM = 200

cdef class Arm:
    """Joint angles for poses of the TCP. Joint vectors are shape (dof,), rad (m for a slide).

    Not thread safe from Python; the methods for compiled code are.

    Attributes:
        chain: the arm.
        dof: the number of joints.
        lacking: whether the arm cannot move its TCP in all six directions. Then it is considered to be at a
            pose within the tolerance of lin.
        redundant: whether the arm has more joints than a pose fixes.
    """

    def __init__(
        self, Chain chain, limits, rest, root, double reach, double slop, int free=FIXED, bint lacking=False
    ):
        """Create the inverse kinematics of an arm. The limits are read at each call.

        Args:
            rest: joints, shape (dof,), at which the frames of its geometry are taken.
            root, reach: a point, shape (3,), in the base frame, m, and the largest distance of the TCP from
                it.
            slop: error of the geometry that a subclass assumes, m or rad.
            free: the axis of the TCP, 0 to 2, about which a pose leaves the rotation free; ANY_ROTATION: only
                the position matters.
            lacking: whether the arm cannot move its TCP in all six directions, so that it only gets near most
                poses.
        """
        cdef int i
        cdef int fixed = 6 if free == FIXED else 3 if free == ANY_ROTATION else 5
        self.chain, self.dof, self._limits = chain, chain.dof, limits
        self._low, self._high = np.zeros(self.dof), np.zeros(self.dof)
        self.c_low, self.c_high = doubles(self._low, self.dof), doubles(self._high, self.dof)
        self._given, self._found = np.zeros(7 + self.dof), np.zeros(self.dof)
        self.c_given, self.c_found = doubles(self._given, 7 + self.dof), doubles(self._found, self.dof)
        for i in range(self.dof):
            self.c_rest[i] = rest[i]
            self.c_hinge[i] = True
        for i in range(chain._count):
            self.c_hinge[chain._joint[i]] = not chain._slides[i]
        chain.c_place(self.c_rest, self.c_home_position, self.c_home_rotation, NULL)
        for i in range(3):
            self.c_root[i] = root[i]
        self.c_reach, self.c_slop = reach + (NEAR_M if lacking else 0.0), max(slop, MIN_SLOP)
        self.c_free, self.lacking, self.redundant = free, lacking, self.dof > fixed
        self.c_weight = NEAR_RAD / NEAR_M if lacking else 1.0
        self.refresh()

    @property
    def closed_form(self):
        """Whether all solutions are known."""
        return False

    @property
    def arm_angle(self):
        """This object if the arm is S-R-S; else None."""
        return None

    def refresh(self):
        """Read the limits again. Compiled code must call this before its own calls."""
        cdef int i
        self._low[...] = self._limits.min_position
        self._high[...] = self._limits.max_position
        for i in range(self.dof):
            self.c_least[i] = self.c_low[i] - self.c_rest[i]
            self.c_most[i] = self.c_high[i] - self.c_rest[i]

    cdef int _prepare(self, pose, seed, int criterion, Problem* out) except -1:
        """Prepare a problem given by Python: a pose (7,), x, y, z (m) and w, x, y, z, and a seed (dof,)."""
        self.refresh()
        self._given[:7] = pose
        self._given[7:] = seed
        self.c_state(self.c_given, &self.c_given[7], criterion, out)
        return 0

    cdef void c_state(
        self, const double* pose, const double* seed, int criterion, Problem* out
    ) noexcept nogil:
        """Fill in a problem. If `seed` is NULL, the middle of the limits is used."""
        cdef double carried[3]
        cdef double value
        cdef int i
        memcpy(out.position, pose, sizeof(out.position))
        quat_to_matrix(&pose[3], out.rotation)
        product_transposed(out.rotation, self.c_home_rotation, out.moved)
        times(out.moved, self.c_home_position, carried)
        minus3(pose, carried, out.shift)
        out.criterion, out.every, out.slack, out.slop = criterion, False, 1e-6, self.c_slop
        out.patience = PATIENCE
        out.accepted_m, out.accepted_rad = ACCEPTED, ACCEPTED
        if self.lacking:
            out.accepted_m, out.accepted_rad = NEAR_M, NEAR_RAD
        for i in range(self.dof):
            value = 0.5 * (self.c_low[i] + self.c_high[i])
            out.seed[i] = value if seed == NULL else seed[i]
            if seed != NULL and criterion != LIMITS:
                value = seed[i]
            value = self.c_low[i] if value < self.c_low[i] else value
            value = self.c_high[i] if value > self.c_high[i] else value
            out.near[i] = value - self.c_rest[i]

    cdef int c_closed_form(self, const Problem* problem, Candidate* found) noexcept nogil:
        """Find up to MAX_CANDIDATES candidates, the best of each branch. -1: there is no closed form."""
        return -1

    cdef void c_refine(self, const Problem* problem, Candidate* candidate) noexcept nogil:
        """Optimise the free angle of a candidate, if it has one."""
        candidate.refined = True

    cdef double c_gap(self, const Problem* problem) noexcept nogil:
        """A lower bound of the distance of the pose from the arm's reach in this orientation, m."""
        cdef double away[3]
        minus3(problem.position, self.c_root, away)
        return max(length3(away) - self.c_reach, 0.0)

    cdef bint c_solve(self, const Problem* problem, unsigned long long random, double* joints) noexcept nogil:
        """The best joints for the pose; False if none are found."""
        cdef Candidate found[MAX_CANDIDATES]
        cdef double distance[2]
        cdef int count, i, best
        memcpy(joints, problem.seed, self.dof * sizeof(double))
        if not self.lacking and problem.criterion == NEAREST and (
            self.c_descend(problem, joints, 1, True, distance)
        ):
            return True
        count = self.c_closed_form(problem, found)
        for _ in range(count if problem.criterion == NEAREST else min(count, REFINED)):
            best = cheapest(found, count, True)
            if problem.criterion == NEAREST and (
                found[best].bound > found[cheapest(found, count, False)].cost
            ):
                found[best].refined = True  # It cannot become the best.
            elif not found[best].refined:
                self.c_refine(problem, &found[best])
        for i in range(count, 0, -1):
            best = cheapest(found, i, False)
            memcpy(joints, found[best].joints, self.dof * sizeof(double))
            if self.c_verify(problem, joints):
                return True
            found[best] = found[i - 1]
        if self.c_gap(problem) > 2.0 * self.c_slop:
            return False
        memcpy(joints, problem.seed, self.dof * sizeof(double))
        if problem.criterion == NEAREST and self.c_descend(problem, joints, STEPS, True, distance):
            return True
        if self.lacking and problem.criterion == NEAREST:
            # The nearest joints may exceed one tolerance and fall below the other, where the seed keeps both.
            memcpy(joints, problem.seed, self.dof * sizeof(double))
            if self.c_descend(problem, joints, 1, True, distance):
                return True
        count = self.c_search(problem, random, self._attempts(count), ENOUGH, found)
        if count > 0:
            memcpy(joints, found[cheapest(found, count, False)].joints, self.dof * sizeof(double))
        return count > 0

    cdef int _attempts(self, int candidates) noexcept nogil:
        """Number of descents from random starts, given the number of candidates in closed form."""
        return ATTEMPTS if candidates < 0 or self.c_slop > MIN_SLOP else ATTEMPTS_AFTER_CLOSED_FORM

    cdef int c_search(
        self, const Problem* problem, unsigned long long random, int attempts, int wanted, Candidate* found
    ) noexcept nogil:
        """Descend from random starts until `wanted` descents have succeeded. Some may have found the same
        solution."""
        cdef int count = 0
        cdef int attempt, i
        cdef unsigned long long factor = 6364136223846793005ULL  # Knuth's MMIX
        cdef unsigned long long summand = 1442695040888963407ULL
        random = random * 2 + summand
        for attempt in range(attempts):
            for i in range(self.dof):
                random = random * factor + summand
                found[count].joints[i] = self.c_low[i] + (self.c_high[i] - self.c_low[i]) * (
                    <double>(random >> 11) / 9007199254740992.0
                )
            if self._from_random(problem, found[count].joints, attempt):
                found[count].cost = self.c_cost(problem, found[count].joints)
                found[count].branch, found[count].refined = 0, True
                count += 1
                if count == wanted:
                    break
        return count

    cdef bint _from_random(self, const Problem* problem, double* joints, int attempt) noexcept nogil:
        """Descend from random joints. Some descents stay within the limits; others apply the limits only at
        the end, because a limit that stops one joint can keep the others from a solution.
        """
        cdef double distance[2]
        cdef double middle, far
        cdef int i
        if attempt % (2 if self.redundant else 4) == 0:
            return self.c_descend(problem, joints, STEPS, True, distance)
        if not self.c_descend(problem, joints, STEPS, False, distance):
            return False
        for i in range(self.dof):
            middle = 0.5 * (self.c_low[i] + self.c_high[i])
            if self.c_hinge[i]:
                joints[i] = wrapped(joints[i], middle)
            far = fabs(joints[i] - middle) - 0.5 * (self.c_high[i] - self.c_low[i])
            if far > problem.slack and not self.redundant:
                return False  # There is no other way to turn the other joints.
        return self.c_descend(problem, joints, STEPS, True, distance)

    cdef bint c_verify(self, const Problem* problem, double* joints) noexcept nogil:
        """Make joints from a closed form exact: within the limits, and at the pose. False if that fails."""
        cdef double rotation[9]
        cdef double position[3]
        cdef double error[3]
        cdef double distance[2]
        self._clip(joints)
        self.chain.c_place(joints, position, rotation, NULL)
        minus3(problem.position, position, error)
        distance[0] = length3(error)
        rotation_error(problem.rotation, rotation, error)
        if distance[0] < TOLERANCE and length3(error) < TOLERANCE:
            return True
        return self.c_descend(problem, joints, STEPS_TO_VERIFY, True, distance)

    cdef bint c_descend(
        self, const Problem* problem, double* joints, int steps, bint bounded, double* distance
    ) noexcept nogil:
        """Descend from joints to the nearest ones at the pose, or as near to the pose as possible.

        `distance` becomes the remaining distance from the pose, m and rad.
        """
        cdef double best[MAX_DOF]
        cdef double jacobian[6 * MAX_DOF]
        cdef double step[MAX_DOF]
        cdef double rotation[9]
        cdef double position[3]
        cdef double error[6]
        cdef double off_m, off_rad, off, largest
        cdef double least = 2e300
        cdef int stalled = 0
        cdef int i, _step
        if bounded:
            self._clip(joints)
        memcpy(best, joints, self.dof * sizeof(double))
        distance[0] = distance[1] = 1e300
        for _step in range(steps):
            self.chain.c_place(joints, position, rotation, jacobian)
            minus3(problem.position, position, error)
            self._turn_error(problem, rotation, jacobian, &error[3])
            off_m, off_rad = length3(error), length3(&error[3])
            off = self.c_weight * off_m + off_rad
            stalled = stalled + 1 if off > 0.9 * least else 0
            if off < least:
                distance[0], distance[1], least = off_m, off_rad, off
                memcpy(best, joints, self.dof * sizeof(double))
            if off_m < TOLERANCE and off_rad < TOLERANCE:
                return True
            self._weigh(jacobian, error)
            if stalled > problem.patience or not self._damped_step(
                joints, jacobian, error, off, bounded, step
            ):
                break
            largest = 0.0
            for i in range(self.dof):
                largest = fabs(step[i]) if fabs(step[i]) > largest else largest
            largest = MAX_STEP / largest if largest > MAX_STEP else 1.0
            for i in range(self.dof):
                joints[i] += largest * step[i]
            if bounded:
                self._clip(joints)
        memcpy(joints, best, self.dof * sizeof(double))
        return distance[0] < problem.accepted_m and distance[1] < problem.accepted_rad

    cdef void _turn_error(
        self, const Problem* problem, const double* rotation, double* jacobian, double* error
    ) noexcept nogil:
        """The remaining rotation to the pose. Free rotations are removed from the Jacobian."""
        cdef double axis[3]
        cdef double target[3]
        cdef double along, sine
        cdef int i, k
        if self.c_free == FIXED:
            rotation_error(problem.rotation, rotation, error)
            return
        for i in range(3):
            error[i] = 0.0
            if self.c_free != ANY_ROTATION:
                axis[i], target[i] = rotation[3 * i + self.c_free], problem.rotation[3 * i + self.c_free]
        for k in range(self.dof):
            along = 0.0
            for i in range(3):
                if self.c_free != ANY_ROTATION:
                    along += axis[i] * jacobian[(3 + i) * self.dof + k]
            for i in range(3):
                if self.c_free == ANY_ROTATION:
                    jacobian[(3 + i) * self.dof + k] = 0.0
                else:
                    jacobian[(3 + i) * self.dof + k] -= along * axis[i]
        if self.c_free == ANY_ROTATION:
            return
        cross3(axis, target, error)
        sine = length3(error)
        if sine < 1e-9 and dot3(axis, target) < 0.0:
            # Half a turn about any axis at right angles to it, such as the TCP's next axis.
            for i in range(3):
                error[i] = 3.141592653589793 * rotation[3 * i + (self.c_free + 1) % 3]
        elif sine > 1e-9:
            along = atan2(sine, dot3(axis, target)) / sine
            for i in range(3):
                error[i] *= along

    cdef void _weigh(self, double* jacobian, double* error) noexcept nogil:
        """Weigh the position against the rotation by the ratio of their tolerances."""
        cdef int i
        if self.c_weight != 1.0:
            for i in range(3):
                error[i] *= self.c_weight
            for i in range(3 * self.dof):
                jacobian[i] *= self.c_weight

    cdef void _clip(self, double* joints) noexcept nogil:
        cdef int i
        for i in range(self.dof):
            joints[i] = self.c_low[i] if not joints[i] >= self.c_low[i] else joints[i]
            joints[i] = self.c_high[i] if joints[i] > self.c_high[i] else joints[i]

    cdef bint _damped_step(
        self, const double* joints, double* jacobian, const double* error, double off, bint bounded,
        double* step
    ) noexcept nogil:
        """Jᵀ (J Jᵀ + λ)⁻¹ error. A joint at its limit that would be pushed beyond is left out."""
        cdef double normal[36]
        cdef double right[6]
        cdef double gradient
        cdef double damping = max(BIAS * min(off, 1.0), MIN_DAMPING)
        cdef int i, j, k
        for i in range(6):
            damping += 0.5 * error[i] * error[i]
            right[i] = error[i]
        for k in range(self.dof):
            gradient = 0.0
            for i in range(6):
                gradient += jacobian[i * self.dof + k] * error[i]
            if bounded and (
                (joints[k] <= self.c_low[k] and gradient < 0.0)
                or (joints[k] >= self.c_high[k] and gradient > 0.0)
            ):
                for i in range(6):
                    jacobian[i * self.dof + k] = 0.0
        for i in range(6):
            for j in range(i + 1):
                gradient = damping if i == j else 0.0
                for k in range(self.dof):
                    gradient += jacobian[i * self.dof + k] * jacobian[j * self.dof + k]
                normal[6 * i + j] = gradient
        if not cholesky_factor(normal, 6):
            return False
        cholesky_substitute(normal, 6, right)
        for k in range(self.dof):
            step[k] = 0.0
            for i in range(6):
                step[k] += jacobian[i * self.dof + k] * right[i]
        return True

    cdef double c_cost(self, const Problem* problem, const double* joints) noexcept nogil:
        """The cost of joints under the criterion; lower is better."""
        cdef double cost = 0.0
        cdef double value
        cdef int i
        if problem.criterion == MANIPULABILITY:
            return -self.c_manipulability(joints)
        for i in range(self.dof):
            if problem.criterion == NEAREST:
                value = joints[i] - problem.seed[i]
                cost += value * value
            else:
                value = fabs(2.0 * joints[i] - self.c_low[i] - self.c_high[i])
                value /= self.c_high[i] - self.c_low[i]
                cost = value if value > cost else cost
        return cost

    cdef double c_manipulability(self, const double* joints) noexcept nogil:
        """√det(J Jᵀ), m and rad (Yoshikawa 1985)."""
        cdef double jacobian[6 * MAX_DOF]
        cdef double normal[36]
        cdef double rotation[9]
        cdef double position[3]
        cdef double volume = 1.0
        cdef int i, j, k
        self.chain.c_place(joints, position, rotation, jacobian)
        for i in range(6):
            for j in range(i + 1):
                normal[6 * i + j] = 0.0
                for k in range(self.dof):
                    normal[6 * i + j] += jacobian[i * self.dof + k] * jacobian[j * self.dof + k]
        if not cholesky_factor(normal, 6):
            return 0.0
        for i in range(6):
            volume *= normal[7 * i]
        return volume

    def solve(self, pose, seed, int criterion, unsigned long long random_seed):
        """The best joints, shape (dof,), for a pose; None if none are found.

        Args:
            pose: shape (7,), x, y, z (m) and w, x, y, z of the TCP in the base frame.
            criterion: 0 nearest to the seed, 1 far from the limits, 2 manipulability.
        """
        cdef Problem problem
        cdef bint solved
        self._prepare(pose, seed, criterion, &problem)
        with nogil:
            solved = self.c_solve(&problem, random_seed, self.c_found)
        return self._found.copy() if solved else None

    def solve_all(self, pose, seed, int criterion, int wanted, unsigned long long random_seed):
        """Joints for a pose, the best first. These are the best of each branch; without a closed form, the
        results of `wanted` successful descents, which may be equal.
        """
        cdef Problem problem
        cdef Candidate found[MAX_CANDIDATES]
        cdef int count, best
        self._prepare(pose, seed, criterion, &problem)
        problem.every = True
        with nogil:
            count = self.c_closed_form(&problem, found)
            for best in range(count):
                self.c_refine(&problem, &found[best])
            if count < 0 or (count == 0 and self.c_gap(&problem) <= 2.0 * self.c_slop):
                wanted = min(wanted, MAX_CANDIDATES - 1)
                count = self.c_search(&problem, random_seed, self._attempts(count), wanted, found)
        rows = []
        for count in range(count, 0, -1):
            best = cheapest(found, count, False)
            memcpy(self.c_found, found[best].joints, self.dof * sizeof(double))
            if self.c_verify(&problem, self.c_found):
                rows.append(self._found.copy())
            found[best] = found[count - 1]
        return rows

    def is_vague(self, joints):
        """Whether the closed form may miss nearer joints because of rounding; False without a closed form."""
        return self.closed_form

    def descend(self, pose, seed, int steps, bint patient=False, within=None, double share=1.0):
        """Descend from a seed. Returns the joints (dof,) at its end, whether they reach the pose, and their
        distance from it, m and rad.

        Args:
            patient: whether the descent continues while it makes little progress.
            within: the lowest and highest joints, (2, dof), instead of the limits. The descent slides along
                them.
            share: share of its tolerance that an arm that is `lacking` must keep.
        """
        cdef Problem problem
        cdef double distance[2]
        cdef bint solved
        self._prepare(pose, seed, NEAREST, &problem)
        if within is not None:
            self._low[...], self._high[...] = within
        if patient:
            problem.patience = steps
        if self.lacking:
            problem.accepted_m, problem.accepted_rad = share * NEAR_M, share * NEAR_RAD
        memcpy(self.c_found, problem.seed, self.dof * sizeof(double))
        with nogil:
            solved = self.c_descend(&problem, self.c_found, steps, True, distance)
        self.refresh()
        return self._found.copy(), bool(solved), distance[0], distance[1]

    def descend_all(self, pose, seeds, int steps, within, double share=1.0):
        """The joints, (k, dof), of those descents to a pose from seeds, (n, dof), that reach it; for the
        other arguments see `descend`."""
        cdef Problem problem
        cdef double distance[2]
        cdef Py_ssize_t row, count = len(seeds)
        if count == 0:
            return np.empty((0, self.dof))
        rows = np.array(seeds, dtype=np.float64, order="C")
        solved = np.zeros(count, dtype=np.uint8)
        cdef double* joints = doubles(rows, count * self.dof)
        cdef char* flag = bytes_of(solved, count)
        self._prepare(pose, rows[0], NEAREST, &problem)
        self._low[...], self._high[...] = within
        if self.lacking:
            problem.accepted_m, problem.accepted_rad = share * NEAR_M, share * NEAR_RAD
        with nogil:
            for row in range(count):
                flag[row] = self.c_descend(&problem, joints + row * self.dof, steps, True, distance)
        self.refresh()
        return rows[solved.astype(bool)]

    def carry(self, poses, seed, int steps, double step, double share=1.0):
        """Descend to each of the poses, (n, 7), in turn, starting from the joints at the previous pose.
        Returns the joints, (k, dof), before the first descent that fails, drives a joint into a limit, or
        turns a joint by more than `step`. `share` is that of `descend`."""
        cdef Problem problem
        cdef double distance[2]
        cdef double turned
        cdef int i, row = 0, count = len(poses)
        cdef bint good = count > 0
        rows, near = np.empty((count, self.dof)), np.array(seed, dtype=np.float64)
        cdef const double* before = doubles(near, self.dof)
        cdef double* joints
        while good and row < count:
            self._prepare(poses[row], near, NEAREST, &problem)
            if self.lacking:
                problem.accepted_m, problem.accepted_rad = share * NEAR_M, share * NEAR_RAD
            joints = doubles(rows[row], self.dof)
            memcpy(joints, before, self.dof * sizeof(double))
            good = self.c_descend(&problem, joints, steps, True, distance)
            for i in range(self.dof):
                turned = fabs(joints[i] - before[i])
                if turned > step or (turned > MOVED and not self.c_low[i] < joints[i] < self.c_high[i]):
                    good = False
            if good:
                near = rows[row]
                before = joints
                row += 1
        return rows[:row]

    def gap(self, pose):
        """Distance of a pose from the arm's reach in this orientation, m. Not all joint limits are
        considered."""
        cdef Problem problem
        self._prepare(pose, self._low, NEAREST, &problem)
        return self.c_gap(&problem)

    def manipulability(self, joints):
        """√det(J Jᵀ), m and rad."""
        self._found[...] = joints
        return self.c_manipulability(self.c_found)


cdef int cheapest(const Candidate* found, int count, bint unrefined) noexcept nogil:
    """The best candidate. With `unrefined` the best one that is not refined yet, if there is any."""
    cdef int best = -1
    cdef int i
    for i in range(count):
        if (best < 0 or found[i].cost < found[best].cost) and not (unrefined and found[i].refined):
            best = i
    return max(best, 0)


cdef void rotation_error(const double* target, const double* rotation, double* out) noexcept nogil:
    """The rotation vector from `rotation` to `target`, in the base frame."""
    cdef double m[9]
    cdef double sine, cosine, scale
    cdef int i, column
    product_transposed(target, rotation, m)
    out[0], out[1], out[2] = 0.5 * (m[7] - m[5]), 0.5 * (m[2] - m[6]), 0.5 * (m[3] - m[1])
    sine, cosine = length3(out), 0.5 * (m[0] + m[4] + m[8] - 1.0)
    if sine > 1e-9:
        scale = atan2(sine, cosine) / sine
        for i in range(3):
            out[i] *= scale
    elif cosine < 0.0:
        # Half a turn: the axis is the largest column of R + 1.
        column = 0
        for i in range(1, 3):
            column = i if m[4 * i] > m[4 * column] else column
        for i in range(3):
            out[i] = m[3 * i + column] + (1.0 if i == column else 0.0)
        scale = 3.141592653589793 / length3(out)
        for i in range(3):
            out[i] *= scale
