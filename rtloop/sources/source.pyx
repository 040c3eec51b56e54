"""Sources convert a client's streamed targets into a joint reference for every cycle."""

import numpy as np

from cobot.arrays cimport MAX_DOF, doubles
from cobot.ipc.seqlock cimport Block

from cobot.errors import InputError
from cobot.ipc.layout import Intervention


# Maximum distance of the reference ahead of the arm. At this distance it waits for the arm.
cdef double LEAD_RAD = 0.2


cdef Setpoint setpoint_fields(Block block):
    """Return pointers to the fields of the setpoint block."""
    cdef Setpoint fields
    fields.session = <unsigned long long*>block.c_field("session")
    fields.number = <unsigned long long*>block.c_field("number")
    fields.feed_forward = <unsigned long long*>block.c_field("feed_forward")
    fields.joints = <double*>block.c_field("joints")
    fields.joint_velocity = <double*>block.c_field("joint_velocity")
    fields.pose = <double*>block.c_field("pose")
    fields.wrench = <double*>block.c_field("wrench")
    fields.twist = <double*>block.c_field("twist")
    fields.move = <unsigned long long*>block.c_field("move")
    fields.move_pose = <double*>block.c_field("move_pose")
    fields.move_duration_s = <double*>block.c_field("move_duration_s")
    fields.cancel = <unsigned long long*>block.c_field("cancel")
    return fields


cdef Chunk chunk_fields(Block block):
    """Return pointers to the fields of the chunk block."""
    cdef Chunk fields
    fields.session = <unsigned long long*>block.c_field("session")
    fields.number = <unsigned long long*>block.c_field("number")
    fields.count = <unsigned long long*>block.c_field("count")
    fields.times_s = <double*>block.c_field("times_s")
    fields.points = <double*>block.c_field("points")
    fields.point_size = block.data.dtype["points"].shape[1]
    return fields


cdef object flaw_of(int code):
    """Return the flaw of a target for Python: an `Intervention`, or None."""
    return None if code == FINE else Intervention(code - 1)


cdef class Source:
    """Follows a stream of targets. Methods with the prefix `c_` are real-time safe.

    Attributes:
        reference: joint reference of this cycle, shape (3, dof): rad, rad/s, rad/s².
        heading: a joint step towards the last target, shape (dof,), rad. Only its direction matters.
    """

    def __init__(self, int dof):
        if dof > MAX_DOF:
            raise InputError(f"{dof} joints are too many for a stream, allowed: up to {MAX_DOF}")
        self.dof = dof
        self.reference = np.zeros((3, dof))
        self.ref = doubles(self.reference, 3 * dof)

    def explain(self):
        """The reason why the last target was NOT_FINITE: the name of the streamed value."""
        return ""

    def begin(self, command):
        """Continue from the commanded state, shape (3, dof)."""
        rows = np.array(command, float)
        self.c_begin(doubles(rows, 3 * self.dof))

    def take(self, Block setpoint not None, double interval_s):
        """Process the target in a block's private copy, which comes this interval after the last one. Returns
        its flaw, or None.
        """
        cdef Setpoint fields = setpoint_fields(setpoint)
        return flaw_of(self.c_take(&fields, interval_s))

    def advance(self, external_effort, wrench):
        """Advance by one period. Arguments: external torques on the joints (dof,), N·m, and the external
        wrench at the TCP (6,) in the base frame.
        """
        torques, exerted = np.array(external_effort, float), np.array(wrench, float)
        self.c_advance(doubles(torques, self.dof), doubles(exerted, 6))

    def follow(self, command):
        """Note the command that the safety layer has made of the reference, shape (3, dof)."""
        rows = np.array(command, float)
        self.c_follow(doubles(rows, 3 * self.dof))

    @property
    def heading(self):
        step = np.zeros(self.dof)
        self.c_heading(doubles(step, self.dof))
        return step

    cdef void c_begin(self, const double* command) noexcept nogil:
        """Continue from the commanded state, shape (3, dof)."""

    cdef int c_take(self, const Setpoint* setpoint, double interval_s) noexcept nogil:
        """Process a new target, which comes this interval after the last one. Returns its flaw, or FINE."""
        return FINE

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        """Advance by one period. The arguments are the external torques on the joints, (dof,), N·m, and the
        external wrench at the TCP, (6,), in the base frame.
        """

    cdef void c_follow(self, const double* command) noexcept nogil:
        """Record the command that the safety layer has derived from the reference, shape (3, dof)."""

    cdef void c_heading(self, double* step) noexcept nogil:
        """Calculate a joint step towards the last target, shape (dof,), rad. Only its direction matters."""

    cdef void c_exert(self, double* rows) noexcept nogil:
        """Write the effort that the client requests in addition to its motion to `rows`, which contains
        zeros: joint torques, (dof,), N·m, or a wrench at the TCP, (6,), in the base frame, N and N·m.
        """
