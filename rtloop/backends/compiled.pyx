"""What the cycle and a compiled backend share: the measured values, reading and writing without Python."""

from types import FunctionType

import numpy as np

from cobot.arrays cimport checked_dof, doubles

JOINT_ROWS = MEASURED_ROWS


cdef class Measured:
    def __init__(self, dof: int) -> None:
        self.dof = checked_dof(dof)
        joints = MEASURED_ROWS * dof
        self.values = np.zeros(joints + 12)
        self.c_values = doubles(self.values, joints + 12)
        self.joints = self.values[:joints].reshape(MEASURED_ROWS, dof)
        self.position, self.velocity, self.effort, self.desired_effort, self.external_effort = self.joints
        self.wrench = self.values[joints:][:6]
        self.external = self.values[(MEASURED_ROWS - 1) * dof:joints + 6]
        self.sensor = self.values[joints:][6:]

    def __setattr__(self, name: str, value: object) -> None:
        # `measured.position += offset` assigns too: the array stays the part of the buffer that it is.
        kept, given = getattr(self, name), np.asarray(value)
        if given.shape != kept.shape:
            raise ValueError(f"measured.{name} is given the shape {given.shape}, it has to be {kept.shape}")
        kept[...] = given


cdef class CompiledBackend:
    def __cinit__(self, *_, **__) -> None:
        # A subclass in Python that reads or writes in its own way is asked, each time.
        self.read_in_python = isinstance(getattr(type(self), "read", None), FunctionType)
        self.write_in_python = isinstance(getattr(type(self), "write", None), FunctionType)

    def try_read(self, Measured measured not None) -> bool:
        return self.c_read(self._values_of(measured)) == 0

    def try_write(self, command: object) -> bool:
        return self.c_write(doubles(command, 3 * self._dof)) == 0

    cdef double* _values_of(self, Measured measured) except NULL:
        """Raises ValueError: they are those of an arm with other joints."""
        if measured.dof != self._dof:
            raise ValueError(f"measured values of {measured.dof} joints, not {self._dof}")
        return measured.c_values

    cdef int c_read(self, double* values) noexcept nogil:
        return 1

    cdef int c_write(self, const double* command) noexcept nogil:
        return 1
