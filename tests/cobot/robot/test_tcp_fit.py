"""The TCP from poses that touch one point. Oracle: scipy's least squares over all poses; the TCP they were
made with."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from cobot.errors import InputError
from cobot.pose import Pose
from cobot.robot.tcp_fit import MAX_POSES, MIN_TILT_DEG, fit_tcp

TCP = np.array([0.012, -0.034, 0.151])
POINT = np.array([0.45, -0.12, 0.2])


def touching(turns: list[Rotation], noise_m: float = 0.0, seed: int = 1) -> list[Pose]:
    """Poses of the flange with the tip at `POINT`, each with an error of the tip."""
    random = np.random.default_rng(seed)
    return [
        Pose(POINT - turn.apply(TCP) + noise_m * random.standard_normal(3), turn.as_quat()[[3, 0, 1, 2]])
        for turn in turns
    ]


def tilted(*angles_deg: tuple[float, float, float]) -> list[Rotation]:
    """The flange looks down, then turns about its own axes."""
    down = Rotation.from_euler("x", 180.0, degrees=True)
    return [down * Rotation.from_euler("XYZ", each, degrees=True) for each in angles_deg]


FOUR = tilted((25, 0, 0), (-25, 0, 20), (0, 25, 0), (0, -25, -20))


def test_exact_poses_give_the_tcp_they_were_made_with() -> None:
    found = fit_tcp(touching(FOUR))
    np.testing.assert_allclose(found.tcp, TCP, atol=1e-12)
    np.testing.assert_allclose(found.point, POINT, atol=1e-12)
    assert found.error_m < 1e-12


@pytest.mark.parametrize("seed", range(20))
def test_with_noise_it_is_the_least_squares_of_scipy(seed: int) -> None:
    random = np.random.default_rng(seed)
    turns = FOUR + [Rotation.random(rng=random) for _ in range(seed % 5)]
    poses = touching(turns, 1e-3, seed)

    def apart(unknown: np.ndarray) -> np.ndarray:
        return np.concatenate(
            [
                Rotation.from_quat(each.quaternion[[1, 2, 3, 0]]).apply(unknown[:3])
                + each.position
                - unknown[3:]
                for each in poses
            ]
        )

    wanted = least_squares(apart, np.zeros(6), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    found = fit_tcp(poses)
    np.testing.assert_allclose(found.tcp, wanted.x[:3], atol=1e-7)
    np.testing.assert_allclose(found.point, wanted.x[3:], atol=1e-7)
    assert found.error_m == pytest.approx(math.sqrt(2.0 * wanted.cost / len(poses)), rel=1e-6)
    np.testing.assert_allclose(
        found.errors_m, np.linalg.norm(apart(wanted.x).reshape(-1, 3), axis=1), atol=1e-7
    )


def test_the_error_names_the_pose_that_did_not_touch() -> None:
    poses = touching([*FOUR, *tilted((20, 20, 0), (-20, 20, 0), (-20, -20, 0))])
    poses[2] = Pose(poses[2].position + np.array([0.0, 0.0, 0.01]), poses[2].quaternion)
    errors = fit_tcp(poses).errors_m
    assert max(range(len(errors)), key=errors.__getitem__) == 2


def test_the_tilt_that_a_person_is_told_is_enough() -> None:
    tilt = MIN_TILT_DEG / 2
    found = fit_tcp(touching(tilted((tilt, 0, 0), (-tilt, 0, 0), (0, tilt, 0), (0, -tilt, 0))))
    np.testing.assert_allclose(found.tcp, TCP, atol=1e-12)


@pytest.mark.parametrize(
    ("turns", "said"),
    [
        (tilted(*[(0, 0, 0)] * 4), "nearly the same orientation in all of them"),
        (tilted((2, 0, 0), (-2, 0, 0), (0, 2, 0), (0, -2, 0)), "nearly the same orientation in all of them"),
        (tilted((0, 0, 0), (0, 0, 30), (0, 0, 60), (0, 0, 90)), r"about one axis only, \(0.00, 0.00, 1.00\)"),
        (tilted((0, 0, 0), (40, 0, 0), (0, 0, 0), (40, 0, 0)), r"about one axis only, \(1.00, 0.00, 0.00\)"),
        (FOUR[:3], "3 are given, allowed: 4 to 20"),
        (FOUR * MAX_POSES, "80 are given"),
    ],
)
def test_poses_that_do_not_determine_a_tcp_are_rejected_in_words(turns: list[Rotation], said: str) -> None:
    with pytest.raises(InputError, match=said):
        fit_tcp(touching(turns, 1e-4))
