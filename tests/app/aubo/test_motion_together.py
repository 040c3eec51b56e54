"""Robots that move together, and a watchdog's protective stop, through vendor services on virtual time.

Oracle: where the arms are as GET /robot/joint_states shows it.
"""

from __future__ import annotations

import json

import numpy as np
import pytest
from vendor_arm import VendorArm
from virtual_service import VirtualService

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.4, 0.1, 0.0, -1.4, 0.0, 1.4, 0.2]


@pytest.fixture
def arms(pair: VirtualService) -> tuple[VendorArm, VendorArm]:
    """Both at home."""
    left, right = (VendorArm(pair, name) for name in pair.names)
    for arm in (left, right):
        arm.home()
    return left, right


def test_a_protective_stop_by_a_watchdog_holds_until_it_is_unlocked(
    pair: VirtualService, arms: tuple[VendorArm, VendorArm]
) -> None:
    arm, other = arms
    arm.ask("RegisterControl/setWatchDog", key="plc", timeout=0.05, action=3)
    pair.until(lambda: arm.ask("RobotManage/getRobotControlMode") == "ESTOP")
    assert arm.ask("RobotManage/getOperationalMode") == "Disabled"
    assert "e-stop requested" in arm.fails("RobotManage/poweron", 51)
    assert other.ask("RobotManage/getRobotControlMode") == "HOLD"
    messages = json.loads(arm.ask("Trace/peek", num=10))
    assert "watchdog plc: not written in time; action: protective_stop" in [m["text"] for m in messages]
    arm.ask("RegisterControl/setWatchDog", key="plc", timeout=0.0, action=0)
    arm.ask("RobotManage/setUnlockProtectiveStop")
    for method in ("poweron", "startup", "releaseRobotBrake"):
        arm.ask(f"RobotManage/{method}")
    assert arm.ask("RobotManage/getOperationalMode") == "Automatic"
    assert arm.ask("RobotManage/isSimulationEnabled")


def done(arm: VendorArm, goal: list[float]) -> float:
    """The share of its way from home that it has behind it."""
    return float(np.linalg.norm(arm.joints - HOME) / np.linalg.norm(np.array(goal) - HOME))


def test_a_group_of_two_robots_begins_and_ends_together(
    pair: VirtualService, arms: tuple[VendorArm, VendorArm]
) -> None:
    left, right = arms
    near = (np.array(HOME) + 0.25 * (np.array(AWAY) - HOME)).tolist()
    left.ask("SyncMove/axisGroupAdd", name="both", robots=[left.name, right.name])
    assert right.ask("SyncMove/axisGroupGetAxisNum", name="both") == 14
    left.ask("SyncMove/axisGroupMoveJoint", name="both", q=AWAY + near, a=1.0, v=0.3)
    shares = []
    while max(left.speed, right.speed) > 1e-3 or len(shares) < 20:
        shares.append((done(left, AWAY), done(right, near)))
        pair.sleep(0.01)
    left.ask("SyncMove/syncMoveWait")
    np.testing.assert_allclose(left.joints, AWAY, atol=2e-3)
    np.testing.assert_allclose(right.joints, near, atol=2e-3)
    np.testing.assert_allclose(*np.array(shares).T, atol=0.1)
    assert any(0.2 < share < 0.8 for _, share in shares)
    left.ask("SyncMove/axisGroupDelete", name="both")
    left.fails("SyncMove/axisGroupMoveJoint", 12, name="both", q=AWAY + near)


def test_when_one_of_a_group_stops_the_other_one_stops_too(
    pair: VirtualService, arms: tuple[VendorArm, VendorArm]
) -> None:
    left, right = arms
    left.ask("SyncMove/axisGroupAdd", name="stopped", robots=[left.name, right.name])
    left.ask("SyncMove/axisGroupMoveJoint", name="stopped", q=AWAY + AWAY, a=0.5, v=0.1)
    pair.until(lambda: right.speed > 0.02)
    left.fails("SyncMove/axisGroupMoveJoint", 40, name="stopped", q=HOME + HOME)
    left.ask("RuntimeMachine/stop")
    pair.until(lambda: right.speed < 1e-3)
    right.ask("SyncMove/syncMoveWait")
    assert np.linalg.norm(right.joints - AWAY) > 0.05
    left.ask("SyncMove/axisGroupDelete", name="stopped")


def test_segments_start_when_all_robots_have_their_part(arms: tuple[VendorArm, VendorArm]) -> None:
    left, right = arms
    both = [left.name, right.name]
    left.fails("SyncMove/syncMoveSegment", 40, segment=1, q=AWAY)
    left.ask("SyncMove/syncMoveOn", syncident=7, taskset=both)
    right.ask("SyncMove/syncMoveOn", syncident=7, taskset=both)
    assert right.ask("SyncMove/isSyncMoveOn")
    assert left.ask("SyncMove/syncMoveSegment", segment=1, q=AWAY, v=1.0, a=2.0) is False
    left.fails("SyncMove/syncMoveSegment", 40, segment=1, q=AWAY)
    assert "segment 1 waits for" in left.fails("SyncMove/syncMoveOff", 40, syncident=7)
    np.testing.assert_allclose(left.joints, HOME, atol=2e-3)
    assert right.ask("SyncMove/syncMoveSegment", segment=1, q=AWAY, v=1.0, a=2.0) is True
    assert right.ask("SyncMove/syncMoveSegment", segment=2, q=HOME, v=1.0, a=2.0) is False
    assert left.ask("SyncMove/syncMoveSegment", segment=2, q=AWAY, v=1.0, a=2.0) is True
    right.ask("SyncMove/syncMoveWait")
    np.testing.assert_allclose(left.joints, AWAY, atol=2e-3)
    np.testing.assert_allclose(right.joints, HOME, atol=2e-3)
    left.ask("SyncMove/syncMoveOff", syncident=7)
    assert not right.ask("SyncMove/isSyncMoveOn")


def test_what_cannot_move_together_is_refused_and_nothing_moves(arms: tuple[VendorArm, VendorArm]) -> None:
    left, right = arms
    both = [left.name, right.name]
    left.ask("SyncMove/axisGroupAdd", name="g", robots=both)
    left.fails("SyncMove/axisGroupAdd", 40, name="g", robots=both)
    left.fails("SyncMove/axisGroupAdd", 10, name="h", robots=[left.name, left.name])
    assert "valid names:" in left.fails("SyncMove/axisGroupAdd", 10, name="h", robots=["nobody"])
    assert "q must have 14 angles" in left.fails("SyncMove/axisGroupMoveJoint", 10, name="g", q=AWAY)
    left.fails("SyncMove/axisGroupMoveJoint", 11, name="g", q=[*AWAY, 9.0, *AWAY[1:]])
    left.fails("SyncMove/syncMoveOff", 12, syncident=99)
    np.testing.assert_allclose(left.joints, HOME, atol=2e-3)
    left.ask("SyncMove/axisGroupDelete", name="g")
