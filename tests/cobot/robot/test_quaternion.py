"""Quaternions and rotation vectors in compiled code.

Oracle: scipy's Rotation, finite differences for the Jacobian, MuJoCo for matrices, and numpy for all.
"""

from __future__ import annotations

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from laws import quaternions as law
from scipy.spatial.transform import Rotation

from cobot.robot import quaternion
from cobot.types import Array

COUNT = 100_000


def test_logarithm_and_exponential_are_those_of_scipy(rng: np.random.Generator) -> None:
    for scale in (1e-12, 1e-6, 1e-4, 1.0):
        for vector in rng.normal(size=(50, 3)) * scale:
            wanted, angle = Rotation.from_rotvec(vector), np.linalg.norm(vector)
            got = np.array(quaternion.exp(vector))
            np.testing.assert_allclose(got[0], np.cos(angle / 2.0), rtol=1e-15)
            np.testing.assert_allclose(got[1:], vector * 0.5 * np.sinc(angle / 2.0 / np.pi), rtol=1e-12)
            np.testing.assert_allclose(quaternion.log(got), wanted.as_rotvec(), rtol=1e-12)


def test_the_jacobian_is_the_derivative_and_its_inverse_the_inverse(rng: np.random.Generator) -> None:
    step = 1e-6
    for scale in (1e-7, 1e-3, 0.5):
        for turn, rate in rng.normal(size=(30, 2, 3)) * [[scale], [1.0]]:
            before, after = (Rotation.from_rotvec(turn + sign * step * rate) for sign in (-1, 1))
            velocity = (after * before.inv()).as_rotvec() / (2.0 * step)
            np.testing.assert_allclose(quaternion.angular_velocity(turn, rate), velocity, atol=1e-8)
            np.testing.assert_allclose(quaternion.rotation_rate(turn, velocity), rate, atol=1e-8)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def quaternions(rng: np.random.Generator) -> Array:
    """Columns: of any length, some a tiny turn from 1 or -1, some without a w."""
    q = rng.normal(size=(4, COUNT)) * 10.0 ** rng.uniform(-1.0, 1.0, COUNT)
    tiny = slice(0, COUNT // 10)
    q[1:, tiny] *= 10.0 ** rng.uniform(-9.0, -3.0, COUNT // 10)
    q[0, COUNT // 10 : COUNT // 10 + 100] = 0.0
    return q


def turns(rng: np.random.Generator) -> Array:
    """Columns: rotation vectors from nothing to nearly a whole turn."""
    direction = rng.normal(size=(3, COUNT))
    lengths = np.where(
        rng.random(COUNT) < 0.3, 10.0 ** rng.uniform(-12.0, 0.0, COUNT), rng.uniform(0, 6, COUNT)
    )
    lengths[:100] = 0.0
    return np.asarray(direction / np.linalg.norm(direction, axis=0) * lengths)


def vectors(rng: np.random.Generator) -> Array:
    return rng.normal(size=(3, COUNT)) * 10.0 ** rng.uniform(-3.0, 1.0, COUNT)


def agree(compiled: Callable[..., object], plain: Callable[..., Array], *columns: Array) -> None:
    rows = [column.T.tolist() for column in columns]
    got = np.array(list(map(compiled, *rows)))
    wanted = plain(*columns).T
    scale = np.maximum(1.0, np.linalg.norm(wanted, axis=1, keepdims=True))
    np.testing.assert_allclose(got / scale, wanted / scale, atol=1e-12, rtol=0.0)


def test_products_are_those_of_numpy(rng: np.random.Generator) -> None:
    a, b = quaternions(rng), quaternions(rng)
    agree(quaternion.product, law.product, a, b)
    agree(quaternion.conjugate, law.conjugate, a)
    agree(quaternion.normalised, law.normalised, a)
    agree(quaternion.cross, law.cross, vectors(rng), vectors(rng))
    agree(quaternion.rotated, law.rotated, law.normalised(a), vectors(rng))


def test_rotation_vectors_are_those_of_numpy(rng: np.random.Generator) -> None:
    a, b = quaternions(rng), quaternions(rng)
    agree(quaternion.exp, law.exp, turns(rng))
    agree(quaternion.log, law.log, a)
    agree(quaternion.between, law.between, law.normalised(a), law.normalised(b))


def test_derivatives_are_those_of_numpy(rng: np.random.Generator) -> None:
    agree(quaternion.angular_velocity, law.angular_velocity, turns(rng), vectors(rng))
    agree(quaternion.rotation_rate, law.rotation_rate, turns(rng), vectors(rng))
    agree(quaternion.angular_acceleration, law.angular_acceleration, turns(rng), vectors(rng), vectors(rng))


def test_matrices_are_those_of_mujoco_and_so_is_the_sign(rng: np.random.Generator) -> None:
    matrix, back = np.empty(9), np.empty(4)
    for q in law.normalised(quaternions(rng)).T:
        mujoco.mju_quat2Mat(matrix, q)
        mujoco.mju_mat2Quat(back, matrix)
        assert abs(np.array(quaternion.to_matrix(q)) - matrix).max() < 1e-12
        assert abs(np.array(quaternion.from_matrix(matrix.tolist())) - back).max() < 1e-12


def test_zeros_have_no_direction() -> None:
    with pytest.raises(ZeroDivisionError):
        quaternion.normalised((0.0, 0.0, 0.0, 0.0))


def test_a_vector_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="unpack"):
        quaternion.product((1.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
