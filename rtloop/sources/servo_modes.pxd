from cobot.arrays cimport MAX_DOF
from rtloop.generators.online_trajectory cimport OnlineTrajectory
from rtloop.inboxes.point_queue cimport PointQueue
from rtloop.sources.servo_base cimport ServoSource
from rtloop.sources.servo_law cimport ServoLaw


cdef class Newest(ServoSource):
    cdef bint planned
    cdef OnlineTrajectory planner
    cdef ServoLaw law
    cdef double aim[3 * MAX_DOF]
    cdef double since_s, every_s

    cdef void c_step_to(self, double time_s) noexcept nogil
    cdef void c_accept_far(self, double interval_s) noexcept nogil


cdef class Buffered(ServoSource):
    cdef ServoLaw law
    cdef double fixed_s  # Time of each point, s, regardless of the stated time; 0: the stated time.
    cdef double line[3 * MAX_DOF]
    cdef double start[MAX_DOF]
    cdef double way[MAX_DOF]
    cdef double elapsed_s, waited_s, since_s
    cdef bint playing

    cdef bint c_may_begin(self, PointQueue queue) noexcept nogil
    cdef void c_turn_to_last(self) noexcept nogil
