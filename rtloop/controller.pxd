from rtloop.backends.compiled cimport Measured
from rtloop.mode_machine cimport ModeMachine
from cobot.ipc.state_block cimport StateScalars
from rtloop.tool_and_scene cimport ToolAndScene


cdef class Controller(ModeMachine):
    cdef readonly ToolAndScene tool_and_scene
    cdef readonly int slot
    cdef public bint stale
    cdef object _device, _output, _pull_block, _backend_of_arm
    cdef public object start_position, cycle_clock
    cdef double _service_timeout_s

    cdef void c_update(self, Measured measured, long long now_ns, double robot_time_s, bint fresh) except *
    cdef void c_describe(self, StateScalars* state) noexcept nogil
    cdef void _heed_requests(self, long long now_ns) except *
