"""Shortens a free polyline by cuts and by moving its corners: each must save length and is proven free."""

from libc.math cimport INFINITY, fmax, fmin, sqrt
from libc.stdint cimport uint64_t
from libc.string cimport memcmp, memcpy, memmove

import numpy as np

from cobot.arrays cimport MAX_DOF, doubles
from cobot.planners.monotonic cimport now_s
from cobot.planners.splitmix cimport uniform
from cobot.robot.clearance cimport Clearance

cdef enum:
    CHOICES = 12    # number of random cuts, of which the one that would save most is tried
    TRIALS = 200
    FAILURES = 50   # number of consecutive trials without a gain after which the search ends
    KEPT = 64       # number of edges that are remembered
    HALVINGS = 3    # with more, a corner gets nearer to an obstacle, where each check takes long

cdef double WORTH = 1e-3  # a cut that gains less than this share of the length is not tried


cdef struct Cut:
    int first           # the segments in which it begins and ends
    int last
    double begin[MAX_DOF]
    double end[MAX_DOF]


cdef struct Way:
    double* corners
    double* reached     # along the way to each corner
    int count
    int dof
    double* touching    # edges that are not free: both ends of each
    int touching_count
    double end_s        # no motion is checked after this time of the monotonic clock


def shorten(Clearance clearance, corners, uint64_t seed, double end_s=INFINITY):
    """See shortcut.pyi."""
    cdef Way way
    kept = _open(clearance, corners, end_s, &way)
    with nogil:
        _cut_short(clearance, &way, seed)
        _leave_out(clearance, &way)
    return kept[0][: way.count].copy()


def draw_in(Clearance clearance, corners, double end_s=INFINITY):
    """See shortcut.pyi."""
    cdef Way way
    cdef int index
    kept = _open(clearance, corners, end_s, &way)
    with nogil:
        for index in range(1, way.count - 1):
            _draw_in(clearance, &way, index)
        _leave_out(clearance, &way)
    return kept[0][: way.count].copy()


cdef _open(Clearance clearance, corners, double end_s, Way* way):
    """Fill in a path with these corners and space for more. Returns the arrays that it points to."""
    cdef int dof = clearance.dof
    given = np.array(corners, dtype=np.float64).reshape(-1, dof)
    room = np.zeros((len(given) + TRIALS + 2, dof))
    room[: len(given)] = given
    reached, touching = np.zeros(len(room)), np.empty(2 * KEPT * dof)
    way.corners, way.reached = doubles(room, room.size), doubles(reached, len(reached))
    way.count, way.dof, way.end_s = len(given), dof, end_s
    way.touching, way.touching_count = doubles(touching, len(touching)), 0
    if way.count < 2 or not np.isfinite(given).all():
        raise ValueError("a polyline of finite corners, at least two, is needed")
    clearance.enclose()
    return room, reached, touching


cdef void _cut_short(Clearance clearance, Way* way, uint64_t seed) noexcept nogil:
    cdef uint64_t state = seed
    cdef int failures = 0
    cdef int _trial
    cdef Cut cut
    _measure(way)
    for _trial in range(TRIALS):
        if way.count == 2 or failures == FAILURES or now_s() > way.end_s:
            return
        if _find_cut(way, &state, &cut) and _is_free(clearance, way, cut.begin, cut.end):
            _make(way, &cut)
            failures = 0
        else:
            failures += 1


cdef bint _is_free(Clearance clearance, Way* way, const double* begin, const double* end) noexcept nogil:
    """Whether an edge is free. Most cuts join corners, so the same edges are checked again; those that are
    not free are stored."""
    cdef size_t size = way.dof * sizeof(double)
    cdef double* ends = way.touching
    cdef int _edge
    for _edge in range(min(way.touching_count, <int>KEPT)):
        if memcmp(ends, begin, size) == 0 and memcmp(ends + way.dof, end, size) == 0:
            return False
        ends += 2 * way.dof
    if clearance.c_is_edge_free(begin, end):
        return True
    ends = way.touching + way.touching_count % KEPT * 2 * way.dof
    memcpy(ends, begin, size)
    memcpy(ends + way.dof, end, size)
    way.touching_count += 1
    return False


