"""Linear algebra on small dense matrices, row by row, without allocation.

No argument may share memory with another. A NaN ends no loop late: all are bounded.
"""

from libc.math cimport fabs, sqrt

from cobot.arrays cimport MAX_DOF


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


cdef inline void tridiagonalise(double* a, int n, double* beside, double* vectors) noexcept nogil:
    """A = Q T Qᵀ with a symmetric T whose diagonal becomes A's and whose elements beside it are `beside`,
    n - 1 of them: n - 2 Householder reflections, by which the columns of `vectors` are mixed too (Golub and
    Van Loan, Matrix Computations, algorithm 8.3.1). At the most MAX_DOF rows.
    """
    cdef double normal[MAX_DOF]  # of the mirror, not of length 1
    cdef double image[MAX_DOF]
    cdef double square, first, length, share, product
    cdef int i, j, k
    for k in range(n - 2):
        square, first = 0.0, a[(k + 1) * n + k]
        for i in range(k + 2, n):
            normal[i] = a[i * n + k]
            square += normal[i] * normal[i]
        beside[k] = first
        if square == 0.0:
            continue
        length = sqrt(first * first + square)
        if first > 0.0:
            length = -length
        beside[k], normal[k + 1], share = length, first - length, 1.0 / (length * (length - first))
        product = 0.0
        for i in range(k + 1, n):
            image[i] = 0.0
            for j in range(k + 1, n):
                image[i] += a[i * n + j] * normal[j]
            image[i] *= share
            product += image[i] * normal[i]
        for i in range(k + 1, n):
            image[i] -= 0.5 * share * product * normal[i]
        for i in range(k + 1, n):
            for j in range(k + 1, n):
                a[i * n + j] -= normal[i] * image[j] + image[i] * normal[j]
        for i in range(n):
            product = 0.0
            for j in range(k + 1, n):
                product += vectors[i * n + j] * normal[j]
            for j in range(k + 1, n):
                vectors[i * n + j] -= share * product * normal[j]
    if n > 1:
        beside[n - 2] = a[n * n - 2]


cdef inline void chase_bulge(
    double* values, double* beside, int begin, int last, int n, double* vectors
) noexcept nogil:
    """One step of the QR iteration on the rows `begin` to `last` of a symmetric tridiagonal matrix, with
    Wilkinson's shift (Golub and Van Loan, algorithm 8.3.2).
    """
    cdef double half = 0.5 * (values[last - 1] - values[last])
    cdef double off = beside[last - 1]
    cdef double root = sqrt(half * half + off * off)
    cdef double x = values[begin] - values[last] + off * off / (half + (root if half >= 0.0 else -root))
    cdef double z = beside[begin]
    cdef double length, c, s, first, second
    cdef int i, k
    for k in range(begin, last):
        length = sqrt(x * x + z * z)
        c, s = (x / length, z / length) if length > 0.0 else (1.0, 0.0)
        if k > begin:
            beside[k - 1] = length
        first, second, off = values[k], values[k + 1], beside[k]
        values[k] = c * c * first + 2.0 * c * s * off + s * s * second
        values[k + 1] = s * s * first - 2.0 * c * s * off + c * c * second
        beside[k] = c * s * (second - first) + (c * c - s * s) * off
        if k + 1 < last:
            x, z = beside[k], s * beside[k + 1]
            beside[k + 1] *= c
        for i in range(n):
            first, second = vectors[i * n + k], vectors[i * n + k + 1]
            vectors[i * n + k] = c * first + s * second
            vectors[i * n + k + 1] = c * second - s * first


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


cdef inline bint divides(const double* values, const double* beside, int row) noexcept nogil:
    """Whether nothing that counts couples a row to the one before."""
    return fabs(beside[row - 1]) <= 1.1e-16 * (fabs(values[row - 1]) + fabs(values[row]))


cdef inline void eigen_symmetric(double* a, int n, double* values, double* vectors) noexcept nogil:
    """Eigenvalues of a symmetric A, n × n with n up to MAX_DOF, ascending, and eigenvectors of length 1 in
    the columns.

    A tridiagonal matrix first, which the QR iteration makes diagonal: for six rows half the work of Jacobi's
    rotations, and as exact as LAPACK. A is overwritten. The vectors' signs, and the vectors of equal values,
    are not those of LAPACK.
    """
    cdef double beside[MAX_DOF]
    cdef int i, begin, _step
    cdef int last = n - 1
    for i in range(n * n):
        vectors[i] = 0.0
    for i in range(n):
        vectors[i * n + i] = 1.0
    tridiagonalise(a, n, beside, vectors)
    for i in range(n):
        values[i] = a[i * n + i]
    for _step in range(30 * n):
        while last > 0 and divides(values, beside, last):
            last -= 1
        if last == 0:
            break
        begin = last - 1
        while begin > 0 and not divides(values, beside, begin):
            begin -= 1
        chase_bulge(values, beside, begin, last, n, vectors)
    sort_eigen(n, values, vectors)
