"""What the cycle and a compiled backend have in common: the measured values, and reading and writing without
Python.
"""

from types import FunctionType

from cpython.object cimport PyObject_GenericSetAttr

import numpy as np

from cobot.arrays cimport checked_dof, doubles
from cobot.ipc.state_block cimport EXTERNAL_EFFORT_ROW, MEASURED_ROWS, count_measured

from cobot.ipc.state_fields import MEASURED


cdef class Measured:
    def __init__(self, dof: int) -> None:
        self.dof = checked_dof(dof)
        self.values = np.zeros(count_measured(dof))
        self.c_values = doubles(self.values, count_measured(dof))
        self.joints = self.values[:MEASURED_ROWS * dof].reshape(MEASURED_ROWS, dof)
        self.external = self.values[EXTERNAL_EFFORT_ROW * dof:MEASURED_ROWS * dof + 6]
        start = 0
        for field in MEASURED:
            end = start + field.shape(dof)[0]
            PyObject_GenericSetAttr(self, field.name, self.values[start:end])
            start = end

    def __setattr__(self, name: str, value: object) -> None:
        # `measured.position += offset` is an assignment, too. It must not replace the array, which is a view
        # of the buffer.
        kept, given = getattr(self, name), np.asarray(value)
        if given.shape != kept.shape:
            raise ValueError(f"measured.{name} is given the shape {given.shape}, expected {kept.shape}")
        kept[...] = given


cdef class CompiledBackend:
    def __cinit__(self, *_, **__) -> None:
        # Whether a Python subclass overrides `read` or `write`. If so, that method is called in each cycle.
        self.read_in_python = isinstance(getattr(type(self), "read", None), FunctionType)
        self.write_in_python = isinstance(getattr(type(self), "write", None), FunctionType)

    def try_read(self, Measured measured not None) -> bool:
        return self.c_read(self._values_of(measured)) == 0

    def try_write(self, command: object) -> bool:
        return self.c_write(doubles(command, 3 * self._dof)) == 0

    cdef double* _values_of(self, Measured measured) except NULL:
        """Return the values as a C array. Raises ValueError if they are for an arm with a different number of
        joints.
        """
        if measured.dof != self._dof:
            raise ValueError(f"measured values of {measured.dof} joints, not {self._dof}")
        return measured.c_values

    cdef int c_read(self, double* values) noexcept nogil:
        return 1

    cdef int c_write(self, const double* command) noexcept nogil:
        return 1
