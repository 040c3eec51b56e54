"""Linear algebra on small matrices, for compiled code; to Python it is visible for tests."""

import numpy as np

from cobot.arrays cimport doubles


def solved(matrix, right):
    """x of A x = b, A symmetric and positive definite, shape (n, n); None if it is not."""
    factor = np.array(matrix, dtype=np.float64)
    solution = np.array(right, dtype=np.float64)
    cdef int n = len(solution)
    if not cholesky_solve(doubles(factor, n * n), n, doubles(solution, n)):
        return None
    return solution


def eigen(matrix):
    """Eigenvalues, ascending, shape (n,), and eigenvectors in the columns, shape (n, n), of a symmetric A."""
    work = np.array(matrix, dtype=np.float64)
    cdef int n = len(work)
    values, vectors = np.empty(n), np.empty((n, n))
    eigen_symmetric(doubles(work, n * n), n, doubles(values, n), doubles(vectors, n * n))
    return values, vectors
