"""Actions and conditions of motions in the queue, over REST, on virtual time.

Oracle: the commands of the cycle, and how long pinocchio says the path of the TCP through them is. An action
has to fire in the first cycle whose command is that far along.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from independent_models import second_robot
from queued_actions import HOME, Json, Queue, reached, setting
from wired_arm import WiredService

from cobot.types import LoopMode

A, B, C = ([turn, lift, *HOME[2:]] for turn, lift in ((0.6, 0.0), (0.6, 0.4), (0.1, 0.4)))
RADIUS_M = 0.05
START = {"x": 0.55, "y": 0.0, "z": 0.6, "b": 3.14159, "speed": 0.8}
DOWN = {"x": 0.55, "y": 0.0, "z": 0.45, "b": 3.14159, "planner": "lin", "speed": 0.2}
PART = {"input": "part", "is": True}


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[WiredService]:
    with WiredService(tmp_path_factory.mktemp("queued_signals")).serving() as made:
        yield made


@pytest.fixture
def queue(service: WiredService) -> Iterator[Queue]:
    service.cycles[service.name].watch = lambda: None
    service.arm.push = np.zeros(6)
    if service.rig.mode is not LoopMode.HOLD:
        service.post("/robot/reset").raise_for_status()
    service.go_home()
    service.arm.wire()
    made = Queue(service)
    with made.noting():
        yield made
    service.post("/stop").raise_for_status()
    service.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()


@pytest.mark.parametrize("seed", range(4))
def test_actions_fire_once_in_their_cycle_through_a_blend_under_overrides_and_pauses(
    queue: Queue, seed: int
) -> None:
    random = np.random.default_rng(seed)
    first = queue.add(A, RADIUS_M, actions=[setting(1.0, distance_m=0.05), setting(2.0, distance_m=0.2)])
    last = queue.add(B, actions=[setting(3.0, **{"distance_m": 0.05, "from": "end"})])
    queue.vary_speed(random, int(random.integers(0, 6)))
    queue.until(last)
    lengths_m = queue.lengths_m()
    places_m = [0.05, 0.2, lengths_m[-1] - 0.05]
    assert [cycle for _, cycle in queue.fired] == [reached(lengths_m, place_m) for place_m in places_m]
    assert queue.values == [1.0, 2.0, 3.0]
    assert [queue.fates(first), queue.fates(last)] == [[True, True], [True]]
    before = queue.job(last)["actions"][0]
    assert before["path_time_s"] == pytest.approx(before["planned_s"], abs=1.1e-3)


def test_an_action_fires_once_when_the_next_motion_comes_while_the_arm_is_past_it(queue: Queue) -> None:
    """The end of the first motion is cut off by the blend: what was to happen there happens in its middle."""
    ends = [setting(1.0, time_s=0.1), setting(2.0, **{"distance_m": 0.0, "from": "end"})]
    first = queue.add(A, RADIUS_M, actions=ends)
    queue.run.until(lambda: queue.values == [1.0])
    second = queue.add(B, RADIUS_M, actions=[setting(3.0, distance_m=0.0)])
    queue.run.until(lambda: queue.values == [1.0, 2.0, 3.0])
    third = queue.add(C, actions=[setting(4.0, fraction=1.0)])
    queue.until(third)
    assert queue.values == [1.0, 2.0, 3.0, 4.0]
    assert queue.rests() == 0
    cycles = [cycle for _, cycle in queue.fired]
    assert cycles[1] == cycles[2], "the end of one is the start of the next"
    at_end = queue.job(first)["actions"][1]["position"]
    corner = second_robot().path(np.array([A]))[0][0]
    assert 0.0 < np.linalg.norm(np.array(at_end) - corner) < RADIUS_M
    assert queue.fates(second) == [True]


def test_a_pause_and_a_resume_of_the_job_fire_nothing_twice(queue: Queue) -> None:
    first = queue.add(A, RADIUS_M, actions=[setting(n, fraction=n / 10.0) for n in range(1, 10)])
    last = queue.add(B, actions=[setting(10.0, fraction=0.0)])
    for count in (2, 5, 7):
        queue.run.until(lambda count=count: len(queue.fired) >= count)
        queue.run.post(f"/jobs/{first}/pause").raise_for_status()
        queue.run.sleep(0.3)
        queue.run.post(f"/jobs/{first}/resume").raise_for_status()
    queue.until(last)
    assert queue.values == [float(n) for n in range(1, 11)]


def test_more_actions_than_a_motion_has_in_all_the_moves_together(queue: Queue) -> None:
    """rtloop has a place for 64 at a time. Those that have fired make room."""
    jobs = []
    for turn in (0.4, 0.8, 0.4, 0.0):
        actions = [setting(n, fraction=n / 41.0) for n in range(1, 41)]
        jobs.append(queue.add([turn, *HOME[1:]], actions=actions))
    queue.until(jobs[-1])
    assert queue.values == [float(n) for n in range(1, 41)] * 4
    assert all(queue.fates(job) == [True] * 40 for job in jobs)


def test_what_a_stop_leaves_is_reported_as_not_fired_by_each_job(queue: Queue) -> None:
    first = queue.add(A, RADIUS_M, actions=[setting(1.0, time_s=0.1), setting(2.0, fraction=1.0)])
    second = queue.add(B, actions=[setting(3.0, fraction=0.5)])
    queue.run.until(lambda: queue.values == [1.0])
    queue.run.post("/stop").raise_for_status()
    queue.run.sleep(0.5)
    assert queue.states(first, second) == ["cancelled"] * 2
    assert [queue.fates(first), queue.fates(second)] == [[True, False], [False]]
    assert queue.values == [1.0]
    assert all(not each["problem"] for each in queue.job(second)["actions"])


def test_a_move_that_is_taken_out_does_not_fire_and_the_rest_of_the_path_keeps_its_places(
    queue: Queue,
) -> None:
    """The arm stops for the cancelled one in the middle of the first, which goes on: its actions stay where
    they are on its path, and those that have fired do not fire again."""
    places_m = [0.05, 0.17, 0.23]
    first = queue.add(A, actions=[setting(n, distance_m=place) for n, place in enumerate(places_m, 1)])
    gone = queue.add(B, actions=[setting(4.0, fraction=0.5)])
    last = queue.add(HOME, actions=[setting(5.0, fraction=0.5)])
    queue.run.until(lambda: queue.values == [1.0])
    queue.run.until(lambda: len(queue.run.app.state.services.queue._running.moves) == 3)
    assert queue.run.post(f"/jobs/{gone}/cancel").json()["state"] == "cancelled"
    queue.until(last)
    assert queue.states(first, gone, last) == ["finished", "cancelled", "finished"]
    assert queue.values == [1.0, 2.0, 3.0, 5.0]
    assert [queue.fates(first), queue.fates(gone)] == [[True] * 3, [False]]
    lengths_m = queue.lengths_m()
    cycles = [reached(lengths_m, place_m) for place_m in places_m]
    assert np.abs(np.array([cycle for _, cycle in queue.fired[:3]]) - cycles).max() <= 1
    assert queue.job(first)["actions"][1]["at"] == "0.17 m after the start"


def test_a_job_that_is_taken_out_while_it_waits_reports_its_actions(queue: Queue) -> None:
    queue.run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()
    first, gone = queue.add(A), queue.add(B, actions=[setting(1.0, fraction=0.5)])
    assert queue.fates(gone) == [False]
    with queue.run.listen("/events?types=action") as events:
        queue.run.post(f"/jobs/{gone}/cancel").raise_for_status()
        found = events.event("action")["data"]
    assert (found["what"], found["job"]) == ("not fired", gone)
    queue.run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    queue.until(first)
    assert queue.values == []


def test_a_motion_that_waits_to_start_begins_from_rest_behind_the_one_before(queue: Queue) -> None:
    first = queue.add(A, RADIUS_M)
    second = queue.add(B, start_when=PART, actions=[setting(1.0, fraction=0.5)])
    third = queue.add(C)
    queue.until(first)
    queue.run.sleep(2.0)
    np.testing.assert_allclose(queue.commanded[-1], A, atol=1e-9)
    assert queue.job(second)["waits_for"] == "start_when: input part is true"
    assert queue.states(second, third) == ["running", "queued"]
    assert queue.values == []
    queue.run.arm.inputs["part"] = 1.0
    queue.until(third)
    assert queue.values == [1.0]
    assert queue.states(second) == ["finished"]


def test_a_motion_that_waits_to_start_still_waits_when_another_is_taken_out(queue: Queue) -> None:
    first = queue.add(A, start_when=PART, actions=[setting(1.0, distance_m=0.1)])
    gone, last = queue.add(B), queue.add(C)
    queue.run.until(lambda: queue.job(first)["waits_for"])
    queue.run.sleep(1.0)
    assert queue.run.post(f"/jobs/{gone}/cancel").json()["state"] == "cancelled"
    queue.run.sleep(1.0)
    assert queue.job(first)["waits_for"] == "start_when: input part is true"
    np.testing.assert_allclose(queue.commanded[-1], HOME, atol=1e-9)
    queue.run.arm.inputs["part"] = 1.0
    queue.until(last)
    assert queue.values == [1.0]


def test_a_pause_belongs_to_its_own_part_of_the_path(queue: Queue) -> None:
    queue.run.arm.inputs["part"] = 1.0
    first = queue.add(A, RADIUS_M)
    second = queue.add(B, pause_while=PART, actions=[setting(1.0, fraction=0.9)])
    third = queue.add(C)
    queue.until(first)
    queue.run.sleep(2.0)
    assert queue.job(second)["waits_for"] == "pause_while: input part is true"
    assert not np.diff(queue.commanded[-100:], axis=0).any()
    corner = second_robot().path(np.array([A]))[0][0]
    assert np.linalg.norm(second_robot().path(queue.commanded[-1:])[0][0] - corner) < 2.0 * RADIUS_M
    queue.run.arm.inputs["part"] = 0.0
    queue.until(second)
    queue.run.arm.inputs["part"] = 1.0
    queue.until(third)
    assert queue.values == [1.0]


def test_one_condition_pauses_blended_motions_in_a_row_and_another_one_begins_from_rest(
    queue: Queue,
) -> None:
    jobs = [queue.add(A, RADIUS_M, pause_while=PART), queue.add(B, RADIUS_M, pause_while=PART)]
    other = queue.add(C, pause_while={"input": "distance", "above": 0.8})
    for job in jobs:
        queue.until(job, "running")
        queue.run.sleep(0.3)
        queue.run.arm.inputs["part"] = 1.0
        queue.run.sleep(1.0)
        assert not np.diff(queue.commanded[-100:], axis=0).any()
        assert queue.job(job)["waits_for"]
        queue.run.arm.inputs["part"] = 0.0
        queue.until(job)
    np.testing.assert_allclose(
        queue.commanded[np.abs(queue.commanded - B).max(axis=1).argmin()], B, atol=1e-9
    )
    queue.until(other, "running")
    queue.run.arm.inputs["part"] = 1.0
    queue.until(other)


def touch(queue: Queue, at_z: float) -> None:
    """A wall below the arm: the further the TCP is below it, the harder it pushes up."""
    tcp, arm = queue.run.rig.memory.state.data["tcp"], queue.run.arm

    def push() -> None:
        arm.push[2] = max(0.0, 20_000.0 * (at_z - float(tcp[2])))

    queue.run.cycles[queue.run.name].watch = push


def test_a_contact_ends_its_own_motion_and_the_queue_goes_on_from_there(queue: Queue) -> None:
    touch(queue, 0.5)
    above = queue.add(START, RADIUS_M, actions=[setting(1.0, fraction=1.0)])
    until = {"force": {"threshold": 15.0}, "retract": 0.03}
    down = queue.add(DOWN, RADIUS_M, until=until, actions=[setting(2.0, fraction=1.0)])
    up = queue.add(START, actions=[setting(3.0, fraction=1.0)])
    queue.until(up)
    assert queue.states(above, down, up) == ["finished"] * 3
    record = queue.job(down)
    assert record["stopped_by"] == "the force at the TCP is above 15 N"
    assert record["contact"]["position"][2] == pytest.approx(0.5, abs=4e-3)
    assert record["contact"]["retracted_m"] == pytest.approx(0.03, abs=1e-4)
    assert queue.values == [1.0, 3.0]
    assert queue.fates(down) == [False]
    assert [queue.job(job)["stopped_by"] for job in (above, up)] == [None, None]


def test_a_condition_holds_before_its_own_motion_and_ends_nothing(queue: Queue) -> None:
    """The input is true all along; the motion with `until` ends where it begins, in the blend."""
    queue.run.arm.inputs["part"] = 1.0
    first = queue.add(A, RADIUS_M)
    second = queue.add(B, until={"input": "part", "is": True, "stop": "path"})
    queue.until(second)
    assert queue.states(first) == ["finished"]
    corner = second_robot().path(np.array([A]))[0][0]
    assert np.linalg.norm(second_robot().path(queue.commanded[-1:])[0][0] - corner) < 2.0 * RADIUS_M


def test_a_goal_without_contact_empties_the_queue_or_goes_on(queue: Queue) -> None:
    above = queue.add(START)
    down = queue.add(DOWN, until={"force": {}, "if_not_met": "success"})
    up = queue.add(START)
    missed, behind = queue.add(DOWN, until={"force": {}}), queue.add(START)
    queue.until(behind, "cancelled")
    assert queue.states(above, down, up, missed) == ["finished"] * 3 + ["failed"]
    assert queue.job(missed)["error"]["code"] == "condition_not_met"
    assert queue.job(down)["stopped_by"] is None


def test_an_arm_that_is_there_already_does_its_actions_in_its_turn(queue: Queue) -> None:
    queue.add(A, RADIUS_M, actions=[setting(1.0, fraction=1.0)])
    there = queue.add(A, RADIUS_M, actions=[setting(2.0, distance_m=0.0)])
    last = queue.add(HOME, actions=[setting(3.0, distance_m=0.0)])
    queue.until(last)
    assert queue.values == [1.0, 2.0, 3.0]
    assert queue.fates(there) == [True]


def test_motions_of_a_queued_sequence_have_their_own(queue: Queue) -> None:
    motions = [
        {"joints": A, "speed": 0.3, "actions": [setting(1.0, fraction=0.5)]},
        {"joints": B, "speed": 0.3, "actions": [setting(2.0, distance_m=0.0), setting(3.0, fraction=1.0)]},
    ]
    both = queue.add({"motions": motions, "radii": [RADIUS_M]}, RADIUS_M, "/robot/move/sequence")
    last = queue.add(C, actions=[setting(4.0, fraction=1.0)])
    queue.until(last)
    assert queue.values == [1.0, 2.0, 3.0, 4.0]
    assert [each["action"] for each in queue.job(both)["actions"]] == [
        "actions[0]",
        "actions[0]",
        "actions[1]",
    ]
    assert queue.rests() == 0


def test_a_plan_in_the_queue_does_its_actions(queue: Queue) -> None:
    first = queue.add(A, RADIUS_M)
    body = {"joints": B, "speed": 0.3, "start": A, "actions": [setting(1.0, fraction=0.5)]}
    made = queue.run.post("/robot/plan/joints", body).raise_for_status().json()
    second = queue.add({"plan_id": made["plan_id"]}, 0.0, "/robot/execute")
    third = queue.add(HOME)
    queue.until(third)
    assert queue.values == [1.0]
    assert queue.states(first, second) == ["finished"] * 2
    assert queue.fates(second) == [True]


@pytest.mark.parametrize(
    ("fields", "detail"),
    [
        ({"actions": [setting(1.0, distance_m=9.0)]}, "actions[0].at.distance_m: is 9 m, but the path is 0."),
        ({"until": {"force": {}, "relative_to": "zero"}}, "set it with POST /robot/force/zero"),
        ({"start_when": {"input": "light", "is": True}}, "start_when.input: there is no input 'light'"),
    ],
)
def test_what_is_wrong_is_said_when_it_is_queued(queue: Queue, fields: Json, detail: str) -> None:
    first = queue.add(A)
    answer = queue.ask(B, **fields)
    assert answer.status_code in (409, 422), answer.text
    assert detail in answer.json()["detail"]
    queue.until(first)


def test_a_rejected_output_that_stops_its_motion_empties_the_queue(queue: Queue) -> None:
    queue.run.arm.refuses = "the valve block is off"
    first = queue.add(A, RADIUS_M, actions=[setting(1.0, time_s=0.2) | {"on_failure": "stop"}])
    second = queue.add(B, actions=[setting(2.0, fraction=0.5)])
    queue.until(second, "cancelled")
    assert "the valve block is off" in queue.job(first)["error"]["detail"]
    assert queue.job(first)["actions"][0]["problem"] == "the valve block is off"
    assert queue.fates(second) == [False]


@pytest.mark.thorough
@pytest.mark.parametrize("seed", [5, 18, 24])
def test_whatever_comes_and_is_taken_out_nothing_fires_twice_and_nothing_is_lost(
    queue: Queue, seed: int
) -> None:
    """Random motions, radii, overrides and cancels. Every job that finishes has fired all of its actions."""
    random, run = np.random.default_rng(seed), queue.run
    jobs: dict[str, list[float]] = {}
    for number in range(1, 9):
        goal = [random.uniform(-0.6, 0.6), random.uniform(-0.3, 0.5), *HOME[2:]]
        values = [10.0 * number + n for n in range(3)]
        actions = [setting(value, fraction=float(random.uniform())) for value in values]
        actions.append(setting(10.0 * number + 9.0, **{"distance_m": 0.0, "from": "end"}))
        job = queue.add(goal, float(random.choice([0.0, 0.03, 0.1])), actions=actions)
        jobs[job] = [*values, 10.0 * number + 9.0]
        run.sleep(float(random.uniform(0.0, 0.6)))
        run.post("/robot/speed_override", {"fraction": float(random.choice([0.3, 1.0, 1.0]))})
        if random.uniform() < 0.3:
            run.post(f"/jobs/{random.choice(list(jobs))}/cancel")
    run.until(lambda: all(queue.job(job)["ended_at"] for job in jobs))
    assert len(set(queue.values)) == len(queue.values), "none fires twice"
    for job, values in jobs.items():
        record = queue.job(job)
        assert [value in queue.values for value in values] == queue.fates(job)
        assert record["state"] in ("finished", "cancelled"), record["error"]
        if record["state"] == "finished":
            assert queue.fates(job) == [True] * 4
    assert "finished" in queue.states(*jobs)
