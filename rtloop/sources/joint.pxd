from cobot.arrays cimport MAX_DOF
from rtloop.generators.chunks cimport ChunkInterpolator
from rtloop.generators.interpolation cimport Interpolator
from rtloop.generators.online_trajectory cimport OnlineTrajectory
from rtloop.sources.source cimport Chunk, Source


cdef class JointSource(Source):
    cdef Interpolator interpolator
    cdef ChunkInterpolator chunks
    cdef OnlineTrajectory end  # Interpolator for the motion after the last waypoint of a chunk.
    cdef bint settles
    cdef long long entered
    cdef bint chunked, spoilt_chunk, looks_ahead, states_motion
    cdef double time_s, period_s, command_s
    cdef double last[MAX_DOF]
    cdef double fastest[MAX_DOF]
    cdef double heading[MAX_DOF]
    cdef tuple names

    cdef int c_take_chunk(self, const Chunk* chunk, double robot_time_s) noexcept nogil
    cdef bint c_chunk_jumps(self, const double* times_s, const double* points, int count) noexcept nogil
    cdef void c_copy_reference(self) noexcept nogil
    cdef void c_bound(self, const double* target, bint moves) noexcept nogil
    cdef void c_bound_chunk(self) noexcept nogil
    cdef void c_settle(self) noexcept nogil
    cdef long long c_late(self) noexcept nogil
    cdef long long c_starved(self) noexcept nogil
