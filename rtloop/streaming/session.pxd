from rtloop.inboxes.point_queue cimport PointQueue
from rtloop.inboxes.stream cimport StreamInbox
from cobot.ipc.state_block cimport StateScalars
from rtloop.safety.limiter cimport Safety
from rtloop.streaming.client_watch cimport ClientWatch
from rtloop.streaming.collision_monitor cimport CollisionMonitor
from rtloop.streaming.contact_monitor cimport ContactMonitor
from rtloop.streaming.feed cimport Feed, PointFeed, TargetFeed


cdef class Session:
    cdef readonly StreamInbox box
    cdef readonly unsigned long long session
    cdef readonly object mode
    cdef Feed feed
    cdef TargetFeed targets
    cdef PointFeed points
    cdef bint has_targets, has_points, _released
    cdef readonly bint guided
    cdef public object _backend  # the backend; each session checks whether it is compliant
    cdef readonly object overlay, t1_share
    cdef object _exerted, _backend_name
    cdef double* _c_exerted
    cdef object _limits, _session_limits, _model
    cdef double _period_s
    cdef long long _timeout_cycles, _cycle
    cdef Safety _safety
    cdef PointQueue _queue
    cdef ClientWatch _client
    cdef CollisionMonitor _collision_monitor
    cdef ContactMonitor _contact_monitor

    cdef void c_advance(self, const double* external, double robot_time_s) noexcept nogil
    cdef void c_describe(self, StateScalars* state) noexcept nogil
    cdef long long c_torn_reads(self) noexcept nogil
    cdef bint c_from_service(self) noexcept nogil
