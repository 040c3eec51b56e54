from rtloop.inboxes.point_queue cimport PointQueue
from rtloop.inboxes.stream cimport StreamInbox
from rtloop.safety.limiter cimport Safety
from rtloop.sources.cartesian cimport CartesianSource
from rtloop.sources.joint cimport JointSource
from rtloop.sources.servo_base cimport ServoSource
from rtloop.sources.source cimport Chunk, Setpoint, Source
from rtloop.streaming.collision_monitor cimport CollisionMonitor


cdef enum Problem:
    NO_PROBLEM = 0
    CLIENT_ENDED = 1
    CLIENT_DIED = 2
    CONTACT = 3
    SERVO_WATCHDOG = 4
    OBSTACLE = 5


cdef class Feed:
    cdef readonly bint holding
    cdef readonly bint not_finite
    cdef readonly Source source
    cdef readonly Problem problem
    cdef Safety safety
    cdef CollisionMonitor monitor
    cdef StreamInbox box
    cdef double period_s
    cdef bint blocked, slowed

    cdef void c_advance(self, const double* external_effort, const double* wrench,
                        double robot_time_s) noexcept nogil
    cdef void c_watch_surroundings(self) noexcept nogil
    cdef void c_judge(self, int flaw) noexcept nogil
    cdef void c_follow_unless_deeper(self, const double* heading) noexcept nogil
    cdef void c_hold(self, int why) noexcept nogil
    cdef void c_end(self, Problem problem) noexcept nogil


cdef class TargetFeed(Feed):
    cdef readonly unsigned long long setpoint_seen
    cdef readonly unsigned long long move_seen
    cdef readonly unsigned long long chunk_seen
    cdef unsigned long long session, cancel_seen
    cdef JointSource joints
    cdef CartesianSource poses
    cdef bint has_joints, has_poses, live, target_waits
    cdef Setpoint setpoint
    cdef Chunk chunk
    cdef long long decimation, patience_cycles, silent_cycles, untaken_cycles, starved

    cdef bint c_move_running(self) noexcept nogil
    cdef void c_read_setpoint(self) noexcept nogil
    cdef void c_take(self) noexcept nogil
    cdef void c_take_move(self) noexcept nogil
    cdef void c_take_chunk(self, double robot_time_s) noexcept nogil
    cdef void c_end_hold(self) noexcept nogil


cdef class PointFeed(Feed):
    cdef readonly ServoSource points
    cdef PointQueue queue
    cdef CartesianSource presses
    cdef bint has_force
    cdef unsigned long long session, judged
    cdef Setpoint setpoint
    cdef long long watchdog_cycles, silent_cycles, finishing_cycles, dropped

    cdef bint c_done(self) noexcept nogil
