from cobot.ipc.seqlock cimport Block
from cobot.robot.chain cimport Chain
from rtloop.planned.conditions cimport CycleCondition

cdef enum:
    CAPACITY = 64  # Actions: `cobot.types.MAX_ACTIONS`.


cdef enum Verdict:
    # What the conditions of a motion require in a cycle.
    AS_BEFORE = 0
    BEGIN = 1  # `start_when` holds.
    HOLD = 2  # `pause_while` holds.
    RESUME = 3  # `pause_while` no longer holds.
    END = 4  # `until` is met.


cdef class Signals:
    cdef readonly bint active  # Whether there is an action to fire, or a condition to watch.
    cdef readonly bint waiting, paused, met, fast
    cdef readonly CycleCondition start_when, pause_while, until
    cdef Block _report
    cdef Chain _chain
    cdef object _device, _record
    cdef int _count, _next
    cdef double _offset_s
    cdef double _path_times_s[CAPACITY]

    cdef bint c_due(self, double path_time_s) noexcept nogil
    cdef Verdict c_look(
        self, const double* measured, double path_time_s, double robot_time_s
    ) except *
    cdef void _meet(self, const double* measured, double path_time_s, double robot_time_s) except *
