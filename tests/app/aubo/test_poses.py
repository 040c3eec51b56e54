"""Poses of vendor services. Oracle: scipy's rotations about fixed axes, x first."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from app.aubo.poses import as_list, numbers_of, pose_of
from cobot.errors import InputError
from cobot.types import Pose

SEED = 20261122


def test_the_angles_turn_about_fixed_axes_x_first_and_come_back() -> None:
    random = np.random.default_rng(SEED)
    for values in random.uniform(-1.5, 1.5, (500, 6)).tolist():
        pose = pose_of(values)
        turn = Rotation.from_quat(pose.quaternion, scalar_first=True)
        assert pose.position.tolist() == values[:3]
        assert (turn * Rotation.from_euler("xyz", values[3:]).inv()).magnitude() < 1e-9
        np.testing.assert_allclose(numbers_of(pose), values, atol=1e-9)


@pytest.mark.parametrize("turn", [np.pi / 2, -np.pi / 2])
def test_where_the_angles_are_ambiguous_the_orientation_still_is_right(turn: float) -> None:
    values = [0.0, 0.0, 0.0, 0.4, turn, -0.7]
    again = pose_of(numbers_of(pose_of(values)))
    turned = Rotation.from_quat(again.quaternion, scalar_first=True)
    assert (turned * Rotation.from_euler("xyz", values[3:]).inv()).magnitude() < 1e-7


def test_seven_numbers_are_a_states_pose_and_five_are_none() -> None:
    pose = Pose.from_numbers(np.array([0.0, 1.0, 2.0, 0.1, 0.5, 0.5, 0.7]))
    assert (pose.position.tolist(), pose.quaternion.tolist()) == ([0.0, 1.0, 2.0], [0.1, 0.5, 0.5, 0.7])
    assert [type(each) for each in as_list(np.arange(2.0))] == [float, float]
    with pytest.raises(InputError, match=r"via_pose must be \[x, y, z, rx, ry, rz\], got 5 numbers"):
        pose_of([0.0] * 5, "via_pose")
    with pytest.raises(InputError, match=r"via_pose: y may be up to 1e\+06 m, got -1.3e\+308 m"):
        pose_of([0.0, -1.3e308, 0.0, 0.0, 0.0, 0.0], "via_pose")
