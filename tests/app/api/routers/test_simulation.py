"""The time factor of the simulation over REST.

Oracle: the virtual clock, on which the service waits, against the robot's own clock.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from virtual_service import VirtualService

FACTOR = "/robot/simulation/time_factor"
PAUSE_S = 3.0
"""What a pause takes at the most in real time, as the service waits for it."""
AWAY = {"name": "work", "speed": 0.25}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    folder: Path = tmp_path_factory.mktemp("factor")
    (folder / "endpoints.yaml").write_text("endpoints: {POST /robot/move/named: {timeout_s: 4}}\n")
    with VirtualService(folder, more="web: {endpoints: endpoints.yaml}").serving() as made:
        yield made


@pytest.fixture(autouse=True)
def _in_real_time(run: VirtualService) -> Iterator[None]:
    yield
    run.post(FACTOR, {"factor": 1.0}).raise_for_status()
    run.go_home()


def begin(run: VirtualService, body: dict[str, Any]) -> str:
    """The job of a motion."""
    return str(run.post("/robot/move/named?wait=false", body).raise_for_status().json()["id"])


def state(run: VirtualService) -> dict[str, Any]:
    found: dict[str, Any] = run.get("/robot/state").json()
    return found


def moved_s(run: VirtualService) -> tuple[float, float]:
    """How long a motion takes on the clock of the service, and on that of the robot."""
    begun_s, robot_s = run.clock.now_s(), state(run)["robot_time_s"]
    answer = run.post("/robot/move/named", AWAY)
    assert answer.status_code == 200, answer.text
    return run.clock.now_s() - begun_s, state(run)["robot_time_s"] - robot_s


def test_a_motion_takes_as_much_longer_or_shorter_as_the_factor_says(run: VirtualService) -> None:
    """Its timeout of 4 s does not end the slow one, which takes 12 s of the service's clock."""
    assert run.get(FACTOR).json() == {"factor": 1.0}
    plain_s, robot_s = moved_s(run)
    assert plain_s == pytest.approx(robot_s, abs=0.05)
    assert 1.5 < plain_s < 4.0
    for factor in (0.25, 4.0, 0.1):
        run.go_home()
        assert run.post(FACTOR, {"factor": factor}).json() == {"factor": factor}
        assert state(run)["time_factor"] == factor
        scaled_s, same_s = moved_s(run)
        assert same_s == pytest.approx(robot_s, abs=0.05)
        assert scaled_s == pytest.approx(plain_s / factor, rel=0.05, abs=0.1)


def test_the_factor_changes_during_a_motion_and_so_does_the_remaining_time(run: VirtualService) -> None:
    job = begin(run, AWAY)
    run.sleep(0.5)
    left_s = run.get(f"/jobs/{job}").json()["remaining_s"]
    run.post(FACTOR, {"factor": 0.1}).raise_for_status()
    assert run.get(f"/jobs/{job}").json()["remaining_s"] == pytest.approx(10.0 * left_s, rel=0.1)
    before_s = state(run)["robot_time_s"]
    run.sleep(1.0)
    assert state(run)["robot_time_s"] - before_s == pytest.approx(0.1, abs=0.02)
    run.post(FACTOR, {"factor": 4.0}).raise_for_status()
    run.until(lambda: run.get(f"/jobs/{job}").json()["state"] == "finished")


def test_a_motion_in_slow_motion_pauses_and_stops_as_quickly_as_the_client_waits(run: VirtualService) -> None:
    """At a tenth of the speed the way to rest takes seconds for a pause. A stop runs in real time."""
    run.post(FACTOR, {"factor": 0.1}).raise_for_status()
    job = begin(run, AWAY | {"speed": 1.0})
    run.sleep(3.0)
    begun_s = run.clock.now_s()
    answer = run.post(f"/jobs/{job}/pause")
    assert answer.status_code == 200, answer.text
    assert run.clock.now_s() - begun_s > PAUSE_S
    run.post(f"/jobs/{job}/resume").raise_for_status()
    run.sleep(1.0)
    begun_s = run.clock.now_s()
    assert run.post("/stop").json()["at_rest"]
    assert run.clock.now_s() - begun_s < 1.5


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ('{"factor": 0}', "factor: must be greater than or equal to 0.1, got 0"),
        ('{"factor": -1}', "factor: must be greater than or equal to 0.1, got -1"),
        ('{"factor": 4.1}', "factor: must be less than or equal to 4, got 4.1"),
        ('{"factor": NaN}', "NaN"),
        ('{"factor": "fast"}', "factor: must be a number"),
        ('{"factor": true}', "factor: must be a number"),
        ("{}", "factor"),
        ('{"factor": 2, "speed": 1}', "speed"),
    ],
)
def test_what_is_no_factor_is_rejected(run: VirtualService, body: str, words: str) -> None:
    answer = run.ask("POST", FACTOR, content=body, headers={"Content-Type": "application/json"})
    assert answer.status_code in (400, 422), answer.text
    assert words in answer.json()["detail"]
    assert run.get(FACTOR).json() == {"factor": 1.0}


def test_only_the_client_in_control_changes_the_factor(run: VirtualService) -> None:
    token = run.post("/robot/control", {"timeout_s": 60}).json()["token"]
    try:
        answer = run.post(FACTOR, {"factor": 2.0})
        assert answer.status_code == 409
        assert "control" in answer.json()["detail"]
        mine = {"X-Control-Token": token}
        assert run.post(FACTOR, {"factor": 2.0}, headers=mine).json() == {"factor": 2.0}
    finally:
        run.ask("DELETE", "/robot/control", headers={"X-Control-Token": token}).raise_for_status()


def test_a_change_is_an_event(run: VirtualService) -> None:
    with run.listen("/events?types=time_factor") as events:
        run.post(FACTOR, {"factor": 0.5}).raise_for_status()
        assert events.event("time_factor")["data"] == {"factor": 0.5}
