"""Linear algebra on small dense matrices, row by row, without allocation.

No argument may share memory with another. A NaN ends no loop late: all are bounded.
"""

from libc.math cimport fabs, sqrt


cdef inline bint cholesky_factor(double* a, int n) noexcept nogil:
    """A = L Lᵀ for a symmetric positive definite A, n × n: its lower triangle becomes L.

    False, with A half done, if it is not positive definite or not finite.
    """
    cdef int i, j, k
    cdef double rest
    for i in range(n):
        for j in range(i + 1):
            rest = a[i * n + j]
            for k in range(j):
                rest -= a[i * n + k] * a[j * n + k]
            if i > j:
                a[i * n + j] = rest / a[j * n + j]
            elif rest > 0.0 and rest - rest == 0.0:
                a[i * n + i] = sqrt(rest)
            else:
                return False
    return True


cdef inline void cholesky_substitute(const double* l, int n, double* b) noexcept nogil:
    """Solves L Lᵀ x = b, in place."""
    cdef int i, k
    for i in range(n):
        for k in range(i):
            b[i] -= l[i * n + k] * b[k]
        b[i] /= l[i * n + i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= l[k * n + i] * b[k]
        b[i] /= l[i * n + i]


cdef inline bint cholesky_solve(double* a, int n, double* b) noexcept nogil:
    """Solves A x = b for a symmetric positive definite A, n × n: b becomes x, A's lower triangle its factor.

    False, with b as it was, if A is not positive definite or not finite.
    """
    if not cholesky_factor(a, n):
        return False
    cholesky_substitute(a, n, b)
    return True


cdef inline void jacobi_rotate(double* a, int n, int p, int q, double* vectors) noexcept nogil:
    """One Jacobi rotation, which makes A[p, q] zero (Golub and Van Loan, Matrix Computations, 8.5.2)."""
    cdef double off = a[p * n + q]
    cdef double ratio = 0.5 * (a[q * n + q] - a[p * n + p]) / off
    cdef double t = 1.0 / (fabs(ratio) + sqrt(1.0 + ratio * ratio))
    cdef double c, s, first, second
    cdef int k
    if ratio < 0.0:
        t = -t
    c = 1.0 / sqrt(1.0 + t * t)
    s = t * c
    a[p * n + p] -= t * off
    a[q * n + q] += t * off
    a[p * n + q] = a[q * n + p] = 0.0
    for k in range(n):
        if k != p and k != q:
            first, second = a[k * n + p], a[k * n + q]
            a[k * n + p] = a[p * n + k] = c * first - s * second
            a[k * n + q] = a[q * n + k] = s * first + c * second
        first, second = vectors[k * n + p], vectors[k * n + q]
        vectors[k * n + p] = c * first - s * second
        vectors[k * n + q] = s * first + c * second


cdef inline void sort_eigen(int n, double* values, double* vectors) noexcept nogil:
    """Ascending, by selection."""
    cdef int i, j, k, least
    cdef double kept
    for i in range(n - 1):
        least = i
        for j in range(i + 1, n):
            if values[j] < values[least]:
                least = j
        if least != i:
            kept = values[i]
            values[i] = values[least]
            values[least] = kept
            for k in range(n):
                kept = vectors[k * n + i]
                vectors[k * n + i] = vectors[k * n + least]
                vectors[k * n + least] = kept


cdef inline void eigen_symmetric(double* a, int n, double* values, double* vectors) noexcept nogil:
    """Eigenvalues of a symmetric A, n × n, ascending, and eigenvectors of length 1 in the columns.

    Cyclic Jacobi: each sweep makes every element beside the diagonal zero once; after four to ten sweeps
    none is left that counts. A is overwritten. The vectors' signs, and the vectors of equal values, are not
    those of LAPACK.
    """
    cdef int i, p, q, _sweep
    cdef bint done
    for i in range(n * n):
        vectors[i] = 0.0
    for i in range(n):
        vectors[i * n + i] = 1.0
    for _sweep in range(30):
        done = True
        for p in range(n - 1):
            for q in range(p + 1, n):
                # Beside such a diagonal it would not change the last bit of an eigenvalue.
                if fabs(a[p * n + q]) > 1e-18 * (fabs(a[p * n + p]) + fabs(a[q * n + q])):
                    jacobi_rotate(a, n, p, q, vectors)
                    done = False
        if done:
            break
    for i in range(n):
        values[i] = a[i * n + i]
    sort_eigen(n, values, vectors)
