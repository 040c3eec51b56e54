"""Random numbers for compiled planners: splitmix64 (G. Steele, D. Lea, C. Flood, 2014, doi
10.1145/2660193.2660195).
"""

from libc.stdint cimport uint64_t


cdef inline double uniform(uint64_t* state) noexcept nogil:
    """In [0, 1)."""
    cdef uint64_t z
    state[0] += <uint64_t>0x9E3779B97F4A7C15
    z = state[0]
    z = (z ^ (z >> 30)) * <uint64_t>0xBF58476D1CE4E5B9
    z = (z ^ (z >> 27)) * <uint64_t>0x94D049BB133111EB
    z = z ^ (z >> 31)
    return <double>(z >> 11) * (1.0 / 9007199254740992.0)
