"""The servo protocol: each rule of the manual's chapter 7, and whatever else a client may write.

Oracle: the manual (7.1 to 7.5); for garbage, that nothing is raised and each message is counted exactly once.
"""

from __future__ import annotations

import json
import math
from typing import Any

import pytest
from random_json import Garbage
from thorough import few

from cobot.ipc.layout import ServoMode
from cobot.servo.fields import BrokenRule
from cobot.servo.protocol import (
    DEFAULT_GAIN,
    DEFAULT_LOOKAHEAD_S,
    DEFAULT_WATCHDOG_S,
    FjtControl,
    Point,
    ServoRules,
    SetMode,
    Stop,
)

PERIOD_S = 0.001
LOW, HIGH = [-2.0] * 7, [2.0] * 7


@pytest.fixture
def rules() -> ServoRules:
    return ServoRules(LOW, HIGH, PERIOD_S)


@pytest.fixture
def active(rules: ServoRules) -> ServoRules:
    """In a session of mode 3 at 50 Hz."""
    control(rules, mode=3, watchdog_timeout=0.5, send_period=0.02)
    return rules


def control(rules: ServoRules, command: Any = "set_mode", **fields: Any) -> Any:
    message = rules.read(json.dumps({"type": "servo_control", "command": command, **fields}))
    if isinstance(message, SetMode):
        rules.begin(message)
    return message


def point(rules: ServoRules, point_id: Any = 1, **fields: Any) -> Point | None:
    """Send a point, and accept it if it may be; a field that is `...` is left out."""
    whole = {
        "type": "servo_point",
        "session_id": 7,
        "point_id": point_id,
        "point_type": "joint",
        "position": [0.0] * 7,
        "time": 0.02,
        "lookahead_time": 0.1,
        "gain": 200.0,
        **fields,
    }
    message = rules.read(json.dumps({name: value for name, value in whole.items() if value is not ...}))
    if message is None:
        return None
    assert isinstance(message, Point)
    rules.accept(message)
    return message


def refused(rules: ServoRules) -> dict[str, int]:
    return {str(kind): count for kind, count in rules.refused.items()}


def test_set_mode_is_read_as_the_manual_writes_it(rules: ServoRules) -> None:
    text = """{"type": "servo_control", "command": "set_mode", "mode": 4,
               "watchdog_timeout": 0.5, "send_period": 0.02}"""
    assert rules.read(text) == SetMode(ServoMode.BUFFERED_1MS, 0.5, 0.02)


def test_stop_is_read_as_the_manual_writes_it(rules: ServoRules) -> None:
    assert rules.read('{"type": "servo_control", "command": "stop"}') == Stop()


def test_a_point_is_read_as_the_manual_writes_it() -> None:
    rules = ServoRules([-3.0] * 6, [3.0] * 6, PERIOD_S)
    control(rules, mode=4)
    text = """{"type": "servo_point", "session_id": 123456789, "point_id": 1, "point_type": "joint",
               "position": [0, 0, 0, 0, 0, 0], "time": 0.02, "lookahead_time": 0.1, "gain": 200.0}"""
    assert rules.read(text) == Point(123456789, 1, False, (0.0,) * 6, 0.02, 0.1, 200.0)


@pytest.mark.parametrize("mode", range(8))
def test_modes_from_0_to_7_exist(rules: ServoRules, mode: int) -> None:
    message = control(rules, mode=mode)
    assert isinstance(message, SetMode)
    assert message.mode == mode


@pytest.mark.parametrize("mode", [-1, 8, 1.5, "1", True, None, [], 10**30, ...])
def test_another_mode_is_refused(rules: ServoRules, mode: Any) -> None:
    assert control(rules, **({} if mode is ... else {"mode": mode})) is None
    assert refused(rules) == {"mode": 1}
    assert not rules.active


@pytest.mark.parametrize("command", ["start", "", None, 1, ["stop"], {"stop": 1}])
def test_an_unknown_command_is_refused(rules: ServoRules, command: Any) -> None:
    assert control(rules, command, mode=1) is None
    assert refused(rules) == {"command": 1}


