"""What clients may write, and what not.

Oracle: the conditions of cobot/ipc/layout.py, one counter-example each.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.client.wire import FrameKind, header, packed, record
from cobot.errors import InputError, LayoutError
from cobot.ipc.layout import Stream, chunk_dtype, info_dtype, setpoint_dtype
from cobot.ipc.session_rules import check_chunk, check_session, check_setpoint, nominal_session

DOF = 7


@pytest.fixture
def info() -> np.ndarray:
    made = np.zeros((), info_dtype(DOF))
    made["min_position"], made["max_position"] = -2.0, 2.0
    made["stiffness"], made["cartesian_stiffness"] = 500.0, 1000.0
    return made


def setpoint(**values: Any) -> np.ndarray:
    made = np.zeros((), setpoint_dtype(DOF))
    made["number"], made["pose"][3] = 1, 1.0
    for name, value in values.items():
        made[name] = value
    return made


def test_a_nominal_session_passes(info: np.ndarray) -> None:
    request = nominal_session(info)
    check_session(request, info)
    np.testing.assert_array_equal(request["stiffness"], info["stiffness"])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("force_axes", 0.5),
        ("force_axes", np.nan),
        ("force_frame", 0.0),
        ("force_frame", np.nan),
        ("posture", 2.1),
        ("posture", [np.nan, 0, 0, 0, 0, 0, 0]),
        ("posture", np.inf),
    ],
)
def test_a_session_that_rtloop_would_not_look_at_is_refused(
    info: np.ndarray, field: str, value: object
) -> None:
    request = nominal_session(info)
    request[field] = value
    with pytest.raises(InputError, match=field):
        check_session(request, info)


@pytest.mark.parametrize("poison", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    ("stream", "field"),
    [
        (Stream.JOINT_IMPEDANCE, "joints"),
        (Stream.JOINT_IMPEDANCE, "joint_velocity"),
        (Stream.JOINT_TORQUE, "joints"),
        (Stream.CARTESIAN, "pose"),
        (Stream.CARTESIAN, "wrench"),
        (Stream.CARTESIAN, "twist"),
    ],
)
def test_what_is_no_number_is_refused(stream: Stream, field: str, poison: float) -> None:
    target = setpoint()
    check_setpoint(target, stream)
    target[field][-1] = poison
    with pytest.raises(InputError, match=f"{field} must be finite"):
        check_setpoint(target, stream)


def test_quaternions_are_normalised_or_refused() -> None:
    target = setpoint(pose=[0.1, 0.2, 0.3, 0.502, 0.502, 0.502, 0.502])
    check_setpoint(target, Stream.CARTESIAN)
    expected = Rotation.from_quat([0.5, 0.5, 0.5, 0.5], scalar_first=True)
    assert (expected.inv() * Rotation.from_quat(target["pose"][3:], scalar_first=True)).magnitude() < 1e-9
    assert np.linalg.norm(target["pose"][3:]) == pytest.approx(1.0, abs=1e-15)
    for pose in ([0.0] * 7, [0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0]):
        with pytest.raises(InputError, match="the quaternion of pose must have length 1"):
            check_setpoint(setpoint(pose=pose), Stream.CARTESIAN)


def test_a_move_needs_a_pose_and_a_duration_but_no_target() -> None:
    good = {"number": 0, "pose": 0.0, "move": 1, "move_pose": [0, 0, 0, 1, 0, 0, 0], "move_duration_s": 1.0}
    check_setpoint(setpoint(**good), Stream.CARTESIAN)
    for wrong in (
        {"move_pose": 0.0},
        {"move_pose": np.nan},
        {"move_duration_s": 0.0},
        {"move_duration_s": np.nan},
    ):
        with pytest.raises(InputError, match="move"):
            check_setpoint(setpoint(**(good | wrong)), Stream.CARTESIAN)


@pytest.mark.parametrize(
    "wrong",
    [{"count": 0}, {"count": 65}, {"times_s": 1.0}, {"times_s": np.nan}, {"points": np.nan}],
)
def test_a_chunk_is_checked_as_far_as_it_is_filled(wrong: dict[str, Any]) -> None:
    chunk = np.zeros((), chunk_dtype(DOF))
    chunk["count"], chunk["times_s"][:3] = 3, [1.0, 1.1, 1.2]
    chunk["points"][3:] = np.nan
    check_chunk(chunk, Stream.JOINT_IMPEDANCE)
    for name, value in wrong.items():
        chunk[name] = value
    with pytest.raises(InputError):
        check_chunk(chunk, Stream.JOINT_IMPEDANCE)


def test_a_frame_is_unpacked_as_it_was_packed() -> None:
    frame = packed(FrameKind.SETPOINT, 2**63, setpoint(joints=1.5))
    assert header(frame) == (FrameKind.SETPOINT, 2**63)
    np.testing.assert_array_equal(record(frame, DOF)["joints"], 1.5)
    record(frame, DOF)["joints"] = 0.0  # it is a copy
    with pytest.raises(InputError, match="a record setpoint has"):
        record(frame[:-1], DOF)
    with pytest.raises(InputError, match="a record setpoint has"):
        record(frame, DOF - 1)
    with pytest.raises(LayoutError, match="layout version 0"):
        header(frame[:4] + bytes(4) + frame[8:])
