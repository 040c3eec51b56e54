"""Publishes the state in each cycle, and statistics of all cycles."""

from libc.math cimport NAN
from libc.stdint cimport UINT64_MAX, int64_t, uint32_t, uint64_t
from libc.string cimport memcpy, memmove

from cobot.arrays cimport MAX_DOF, bytes_of, checked_dof, doubles
from cobot.ipc.seqlock cimport Block
from cobot.ipc.state_block cimport count_measured
from rtloop.clock cimport monotonic_ns

import numpy as np

from cobot.errors import LayoutError
from cobot.ipc.layout import HISTOGRAM_BUCKETS, GripperObject, Intervention, Phase
from cobot.ipc.state_fields import STATE_SCALARS
from cobot.ipc.shm import encoded
from cobot.reasons import SEPARATOR, Reason

STATISTICS_CYCLES = 500
EFFORT_RATE_S = 0.01
"""Time constant of the effort's derivative."""

cdef uint64_t _statistics_cycles = STATISTICS_CYCLES
cdef int _phases = len(Phase)
cdef int _buckets = HISTOGRAM_BUCKETS
cdef int _kinds = len(Intervention)
cdef uint64_t _objects = len(GripperObject)
cdef uint64_t UNKNOWN = GripperObject.UNKNOWN


cdef class StatePublisher:
    """Writes the state block. Real-time safe."""

    def __init__(self, memory, model):
        """
        Raises:
            InputError: the robot has more joints than compiled code supports.
            LayoutError: `StateScalars` differs from the layout.
        """
        cdef Block block = memory.state
        _require_layout()
        self._dof = checked_dof(memory.dof)
        self.block = block
        self._chain = model.chain
        self._smoothing = memory.period_s / EFFORT_RATE_S
        self._per_period = 1.0 / memory.period_s
        self.scalars = <StateScalars*>block.c_unsigned("cycle")
        # The measured values are adjacent in the block, as are the three commanded rows.
        self._measured = block.c_doubles("position")
        self._velocity, self._effort = block.c_doubles("velocity"), block.c_doubles("effort")
        self._commanded = block.c_doubles("commanded_position")
        self._tcp, self._tcp_velocity = block.c_doubles("tcp"), block.c_doubles("tcp_velocity")
        self._effort_rate = block.c_doubles("effort_rate")
        self._interventions = block.c_unsigned("interventions")
        self._intervened_ns = block.c_signed("intervened_ns")
        self._counted = -1
        self._gripper = memory.gripper
        self._gripper_values = self._gripper.c_doubles("gripper_width")
        self._gripper_seen = UINT64_MAX

    cdef void c_heed_gripper(self, StateScalars* scalars) noexcept nogil:
        cdef uint64_t sequence = self._gripper.c_sequence()
        if sequence == self._gripper_seen or not self._gripper.c_try_read():
            return
        self._gripper_seen = sequence
        # The fields of the gripper are adjacent, in the order of its block.
        memcpy(&scalars.gripper_width, self._gripper_values, self._gripper.mapped.size)
        if scalars.gripper_monotonic_ns == 0:
            scalars.gripper_width = scalars.gripper_commanded_width = scalars.gripper_force = NAN
        if scalars.gripper_object >= _objects:
            scalars.gripper_object = UNKNOWN

    cdef void c_heed(self, Safety safety, object reason) except *:
        """Copy the counts of the safety layer, and the reason for the mode, when they have changed."""
        if safety.counted != self._counted:
            self._counted = safety.counted
            memcpy(self._interventions, safety.c_interventions, _kinds * sizeof(uint64_t))
            memcpy(self._intervened_ns, safety.c_intervened_ns, _kinds * sizeof(int64_t))
        if reason is not self._reason:
            self._reason = reason
            self._write(Reason.of_text(reason))

    def _write(self, reason):
        """Write a reason into the state block."""
        state = self.block.data
        state["reason"], state["reason_of"] = encoded(reason), encoded(SEPARATOR.join(reason.of))
        state["reason_code"], state["reason_unit"] = reason.code.encode(), reason.unit.encode()
        state["reason_values"] = reason.value, reason.limit

    cdef void c_publish(
        self, const StateScalars* scalars, const double* measured, const double* command
    ) noexcept nogil:
        memmove(self.scalars, scalars, sizeof(StateScalars))
        memcpy(self._measured, measured, count_measured(self._dof) * sizeof(double))
        memcpy(self._commanded, command, 3 * self._dof * sizeof(double))
        self._find_tcp()
        self._smooth_effort_rate()
        self.scalars.monotonic_ns = monotonic_ns()
        self.block.c_publish()

    cdef void _find_tcp(self) noexcept nogil:
        """Calculate pose and velocity of the TCP from the measured values."""
        cdef double jacobian[6 * MAX_DOF]
        cdef double rate
        cdef int row, joint
        self._chain.c_forward_jacobian(self._measured, self._tcp, jacobian)
        for row in range(6):
            rate = 0.0
            for joint in range(self._dof):
                rate += jacobian[row * self._dof + joint] * self._velocity[joint]
            self._tcp_velocity[row] = rate

    cdef void _smooth_effort_rate(self) noexcept nogil:
        cdef double change
        cdef int joint
        for joint in range(self._dof):
            change = (self._effort[joint] - self._effort_before[joint]) * self._per_period
            self._effort_before[joint] = self._effort[joint]
            self._effort_rate[joint] += (change - self._effort_rate[joint]) * self._smoothing

    def publish_values(self, scalars, measured, command):
        """Like `c_publish`, with arrays. The scalars are a record of
        `cobot.ipc.state_fields.STATE_SCALARS`.
        """
        cdef StateScalars* given = <StateScalars*>bytes_of(scalars, sizeof(StateScalars))
        cdef double* values = doubles(measured, count_measured(self._dof))
        self.c_publish(given, values, doubles(command, 3 * self._dof))


