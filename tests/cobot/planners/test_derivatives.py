"""The compiled derivatives along a path. Oracle: the same law in numpy, with the TCP's as differences."""

from __future__ import annotations

import numpy as np
import pytest
from laws import coordinates as law

from cobot.planners.derivatives import chained, coordinates_at, speeds_and_bends
from cobot.robot.description import RobotDescription
from cobot.types import Array

PLACES, DOF = 40, 7
DIRECTIONS = (np.array([-0.4, 0.1, 1.2]), np.array([0.0]))


def random_path(seed: int) -> Array:
    """Joints and three derivatives at some places; nothing moves at the last one."""
    random = np.random.default_rng(seed)
    derivatives = random.normal(size=(4, PLACES, DOF))
    derivatives[0] = random.uniform(-2.5, 2.5, (PLACES, DOF))
    derivatives[1:, -1] = 0.0
    return derivatives


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("parts", [0, 1, 2])
def test_coordinates_are_those_of_the_law_in_numpy(robot: RobotDescription, seed: int, parts: int) -> None:
    derivatives, chain = random_path(seed), robot.model.chain
    fastest = np.random.default_rng(seed).uniform(0.5, 2.0, (PLACES, DOF + 2))
    rows, slowness = coordinates_at(chain, derivatives, fastest, DIRECTIONS[:parts])
    expected = law.coordinates(derivatives, chain.motions(derivatives), fastest, DIRECTIONS[:parts])
    np.testing.assert_allclose(rows, expected[0], rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(slowness, expected[1], rtol=1e-12)


def test_speeds_and_bends_are_those_of_the_law_in_numpy(robot: RobotDescription) -> None:
    derivatives, chain = random_path(9), robot.model.chain
    found, twists = speeds_and_bends(chain, derivatives), chain.motions(derivatives)
    for part in range(2):
        expected = law.frame(twists[:, :, 3 * part : 3 * part + 3])[:2]
        np.testing.assert_allclose(found[part], expected, rtol=1e-11, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_the_chain_rule_is_that_of_the_law_in_numpy(seed: int) -> None:
    random = np.random.default_rng(seed)
    derivatives, times = random.normal(size=(3, PLACES, 9)), random.normal(size=(4, PLACES))
    limits = random.uniform(0.5, 2.0, 9)
    expected = law.chained(derivatives, times)
    np.testing.assert_allclose(chained(derivatives, times), expected, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(chained(derivatives, times, limits), expected / limits, rtol=1e-12, atol=1e-13)


def test_no_places_have_no_derivatives_and_other_shapes_are_refused(robot: RobotDescription) -> None:
    chain = robot.model.chain
    rows, slowness = coordinates_at(chain, np.zeros((4, 0, DOF)), np.ones((0, DOF + 2)), DIRECTIONS)
    assert (rows.shape, slowness.shape) == ((3, 0, DOF + 4), (0,))
    assert chained(np.zeros((3, 0, 9)), np.zeros((4, 0))).shape == (3, 0, 9)
    with pytest.raises(ValueError, match="velocities of shape"):
        coordinates_at(chain, np.zeros((4, 3, DOF)), np.ones((3, DOF)), DIRECTIONS)
    with pytest.raises(ValueError, match="a law of shape"):
        chained(np.zeros((3, 4, 9)), np.zeros((4, 5)))
