"""Modes 6 and 7: a servo mode's motion, with force control along the force axes."""

from libc.string cimport memcpy

from cobot.arrays cimport MAX_DOF
from rtloop.sources.cartesian cimport CartesianSource
from rtloop.sources.servo_base cimport ServoSource

from cobot.ipc.layout import Interpolation


cdef class ForceServo(CartesianSource):
    """Follows the pose of a joint source's reference and, in the null space, the source's posture.

    Unless a force deflects the arm, its joints equal those of the source, which are within the joints'
    limits.
    """

    def __init__(self, ServoSource points, model, limits, within, double period_s, request):
        super().__init__(Interpolation.NONE, model, limits, within, period_s, period_s, request)
        self.points = points

    cdef void c_begin(self, const double* command) noexcept nogil:
        self.points.c_begin(command)
        memcpy(self.before_points, command, self.dof * sizeof(double))
        CartesianSource.c_begin(self, command)

    cdef const double* c_next_pose(self, const double* external_effort, const double* wrench) noexcept nogil:
        self.points.c_advance(external_effort, wrench)
        self.chain.c_forward(self.points.ref, self.pose)
        return self.pose

    cdef void c_pull_at_posture(self, double* step) noexcept nogil:
        """Use the source's own step. Its part that moves the TCP is removed along the force axes."""
        cdef double toward[MAX_DOF]
        cdef int joint
        memcpy(self.posture, self.points.ref, self.dof * sizeof(double))
        CartesianSource.c_pull_at_posture(self, toward)
        for joint in range(self.dof):
            step[joint] = self.points.ref[joint] - self.before_points[joint] + toward[joint]
            self.before_points[joint] = self.points.ref[joint]
