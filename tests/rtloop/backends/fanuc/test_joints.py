"""Joint 3 of FANUC's, which is measured from the horizon, and that of a model.

Oracles: what a real CRX reported on both of its interfaces at rest, at three poses (docs/controller-notes.md
of airo-fanuc 0.1.0); FANUC's sentence that joint 3 is the angle from the horizontal plane, by the model's own
kinematics.
"""

from __future__ import annotations

import numpy as np
import pytest

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.types import JointLimits
from rtloop.backends.fanuc.joints import JointUnits, from_horizon, to_horizon

MEASURED = [
    ((92.678, 2.595, -1.380, -45.464, -27.230, -11.037), -3.975),
    ((0.0, 11.695, 7.761, 0.0, 0.0, 0.0), -3.934),
    ((0.0, 36.692, 7.757, 0.0, 0.0, 0.0), -28.935),
]
"""Axes of Stream Motion, and J3 of the Remote Motion Interface, degrees."""


@pytest.mark.parametrize(("stream", "rmi_j3"), MEASURED)
def test_both_interfaces_of_a_real_arm_mean_the_same_posture(
    arm: RobotDescription, stream: tuple[float, ...], rmi_j3: float
) -> None:
    rmi = (*stream[:2], rmi_j3, *stream[3:])
    np.testing.assert_allclose(from_horizon(rmi), stream, atol=1e-3)
    np.testing.assert_allclose(to_horizon(stream), rmi, atol=1e-3)
    relative, horizon = JointUnits(arm.limits), JointUnits(arm.limits, horizon=True)
    np.testing.assert_allclose(relative.to_model(stream), np.radians(stream))
    np.testing.assert_allclose(horizon.to_model(rmi), np.radians(stream), atol=2e-5)


def test_joint_3_is_the_angle_of_the_forearm_from_the_horizon(arm: RobotDescription) -> None:
    """Whatever joint 2 is. A positive one points the forearm up, as at the teach pendant."""
    units = JointUnits(arm.limits, horizon=True)
    for j2 in (-40.0, 0.0, 55.0):
        for j3 in (-30.0, 0.0, 20.0):
            joints = units.to_model((0.0, j2, j3, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))
            ahead = arm.model.forward(joints).rotation[:, 2]  # of the face plate
            assert np.degrees(np.arcsin(ahead[2])) == pytest.approx(j3)


@pytest.mark.parametrize("horizon", [False, True])
def test_there_and_back_is_where_it_was(arm: RobotDescription, horizon: bool) -> None:
    units = JointUnits(arm.limits, horizon)
    random = np.random.default_rng(1)
    for joints in random.uniform(arm.limits.min_position, arm.limits.max_position, (100, 6)):
        np.testing.assert_allclose(units.to_model(units.to_device(joints)), joints, atol=1e-12)


def test_a_rail_is_in_millimetres(crx: Settings, arm: RobotDescription) -> None:
    limits = arm.limits
    rows = {name: np.append(getattr(limits, name), 1.0) for name in JointLimits.QUANTITIES}
    railed = JointLimits((*limits.names, "rail"), **rows, slides=(False,) * 6 + (True,))
    units = JointUnits(railed)
    assert units.to_device(np.array([0.0] * 6 + [0.25]))[6] == 250.0
    assert units.to_model((0.0,) * 6 + (250.0, 0.0, 0.0))[6] == 0.25
