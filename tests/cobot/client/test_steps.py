"""Steps of programs in Python. Oracle: what the service receives, and a clock of the test."""

from __future__ import annotations

import json
import math
from typing import Any

import httpx2
import pytest
from scipy.spatial.transform import Rotation

from cobot.client import Client
from cobot.client import steps as client_steps
from cobot.client.conditions import describe, require_condition
from cobot.client.pallets import places
from cobot.client.steps import on_error
from cobot.errors import (
    CobotError,
    ExecutionError,
    InputError,
    MotionStopped,
    NotFoundError,
    UnavailableError,
)
from cobot.orientations import kuka_angles, kuka_quaternion

ORIGIN = {"x": 0.4, "y": 0.0, "z": 0.1}


def client(*answers: Any) -> tuple[Client, list[tuple[str, str, Any]]]:
    left, asked = list(answers), []

    def answer(request: httpx2.Request) -> httpx2.Response:
        body = (
            json.loads(request.content) if request.headers.get("content-type") == "application/json" else None
        )
        asked.append((request.method, request.url.path, body))
        return httpx2.Response(200, json=left.pop(0))

    return Client("http://robot.test", transport=httpx2.MockTransport(answer)), asked


def points(value: bool) -> dict[str, Any]:
    return {"points": [{"name": "part", "kind": "boolean", "direction": "input", "value": value}]}


def test_an_output_is_set_by_both_names() -> None:
    arm, asked = client({}, {})
    arm.set("door/left", True)
    arm.set_output("level", 0.5)
    assert [(method, body) for method, _, body in asked] == [
        ("PUT", {"value": True}),
        ("PUT", {"value": 0.5}),
    ]
    assert [path for _, path, _ in asked] == ["/robot/io/door/left", "/robot/io/level"]


def test_a_program_waits_for_an_input(monkeypatch: pytest.MonkeyPatch) -> None:
    arm, asked = client(
        points(False), points(False), points(True), points(False), points(False), points(False)
    )
    slept: list[float] = []

    class Time:
        def now_s(self) -> float:
            return sum(slept)

        def sleep(self, seconds: float) -> None:
            slept.append(seconds)

    monkeypatch.setattr(client_steps.wait_until, "__defaults__", (Time(), lambda: 0.0))
    assert arm.wait_for({"input": "part", "is": True}) == pytest.approx(0.1)
    with pytest.raises(
        ExecutionError, match=r"part is true did not become true within 0.1 s; the input is false"
    ):
        arm.wait_for({"input": "part", "is": True}, timeout_s=0.1)
    assert len(asked) == 6


