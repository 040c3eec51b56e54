"""Orientations in pure Python. Oracle: the compiled module, and scipy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot import orientations
from cobot.robot import quaternion

RNG = np.random.default_rng(8007)
TURNS = [(q / np.linalg.norm(q)).tolist() for q in RNG.normal(size=(200, 4))]
VECTORS = RNG.normal(size=(200, 3)).tolist()


def test_pure_python_and_the_compiled_module_agree() -> None:
    for first, second, vector in zip(TURNS, TURNS[::-1], VECTORS, strict=True):
        scaled = [3.0 * number for number in first]
        for mine, compiled in (
            (orientations.product(first, second), quaternion.product(first, second)),
            (orientations.inverse(first), quaternion.conjugate(first)),
            (orientations.normalised(scaled), quaternion.normalised(scaled)),
            (orientations.rotated(first, vector), quaternion.rotated(first, vector)),
            (sum(orientations.matrix(first), ()), quaternion.to_matrix(first)),
        ):
            np.testing.assert_allclose(mine, compiled, atol=1e-14)


def test_kukas_angles_are_those_of_scipy() -> None:
    for turn in TURNS:
        angles = Rotation.from_quat(turn, scalar_first=True).as_euler("ZYX")
        np.testing.assert_allclose(orientations.kuka_angles(turn), angles, atol=1e-12)
        again = Rotation.from_quat(orientations.kuka_quaternion(*angles), scalar_first=True)
        np.testing.assert_allclose(again.as_matrix(), orientations.matrix(turn), atol=1e-12)


@pytest.mark.parametrize("beside", [0.0, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_kukas_angles_lead_back_where_they_are_not_unique(sign: float, beside: float) -> None:
    turn = orientations.kuka_quaternion(0.7, sign * (math.pi / 2 - beside), -0.4)
    a, b, c = orientations.kuka_angles(turn)
    away = quaternion.between(orientations.kuka_quaternion(a, b, c), turn)
    assert math.hypot(*away) < 3e-7
    assert (c == 0.0) == (beside < orientations.GIMBAL_LOCK_RAD)