@pytest.mark.parametrize("period", [0.0, -1.0, None, ...])
def test_a_send_period_that_is_not_set_or_not_above_0_is_the_control_period(
    rules: ServoRules, period: Any
) -> None:
    message = control(rules, mode=1, **({} if period is ... else {"send_period": period}))
    assert message.send_period_s == PERIOD_S


@pytest.mark.parametrize("watchdog", [0, -0.5, 61.0, "0.5", True, math.nan, math.inf, 1e999])
def test_a_watchdog_that_could_never_or_would_at_once_expire_is_refused(
    rules: ServoRules, watchdog: Any
) -> None:
    assert control(rules, mode=1, watchdog_timeout=watchdog) is None
    assert refused(rules) == {"value": 1}


def test_a_watchdog_below_the_recommended_is_accepted_with_a_warning(
    rules: ServoRules, caplog: pytest.LogCaptureFixture
) -> None:
    assert control(rules, mode=1, watchdog_timeout=0.01).watchdog_s == 0.01
    assert "recommended" in caplog.text


def test_a_watchdog_that_is_not_stated_is_half_a_second(rules: ServoRules) -> None:
    assert control(rules, mode=1).watchdog_s == DEFAULT_WATCHDOG_S


def test_points_need_an_active_session(rules: ServoRules) -> None:
    assert point(rules) is None
    control(rules, mode=1)
    assert point(rules) is not None
    rules.end()
    assert point(rules, 2) is None
    assert refused(rules) == {"not_active": 1}  # the count before belonged to no session


def test_a_session_begins_with_counts_of_zero(active: ServoRules) -> None:
    point(active, 5)
    point(active, 5)
    control(active, mode=1)
    assert (active.received, active.accepted, refused(active), active.last_refusal) == (0, 0, {}, "")
    assert point(active, 1, session_id=8) is not None


def test_a_message_without_a_type_is_a_point(active: ServoRules) -> None:
    assert point(active, type=...) is not None


@pytest.mark.parametrize("kind", ["servo", "", None, 3, []])
def test_an_unknown_type_is_refused(active: ServoRules, kind: Any) -> None:
    assert active.read(json.dumps({"type": kind})) is None
    assert refused(active) == {"type": 1}


def test_the_first_session_id_locks_the_session(active: ServoRules) -> None:
    assert point(active, 1, session_id=1_700_000_000_000_000_000) is not None
    assert point(active, 2, session_id=8) is None
    assert point(active, 2, session_id=...) is None
    assert point(active, 2, session_id=1_700_000_000_000_000_000) is not None
    assert refused(active) == {"session_id": 2}
    assert "locked to 1700000000000000000" in active.last_refusal


def test_a_refused_point_locks_nothing(active: ServoRules) -> None:
    assert point(active, 1, session_id=8, position=[0.0]) is None
    assert point(active, 1, session_id=9) is not None


def test_points_without_a_session_id_lock_nothing(active: ServoRules) -> None:
    assert point(active, 1, session_id=...) is not None
    assert point(active, 2, session_id=5) is not None
    assert point(active, 3, session_id=...) is None


@pytest.mark.parametrize("session_id", ["7", 1.5, True, 2**63, -(2**70), [7]])
def test_a_session_id_is_an_integer_of_64_bits(active: ServoRules, session_id: Any) -> None:
    assert point(active, session_id=session_id) is None
    assert refused(active) == {"session_id": 1}


def test_a_point_needs_a_point_id(active: ServoRules) -> None:
    assert point(active, ...) is None
    assert point(active, None) is None
    assert refused(active) == {"no_point_id": 2}


def test_point_ids_increase_strictly_from_the_last_accepted_one(active: ServoRules) -> None:
    assert point(active, 3) is not None
    for stale in (3, 2, -5):
        assert point(active, stale) is None
    assert point(active, 9, position=[]) is None  # refused for another reason: 4 may still come
    assert point(active, 4) is not None
    assert refused(active) == {"point_id": 3, "dimension": 1}
    assert (active.received, active.accepted) == (6, 2)


