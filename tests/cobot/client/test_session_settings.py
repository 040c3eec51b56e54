"""Settings of streaming sessions. Oracle: the fields of the request as the layout names them, set by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from cobot.client.modes import CoordType
from cobot.client.session_settings import SessionSettings
from cobot.errors import InputError
from cobot.ipc.layout import Interpolation, Stream, info_dtype

DOF = 7


def info(period_s: float = 0.001) -> np.ndarray:
    record = np.zeros((), info_dtype(DOF))
    record["period_s"] = period_s
    record["stiffness"], record["cartesian_stiffness"] = 1000.0, [4000.0] * 3 + [200.0] * 3
    record["min_position"], record["max_position"] = -2.0, 2.0
    return record


def described(settings: SessionSettings, rate_hz: float = 1000.0) -> np.ndarray:
    settings._describe(Stream.CARTESIAN, rate_hz, True, None)
    return settings._request


def test_each_setting_stands_in_the_request_of_the_next_session() -> None:
    settings = SessionSettings(info())
    settings.set_joint_impedance([500.0] * DOF, [0.3] * DOF)
    settings.set_cartesian_impedance([100.0] * 6)
    settings.set_max_contact_wrench([10.0] * 6)
    settings.set_max_contact_torque([5.0] * DOF)
    settings.set_force_control_axis([False, False, True, False, False, False], [0.1, 0.2, 0.3])
    settings.set_force_control_frame(CoordType.TCP, [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0])
    settings.set_null_space_posture([0.5] * DOF)
    request = described(settings)
    assert request["stiffness"].tolist() == [500.0] * DOF
    assert request["damping_ratio"].tolist() == [0.3] * DOF
    assert request["cartesian_stiffness"].tolist() == [100.0] * 6
    assert request["cartesian_damping_ratio"].tolist() == [0.7] * 6
    assert request["max_contact_wrench"].tolist() == [10.0] * 6
    assert request["max_contact_torque"].tolist() == [5.0] * DOF
    assert np.flatnonzero(request["force_axes"]).tolist() == [2]
    assert request["force_velocity"][:3].tolist() == [0.1, 0.2, 0.3]
    assert bool(request["force_in_tcp"])
    assert request["force_frame"].tolist() == [0.1, 0.2, 0.3, 1.0, 0.0, 0.0, 0.0]
    assert request["posture"].tolist() == [0.5] * DOF
    assert Stream(int(request["stream"])) is Stream.CARTESIAN
    assert Interpolation(int(request["interpolation"])) is Interpolation.LINEAR


@pytest.mark.parametrize("period_s", [0.0005, 0.001, 0.002, 0.01])
@pytest.mark.parametrize("rate_hz", [1.0, 30.0, 100.0, 500.0, 1000.0])
def test_a_target_is_taken_as_often_as_it_is_sent_at_any_period(period_s: float, rate_hz: float) -> None:
    count = int(described(SessionSettings(info(period_s)), rate_hz)["decimation"])
    wanted = 1.0 / (rate_hz * period_s)
    assert 1 <= count <= 1000
    if 1.0 <= wanted <= 1000.0:
        assert abs(count - wanted) <= 0.5 + 1e-9


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (lambda s: s.set_joint_impedance([1000.5] * DOF), "K_q"),
        (lambda s: s.set_joint_impedance([-1.0] * DOF), "K_q"),
        (lambda s: s.set_cartesian_impedance([100.0] * 6, [0.29] * 6), "Z_x"),
        (lambda s: s.set_cartesian_impedance([100.0] * 5), "K_x"),
        (lambda s: s.set_max_contact_wrench([0.0] * 6), "wrench must be above 0"),
        (lambda s: s.set_max_contact_torque([math.nan] * DOF), "torques"),
        (lambda s: s.set_force_control_axis([1] * 6), "axes must be six True or False values"),
        (lambda s: s.set_force_control_axis([True] * 5), "axes must be six"),
        (lambda s: s.set_force_control_frame(CoordType.WORLD, [0.0] * 7), "the quaternion of T must have"),
        (lambda s: s.set_null_space_posture([2.1] * DOF), "ref_pos must be from"),
        (lambda s: s._describe(Stream.CARTESIAN, 0.5, True, None), "inner_control_hz must be from 1 to 1000"),
        (
            lambda s: s._describe(Stream.CARTESIAN, 100, True, "cubic"),
            "unknown interpolation 'cubic'; valid values:",
        ),
    ],
)
def test_what_is_wrong_is_refused_and_changes_nothing(
    change: Callable[[SessionSettings], None], sentence: str
) -> None:
    settings = SessionSettings(info())
    before = described(settings).tobytes()
    with pytest.raises(InputError, match=sentence):
        change(settings)
    assert settings._request.tobytes() == before
