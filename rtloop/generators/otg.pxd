"""Declarations for other compiled modules: jerk-limited, time-optimal motion of single axes. See otg.pyx."""

cdef enum:
    MAX_PHASES = 9  # Two phases that bring the state within the limits, and seven of the motion.

cdef enum OtgResult:
    OTG_OK = 0
    # A number is not finite, a limit has the wrong sign, or the target's velocity is beyond its limit.
    OTG_INVALID = 1
    OTG_NO_SOLUTION = 2  # The target cannot be reached within the limits.

cdef struct Problem:  # Problem of one axis, in m or rad, and s.
    double position, velocity, acceleration
    double target_position, target_velocity  # The target's acceleration is zero.
    double min_velocity, max_velocity  # Not used by the velocity interface.
    double min_acceleration, max_acceleration
    double max_jerk

cdef struct Profile:  # Phases of constant jerk, each with its initial state.
    int count
    double duration
    double duration_s[MAX_PHASES]
    double jerk[MAX_PHASES]
    double position[MAX_PHASES]
    double velocity[MAX_PHASES]
    double acceleration[MAX_PHASES]
    double end_position, end_velocity  # After the end, the motion continues with this velocity.

cdef int otg_position(const Problem* problem, Profile* profile) noexcept nogil
cdef int otg_velocity(const Problem* problem, Profile* profile) noexcept nogil
cdef int otg_step(const Problem* problem, double period_s, double* out) noexcept nogil
cdef int otg_position_in(const Problem* problem, double duration_s, Profile* profile) noexcept nogil
cdef int otg_synchronise(const Problem* problems, int n, Profile* profiles) noexcept nogil
cdef int otg_vector(const Problem* problems, int n, Profile* profiles) noexcept nogil
cdef void profile_at(const Profile* profile, double time_s, double* out) noexcept nogil
cdef void profile_extrema(const Profile* profile, double* out) noexcept nogil