@pytest.mark.parametrize(
    ("condition", "words"),
    [
        ("part", "a condition is"),
        ({}, "a condition is"),
        ({"input": "part"}, "a condition is"),
        ({"input": "part", "is": True, "above": 1}, "a condition is"),
        ({"input": "part", "equals": 1}, "a condition is"),
        ({"input": "part", "is": 1}, "is is 1; it must be true or false"),
        ({"input": "level", "above": True}, "above is true; it must be a number"),
        ({"input": "level", "below": math.nan}, "below is NaN; it must be a number"),
    ],
)
def test_a_condition_of_another_form_is_refused(condition: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        require_condition(condition)


def test_a_condition_is_described_in_words() -> None:
    assert describe({"input": "part", "is": False}) == "part is false"
    assert describe({"input": "level", "below": 0.25}) == "level is below 0.25"


@pytest.mark.parametrize("seconds", [-1, math.nan, math.inf, 1e6, "1", True, None])
def test_a_time_that_cannot_be_is_refused(seconds: Any) -> None:
    arm, _ = client()
    with pytest.raises(InputError, match="allowed: 0 to 86400 s"):
        arm.wait_s(seconds)
    with pytest.raises(InputError, match="allowed: 0 to 86400 s"):
        arm.wait_for({"input": "part", "is": True}, seconds)


def test_work_is_done_again_until_it_succeeds_or_has_failed_too_often() -> None:
    failures, seen = [ExecutionError("one"), ExecutionError("two")], []

    def work() -> str:
        if failures:
            raise failures.pop(0)
        return "done"

    assert on_error(work, retry=2, run=lambda error: seen.append(str(error))) == "done"
    assert seen == ["one", "two"]
    failures += [ExecutionError("three"), ExecutionError("four")]
    with pytest.raises(ExecutionError, match="four"):
        on_error(work, retry=1)
    failures += [ExecutionError("five")]
    assert on_error(work, go_on=True) is None


@pytest.mark.parametrize(
    "error", [MotionStopped("s"), InputError("i"), NotFoundError("n"), UnavailableError("u")]
)
def test_what_no_retry_can_heal_is_raised_at_once(error: CobotError) -> None:
    attempts = []

    def work() -> None:
        attempts.append(1)
        raise error

    with pytest.raises(type(error)):
        on_error(work, retry=5, go_on=True)
    assert len(attempts) == 1


@pytest.mark.parametrize("retry", [-1, 1001, 1.5, True, "2"])
def test_a_number_of_retries_that_cannot_be_is_refused(retry: Any) -> None:
    with pytest.raises(InputError, match="allowed: 0 to 1000"):
        on_error(lambda: None, retry=retry)


def test_places_are_counted_along_the_first_direction_first() -> None:
    found = list(places(ORIGIN, [2, 2, 2], [{"x": 0.1}, {"y": 0.2}, {"z": 0.3}]))
    assert [place.number for place in found] == list(range(1, 9))
    expected = [(0.4 + 0.1 * a, 0.2 * b, 0.1 + 0.3 * c) for c in range(2) for b in range(2) for a in range(2)]
    assert [place.position for place in found] == [pytest.approx(each) for each in expected]


@pytest.mark.parametrize(
    ("counts", "offsets", "words"),
    [
        ([], [], "counts has 0 directions, allowed: 1 to 3"),
        ([1, 1, 1, 1], [{}] * 4, "counts has 4 directions, allowed: 1 to 3"),
        ([2], [], "counts has 1 directions and offsets has 0"),
        ([0], [{}], r"counts\[0\] is 0, allowed: 1 to 10000"),
        ([2, -1], [{}, {}], r"counts\[1\] is -1"),
        ([2.5], [{}], r"counts\[0\] is 2.5"),
        ([True], [{}], r"counts\[0\] is True"),
        ([10**5000], [{}], r"counts\[0\] is too large"),
        ([1000, 1000], [{}, {}], "1000 x 1000 are 1000000 places, allowed: 1 to 10000"),
    ],
)
def test_a_grid_that_cannot_be_is_refused(counts: Any, offsets: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        list(places(ORIGIN, counts, offsets))


def test_a_pallet_is_not_in_the_frame_of_the_tool() -> None:
    with pytest.raises(InputError, match="'tool', which moves with the arm"):
        list(places({**ORIGIN, "frame_id": "tool"}, [1], [{}]))


@pytest.mark.parametrize("angles", [(0.0, 0.0, 0.0), (0.5, -1.2, 2.5), (-3.0, 0.3, -2.0)])
def test_kuka_angles_and_quaternions_are_inverse(angles: tuple[float, float, float]) -> None:
    """Oracle: scipy's rotations."""
    found = kuka_quaternion(*angles)
    w, x, y, z = found
    assert (Rotation.from_quat([x, y, z, w]) * Rotation.from_euler("ZYX", angles).inv()).magnitude() < 1e-12
    assert kuka_angles(found) == pytest.approx(angles)


def test_a_called_program_is_waited_for(tmp_path: Any) -> None:
    file = tmp_path / "pick.json"
    file.write_text("{}")
    ended = {"state": "finished", "error": None}
    arm, asked = client({"id": "j1"}, {"state": "running", "error": None}, ended)
    assert arm.call(file) == ended
    assert [(method, path) for method, path, _ in asked] == [
        ("POST", "/sequences/start"),
        ("GET", "/jobs/j1"),
        ("GET", "/jobs/j1"),
    ]
