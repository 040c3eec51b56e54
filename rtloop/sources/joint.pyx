"""Converts joint targets to a joint reference for every cycle."""

from libc.math cimport fabs
from libc.string cimport memcpy

from cobot.arrays cimport MAX_DOF
from cobot.ipc.seqlock cimport Block
from rtloop.generators.interpolation cimport clipped
from rtloop.sources.source cimport (
    FINE,
    JUMP,
    LATE,
    NOT_FINITE,
    Chunk,
    Setpoint,
    Source,
    chunk_fields,
    flaw_of,
)
from rtloop.sources.target_checks cimport SLACK_S, c_is_finite, c_joint_jump

from cobot.ipc.layout import CHUNK_POINTS, Interpolation
from rtloop.generators.chunks import ChunkInterpolator
from rtloop.generators.factory import make_interpolator
from rtloop.generators.online_trajectory import OnlineTrajectory
from rtloop.generators.target_range import TargetRange

cdef enum:
    MAX_CHUNK = 64
cdef double MAX_CHUNK_S = 600.0

assert CHUNK_POINTS == MAX_CHUNK, "the format of the chunk block of cobot.ipc.layout is not this module's"


cdef class JointSource(Source):
    """A source of references that follow joint targets by interpolation, or chunks of timed targets,
    whichever has arrived last.
    """

    def __init__(self, kind, limits, safe_velocity, double period_s, double command_s):
        """
        Args:
            kind: kind of interpolation between targets.
            limits: limits of the reference.
            safe_velocity: maximum velocity of the robot itself, shape (dof,), rad/s. A step that needs a
                higher velocity is a jump.
            period_s: cycle period.
            command_s: interval between two targets.
        """
        super().__init__(limits.dof)
        rates = limits.max_velocity, limits.max_acceleration, limits.max_jerk
        self.interpolator = make_interpolator(kind, limits.dof, period_s, *rates)
        self.chunks = ChunkInterpolator(limits.dof, period_s, *rates)
        self.end = OnlineTrajectory(limits.dof, period_s, *rates)
        self.targets = TargetRange(limits.dof, period_s, command_s)
        self.chunked = False
        # whether the motion continues after a target; otherwise the arm stops at each target
        self.looks_ahead = kind is not Interpolation.NONE
        self.time_s = 0.0  # Time of the reference along the chunks.
        self.names = tuple(limits.names)
        self.period_s = period_s
        self.command_s = command_s
        for joint in range(self.dof):
            self.fastest[joint] = safe_velocity[joint]
            self.last[joint] = self.heading[joint] = 0.0
        self.spoilt_chunk = False

    def explain(self):
        return f"a streamed {'chunk' if self.spoilt_chunk else 'joint target'} is not finite"

    @property
    def late(self):
        """Number of waypoints that were dropped because their time had passed."""
        return self.c_late()

    @property
    def starved(self):
        """Number of times that the waypoints of a chunk ran out."""
        return self.c_starved()

    def take_chunk(self, Block chunk not None, double robot_time_s):
        """From now on, follow the timed targets in a block's private copy. Returns their flaw, or None."""
        cdef Chunk fields = chunk_fields(chunk)
        return flaw_of(self.c_take_chunk(&fields, robot_time_s))

    cdef void c_begin(self, const double* command) noexcept nogil:
        self.chunked = False
        self.interpolator.c_begin(command)
        self.states_motion = self.settles = False
        self.targets.c_begin(command)
        if not self.looks_ahead:
            self.targets.c_open()
        memcpy(self.last, command, self.dof * sizeof(double))
        self.c_copy_reference()

    cdef int c_take(self, const Setpoint* setpoint, double interval_s) noexcept nogil:
        cdef const double* target = setpoint.joints
        cdef const double* velocity = setpoint.joint_velocity if setpoint.feed_forward[0] else NULL
        cdef double stated[MAX_DOF]
        cdef bint moves = False
        cdef int joint
        if not c_is_finite(target, self.dof) or (
            velocity != NULL and not c_is_finite(velocity, self.dof)
        ):
            self.spoilt_chunk = False
            return NOT_FINITE
        if c_joint_jump(target, self.last, self.dof, interval_s, self.fastest) >= 0:
            return JUMP
        if self.chunked:
            self.c_begin(self.ref)
        if velocity != NULL:  # A target that does not change has no velocity, even if one is stated.
            for joint in range(self.dof):
                stated[joint] = 0.0 if self.targets.c_stands(joint, target[joint]) else velocity[joint]
                moves = moves or stated[joint] != 0.0
            velocity = stated
        self.c_bound(target, moves)
        for joint in range(self.dof):
            self.heading[joint] = target[joint] - self.ref[joint]
            self.last[joint] = target[joint]
        self.interpolator.c_aim(target, velocity, self.command_s)
        self.c_copy_reference()
        return FINE

    cdef void c_bound(self, const double* target, bint moves) noexcept nogil:
        """Set the target range. If the client states the velocity of its target, the reference may go beyond
        the target.
        """
        if moves:
            self.targets.c_open_at(target)
        else:
            self.targets.c_update(target)
        self.states_motion = moves

    cdef int c_take_chunk(self, const Chunk* chunk, double robot_time_s) noexcept nogil:
        """From now on, follow timed targets. Returns their flaw, or FINE."""
        cdef double points[MAX_CHUNK * MAX_DOF]
        cdef int dof = self.dof, joint, index
        cdef int count = <int>min(chunk.count[0], <unsigned long long>MAX_CHUNK)
        for index in range(count):
            memcpy(points + index * dof, chunk.points + index * chunk.point_size, dof * sizeof(double))
        if not (c_is_finite(chunk.times_s, count) and c_is_finite(points, count * dof)):
            self.spoilt_chunk = True
            return NOT_FINITE
        self.time_s = robot_time_s - self.period_s  # The reference is that of the previous cycle.
        if count and chunk.times_s[count - 1] > robot_time_s + MAX_CHUNK_S:
            return LATE
        if self.c_chunk_jumps(chunk.times_s, points, count):
            return JUMP
        if not self.chunked:
            self.chunks.c_begin(self.ref)
            if not self.looks_ahead or self.states_motion:
                self.targets.c_begin(self.ref)
        if self.chunks.c_take(chunk.times_s, points, count, self.time_s) != 0:
            return LATE
        self.chunked = True
        self.settles = self.states_motion = False
        self.c_copy_reference()
        for joint in range(dof):
            self.last[joint] = points[(count - 1) * dof + joint]
            self.heading[joint] = self.last[joint] - self.ref[joint]
        return FINE

    cdef bint c_chunk_jumps(self, const double* times_s, const double* points, int count) noexcept nogil:
        """Whether the future targets would require more than a joint's maximum velocity."""
        cdef double at_s = self.time_s - SLACK_S
        cdef const double* here = self.ref
        cdef const double* there
        cdef int index, joint
        for index in range(count):
            if not times_s[index] > self.time_s:
                continue
            there = points + index * self.dof
            for joint in range(self.dof):
                if fabs(there[joint] - here[joint]) > self.fastest[joint] * (times_s[index] - at_s):
                    return True
            here = there
            at_s = times_s[index]
        return False

    cdef void c_settle(self) noexcept nogil:
        """Move from the last reference to rest at the last waypoint.

        The state is first limited, because an erratic chunk may have led far beyond the limits.
        """
        cdef double state[3 * MAX_DOF]
        cdef int joint, dof = self.dof
        memcpy(state, self.ref, 3 * dof * sizeof(double))
        for joint in range(dof):
            state[dof + joint] = clipped(state[dof + joint], self.end.max_velocity[joint])
            state[2 * dof + joint] = clipped(state[2 * dof + joint], self.end.max_acceleration[joint])
        self.end.c_settle(state, self.last)
        # the last waypoint was passed in the same cycle in which it became the next one
        self.targets.c_update(self.last)
        self.settles = True

    cdef void c_bound_chunk(self) noexcept nogil:
        """Set the target range to the future waypoints, all of which are known. The next one is the
        target.
        """
        cdef const double* waypoint = self.chunks.c_waypoint(0)
        cdef int ahead = 0
        if waypoint != NULL and self.chunks.entered != self.entered:
            self.entered = self.chunks.entered
            self.targets.c_update(waypoint)
            self.targets.c_expect(self.chunks.c_step_s())
        while waypoint != NULL:
            self.targets.c_include(waypoint)
            ahead += 1
            waypoint = self.chunks.c_waypoint(ahead)

    cdef void c_advance(self, const double* external_effort, const double* wrench) noexcept nogil:
        cdef long long starved
        if self.chunked:
            self.time_s += self.period_s
            self.targets.c_advance()
            starved = self.chunks.starved
            self.chunks.c_advance(self.time_s)
            if self.chunks.starved != starved:
                self.c_settle()
            if self.settles:
                self.end.c_advance()
                memcpy(self.chunks.ref, self.end.ref, 3 * self.dof * sizeof(double))
            self.c_bound_chunk()
        else:
            self.targets.c_advance()
            self.interpolator.c_advance()
        self.c_copy_reference()

    cdef void c_copy_reference(self) noexcept nogil:
        """Copy the reference from the interpolator that is in use."""
        cdef const double* followed = self.chunks.ref if self.chunked else self.interpolator.ref
        memcpy(self.ref, followed, 3 * self.dof * sizeof(double))

    cdef void c_heading(self, double* step) noexcept nogil:
        memcpy(step, self.heading, self.dof * sizeof(double))

    cdef long long c_late(self) noexcept nogil:
        """Like `late`, for compiled code."""
        return self.chunks.late

    cdef long long c_starved(self) noexcept nogil:
        """Like `starved`, for compiled code."""
        return self.chunks.starved
