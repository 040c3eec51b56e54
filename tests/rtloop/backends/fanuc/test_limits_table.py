"""The controller's limits table, against the model's limits. Oracle: numbers by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cobot.robot.description import RobotDescription
from cobot.types import JointLimits
from rtloop.backends.fanuc.joints import JointUnits
from rtloop.backends.fanuc.limits_table import LimitsTable
from rtloop.backends.fanuc.messages import LimitRate, LimitsPacket
from rtloop.results import ACCEPTED, Rejected


def table(limits: JointLimits, *, j2_loaded: float, j2_unloaded: float) -> LimitsTable:
    """As wide as can be, but for the acceleration of joint 2, in deg/s²; its last column counts."""
    found = LimitsTable(limits.dof)
    for joint in range(limits.dof):
        for rate in LimitRate:
            wide = (1e6,) * 20
            loaded = unloaded = wide
            if (joint, rate) == (1, LimitRate.ACCELERATION):
                loaded = (*wide[:-1], j2_loaded)
                unloaded = (*wide[:-1], j2_unloaded)
            found.take(LimitsPacket(3, joint + 1, rate, 2000, 8, unloaded, loaded))
    return found


def limited(arm: RobotDescription, acceleration_deg: float) -> JointLimits:
    rows = arm.limits.max_acceleration.copy()
    rows[1] = np.radians(acceleration_deg)
    return replace(arm.limits, max_acceleration=rows)


@pytest.mark.parametrize(
    ("load", "allowed_deg"), [(None, 100.0), (1.0, 100.0), (0.0, 300.0), (0.25, 250.0), (7.0, 100.0)]
)
def test_the_tightest_column_at_the_payload_counts(
    arm: RobotDescription, load: float | None, allowed_deg: float
) -> None:
    found, units = table(arm.limits, j2_loaded=100.0, j2_unloaded=300.0), JointUnits(arm.limits)
    assert found.check(limited(arm, 0.9999 * allowed_deg), units, load) is ACCEPTED
    result = found.check(limited(arm, 1.001 * allowed_deg), units, load)
    assert isinstance(result, Rejected)
    allowed = f"{np.floor(1e4 * np.radians(allowed_deg)) / 1e4:.5g}"
    assert "max_acceleration of joint2" in result.reason
    assert f"the table allows {allowed} rad/s²" in result.reason


def test_what_the_sentence_allows_is_allowed(arm: RobotDescription) -> None:
    found, units = table(arm.limits, j2_loaded=123.456, j2_unloaded=123.456), JointUnits(arm.limits)
    result = found.check(limited(arm, 200.0), units, None)
    assert isinstance(result, Rejected)
    allowed = float(result.reason.split("the table allows ")[1].split()[0])
    rows = arm.limits.max_acceleration.copy()
    rows[1] = allowed
    assert found.check(replace(arm.limits, max_acceleration=rows), units, None) is ACCEPTED


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_a_table_of_nonsense_is_refused(arm: RobotDescription, value: float) -> None:
    found = table(arm.limits, j2_loaded=value, j2_unloaded=value)
    result = found.check(arm.limits, JointUnits(arm.limits), None)
    # Infinity is only beside finite columns.
    assert (result is ACCEPTED) == (value == float("inf"))


def test_an_axis_3_from_the_horizon_is_as_fast_as_two_joints(arm: RobotDescription) -> None:
    """Whose senses differ: it turns by the difference of both."""
    units = JointUnits(arm.limits, horizon=True)
    found = LimitsTable(arm.limits.dof)
    for joint in range(arm.limits.dof):
        for rate in LimitRate:
            allowed = 301.0 if (joint, rate) == (2, LimitRate.VELOCITY) else 1e6
            found.take(LimitsPacket(3, joint + 1, rate, 2000, 8, (allowed,) * 20, (allowed,) * 20))
    assert found.check(arm.limits, units, None) is ACCEPTED  # 120 and 180 degrees per second
    faster = replace(arm.limits, max_velocity=1.01 * arm.limits.max_velocity)
    result = found.check(faster, units, None)
    assert isinstance(result, Rejected)
    assert (
        "max_velocity of joint3 together with joint2 is 5.28835, but the table allows 5.2534"
    ) in result.reason
    assert found.check(faster, JointUnits(arm.limits), None) is ACCEPTED
