"""The power of the drives. A stop of category 1 switches it off; a reset switches it on again, at once or in
steps.
"""

from rtloop.backends.compiled cimport Measured

import numpy as np

from rtloop.backends import BackendError, Stepwise
from rtloop.results import ACCEPTED, LATER, Rejected


cdef class Drives:
    """Two states: whether the drives are on, and the progress of a reset in steps. Only the methods of this
    class change them. Methods with the prefix `c_` are real-time safe. The others may take long, because
    nothing is moving.
    """

    def __init__(self, backend, device, int dof, long long limit_cycles):
        """
        Args:
            device: the `rtloop.device.DeviceWatch`, which stores whether the drives are off.
            limit_cycles: maximum number of cycles for which a stop of category 1 waits for the arm to settle.
        """
        self._backend, self._device, self._dof, self._limit_cycles = backend, device, dof, limit_cycles
        self._stepwise = isinstance(backend, Stepwise)
        self._power = OFF if device.drives_off else ON
        self._reset = NO_RESET

    @property
    def off(self):
        return self.c_off()

    @property
    def resetting(self):
        return self.c_resetting()

    def switch_off_at_rest(self):
        """Begin a stop of category 1."""
        if self._power == ON:
            self._power = COMING_OFF
        self._resting_cycles = 0

    def switch_off(self):
        """Switch the drives off after a stop of category 1. Returns `Rejected` if they stay on because of a
        fault.
        """
        self._power = ON
        if 1 not in self._device.capabilities.stops:
            return ACCEPTED
        try:
            self._backend.disable()
        except BackendError as exc:
            return Rejected(f"the drives could not be switched off: {exc}")
        self._set_power(OFF)
        return ACCEPTED

    def begin_reset(self, number, stops, Measured measured):
        """Switch the drives on and read the arm's position, at once or in steps.

        Args:
            number: command number.
            stops: number of requested stops when the command was read.
            measured: the values read are written into it.

        Returns:
            `Later` if the device is enabled in steps; `step_reset` then executes them.
        """
        if self._stepwise:
            self._number, self._stops, self._reset = number, stops, RECOVERING
            self._device.is_enabling = True
            return LATER
        try:
            self._backend.enable()
        except BackendError as exc:
            return Rejected(f"the robot cannot be enabled: {exc}")
        return self._take_over(measured)

    def is_overtaken(self, unsigned long long stops):
        """Whether a stop has been requested since the reset began."""
        return stops != self._stops

    def step_reset(self, Measured measured):
        """Execute one step of a reset: first the device recovers, then its drives are switched on. The cycle
        continues to answer the device's packets. Returns `Later` if more steps follow.
        """
        try:
            if self._reset == RECOVERING:
                if self._backend.recover_step():
                    self._reset = ENABLING
                return LATER
            if not self._backend.enable_step():
                return LATER
        except BackendError as exc:
            return Rejected(f"the robot cannot be enabled: {exc}")
        return self._take_over(measured)

    def end_reset(self):
        """End the reset, whatever its result. If it has not switched the drives on yet, they are switched
        off, because the device may still execute the request. Returns the number of its command.
        """
        self._reset = NO_RESET
        self._device.is_enabling = False
        if self._power == OFF:
            try:
                self._backend.disable()
            except BackendError:
                self._set_power(ON)  # Unknown, so assume that they are on.
        return self._number

    def _take_over(self, Measured measured):
        found = Measured(self._dof)
        self._set_power(ON)
        try:
            self._backend.read(found)
        except BackendError as exc:
            return Rejected(f"the robot cannot be enabled: {exc}")
        if not np.isfinite(found.values).all():
            return Rejected("the robot reports a value that is not finite")
        np.copyto(measured.values, found.values)
        return ACCEPTED

    def _set_power(self, Power power):
        self._power = power
        self._device.set_drives(off=power == OFF)

    cdef bint c_off(self) noexcept nogil:
        return self._power == OFF

    cdef bint c_resetting(self) noexcept nogil:
        """Whether a reset in steps is in progress."""
        return self._reset != NO_RESET

    cdef bint c_loose(self) noexcept nogil:
        """Whether the arm may be at any position, so that the commanded position must follow it."""
        return self._power == OFF or self._reset != NO_RESET

    cdef bint c_count_down(self, bint settled) noexcept nogil:
        """Whether to switch the drives off in this cycle of a stop of category 1, because the arm is at rest
        or has not settled in time. Call it once per cycle.
        """
        if self._power != COMING_OFF:
            return False
        self._resting_cycles += 1
        return settled or self._resting_cycles >= self._limit_cycles
