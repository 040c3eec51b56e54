"""Orientations. Oracle: KUKA's definition R = Rz(A) Ry(B) Rx(C), multiplied out by hand here."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np
import pytest

from cobot.errors import InputError
from cobot.robot.frames import (
    abc_from_quaternion,
    angle_between,
    pose_from_abc,
    quaternion_from_abc,
)
from cobot.types import Pose

SEED = 20261120


def by_definition(a: float, b: float, c: float) -> np.ndarray:
    z = np.array([[cos(a), -sin(a), 0], [sin(a), cos(a), 0], [0, 0, 1]])
    y = np.array([[cos(b), 0, sin(b)], [0, 1, 0], [-sin(b), 0, cos(b)]])
    x = np.array([[1, 0, 0], [0, cos(c), -sin(c)], [0, sin(c), cos(c)]])
    return z @ y @ x


def test_abc_is_z_then_y_then_x() -> None:
    random = np.random.default_rng(SEED)
    for a, b, c in random.uniform(-pi, pi, (200, 3)):
        pose = Pose(np.zeros(3), quaternion_from_abc(a, b, c))
        assert pose.rotation == pytest.approx(by_definition(a, b, c), abs=1e-12)


def test_abc_survives_the_round_trip_as_an_orientation_at_gimbal_lock_too() -> None:
    random = np.random.default_rng(SEED)
    angles = [*random.uniform(-pi, pi, (200, 3)), (0.3, pi / 2, 0.2), (0.3, -pi / 2, -1.0), (0, pi, 0)]
    for a, b, c in angles:
        quaternion = quaternion_from_abc(a, b, c)
        again = quaternion_from_abc(*abc_from_quaternion(quaternion))
        assert angle_between(quaternion, again) == pytest.approx(0.0, abs=1e-7), f"A {a} B {b} C {c}"


def test_a_pose_from_abc_is_in_metres_and_radians() -> None:
    pose = pose_from_abc(0.4, 0.0, 0.5, 0.0, pi, 0.0)
    assert pose.position.tolist() == [0.4, 0.0, 0.5]
    assert pose.rotation @ [0, 0, 1] == pytest.approx([0, 0, -1])


def test_a_pose_refuses_what_is_no_orientation() -> None:
    with pytest.raises(InputError, match="quaternion must not be zero"):
        Pose(np.zeros(3), np.zeros(4))
    with pytest.raises(InputError, match="position must be finite"):
        Pose(np.array([0, np.nan, 0]), np.array([1.0, 0, 0, 0]))
    with pytest.raises(InputError, match="position must have 3 numbers"):
        Pose(np.zeros(2), np.array([1.0, 0, 0, 0]))
