from rtloop.backends.compiled cimport Measured
from rtloop.settling cimport SettlingMonitor
from rtloop.drives cimport Drives
from rtloop.inboxes.commands cimport CommandInbox
from rtloop.planned.follower cimport PathFollower
from rtloop.planned.handover cimport Handover
from rtloop.planned.signals cimport Signals
from rtloop.safety.limiter cimport Safety
from rtloop.streaming.session cimport Session


cdef enum Guide:
    # The source of the next cycle's command. With all except NOTHING, the tool and the scene must not change,
    # and no motion may begin. A stop of category 1 leaves the drives on while the command moves the arm.
    NOTHING = 0  # The arm stays at its commanded position.
    PATH = 1  # The command moves along a path; another trajectory may replace the path.
    STREAM = 2  # The command moves.
    BRAKE = 3  # The command moves, because the safety layer is decelerating it.
    COAST = 4  # The device is stopping by itself, at any position. The command is the measured position.
    # A person is guiding the arm, or it is stopping after that. The command is the measured position.
    HAND = 5


cdef class ModeMachine:
    cdef readonly CommandInbox commands
    cdef readonly Safety safety
    cdef readonly Session streaming
    cdef readonly SettlingMonitor settling
    cdef readonly Drives drives
    cdef readonly Handover handover
    cdef readonly PathFollower follower
    cdef readonly Signals signals
    cdef readonly object reason
    cdef readonly unsigned long long motion_id
    cdef readonly long long deceleration_ns
    cdef int _mode, _dof, _motion_result
    cdef Guide _guide
    cdef bint _stop_unseen  # Whether a stop has been requested, but the arm is not slowing down yet.
    cdef object _desired_rows
    cdef double* _desired
    cdef double _yield_rad, _tracking_error_rad, _settle_position_rad

    cdef bint c_moving(self) noexcept nogil
    cdef bint c_planned(self) noexcept nogil
    cdef bint c_switches_off(self) noexcept nogil
    cdef bint c_streams(self) noexcept nogil
    cdef void c_guide(self, Measured measured, long long now_ns, double robot_time_s, bint fresh) except *
    cdef void c_let(self, Guide guide) noexcept nogil
    cdef void _heed_stream(self) except *
    cdef void _go_with_hand(self, Measured measured, double robot_time_s, bint fresh) except *
    cdef void _follow(self, Measured measured, double robot_time_s, bint fresh) except *
    cdef void _heed_conditions(self, Measured measured, double robot_time_s) except *
    cdef void _end_at_once(self, reason) except *
    cdef void _coast(self, Measured measured, bint fresh) except *
    cdef void _heed_fence(self) except *
    cdef bint c_settle(self, Measured measured, bint fresh) noexcept nogil
