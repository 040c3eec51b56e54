"""The control law with which pass-through servo modes follow their targets, with a look-ahead time and a
gain.

    q'' = gain (target - (q + lookahead q'))

The law pulls the position that the arm would have after the look-ahead time towards the target, as UR
documents for its servoj: the higher the gain (1/s²), the faster the reaction; the longer the look-ahead time
(s), the less overshoot. With ω = √gain, it is a second-order filter with the damping ratio ω lookahead / 2,
which follows a ramp with a lag of the look-ahead time, and reaches a target without error.
"""

from libc.math cimport cos, cosh, exp, fabs, sin, sinh, sqrt
from libc.string cimport memcpy

from cobot.arrays cimport doubles

import numpy as np


cdef class ServoLaw:
    """The control law, solved exactly for a target that is constant within a cycle. Real-time safe.

    Attributes:
        reference: shape (3, n): rad, rad/s, rad/s².
        active: whether the law is applied; if not, the reference is the target.
    """

    def __init__(self, int n, double period_s):
        self.reference = np.zeros((3, n))
        self.ref = doubles(self.reference, 3 * n)
        self.n = n
        self.active = False
        self.period_s = period_s
        self.lookahead_s = self.gain = 0.0

    def begin(self, state):
        """Start from this state, shape (3, n)."""
        np.copyto(self.reference, state)

    def tune(self, double lookahead_s, double gain):
        """From now on, use these parameters; 0 switches the law off."""
        self.c_tune(lookahead_s, gain)

    def follow(self, target):
        """Advance by one period towards a target, shape (3, n)."""
        rows = np.array(target, float)
        self.c_follow(doubles(rows, 3 * self.n))

    cdef void c_begin(self, const double* state) noexcept nogil:
        memcpy(self.ref, state, 3 * self.n * sizeof(double))

    cdef void c_tune(self, double lookahead_s, double gain) noexcept nogil:
        if lookahead_s == self.lookahead_s and gain == self.gain:
            return
        self.lookahead_s = lookahead_s
        self.gain = gain
        self.active = lookahead_s > 0.0 and gain > 0.0
        if self.active:
            find_transition(lookahead_s, gain, self.period_s, self.step)

    cdef void c_follow(self, const double* target) noexcept nogil:
        cdef int n = self.n, joint
        cdef double* ref = self.ref
        cdef double off, velocity
        if not self.active:
            memcpy(ref, target, 3 * n * sizeof(double))
            return
        for joint in range(n):
            off = ref[joint] - target[joint]
            velocity = ref[n + joint]
            ref[n + joint] = self.step[2] * off + self.step[3] * velocity
            off = self.step[0] * off + self.step[1] * velocity
            ref[2 * n + joint] = -self.gain * (off + self.lookahead_s * ref[n + joint])
            ref[joint] = off + target[joint]


def transition(double lookahead_s, double gain, double time_s):
    """Return the transition matrix of (q - target, q') for a time, shape (2, 2): the exponential of the law's
    matrix.
    """
    step = np.zeros((2, 2))
    find_transition(lookahead_s, gain, time_s, doubles(step, 4))
    return step


cdef void find_transition(double lookahead_s, double gain, double time_s, double* step) noexcept nogil:
    """Calculate the transition matrix. With A = [[0, 1], [-gain, -gain lookahead]], half its trace m and D =
    m² - gain, exp(A t) = exp(m t) (cosh(√D t) 1 + sinh(√D t) / √D (A - m 1)).
    """
    cdef double half = -0.5 * gain * lookahead_s
    cdef double discriminant = half * half - gain
    cdef double root = sqrt(fabs(discriminant)), scale = exp(half * time_s)
    cdef double even = 1.0, odd = time_s
    if root * time_s >= 1e-9:
        if discriminant > 0.0:
            even = cosh(root * time_s)
            odd = sinh(root * time_s) / root
        else:
            even = cos(root * time_s)
            odd = sin(root * time_s) / root
    step[0] = scale * (even - half * odd)
    step[1] = scale * odd
    step[2] = -scale * gain * odd
    step[3] = scale * (even + half * odd)