cdef class Statistics:
    """Histograms of the cycle's phases, in the statistics block. Real-time safe."""

    def __init__(self, memory):
        cdef Block block = memory.statistics
        self._block = block
        self._info, self._device = memory.info, memory.device
        self._counts = <uint32_t*>block.c_field("histogram")
        self._max_us = block.c_doubles("max_us")
        self._published_cycles = block.c_unsigned("cycles")

    def count(self, int phase, long long duration_ns):
        """Count one more sample of a phase."""
        self.c_count(phase, duration_ns)

    def end_cycle(self):
        """Publish the statistics twice a second. They are not published in each cycle, because copying the
        large block takes computing time.

        The robot and device descriptions are also published, although they do not change, to repair damage by
        another writer. All are published in different cycles, so that no cycle takes too long.
        """
        self.c_end_cycle()

    cdef void c_count(self, int phase, long long duration_ns) noexcept nogil:
        cdef long long microseconds = duration_ns // 1000
        cdef long long bucket = microseconds if 0 <= microseconds < _buckets else _buckets - 1
        if not 0 <= phase < _phases:
            return
        self._counts[phase * _buckets + bucket] += 1
        if microseconds > self._max_us[phase]:
            self._max_us[phase] = <double>microseconds

    cdef void c_end_cycle(self) noexcept nogil:
        self._cycles += 1
        if self._cycles % _statistics_cycles == 0:
            self._published_cycles[0] = self._cycles
            self._block.c_publish()
        elif self._cycles % _statistics_cycles == _statistics_cycles // 2:
            self._info.c_publish()
        elif self._cycles % _statistics_cycles == _statistics_cycles // 4:
            self._device.c_publish()


cdef int _require_layout() except -1:
    """Require that the fields of `StateScalars` match the layout in order and type."""
    cdef StateScalars scalars
    record = np.zeros((), list(STATE_SCALARS))
    if record.dtype.itemsize != sizeof(StateScalars):
        raise LayoutError("the size of the state's scalars differs from the layout")
    for number, (name, kind) in enumerate(STATE_SCALARS):
        record[name] = -number if kind == "i8" else number
    memcpy(&scalars, bytes_of(record, sizeof(StateScalars)), sizeof(StateScalars))
    if scalars != {name: record[name].item() for name, _ in STATE_SCALARS}:
        raise LayoutError("the state's scalars differ from those in the layout")
    return 0
