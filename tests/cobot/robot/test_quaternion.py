"""Quaternions and rotation vectors in plain floats.

Oracle: scipy's Rotation, and finite differences for the Jacobian.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.robot import quaternion


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
