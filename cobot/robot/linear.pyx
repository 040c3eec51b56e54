"""Linear algebra on small matrices, for compiled code. Its Python functions are only for tests."""

import numpy as np

from cobot.arrays cimport doubles


def solved(matrix, right):
    """The solution x of A x = b for a symmetric positive definite A, shape (n, n); None if A is not positive
    definite."""
    factor = np.array(matrix, dtype=np.float64)
    solution = np.array(right, dtype=np.float64)
    cdef int n = len(solution)
    if not cholesky_solve(doubles(factor, n * n), n, doubles(solution, n)):
        return None
    return solution


def inverse_root_times(matrix, double least, right):
    """A^(-1/2) b for a symmetric A, shape (n, n). Eigenvalues below `least` are replaced by `least`."""
    work = np.array(matrix, dtype=np.float64)
    product = np.array(right, dtype=np.float64)
    cdef int n = len(product)
    apply_inverse_root(doubles(work, n * n), n, least, doubles(product, n))
    return product
