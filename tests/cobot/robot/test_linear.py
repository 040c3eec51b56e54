"""Small linear algebra in compiled code. Oracle: numpy's LAPACK."""

from __future__ import annotations

import numpy as np
import pytest
from sample_counts import samples

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


@pytest.mark.parametrize(("size", "share"), [(1, 0.1), (2, 0.1), (3, 0.3), (6, 0.5), (7, 0.08), (16, 0.02)])
@pytest.mark.parametrize("least", [1e-3, 0.5])
def test_the_inverse_root_is_the_one_of_numpys_eigenvalues(size: int, share: float, least: float) -> None:
    rng = np.random.default_rng(SEED)
    matrices = symmetric(rng, int(share * COUNT), size)
    matrices[:10] = np.eye(size)  # equal values
    matrices[10:20] *= rng.random((10, size, 1)) * 0.0  # nothing at all
    right = rng.normal(size=(len(matrices), size))
    values, vectors = np.linalg.eigh(matrices)
    along = np.einsum("nij,ni->nj", vectors, right) / np.sqrt(np.maximum(values, least))
    expected = np.einsum("nij,nj->ni", vectors, along)
    found = np.array([linear.inverse_root_times(a, least, b) for a, b in zip(matrices, right, strict=True)])
    scale = np.maximum(np.abs(matrices).max(axis=(1, 2)), least)  # of the root's derivative at `least`
    worst = np.abs(found - expected).max(axis=1)
    assert (worst <= 1e-11 * scale * least**-1.5 * np.abs(right).max(axis=1)).all()


def test_eigenvalues_of_very_different_size_count() -> None:
    turn, _ = np.linalg.qr(np.random.default_rng(SEED).normal(size=(6, 6)))
    wanted = 10.0 ** np.arange(-2.0, 4.0)
    found = linear.inverse_root_times((turn * wanted) @ turn.T, 1e-6, turn.sum(axis=1))
    np.testing.assert_allclose(found, turn @ wanted**-0.5, rtol=1e-9)


def test_a_root_of_nan_ends() -> None:
    assert np.isnan(linear.inverse_root_times(np.full((6, 6), np.nan), 1.0, np.ones(6))).all()