cdef bint _find_cut(const Way* way, uint64_t* state, Cut* best) noexcept nogil:
    """Find the most promising of several random cuts. Returns whether it is worth trying."""
    cdef double length = way.reached[way.count - 1]
    cdef double most = WORTH * length
    cdef double gain
    cdef double places[2]
    cdef Cut cut
    cdef bint found = False
    cdef int _choice, k
    for _choice in range(CHOICES):
        for k in range(2):
            # Corners themselves are often the best ends of a cut.
            if uniform(state) < 0.5:
                places[k] = way.reached[<int>(uniform(state) * way.count)]
            else:
                places[k] = uniform(state) * length
        if places[1] < places[0]:
            places[0], places[1] = places[1], places[0]
        cut.first, cut.last = _at(way, places[0], cut.begin), _at(way, places[1], cut.end)
        gain = places[1] - places[0] - _apart(cut.begin, cut.end, way.dof)
        if gain > most:
            most, found = gain, True
            memcpy(best, &cut, sizeof(Cut))
    return found


cdef int _at(const Way* way, double place, double* out) noexcept nogil:
    """The segment and the point at a length along the path."""
    cdef int segment = 0
    cdef int i
    cdef double share
    cdef const double* here
    while segment < way.count - 2 and way.reached[segment + 1] <= place:
        segment += 1
    share = (place - way.reached[segment]) / fmax(way.reached[segment + 1] - way.reached[segment], 1e-12)
    here = &way.corners[segment * way.dof]
    for i in range(way.dof):
        out[i] = here[i] + fmin(share, 1.0) * (here[way.dof + i] - here[i])
    return segment


cdef void _make(Way* way, const Cut* cut) noexcept nogil:
    """Apply a cut: its ends become corners, and the corners between them are removed."""
    cdef int dof = way.dof
    cdef int kept = cut.first + 1
    cdef int rest = cut.last + 1
    cdef bint begins = _apart(&way.corners[cut.first * dof], cut.begin, dof) > 1e-9
    cdef bint ends = _apart(&way.corners[rest * dof], cut.end, dof) > 1e-9
    cdef int count = way.count - rest
    memmove(
        &way.corners[(kept + begins + ends) * dof], &way.corners[rest * dof], count * dof * sizeof(double)
    )
    if begins:
        memcpy(&way.corners[kept * dof], cut.begin, dof * sizeof(double))
    if ends:
        memcpy(&way.corners[(kept + begins) * dof], cut.end, dof * sizeof(double))
    way.count = kept + begins + ends + count
    _measure(way)


cdef void _leave_out(Clearance clearance, Way* way) noexcept nogil:
    """Remove each corner whose neighbours can be joined by a free motion."""
    cdef int dof = way.dof
    cdef int index = 1
    cdef int count
    while index < way.count - 1 and now_s() <= way.end_s:
        if _is_free(clearance, way, &way.corners[(index - 1) * dof], &way.corners[(index + 1) * dof]):
            count = way.count - index - 1
            memmove(&way.corners[index * dof], &way.corners[(index + 1) * dof], count * dof * sizeof(double))
            way.count -= 1
            if index > 1:
                index -= 1
        else:
            index += 1


cdef void _draw_in(Clearance clearance, Way* way, int index) noexcept nogil:
    """Move a corner towards the line between its neighbours."""
    cdef int dof = way.dof
    cdef double* here = &way.corners[index * dof]
    cdef const double* before = here - dof
    cdef const double* after = here + dof
    cdef double foot[MAX_DOF]
    cdef double moved[MAX_DOF]
    cdef double along = 0.0
    cdef double square = 1e-12
    cdef double low = 0.0
    cdef double high = 1.0
    cdef double share
    cdef int i, _halving
    for i in range(dof):
        along += (here[i] - before[i]) * (after[i] - before[i])
        square += (after[i] - before[i]) * (after[i] - before[i])
    for i in range(dof):
        foot[i] = before[i] + fmax(0.0, fmin(1.0, along / square)) * (after[i] - before[i])
    for _halving in range(HALVINGS):
        if now_s() > way.end_s:
            break
        share = 0.5 * (low + high)
        for i in range(dof):
            moved[i] = here[i] + share * (foot[i] - here[i])
        if clearance.c_is_edge_free(before, moved) and clearance.c_is_edge_free(moved, after):
            low = share
        else:
            high = share
    for i in range(dof):
        here[i] += low * (foot[i] - here[i])


cdef void _measure(Way* way) noexcept nogil:
    cdef int i
    way.reached[0] = 0.0
    for i in range(1, way.count):
        way.reached[i] = way.reached[i - 1] + _apart(
            &way.corners[(i - 1) * way.dof], &way.corners[i * way.dof], way.dof
        )


cdef double _apart(const double* first, const double* second, int dof) noexcept nogil:
    cdef double square = 0.0
    cdef int i
    for i in range(dof):
        square += (first[i] - second[i]) * (first[i] - second[i])
    return sqrt(square)
