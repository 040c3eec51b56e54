"""Linear algebra on small dense matrices, row by row, without allocation.

Arguments must not share memory. All loops are bounded, so a NaN cannot prolong them.
"""

from libc.math cimport fabs, sqrt

from cobot.arrays cimport MAX_DOF

cdef enum:
    # For a matrix with MAX_DOF rows: the QR iteration needs about two steps for each eigenvalue.
    MAX_TURNS = 3 * MAX_DOF * MAX_DOF

cdef struct Turn:
    # A rotation of a row and the next one.
    int row
    double cosine, sine


cdef inline bint cholesky_factor(double* a, int n) noexcept nogil:
    """A = L Lᵀ for a symmetric positive definite A, n × n: its lower triangle becomes L.

    False, with A partly overwritten, if A is not positive definite or not finite.
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

    False, with b unchanged, if A is not positive definite or not finite.
    """
    if not cholesky_factor(a, n):
        return False
    cholesky_substitute(a, n, b)
    return True


cdef inline void tridiagonalise(
    double* a, int n, double* values, double* sides, double* normals, double* shares
) noexcept nogil:
    """A = Q T Qᵀ with a symmetric tridiagonal T: `values` is its diagonal, `sides` the n - 1 elements next to
    it. Q is the product of n - 2 Householder reflections 1 - share normal normalᵀ. The normals are in the
    rows of A, from two elements right of the diagonal on (Golub and Van Loan, Matrix Computations, algorithm
    8.3.1). At most MAX_DOF rows.
    """
    cdef double image[MAX_DOF]
    cdef double square, first, length, share, product
    cdef double* normal
    cdef int i, j, k
    for k in range(n - 2):
        square, first, normal = 0.0, a[(k + 1) * n + k], normals + k * n
        for i in range(k + 2, n):
            normal[i] = a[i * n + k]
            square += normal[i] * normal[i]
        sides[k], shares[k] = first, 0.0
        if square == 0.0:
            continue
        length = sqrt(first * first + square)
        if first > 0.0:
            length = -length
        sides[k], normal[k + 1], share = length, first - length, 1.0 / (length * (length - first))
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
        shares[k] = share
    for i in range(n):
        values[i] = a[i * n + i]
    if n > 1:
        sides[n - 2] = a[n * n - 2]


cdef inline void reflect(
    const double* normals, const double* shares, int n, int k, double* row
) noexcept nogil:
    """A row of n elements, reflected by the reflection k of `tridiagonalise`."""
    cdef const double* normal = normals + k * n
    cdef double product = 0.0
    cdef int i
    if shares[k] == 0.0:
        return
    for i in range(k + 1, n):
        product += row[i] * normal[i]
    for i in range(k + 1, n):
        row[i] -= shares[k] * product * normal[i]


cdef inline bint divides(const double* values, const double* sides, int row) noexcept nogil:
    """Whether the element that couples a row to the previous one is negligible."""
    return fabs(sides[row - 1]) <= 1.1e-16 * (fabs(values[row - 1]) + fabs(values[row]))


cdef inline void chase_bulge(
    double* values, double* sides, int begin, int last, Turn* turns
) noexcept nogil:
    """One step of the QR iteration on the rows `begin` to `last` of a symmetric tridiagonal matrix, with
    Wilkinson's shift (Golub and Van Loan, algorithm 8.3.2): last - begin rotations, each of a row and the
    next one.
    """
    cdef double half = 0.5 * (values[last - 1] - values[last])
    cdef double off = sides[last - 1]
    cdef double root = sqrt(half * half + off * off)
    cdef double x = values[begin] - values[last] + off * off / (half + (root if half >= 0.0 else -root))
    cdef double z = sides[begin]
    cdef double length, inverse, c, s, first, second
    cdef int k
    for k in range(begin, last):
        length = sqrt(x * x + z * z)
        c, s = 1.0, 0.0
        if length > 0.0:
            inverse = 1.0 / length
            c, s = x * inverse, z * inverse
        if k > begin:
            sides[k - 1] = length
        first, second, off = values[k], values[k + 1], sides[k]
        values[k] = c * c * first + 2.0 * c * s * off + s * s * second
        values[k + 1] = s * s * first - 2.0 * c * s * off + c * c * second
        sides[k] = c * s * (second - first) + (c * c - s * s) * off
        if k + 1 < last:
            x, z = sides[k], s * sides[k + 1]
            sides[k + 1] *= c
        turns[k - begin].row, turns[k - begin].cosine, turns[k - begin].sine = k, c, s


cdef inline void rotate(const Turn* turn, double direction, double* row) noexcept nogil:
    """Rotate a row of elements as `chase_bulge` does. Direction -1 reverses the rotation of direction 1."""
    cdef int k = turn.row
    cdef double first = row[k], second = row[k + 1], s = direction * turn.sine
    row[k] = turn.cosine * first + s * second
    row[k + 1] = turn.cosine * second - s * first


cdef inline int diagonalise(double* values, double* sides, int n, Turn* turns) noexcept nogil:
    """Replace `values` by the eigenvalues of a symmetric tridiagonal matrix, in any order. Returns the number
    of rotations, at most MAX_TURNS.
    """
    cdef int begin, last = n - 1, count = 0
    while last > 0 and count + last <= MAX_TURNS:
        if divides(values, sides, last):
            last -= 1
            continue
        begin = last - 1
        while begin > 0 and not divides(values, sides, begin):
            begin -= 1
        chase_bulge(values, sides, begin, last, turns + count)
        count += last - begin
    return count


cdef inline void apply_inverse_root(double* a, int n, double least, double* b) noexcept nogil:
    """Replace b by A^(-1/2) b for a symmetric A, n × n. Eigenvalues below `least` are replaced by `least`.

    No eigenvectors are computed. b goes through the reflections and rotations that make A diagonal, and back,
    which takes a third of the time. A is overwritten.
    """
    cdef double values[MAX_DOF]
    cdef double sides[MAX_DOF]
    cdef double normals[MAX_DOF * MAX_DOF]
    cdef double shares[MAX_DOF]
    cdef Turn turns[MAX_TURNS]
    cdef int i, k, count
    tridiagonalise(a, n, values, sides, normals, shares)
    count = diagonalise(values, sides, n, turns)
    for k in range(n - 2):
        reflect(normals, shares, n, k, b)
    for k in range(count):
        rotate(&turns[k], 1.0, b)
    for i in range(n):
        b[i] /= sqrt(values[i] if values[i] >= least else least)
    for k in range(count - 1, -1, -1):
        rotate(&turns[k], -1.0, b)
    for k in range(n - 3, -1, -1):
        reflect(normals, shares, n, k, b)
