"""Addresses of arrays, for compiled code that works on memory without Python objects.

The buffer is released as soon as its address has been taken. So the caller must keep the array alive as an
attribute, and must never resize it.
"""

from cpython.buffer cimport PyBUF_C_CONTIGUOUS, PyBUF_FORMAT, PyBUF_WRITABLE
from cpython.buffer cimport PyBuffer_Release, PyObject_CheckBuffer, PyObject_GetBuffer
from libc.stdint cimport uintptr_t
from libc.string cimport strcmp

from cobot.errors import InputError


cdef double* doubles(object array, Py_ssize_t size) except NULL:
    """The first number of a C-contiguous, writable array of at least `size` float64.

    Raises:
        TypeError: the object is not an array, or its numbers are not float64.
        ValueError: the array is too short, not contiguous, read-only or not aligned.
    """
    cdef Py_buffer view
    cdef void* address
    cdef Py_ssize_t found
    cdef bint are_doubles
    _open(array, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE | PyBUF_FORMAT, &view)
    address = view.buf
    found = view.len // <Py_ssize_t>sizeof(double)
    are_doubles = view.format != NULL and strcmp(view.format, b"d") == 0
    PyBuffer_Release(&view)
    if not are_doubles:
        raise TypeError(f"an array of float64 is needed, not one of {_numbers_of(array)}")
    if <uintptr_t>address % sizeof(double):
        raise ValueError("the array's numbers are not aligned in memory")
    _require(address, found, size, "numbers")
    return <double*>address


cdef char* bytes_of(object buffer, Py_ssize_t size) except NULL:
    """The first byte of a C-contiguous, writable buffer of at least `size` bytes.

    Raises:
        TypeError: the object is not a buffer.
        ValueError: the buffer is too short, not contiguous or read-only.
    """
    cdef Py_buffer view
    _open(buffer, PyBUF_C_CONTIGUOUS | PyBUF_WRITABLE, &view)
    cdef char* address = <char*>view.buf
    cdef Py_ssize_t found = view.len
    PyBuffer_Release(&view)
    _require(address, found, size, "bytes")
    return address


cdef int checked_dof(Py_ssize_t dof) except -1:
    """Check a number of joints and return it.

    Raises:
        InputError: the number is above the maximum of compiled code.
    """
    if dof > MAX_DOF:
        raise InputError(f"{dof} joints, allowed: up to {MAX_DOF}")
    return <int>dof


cdef int _open(object buffer, int flags, Py_buffer* view) except -1:
    if not PyObject_CheckBuffer(buffer):
        raise TypeError(f"an array or a buffer is needed, not {type(buffer).__name__}")
    try:
        PyObject_GetBuffer(buffer, view, flags)
    except (BufferError, ValueError) as error:
        raise ValueError(f"a contiguous, writable array is needed: {error}") from None
    return 0


cdef int _require(void* address, Py_ssize_t found, Py_ssize_t size, str unit) except -1:
    if address == NULL:
        raise ValueError("an empty buffer has no address")
    if found < size:
        raise ValueError(f"at least {size} {unit} are needed, not {found}")
    return 0


cdef str _numbers_of(object array):
    return str(getattr(array, "dtype", None) or memoryview(array).format)


def address_of_doubles(array: object, size: int) -> int:
    """The address that `doubles` gives to compiled code, as a number."""
    return <uintptr_t>doubles(array, size)


def address_of_bytes(buffer: object, size: int) -> int:
    """The address that `bytes_of` gives to compiled code, as a number."""
    return <uintptr_t>bytes_of(buffer, size)
