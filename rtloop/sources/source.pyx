"""What a streaming session makes of its client's targets: a joint reference for every cycle."""

import numpy as np

from cobot.arrays cimport MAX_DOF, doubles
from cobot.ipc.seqlock cimport Block

from cobot.errors import InputError
from cobot.ipc.layout import Intervention


# A reference that is further ahead of the arm than this waits for it.
cdef double LEAD_RAD = 0.2


cdef Setpoint setpoint_fields(Block block):
    """Where a reader of the setpoint block finds its fields."""
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
    """Where a reader of the chunk block finds its fields."""
    cdef Chunk fields
    fields.session = <unsigned long long*>block.c_field("session")
    fields.number = <unsigned long long*>block.c_field("number")
    fields.count = <unsigned long long*>block.c_field("count")
    fields.times_s = <double*>block.c_field("times_s")
    fields.points = <double*>block.c_field("points")
    fields.point_size = block.data.dtype["points"].shape[1]
    return fields


cdef object flaw_of(int code):
    """What is wrong with a target, for Python: an `Intervention`, or None."""
    return None if code == FINE else Intervention(code - 1)


cdef class Source:
    """Follows a stream of targets. Everything that begins with `c_` is real-time safe.

    Attributes:
        reference: where the joints should be in this cycle, shape (3, dof): rad, rad/s, rad/s².
        heading: a joint step towards the last target, shape (dof,), rad: only its direction counts.
    """

    def __init__(self, int dof):
        if dof > MAX_DOF:
            raise InputError(f"{dof} joints are too many for a stream, possible are {MAX_DOF}")
        self.dof = dof
        self.reference = np.zeros((3, dof))
        self.ref = doubles(self.reference, 3 * dof)

    def explain(self):
        """Why the last target was NOT_FINITE: what streamed it was no number."""
        return ""

    def begin(self, command):
        """Go on from what is commanded, shape (3, dof)."""
        rows = np.array(command, float)
        self.c_begin(doubles(rows, 3 * self.dof))

    def take(self, Block setpoint not None, double interval_s):
        """The target in a block's private copy, so long after the last; what is wrong with it, or None."""
        cdef Setpoint fields = setpoint_fields(setpoint)
        return flaw_of(self.c_take(&fields, interval_s))

    def advance(self, external_effort, wrench):
        """One period on; the surroundings exert torques (dof,), N·m, and a wrench (6,) in the base frame."""
        torques, exerted = np.array(external_effort, float), np.array(wrench, float)
        self.c_advance(doubles(torques, self.dof), doubles(exerted, 6))

    def follow(self, command):
        """What the safety layer has made of the reference, shape (3, dof)."""
        rows = np.array(command, float)
        self.c_follow(doubles(rows, 3 * self.dof))

    @property
    def heading(self):
        step = np.zeros(self.dof)
        self.c_heading(doubles(step, self.dof))
        return step

    cdef void c_begin(self, const double* command) noexcept nogil:
        """Go on from what is commanded, shape (3, dof)."""

    cdef int c_take(self, const Setpoint* setpoint, double interval_s) noexcept nogil:
        """A new target, so long after the last one; what is wrong with it, or FINE."""
        return FINE

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        """One period on; the surroundings exert torques (dof,), N·m, and a wrench (6,) in the base frame."""

    cdef void c_follow(self, const double* command) noexcept nogil:
        """What the safety layer has made of the reference, shape (3, dof)."""

    cdef void c_heading(self, double* step) noexcept nogil:
        """A joint step towards the last target, shape (dof,), rad: only its direction counts."""

    cdef void c_exert(self, double* rows) noexcept nogil:
        """Fill in what the client wants exerted besides its motion, in zeros: torques of the joints (dof,),
        N·m, or a wrench at the TCP (6,) in the base frame, N and N·m.
        """
