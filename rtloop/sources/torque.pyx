"""Converts joint torques to a joint reference for every cycle."""

from libc.math cimport copysign, sqrt
from libc.string cimport memcpy

from cobot.arrays cimport MAX_DOF
from cobot.robot.linear cimport cholesky_solve
from rtloop.generators.rates cimport take_rates
from rtloop.sources.source cimport FINE, NOT_FINITE, Setpoint, Source
from rtloop.sources.target_checks cimport c_is_finite


cdef inline double clamped(double value, double bound) noexcept nogil:
    return min(max(value, -bound), bound)


cdef class TorqueSource(Source):
    """A source of references that move the arm as the streamed torques would, in addition to those for
    gravity and motion.

    The reference comes from a model of the arm, M(q) q'' = torque + external torque - damping, within the
    limits of velocity, acceleration and jerk. The drives follow it with soft springs. So all limits also
    apply in this mode, and the arm exerts the commanded torque on an obstacle.
    """

    def __init__(self, model, limits, double period_s):
        super().__init__(limits.dof)
        self.dynamics = model.dynamics
        self.period_s = period_s
        take_rates(limits, &self.rates)
        for joint in range(self.dof):
            self.torque[joint] = 0.0
            self.damping[joint] = model.mj.dof_damping[joint]
            self.max_effort[joint] = limits.max_effort[joint]

    def explain(self):
        return "a streamed torque is not finite"

    cdef void c_begin(self, const double* command) noexcept nogil:
        cdef int joint
        memcpy(self.ref, command, 3 * self.dof * sizeof(double))
        for joint in range(self.dof):
            self.torque[joint] = 0.0

    cdef int c_take(self, const Setpoint* setpoint, double interval_s) noexcept nogil:
        cdef int joint
        if not c_is_finite(setpoint.joints, self.dof):
            return NOT_FINITE
        for joint in range(self.dof):
            self.torque[joint] = clamped(setpoint.joints[joint], self.max_effort[joint])
        return FINE

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        cdef double mass[MAX_DOF * MAX_DOF]
        cdef double wanted[MAX_DOF]
        cdef double* position = self.ref
        cdef double* velocity = self.ref + self.dof
        cdef double* acceleration = self.ref + 2 * self.dof
        cdef double toward, room, most, step
        cdef int joint
        for joint in range(self.dof):
            wanted[joint] = (
                self.torque[joint] + external_effort[joint] - self.damping[joint] * velocity[joint]
            )
        self.dynamics.c_mass_matrix(position, mass)
        cholesky_solve(mass, self.dof, wanted)
        for joint in range(self.dof):
            # Limited so that the acceleration can be reduced to zero before the velocity reaches its limit.
            toward = copysign(velocity[joint], wanted[joint] * velocity[joint]) if wanted[joint] else 0.0
            room = 2.0 * self.rates.jerk[joint] * max(self.rates.velocity[joint] - toward, 0.0)
            most = min(self.rates.acceleration[joint], sqrt(room))
            step = self.rates.jerk[joint] * self.period_s
            acceleration[joint] += clamped(clamped(wanted[joint], most) - acceleration[joint], step)
            velocity[joint] += self.period_s * acceleration[joint]
            position[joint] += self.period_s * velocity[joint]

    cdef void c_follow(self, const double* command) noexcept nogil:
        memcpy(self.ref, command, 3 * self.dof * sizeof(double))

    cdef void c_exert(self, double* rows) noexcept nogil:
        memcpy(rows, self.torque, self.dof * sizeof(double))

    cdef void c_heading(self, double* step) noexcept nogil:
        """Use the torque as the heading. The mass matrix is positive definite, so the torque is within a
        right angle of the motion.
        """
        memcpy(step, self.torque, self.dof * sizeof(double))