@pytest.mark.parametrize("point_id", ["1", 1.5, False, 2**64])
def test_a_point_id_is_an_integer_of_64_bits(active: ServoRules, point_id: Any) -> None:
    assert point(active, point_id) is None
    assert refused(active) == {"point_id": 1}


def test_a_whole_float_is_an_integer(active: ServoRules) -> None:
    assert active.read('{"point_id": 1.0, "position": [0, 0, 0, 0, 0, 0, 0]}') is not None


@pytest.mark.parametrize(
    ("name", "cartesian"), [("joint", False), (0, False), ("cartesian", True), (1, True)]
)
def test_point_types_are_words_or_numbers(active: ServoRules, name: Any, cartesian: bool) -> None:
    read = point(active, point_type=name, position=[0.1] * (6 if cartesian else 7))
    assert read is not None
    assert read.cartesian == cartesian


def test_a_point_without_a_point_type_is_of_joints(active: ServoRules) -> None:
    read = point(active, point_type=...)
    assert read is not None
    assert not read.cartesian


@pytest.mark.parametrize("name", ["Joint", 2, -1, True, None, [0], 0.5])
def test_another_point_type_is_refused(active: ServoRules, name: Any) -> None:
    assert point(active, point_type=name) is None
    assert refused(active) == {"point_type": 1}


@pytest.mark.parametrize(("kind", "sizes"), [("joint", (0, 1, 6, 8, 1000)), ("cartesian", (0, 5, 7, 12))])
def test_a_position_has_as_many_numbers_as_its_type_says(
    active: ServoRules, kind: str, sizes: tuple[int, ...]
) -> None:
    for size in sizes:
        assert point(active, point_type=kind, position=[0.0] * size) is None
    assert refused(active) == {"dimension": len(sizes)}


@pytest.mark.parametrize("position", [None, 1.0, "0000000", {"0": 1.0}, ...])
def test_a_position_is_a_list(active: ServoRules, position: Any) -> None:
    assert point(active, position=position) is None
    assert refused(active) == {"dimension": 1}


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, True, "0", None, [0.0], 10**400, 2**63])
@pytest.mark.parametrize("kind", ["joint", "cartesian"])
def test_a_position_is_made_of_finite_numbers(active: ServoRules, kind: str, value: Any) -> None:
    assert point(active, point_type=kind, position=[value, *[0.0] * (6 if kind == "joint" else 5)]) is None
    assert refused(active) == {"value": 1}


def test_a_joint_beyond_its_limits_is_refused(active: ServoRules) -> None:
    assert point(active, position=[*[0.0] * 6, 2.1]) is None
    assert refused(active) == {"limit": 1}
    assert active.last_refusal == "joint 7 must be from -2 to 2 rad, got 2.1"
    assert point(active, position=[2.0, -2.0, *[0.0] * 5]) is not None


@pytest.mark.parametrize("time", [0.0, None, ...])
def test_a_time_that_is_not_stated_is_the_send_period(active: ServoRules, time: Any) -> None:
    read = point(active, time=time)
    assert read is not None
    assert read.time_s == 0.02


@pytest.mark.parametrize("field", ["time", "lookahead_time", "gain"])
@pytest.mark.parametrize("value", [math.nan, math.inf, "1", True, [1.0], 10**400])
def test_times_and_gains_are_finite_numbers(active: ServoRules, field: str, value: Any) -> None:
    assert point(active, **{field: value}) is None
    assert refused(active) == {"value": 1}


@pytest.mark.parametrize("time", [-0.001, 10.5])
def test_a_time_out_of_its_range_is_refused(active: ServoRules, time: float) -> None:
    assert point(active, time=time) is None
    assert refused(active) == {"value": 1}


@pytest.mark.parametrize(
    ("lookahead", "gain", "used"),
    [
        (0.1, 200.0, (0.1, 200.0)),
        (0.001, 1.0, (0.03, 100.0)),
        (5.0, 1e6, (0.2, 2000.0)),
        (..., ..., (0.0, 0.0)),
        (0.0, 0.0, (0.0, 0.0)),
        (0.1, ..., (0.1, DEFAULT_GAIN)),
        (..., 500.0, (DEFAULT_LOOKAHEAD_S, 500.0)),
    ],
)
def test_lookahead_and_gain_are_moved_into_the_range_of_urs_servoj(
    active: ServoRules, lookahead: Any, gain: Any, used: tuple[float, float]
) -> None:
    read = point(active, lookahead_time=lookahead, gain=gain)
    assert read is not None
    assert (read.lookahead_s, read.gain) == used


