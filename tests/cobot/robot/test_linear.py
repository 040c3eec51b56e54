"""Small linear algebra in compiled code. Oracle: numpy's LAPACK."""

from __future__ import annotations

import numpy as np
import pytest
from samples import samples

from cobot.robot import linear
from cobot.types import Array

COUNT = samples(100_000)
SEED = 11


def symmetric(rng: np.random.Generator, count: int, size: int) -> Array:
    a = rng.normal(size=(count, size, size)) * 10.0 ** rng.uniform(-3.0, 3.0, (count, 1, 1))
    return a + a.transpose(0, 2, 1)


@pytest.mark.parametrize(("size", "share"), [(1, 0.1), (2, 0.1), (6, 0.6), (7, 0.1), (16, 0.1)])
def test_a_cholesky_solution_is_that_of_numpy(size: int, share: float) -> None:
    rng = np.random.default_rng(SEED)
    count = int(share * COUNT)
    half = rng.normal(size=(count, size, size))
    matrices = half @ half.transpose(0, 2, 1) + 0.1 * np.eye(size)
    rights = rng.normal(size=(count, size))
    wanted = np.linalg.solve(matrices, rights[..., None])[..., 0]
    got = np.array([linear.solved(*each) for each in zip(matrices, rights, strict=True)])
    worst = np.abs(got - wanted).max(axis=1)
    assert (worst <= 1e-12 * np.linalg.cond(matrices) * np.maximum(1.0, np.abs(wanted).max(axis=1))).all()


def test_what_is_not_positive_definite_has_no_cholesky_solution() -> None:
    right = np.ones(3)
    assert linear.solved(np.diag([1.0, -1.0, 1.0]), right) is None
    assert linear.solved(np.zeros((3, 3)), right) is None
    assert linear.solved(np.full((3, 3), np.nan), right) is None
    assert linear.solved(np.diag([1.0, np.inf, 1.0]), right) is None


@pytest.mark.parametrize(("size", "share"), [(1, 0.1), (3, 0.3), (6, 0.5), (7, 0.08), (16, 0.02)])
def test_eigenvalues_are_those_of_numpy_and_the_vectors_are_theirs(size: int, share: float) -> None:
    rng = np.random.default_rng(SEED)
    matrices = symmetric(rng, int(share * COUNT), size)
    matrices[:10] = np.eye(size)  # equal values
    matrices[10:20] *= rng.random((10, size, 1)) * 0.0  # nothing at all
    found = [linear.eigen(matrix) for matrix in matrices]
    values, vectors = np.array([each[0] for each in found]), np.array([each[1] for each in found])
    scale = np.maximum(np.abs(matrices).max(axis=(1, 2)), 1e-300)
    assert (np.abs(values - np.linalg.eigvalsh(matrices)).max(axis=1) <= 1e-12 * scale).all()
    again = (vectors * values[:, None, :]) @ vectors.transpose(0, 2, 1)
    assert (np.abs(again - matrices).max(axis=(1, 2)) <= 1e-12 * scale).all()
    np.testing.assert_allclose(
        vectors.transpose(0, 2, 1) @ vectors, np.broadcast_to(np.eye(size), again.shape), atol=1e-12
    )


def test_eigenvalues_of_very_different_size_are_found() -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(SEED).normal(size=(6, 6)))
    wanted = 10.0 ** np.arange(-6.0, 6.0, 2.0)
    values, _ = linear.eigen((turn * wanted) @ turn.T)
    np.testing.assert_allclose(values, wanted, rtol=0.0, atol=1e-9)


def test_eigenvalues_of_nan_end() -> None:
    assert np.isnan(linear.eigen(np.full((6, 6), np.nan))[0]).all()
