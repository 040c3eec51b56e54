"""Orientations in pure Python. Oracle: the compiled module, and scipy by way of `frames`."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cobot import orientations
from cobot.robot import frames, quaternion

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
        expected = frames.abc_from_quaternion(np.array(turn))
        np.testing.assert_allclose(orientations.kuka_angles(turn), expected, atol=1e-12)


@pytest.mark.parametrize("beside", [0.0, 1e-9, 1e-6, 1e-4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_kukas_angles_lead_back_where_they_are_not_unique(sign: float, beside: float) -> None:
    turn = frames.quaternion_from_abc(0.7, sign * (math.pi / 2 - beside), -0.4)
    a, b, c = orientations.kuka_angles(turn.tolist())
    assert frames.angle_between(frames.quaternion_from_abc(a, b, c), turn) < 3e-7
    assert (c == 0.0) == (beside < orientations.GIMBAL_LOCK)
