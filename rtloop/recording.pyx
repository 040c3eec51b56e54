"""Writes data for the recorder: a record of each cycle in a ring, and the reasons for mode changes."""

from libc.stdint cimport int64_t, uint32_t, uint64_t
from libc.string cimport memcpy

from cobot.arrays cimport bytes_of, checked_dof
from rtloop.safety.limiter cimport Safety

import numpy as np

from cobot.errors import LayoutError
from cobot.ipc.layout import Intervention
from cobot.ipc.shm import encoded
from cobot.ipc.state_fields import RECORDED, state_dtype

cdef long long MAX_NS = 2**32 - 1
_COPIES = {
    ("u8", "u8"): COPY_WORDS,
    ("i8", "i8"): COPY_WORDS,
    ("f8", "f8"): COPY_WORDS,
    ("f8", "f4"): COPY_SINGLES,
    ("u8", "u4"): COPY_UINT32,
    ("u8", "u1"): COPY_UINT8,
}
"""The kind of copy for each pair of types of a field in the state block and in the record."""


cdef class CycleRecorder:
    """Writes the ring of cycle records, and the notes. Real-time safe."""

    def __init__(self, memory):
        """
        Raises:
            InputError: the robot has more joints than compiled code supports.
            LayoutError: there are too many recorded fields, or a field has an unknown kind.
        """
        checked_dof(memory.dof)
        self._fresh, self._notes = memory.fresh, memory.notes
        self._fresh.touch()
        self._notes.touch()
        self._record, self._note = np.zeros((), self._fresh.dtype), np.zeros((), self._notes.dtype)
        self._note["number"] = self._notes.newest
        self._c_record = bytes_of(self._record, self._fresh.dtype.itemsize)
        at = {name: offset for name, (_, offset) in self._fresh.dtype.fields.items()}
        self._number = <uint64_t*>(self._c_record + <Py_ssize_t>at["number"])
        self._note_number = <uint32_t*>(self._c_record + <Py_ssize_t>at["note"])
        self._interventions = <uint32_t*>(self._c_record + <Py_ssize_t>at["interventions"])
        self._phases_ns = <uint32_t*>(self._c_record + <Py_ssize_t>at["phases_ns"])
        self._is_fresh = <uint8_t*>(self._c_record + <Py_ssize_t>at["fresh"])
        self._find_copies(memory.dof, at)
        self._kinds = len(Intervention)
        self._counts = np.zeros(self._kinds, np.uint64)
        self._counted_before = <uint64_t*>bytes_of(self._counts, self._kinds * sizeof(uint64_t))
        self._counted = -1
        self._note_number[0] = <uint32_t>self._note["number"]

    def _find_copies(self, dof, at):
        """Determine the offsets of the recorded bytes in the state and in the record."""
        state = state_dtype(dof)
        if len(RECORDED) > MAX_COPIES:
            raise LayoutError(f"{len(RECORDED)} fields of the state are recorded, allowed: {MAX_COPIES}")
        for number, field in enumerate(RECORDED):
            kind = _COPIES.get((field.kind, field.recorded))
            if kind is None:
                raise LayoutError(
                    f"the field {field.name} of the state is {field.kind}, not recorded as {field.recorded}"
                )
            self._copies[number].kind = kind
            self._copies[number].source = state.fields[field.name][1]
            self._copies[number].target = at[field.name]
            self._copies[number].count = np.prod(field.shape(dof), dtype=int)
        self._copied = len(RECORDED)
        self._cycle_at = state.fields["cycle"][1]

    cdef void c_heed(self, Safety safety, object reason, int mode, uint64_t cycle, int64_t now_ns) except *:
        cdef int kind
        self._interventions[0] = 0
        if safety.counted != self._counted:
            for kind in range(self._kinds):
                if self._counted >= 0 and safety.c_interventions[kind] != self._counted_before[kind]:
                    self._interventions[0] |= 1u << kind
                self._counted_before[kind] = safety.c_interventions[kind]
            self._counted = safety.counted
        if reason is not self._reason:
            self._reason = reason
            self._write_note(reason, mode, cycle, now_ns)

    def _write_note(self, reason, mode, cycle, now_ns):
        """Write a note. Called only if the mode or its reason has changed."""
        note = self._note
        note["number"] += 1
        note["cycle"], note["monotonic_ns"], note["mode"] = cycle, now_ns, mode
        note["reason"] = encoded(reason)
        self._notes.put(note)
        self._note_number[0] = <uint32_t>note["number"]

    cdef void c_record(self, const char* state, const long long* phases_ns, bint fresh) noexcept nogil:
        cdef int index
        self._number[0] = (<const uint64_t*>(state + self._cycle_at))[0]
        for index in range(self._copied):
            copy_field(&self._copies[index], state, self._c_record)
        for index in range(PHASES):
            self._phases_ns[index] = <uint32_t>min(max(phases_ns[index], 0), MAX_NS)
        self._is_fresh[0] = fresh
        self._fresh.c_put(self._c_record)

    def heed(self, Safety safety, reason, mode, cycle, now_ns):
        """Like `c_heed`, for Python."""
        self.c_heed(safety, reason, mode, cycle, now_ns)

    def record(self, state, phases_ns, *, fresh):
        """Like `c_record`, with a record of `cobot.ipc.state_fields.state_dtype`."""
        cdef long long* phases = <long long*>bytes_of(phases_ns, PHASES * sizeof(long long))
        self.c_record(bytes_of(state, state.dtype.itemsize), phases, fresh)


cdef void copy_field(const FieldCopy* copy, const char* state, char* record) noexcept nogil:
    cdef const char* source = state + copy.source
    cdef char* target = record + copy.target
    cdef int index
    if copy.kind == COPY_WORDS:
        memcpy(target, source, copy.count * 8)
    elif copy.kind == COPY_SINGLES:
        for index in range(copy.count):
            (<float*>target)[index] = <float>(<const double*>source)[index]
    elif copy.kind == COPY_UINT32:
        (<uint32_t*>target)[0] = <uint32_t>(<const uint64_t*>source)[0]
    else:
        (<uint8_t*>target)[0] = <uint8_t>(<const uint64_t*>source)[0]
