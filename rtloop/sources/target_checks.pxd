from libc.math cimport isfinite


# Result of the check of a streamed pose.
cdef enum:
    POSE_PASSES = 0
    POSE_JUMPS = 1
    POSE_TURNS = 2

cdef double SLACK_S

cdef inline bint c_is_finite(const double* values, int count) noexcept nogil:
    """Whether all values are finite. True if there are none."""
    cdef int index
    for index in range(count):
        if not isfinite(values[index]):
            return False
    return True

cdef double c_clamped_interval(double interval_s) noexcept nogil
cdef int c_joint_jump(
    const double* target, const double* last, int dof, double interval_s, const double* max_velocity
) noexcept nogil
cdef int c_pose_jump(
    const double* pose, const double* last, double interval_s, double max_linear, double max_angular
) noexcept nogil
