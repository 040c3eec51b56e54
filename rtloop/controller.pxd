from cobot.arrays cimport MAX_DOF
from rtloop.backends.compiled cimport Measured
from rtloop.inboxes.commands cimport CommandInbox
from rtloop.planned.path cimport Path
from rtloop.planned.path_clock cimport PathClock
from rtloop.publisher cimport StateScalars
from rtloop.safety.fence cimport Watch
from rtloop.safety.limiter cimport Safety
from rtloop.streaming.session cimport Session


cdef enum Guide:
    # What says where the arm shall be in the next cycle.
    NOTHING = 0  # It stays where it is commanded to be.
    PATH = 1
    STREAM = 2
    BRAKE = 3  # The safety layer brings it to rest.


cdef class Controller:
    cdef readonly CommandInbox commands
    cdef readonly Safety safety
    cdef readonly Session streaming
    cdef readonly Path path
    cdef Path _other  # The one that is being loaded while the arm follows `path`.
    cdef double _offset_s  # Of the path that is being loaded; negative: it is to begin a motion.
    cdef readonly PathClock clock
    cdef readonly Watch watch
    cdef readonly str reason
    cdef public unsigned long long motion_id
    cdef readonly int slot
    cdef readonly bint settled
    cdef public bint stale
    cdef readonly long long deceleration_ns
    cdef int _mode, _dof, _motion_result
    cdef Guide _guide
    cdef bint _left_path, _stop_unseen, _misread
    cdef object _rt, _limits, _slots, _backend, _loader
    cdef object _model, _info, _tool, _output, _max_payload_kg
    cdef readonly object surroundings
    cdef object _device
    cdef readonly bint drives_off, enabling
    cdef bint _recovered
    cdef unsigned long long _enabling_number, _enabling_stops
    cdef bint _switching_off
    cdef object _mover  # the backend, if its device moves along whole motions by itself
    cdef bint _by_itself, _coasting, _fresh
    cdef long long _resting_cycles  # that a stop of category 1 has waited for the arm to settle
    cdef bint _surrounding, _changed
    cdef str _unseen
    cdef int _loading_slot
    cdef unsigned long long _loading, _loading_motion
    cdef object _desired_rows
    cdef double* _desired
    cdef double _error[MAX_DOF]
    cdef double _off, _jump, _largest_step, _largest_error
    cdef double _yield_rad, _tracking_error_rad, _settle_position_rad, _settle_velocity_rad_s
    cdef double _service_timeout_s
    cdef long long _still_cycles, _unsettled_cycles, _settle_cycles, _settle_limit_cycles

    cdef void c_update(self, Measured measured, long long now_ns, double robot_time_s, bint fresh) except *
    cdef bint c_moving(self) noexcept nogil
    cdef bint c_switches_off(self) noexcept nogil
    cdef void c_describe(self, StateScalars* state) noexcept nogil
    cdef void _heed_requests(self, long long now_ns) except *
    cdef void _heed_stream(self) except *
    cdef void _surround(self) except *
    cdef void _follow_device(self, Measured measured) except *
    cdef void _coast(self, Measured measured) except *
    cdef void c_follow_path(self) noexcept nogil
    cdef void _heed_fence(self) except *
    cdef bint c_streams(self) noexcept nogil
    cdef void c_brake(self) noexcept nogil
    cdef bint c_tracks(self, const double* position) noexcept nogil
    cdef bint c_settle(self, const double* velocity, bint fresh) noexcept nogil
