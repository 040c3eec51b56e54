"""Quintic polynomials of several coordinates, for other compiled modules. See polynomials.pyx."""

cdef enum:
    ORDER = 6  # Coefficients of a quintic, in ascending powers.
    DERIVATIVES = 4  # A polynomial and its first three derivatives.

cdef void quintic_between(
    const double* start, const double* end, int n, double duration_s, double* coefficients
) noexcept nogil
cdef void quintic_at(
    const double* coefficients, int n, double time_s, double duration_s, double* out
) noexcept nogil
cdef void quintic_peaks(
    const double* coefficients, int n, int order, double duration_s, int places, double* peaks
) noexcept nogil
