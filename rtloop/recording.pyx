"""What rtloop leaves of each cycle for the recorder: a record in a ring, and why modes changed."""

from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memcpy

from cobot.arrays cimport bytes_of, checked_dof, doubles
from rtloop.publisher cimport StateScalars
from rtloop.safety.limiter cimport Safety

import numpy as np

from cobot.errors import LayoutError
from cobot.ipc.layout import Intervention
from cobot.ipc.records import HEAD, TIMED
from cobot.ipc.shm import encoded
from rtloop.backends import JOINT_ROWS

cdef int _joint_rows = JOINT_ROWS
cdef long long LONGEST_NS = 2**32 - 1


cdef class CycleRecorder:
    """Writes the fresh ring and the notes. Real-time safe."""

    def __init__(self, memory):
        """
        Raises:
            InputError: more joints than compiled code has room for.
            LayoutError: `RecordHead` is not what the layout says.
        """
        _require_layout()
        self._dof = checked_dof(memory.dof)
        self._fresh, self._notes = memory.fresh, memory.notes
        self._fresh.touch()
        self._notes.touch()
        self._record, self._note = np.zeros((), self._fresh.dtype), np.zeros((), self._notes.dtype)
        self._note["number"] = self._notes.newest
        self._c_record = bytes_of(self._record, self._fresh.dtype.itemsize)
        self._head = <RecordHead*>self._c_record
        self._exact = <double*>(self._c_record + <Py_ssize_t>self._fresh.dtype.fields["position"][1])
        self._single = <float*>(self._c_record + <Py_ssize_t>self._fresh.dtype.fields["velocity"][1])
        self._kinds = len(Intervention)
        self._counts = np.zeros(self._kinds, np.uint64)
        self._counted_before = <uint64_t*>bytes_of(self._counts, self._kinds * sizeof(uint64_t))
        self._counted = -1
        self._head.note = <uint32_t>self._note["number"]

    cdef void c_heed(self, Safety safety, str reason, int mode, uint64_t cycle, int64_t now_ns) except *:
        cdef int kind
        self._head.interventions = 0
        if safety.counted != self._counted:
            for kind in range(self._kinds):
                if self._counted >= 0 and safety.c_interventions[kind] != self._counted_before[kind]:
                    self._head.interventions |= 1u << kind
                self._counted_before[kind] = safety.c_interventions[kind]
            self._counted = safety.counted
        if reason is not self._reason:
            self._reason = reason
            self._write_note(reason, mode, cycle, now_ns)

    def _write_note(self, reason, mode, cycle, now_ns):
        """On an event only: a mode, or why it is what it is, is another one."""
        note = self._note
        note["number"] += 1
        note["cycle"], note["monotonic_ns"], note["mode"] = cycle, now_ns, mode
        note["reason"] = encoded(reason)
        self._notes.put(note)
        self._head.note = <uint32_t>note["number"]

    cdef void c_record(
        self,
        const StateScalars* state,
        const double* measured_values,
        const double* command,
        const double* tcp,
        const long long* phases_ns,
        bint fresh,
    ) noexcept nogil:
        cdef RecordHead* head = self._head
        cdef float* single = self._single
        cdef int index, dof = self._dof, measured = _joint_rows * dof + 12
        head.number = state.cycle
        head.monotonic_ns = state.monotonic_ns
        head.measured_monotonic_ns = state.measured_monotonic_ns
        head.motion_id = state.motion_id
        head.path_time_s = state.path_time_s
        head.path_rate = state.path_rate
        head.session = state.session
        head.overruns = <uint32_t>state.overruns
        for index in range(PHASES):
            head.phases_ns[index] = <uint32_t>min(max(phases_ns[index], 0), LONGEST_NS)
        head.mode, head.motion_result = state.mode, state.motion_result
        head.settled, head.fresh = state.settled, fresh
        memcpy(self._exact, measured_values, dof * sizeof(double))
        memcpy(self._exact + dof, command, dof * sizeof(double))
        for index in range(dof, measured):  # velocity, efforts, wrench, sensor
            single[index - dof] = <float>measured_values[index]
        single += measured - dof
        for index in range(dof):
            single[index] = <float>command[dof + index]
        for index in range(7):
            single[dof + index] = <float>tcp[index]
        self._fresh.c_put(self._c_record)

    def heed(self, Safety safety, reason, mode, cycle, now_ns):
        """`c_heed`."""
        self.c_heed(safety, reason, mode, cycle, now_ns)

    def record(self, scalars, measured_values, command, tcp, phases_ns, *, fresh):
        """`c_record` of arrays; the scalars are a record of `cobot.ipc.layout.STATE_SCALARS`."""
        cdef StateScalars* state = <StateScalars*>bytes_of(scalars, sizeof(StateScalars))
        cdef double* values = doubles(measured_values, _joint_rows * self._dof + 12)
        cdef long long* phases = <long long*>bytes_of(phases_ns, PHASES * sizeof(long long))
        self.c_record(state, values, doubles(command, 3 * self._dof), doubles(tcp, 7), phases, fresh)


cdef int _require_layout() except -1:
    """That the fields of `RecordHead` are those of the layout, in their order and of their kind."""
    cdef RecordHead head
    record = np.zeros((), list(HEAD))
    if record.dtype.itemsize != sizeof(RecordHead) or len(TIMED) != PHASES:
        raise LayoutError(f"a record's head takes {record.dtype.itemsize} bytes in the layout alone")
    for number, (name, *_) in enumerate(HEAD, start=1):
        record[name] = number
    memcpy(&head, bytes_of(record, sizeof(RecordHead)), sizeof(RecordHead))
    expected = {name: record[name].tolist() for name, *_ in HEAD}
    if head != expected:
        raise LayoutError("a record's head is another one in the layout")
    return 0