def test_acceleration_velocity_and_unknown_fields_are_ignored(active: ServoRules) -> None:
    assert point(active, acceleration="none", velocity=[math.nan], comment={}) is not None


def test_fjt_control_overrides_only_what_it_says(rules: ServoRules) -> None:
    rules.fjt = rules.read('{"type": "fjt_control", "enable": true, "fjt_mode": 5}')  # type: ignore[assignment]
    assert rules.fjt == FjtControl(True, ServoMode.THROUGH)
    read = rules.read(
        '{"type": "fjt_control", "enable_fjt_action": false, "fjt_time": 0.01, "fjt_send_period": 0.005}'
    )
    assert read == FjtControl(False, ServoMode.THROUGH, 0.01, 0.005)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"enable": 1}, "value"),
        ({"fjt_mode": -1}, "mode"),
        ({"fjt_mode": 8}, "mode"),
        ({"fjt_time": "x"}, "value"),
        ({"fjt_time": 1e9}, "value"),
        ({"fjt_send_period": 5.0}, "value"),
    ],
)
def test_fjt_control_that_makes_no_sense_is_refused(
    rules: ServoRules, fields: dict[str, Any], reason: str
) -> None:
    assert rules.read(json.dumps({"type": "fjt_control", **fields})) is None
    assert refused(rules) == {reason: 1}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "stop",
        "{",
        "[]",
        "null",
        "NaN",
        "1e400",
        '"text"',
        "\0",
        "[" * 100_000,
        '{"a":' * 5_000,
        "9" * 5_000,
        '{"point_id": ' + "9" * 5_000 + "}",
        "\ud800",
        "x" * 10**6,
    ],
)
def test_what_is_no_json_object_is_refused(active: ServoRules, text: str) -> None:
    assert active.read(text) is None
    assert refused(active) == {"malformed": 1}
    assert len(active.last_refusal) < 300


def test_a_program_learns_at_once_what_is_wrong(rules: ServoRules) -> None:
    with pytest.raises(BrokenRule, match="no servo session"):
        rules.point([0.0] * 7, cartesian=False, time_s=0.0, lookahead_s=0.0, gain=0.0)
    with pytest.raises(BrokenRule, match="from 0 to 7"):
        rules.request(8, 0.5, 0.02)
    assert rules.request(1, 0.0, 0.0) == SetMode(ServoMode.REPLANNED, DEFAULT_WATCHDOG_S, PERIOD_S)


WORDS = ("servo_point", "servo_control", "fjt_control", "set_mode", "stop", "joint")
NAMES = (
    "type",
    "command",
    "mode",
    "watchdog_timeout",
    "send_period",
    "session_id",
    "point_id",
    "point_type",
    "position",
    "time",
    "lookahead_time",
    "gain",
    "enable",
    "fjt_mode",
    "fjt_time",
    "fjt_send_period",
)


@pytest.mark.parametrize("seed", few(range(5)))
def test_garbage_is_refused_and_counted_and_nothing_is_raised(seed: int) -> None:
    garbage = Garbage(seed)
    for _ in range(1000):
        refuse([message(garbage) for _ in range(garbage.randrange(9))])


def message(garbage: Garbage) -> str:
    kind = garbage.randrange(3)
    if kind == 0:
        return garbage.text()
    return json.dumps(garbage.mapping(NAMES, WORDS) if kind == 1 else garbage.value(WORDS))


def refuse(texts: list[str]) -> None:
    rules = ServoRules(LOW, HIGH, PERIOD_S)
    control(rules, mode=1)
    for text in texts:
        before = rules.refused.total()
        message = rules.read(text)
        assert rules.refused.total() == before + (message is None)
        if isinstance(message, Point):
            assert all(math.isfinite(value) for value in (*message.position, message.time_s, message.gain))
            rules.accept(message)
