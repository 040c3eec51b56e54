from rtloop.backends.compiled cimport CompiledBackend, Measured
from rtloop.clock cimport CycleClock, Pace
from rtloop.controller cimport Controller
from cobot.ipc.state_block cimport StateScalars
from rtloop.publisher cimport StatePublisher, Statistics
from rtloop.recording cimport CycleRecorder


cdef class ControlLoop:
    cdef readonly Controller controller
    cdef readonly Measured _measured
    cdef Measured _fresh
    cdef object _backend, _model, _last
    cdef CompiledBackend _compiled
    cdef bint _is_compiled, _is_paced
    cdef readonly object _device
    cdef long long _beatless, _begun_ns, _ask_cycles
    cdef CycleClock _clock
    cdef Pace _pace
    cdef StatePublisher _state
    cdef Statistics _statistics
    cdef CycleRecorder _recorder
    cdef bint _is_recorded
    cdef StateScalars _scalars
    cdef double _period_s, _moving_rad_s, _square
    cdef long long _period_ns, _pause_to_stop_ns, _measured_ns
    cdef long long _overruns_to_stop, _late_in_a_row, _frozen_to_fault, _frozen, _unwritten, _cycle

    cdef void c_step(self, long long late_ns) except *
    cdef bint c_read(self) except *
    cdef void c_write(self) except *
    cdef bint c_moves(self) noexcept nogil
    cdef bint _is_loose(self) noexcept
    cdef void c_publish(self, double robot_time_s) noexcept nogil
    cdef void c_record(
        self, long long late_ns, long long read_ns, long long update_ns, long long write_ns, bint fresh
    ) except *
