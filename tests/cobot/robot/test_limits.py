"""joint_limits.yaml. Oracle: the shipped file as plain YAML, and MoveIt's published format."""

from __future__ import annotations

import copy
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from independent_models import LIMITS

from cobot.errors import ConfigError, LimitError
from cobot.robot.limits import check_positions, load_joint_limits

RATES = ("velocity", "acceleration", "jerk", "effort")


def content() -> dict[str, Any]:
    return copy.deepcopy(yaml.safe_load(LIMITS.read_text(encoding="utf-8")))


def written(folder: Path, document: object) -> Path:
    file = folder / "limits.yaml"
    file.write_text(yaml.safe_dump(document, sort_keys=False), encoding="utf-8")
    return file


def test_the_limits_are_those_of_the_file_in_its_order(tmp_path: Path) -> None:
    document = content()
    document["joint_limits"] = dict(reversed(document["joint_limits"].items()))
    limits = load_joint_limits(written(tmp_path, document))
    assert limits.names == ("joint7", "joint6", "joint5", "joint4", "joint3", "joint2", "joint1")
    for key in ("min_position", "max_position", *(f"max_{rate}" for rate in RATES)):
        expected = [entry[key] for entry in document["joint_limits"].values()]
        assert getattr(limits, key).tolist() == expected, key


def test_limits_cannot_be_changed_by_who_reads_them() -> None:
    limits = load_joint_limits(LIMITS)
    with pytest.raises(ValueError, match="read-only"):
        limits.max_velocity[0] = 99.0


def test_a_whole_number_is_a_number(tmp_path: Path) -> None:
    document = content()
    document["joint_limits"]["joint1"]["max_velocity"] = 2
    assert load_joint_limits(written(tmp_path, document)).max_velocity[0] == 2.0


@pytest.mark.parametrize("key", ["min_position", "max_position", "has_jerk_limits", "max_jerk", "max_effort"])
def test_a_missing_limit_is_refused_by_joint_and_key(tmp_path: Path, key: str) -> None:
    document = content()
    del document["joint_limits"]["joint3"][key]
    with pytest.raises(ConfigError, match=rf"limits\.yaml: joint_limits\.joint3\.{key}: is missing"):
        load_joint_limits(written(tmp_path, document))


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        (
            "has_acceleration_limits",
            False,
            "has_acceleration_limits: must be true, got False: cobot needs",
        ),
        ("has_jerk_limits", 1, "has_jerk_limits: must be true, got 1"),
        ("max_velocity", "fast", "max_velocity: must be a number, got 'fast'"),
        ("max_velocity", True, "max_velocity: must be a number, got True"),
        ("max_velocity", None, "max_velocity: must be a number, got None"),
        ("max_velocity", 0.0, "max_velocity: must be above 0 and below 1e6, got 0"),
        ("max_jerk", -1.0, "max_jerk: must be above 0 and below 1e6, got -1"),
        ("max_effort", float("inf"), "max_effort: must be above 0 and below 1e6, got inf"),
        ("max_effort", float("nan"), "max_effort: must be above 0 and below 1e6, got nan"),
        ("min_position", 3.0, "min_position 3 must be below max_position 2.97"),
        ("max_position", float("nan"), "must be below max_position nan, both between -1000 and 1000"),
        ("min_position", float("-inf"), "min_position -inf must be below"),
        ("max_speed", 1.0, "unknown key 'max_speed'; valid keys: has_position_limits, min_position"),
    ],
)
def test_a_wrong_limit_is_refused_with_joint_key_and_value(
    tmp_path: Path, key: str, value: object, message: str
) -> None:
    document = content()
    document["joint_limits"]["joint3"][key] = value
    with pytest.raises(ConfigError, match=rf"limits\.yaml: joint_limits\.joint3.*{re.escape(message)}"):
        load_joint_limits(written(tmp_path, document))


@pytest.mark.parametrize(
    "document", [{}, [], None, "text", {"joint_limits": {}}, {"joint_limits": []}, {"limits": {"joint1": {}}}]
)
def test_a_file_without_joints_is_refused(tmp_path: Path, document: object) -> None:
    with pytest.raises(ConfigError, match=r"limits\.yaml: must contain joint_limits"):
        load_joint_limits(written(tmp_path, document))


def test_a_key_beside_the_limits_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="and nothing else"):
        load_joint_limits(written(tmp_path, {**content(), "default_velocity_scaling_factor": 0.1}))


def test_a_joint_that_is_no_mapping_is_refused(tmp_path: Path) -> None:
    document = content()
    document["joint_limits"]["joint2"] = 1.0
    with pytest.raises(ConfigError, match=r"joint_limits\.joint2: must contain has_position_limits"):
        load_joint_limits(written(tmp_path, document))


def test_a_joint_that_stands_twice_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "limits.yaml"
    text = LIMITS.read_text(encoding="utf-8")
    file.write_text(text.replace("  joint2:", "  joint1:"), encoding="utf-8")
    with pytest.raises(ConfigError, match="'joint1' occurs twice"):
        load_joint_limits(file)


def test_a_missing_file_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nowhere\.yaml: no such file"):
        load_joint_limits(tmp_path / "nowhere.yaml")


def test_positions_at_the_limits_are_allowed_and_the_next_number_is_not() -> None:
    limits = load_joint_limits(LIMITS)
    for bound, outwards in ((limits.min_position, -np.inf), (limits.max_position, np.inf)):
        check_positions(limits, bound)
        for joint, name in enumerate(limits.names):
            beyond = bound.copy()
            beyond[joint] = np.nextafter(bound[joint], outwards)
            with pytest.raises(LimitError, match=f"joint angle of {name} is"):
                check_positions(limits, beyond)


def test_every_joint_that_is_beyond_is_named_with_value_and_range() -> None:
    limits = load_joint_limits(LIMITS)
    joints = np.array([0.0, -2.5, 0.0, float("nan"), 0.0, 0.0, 3.25])
    with pytest.raises(LimitError) as caught:
        check_positions(limits, joints, "goal angle")
    assert str(caught.value) == (
        "goal angle of joint2 is -2.5 rad, allowed: -2.1 to 2.1 rad; "
        "goal angle of joint4 is nan rad, allowed: -2.1 to 2.1 rad; "
        "goal angle of joint7 is 3.25 rad, allowed: -3.05 to 3.05 rad"
    )


def test_scaled_limits_change_the_rates_and_nothing_else() -> None:
    limits = load_joint_limits(LIMITS)
    half = limits.scaled(0.5, 0.25, 0.1)
    assert half.max_velocity == pytest.approx(0.5 * limits.max_velocity)
    assert half.max_acceleration == pytest.approx(0.25 * limits.max_acceleration)
    assert half.max_jerk == pytest.approx(0.1 * limits.max_jerk)
    for name in ("names", "min_position", "max_position", "max_effort"):
        assert np.array_equal(getattr(half, name), getattr(limits, name))


@pytest.mark.parametrize(
    ("value", "degrees"), [(3.0, False), (90.0, True), (-720.0, True), (721.0, False), (1e308, False)]
)
def test_only_what_can_be_degrees_is_said_to_look_like_them(value: float, degrees: bool) -> None:
    with pytest.raises(LimitError, match="joint angle of joint1 is ") as refused:
        check_positions(load_joint_limits(LIMITS), np.array([value, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    assert ("look like degrees" in str(refused.value)) is degrees
