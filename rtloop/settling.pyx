"""The distance of the arm from its commanded position, and the time for which it has been at rest."""

from libc.math cimport fabs, sqrt
from libc.string cimport memcpy

import numpy as np

from cobot.reasons import Reason, ReasonCode
from rtloop.results import ACCEPTED, Rejected

# Timeout for the arm to settle after the end of a motion, s of robot time.
SETTLE_LIMIT_S = 2.0
# Robot time after which the arm is considered at rest if its measured position has hardly changed. Some
# drivers report very noisy velocities, or keep reporting the last velocity of a motion.
REST_S = 1.0
# A measured position is misread if it moves, in one cycle, this many times as far as all joints can at full
# speed.
JUMP_FACTOR = 3.0


cdef class SettlingMonitor:
    """Compares the measured values with the command in `safety`.

    Real-time safe, except for the methods that return sentences.

    Attributes:
        settled: whether the arm has been at rest for long enough, at its commanded position or another
            permitted one.
        rests: whether the arm is settled, or its measured position has hardly changed for `REST_S`.
        misread: whether a physically impossible position was measured since the arm was last held.
        largest: largest deviation of a joint from its command, rad.
    """

    def __init__(self, settings, limits, Safety safety):
        rt = settings.rt
        self._limits, self._safety, self._dof = limits, safety, limits.dof
        self._largest_step = JUMP_FACTOR * rt.period_s * float(np.linalg.norm(limits.max_velocity))
        self._settle_position_rad = rt.settle_position_rad
        self._settle_velocity_rad_s = rt.settle_velocity_rad_s
        self._settle_time_s = rt.settle_time_s
        self._settle_cycles = _cycles(rt.settle_time_s, rt.period_s)
        self._rest_rad = rt.settle_velocity_rad_s * REST_S
        self._rest_cycles = _cycles(REST_S, rt.period_s)
        self.settle_limit_cycles = _cycles(SETTLE_LIMIT_S, rt.period_s)

    def believe_jumps(self):
        """Accept jumps of the measured position, because the device updates it only from time to time."""
        self._largest_step = float("inf")

    def check_tracking(self, position, double allowed):
        """Check that each joint is within `allowed`, rad, of its command, and that none was misread in this
        cycle.

        Args:
            position: measured joint positions, shape (dof,), rad.
        """
        error = self._errors()
        joint = int(np.abs(error).argmax())
        if abs(error[joint]) > allowed:
            unit = self._limits.unit(joint)
            name, off = self._limits.names[joint], abs(error[joint])
            words = (
                f"{name} is {off:.3f} {unit} from its commanded position "
                f"({position[joint]:.3f} instead of {self._safety.position[joint]:.3f} {unit}), "
                f"allowed: {allowed} {unit}"
            )
            return Rejected(Reason(words, ReasonCode.TRACKING, (name,), off, allowed, unit))
        if self._jump:
            words = (
                f"the measured position has jumped by {self._jump:.3f} {self._limits.units} within a cycle, "
                f"which is physically impossible"
            )
            return Rejected(Reason(words, ReasonCode.JUMP, value=self._jump, unit=self._limits.units))
        return ACCEPTED

    def explain_unrest(self, velocity):
        """Describe why the arm is not considered at rest.

        Args:
            velocity: measured joint velocities, shape (dof,), rad/s.
        """
        joint, limit = int(np.abs(velocity).argmax()), self._settle_velocity_rad_s
        if abs(velocity[joint]) <= limit:
            return f"{self._settle_time_s:g} s of rest are needed (rt.settle_time_s)"
        unit = self._limits.unit(joint, 1)
        return (
            f"{self._limits.names[joint]} moves at {abs(velocity[joint]):.4f} {unit}, the maximum at rest is "
            f"{limit:g} {unit} (rt.settle_velocity_rad_s)"
        )

    def explain_unsettled(self, desired, velocity):
        """Describe why the arm has not settled.

        Args:
            desired: end of the motion, shape (dof,), rad.
            velocity: measured joint velocities, shape (dof,), rad/s.
        """
        off = np.abs(desired - self._safety.position)
        joint = int(off.argmax())
        name, unit = self._limits.names[joint], self._limits.unit(joint)
        if off[joint] > self._settle_position_rad:
            words = (
                f"the safety layer keeps {name} at {self._safety.position[joint]:.4f} {unit}: "
                f"the motion ends at {desired[joint]:.4f} {unit}"
            )
            return Reason(words, ReasonCode.SAFETY_LAYER, (name,), off[joint], unit=unit)
        error = self._errors()
        far = np.abs(error).max() > self._settle_position_rad
        joint = int(np.abs(error if far else velocity).argmax())
        name, unit = self._limits.names[joint], self._limits.unit(joint)
        speed_unit = self._limits.unit(joint, 1)
        hint = "a load that is not declared can cause this (POST /robot/tool)"
        if not far:
            hint = (
                f"the maximum at rest is {self._settle_velocity_rad_s:g} {speed_unit} "
                "(rt.settle_velocity_rad_s)"
            )
        words = (
            f"not settled {SETTLE_LIMIT_S} s after the end of the motion: {name} is "
            f"{abs(error[joint]):.4f} {unit} away and moves at {velocity[joint]:.4f} {speed_unit}; {hint}"
        )
        return Reason(words, ReasonCode.NOT_SETTLED, (name,), abs(error[joint]), unit=unit)

    def _errors(self):
        return np.array([self._error[joint] for joint in range(self._dof)])

    cdef void c_begin(self) noexcept nogil:
        """Record that the arm begins to move or to stop."""
        self._still_cycles = self._unsettled_cycles = self._placed_cycles = 0
        self.settled = self.rests = False

    cdef void c_hold(self) noexcept nogil:
        """Record that the arm is commanded to hold its current position."""
        self.misread = False
        self._norm = 0.0

    cdef bint c_tracks(self, const double* position, double allowed) noexcept nogil:
        """Store the measured positions. Returns whether the arm may be at its commanded position."""
        cdef double square = 0.0, before = self._norm
        cdef bint misread
        cdef int joint
        self.largest = 0.0
        for joint in range(self._dof):
            self._error[joint] = position[joint] - self._safety.c_command[joint]
            square += self._error[joint] * self._error[joint]
            self.largest = max(self.largest, fabs(self._error[joint]))
        self._norm = sqrt(square)
        misread = fabs(self._norm - before) > self._largest_step
        self._jump = fabs(self._norm - before) if misread else 0.0
        if misread:
            self.misread = True
        return not (misread or self._norm > allowed)

    cdef void c_settle(
        self, const double* position, const double* velocity, bint may_be_still, bint anywhere
    ) noexcept nogil:
        """Measure how long the arm has been at rest.

        Args:
            position: measured joint positions, (dof,), rad.
            velocity: measured joint velocities, (dof,), rad/s.
            may_be_still: False while the arm is known to be moving.
            anywhere: whether the arm may be at any position.
        """
        cdef bint still = may_be_still and (anywhere or self.largest <= self._settle_position_rad)
        cdef bint moved = not may_be_still
        cdef int joint
        for joint in range(self._dof):
            still = still and fabs(velocity[joint]) <= self._settle_velocity_rad_s
            moved = moved or fabs(position[joint] - self._place[joint]) > self._rest_rad
        self._placed_cycles = 0 if moved else self._placed_cycles + 1
        if moved:
            memcpy(self._place, position, self._dof * sizeof(double))
        self._still_cycles = self._still_cycles + 1 if still else 0
        self.settled = self._still_cycles >= self._settle_cycles
        self.rests = self.settled or self._placed_cycles >= self._rest_cycles

    cdef bint c_check_end(self) noexcept nogil:
        """Whether the motion is over: the arm has settled, or the time for settling has passed."""
        self._unsettled_cycles += 1
        return self.settled or self._unsettled_cycles >= self.settle_limit_cycles


def _cycles(time_s, period_s):
    """Return the smallest number of periods that last at least this long."""
    cycles = int(time_s / period_s)
    return cycles if cycles * period_s >= time_s else cycles + 1
