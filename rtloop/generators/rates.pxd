"""The limits of all joints, in the form for compiled code."""

from cobot.arrays cimport MAX_DOF, checked_dof

cdef struct Rates:  # rad/s, rad/s², rad/s³
    double velocity[MAX_DOF]
    double acceleration[MAX_DOF]
    double jerk[MAX_DOF]


cdef inline int take_rates(object limits, Rates* rates) except -1:
    """Copy the limits of a `JointLimits`. Returns the number of joints; too many are an error."""
    cdef int joint, dof = checked_dof(limits.dof)
    for joint in range(dof):
        rates.velocity[joint] = limits.max_velocity[joint]
        rates.acceleration[joint] = limits.max_acceleration[joint]
        rates.jerk[joint] = limits.max_jerk[joint]
    return dof
