# Written by `python -m cobot.ipc.generate`; `cobot.ipc.state_fields` describes the fields.
# Layout version 24, records 9f6b8cdbcd731da4.
from libc.stdint cimport int64_t, uint64_t

cdef struct StateScalars:
    uint64_t cycle
    double robot_time_s
    double time_factor
    uint64_t mode
    uint64_t settled
    uint64_t motion_id
    uint64_t motion_result
    uint64_t slot
    double path_time_s
    double path_duration_s
    double path_rate
    int64_t deceleration_monotonic_ns
    uint64_t stops_seen
    uint64_t estops_seen
    uint64_t command_seen
    uint64_t session
    uint64_t setpoint_seen
    uint64_t move_seen
    uint64_t move_running
    uint64_t chunk_seen
    uint64_t point_seen
    uint64_t points_taken
    uint64_t points_dropped
    uint64_t points_buffered
    uint64_t underruns
    uint64_t overruns
    uint64_t torn_reads
    int64_t monotonic_ns
    int64_t measured_monotonic_ns
    double gripper_width
    double gripper_commanded_width
    double gripper_force
    uint64_t gripper_moving
    uint64_t gripper_object
    int64_t gripper_monotonic_ns

# Rows of `dof` numbers in the values of `rtloop.backends.Measured`; the wrench follows them.
cdef enum:
    POSITION_ROW = 0
    VELOCITY_ROW = 1
    EFFORT_ROW = 2
    DESIRED_EFFORT_ROW = 3
    EXTERNAL_EFFORT_ROW = 4
    MEASURED_ROWS = 5

# The number of these values.
cdef inline int count_measured(int dof) noexcept nogil:
    return 5 * dof + 12
