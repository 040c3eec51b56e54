"""Outputs that a device reports in time, late or never. Oracle: the times that the test makes up."""

from __future__ import annotations

from cobot.robot.sent_outputs import SentOutputs

TIMEOUT_S = 2.0


def test_a_value_in_time_needs_no_word() -> None:
    sent = SentOutputs(TIMEOUT_S)
    sent.add("lamp", 1.0, 10.0)
    assert sent.explain({"lamp": 0.0}, 11.0) == ""
    assert sent.explain({"lamp": 1.0}, 11.5) == ""
    assert not sent


def test_an_analog_value_is_reported_as_the_device_has_it() -> None:
    """With 12 bits for 10 V."""
    sent = SentOutputs(TIMEOUT_S)
    sent.add("valve", 2.5, 10.0)
    assert sent.explain({"valve": 2.5 + 10.0 / 4096}, 11.0) == ""
    assert not sent


def test_a_value_that_comes_late_is_named_once() -> None:
    sent = SentOutputs(TIMEOUT_S)
    sent.add("lamp", 1.0, 10.0)
    assert sent.explain({}, 12.5).startswith("lamp is not confirmed: the device has not reported 1 within 2")
    assert sent.explain({"lamp": 0.0}, 13.0) == ""
    assert sent.explain({"lamp": 1.0}, 40.0).startswith("lamp is 1 now, 30.0 s after the request: the device")
    assert sent.explain({"lamp": 1.0}, 41.0) == ""


def test_a_first_report_that_comes_late_is_named_too() -> None:
    """After a lost connection."""
    sent = SentOutputs(TIMEOUT_S)
    sent.add("lamp", 1.0, 10.0)
    assert "is 1 now, 5.0 s after the request" in sent.explain({"lamp": 1.0}, 15.0)


def test_only_the_newest_value_counts() -> None:
    sent = SentOutputs(TIMEOUT_S)
    first = sent.add("lamp", 1.0, 10.0)
    sent.add("lamp", 0.0, 11.0)
    sent.drop("lamp", first)
    assert sent
    assert sent.explain({"lamp": 0.0}, 12.5) == ""
    second = sent.add("lamp", 1.0, 13.0)
    sent.drop("lamp", second)
    assert not sent
