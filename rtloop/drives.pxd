from rtloop.backends.compiled cimport Measured


cdef enum Power:
    ON = 0  # The robot gets commands.
    COMING_OFF = 1  # After a stop of category 1: the robot gets commands until the arm is at rest.
    OFF = 2  # The robot gets no commands until a reset.


cdef enum Reset:
    NO_RESET = 0
    # In both, the arm may be at any position, so its current position is commanded, and no motion is
    # accepted.
    RECOVERING = 1
    ENABLING = 2


cdef class Drives:
    cdef object _backend, _device
    cdef bint _stepwise
    cdef int _dof
    cdef Power _power
    cdef Reset _reset
    cdef unsigned long long _number, _stops  # number of the RESET, and number of stops when it was read
    cdef long long _resting_cycles, _limit_cycles

    cdef bint c_off(self) noexcept nogil
    cdef bint c_resetting(self) noexcept nogil
    cdef bint c_loose(self) noexcept nogil
    cdef bint c_count_down(self, bint settled) noexcept nogil
