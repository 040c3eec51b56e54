"""The kinematics of a serial arm, for compiled code; see `chain.pyx`."""

from cobot.arrays cimport MAX_DOF


cdef class Chain:
    cdef object _tail  # rotation and position from the last joint to the body of the TCP
    cdef readonly int dof
    cdef readonly object base_rotation
    cdef int _count                       # number of joints on the way to the TCP; the others do not move it
    cdef int _joint[MAX_DOF]              # the column of each of these joints in the joint vector
    cdef bint _slides[MAX_DOF]
    cdef double _rest[MAX_DOF]            # position of the joint at which the fixed parts were taken
    cdef double _turn[MAX_DOF + 1][9]     # fixed parts: rotation before each joint, and after the last one
    cdef double _offset[MAX_DOF + 1][3]
    cdef object _joints, _pose, _rotation, _jacobian
    cdef double* _c_joints
    cdef double* _c_pose
    cdef double* _c_rotation
    cdef double* _c_jacobian

    cdef void c_forward(self, const double* joints, double* pose7) noexcept nogil
    cdef void c_forward_jacobian(self, const double* joints, double* pose7, double* jacobian) noexcept nogil
    cdef void c_place(
        self, const double* joints, double* position, double* rotation, double* jacobian
    ) noexcept nogil
    cdef void c_motion(self, const double* joints, Py_ssize_t apart, double* motion) noexcept nogil
    cdef void _columns(
        self, const double* axes, const double* anchors, const double* tcp, double* jacobian
    ) noexcept nogil
