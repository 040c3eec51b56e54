"""Jobs that wait for their turn, over REST, on virtual time.

Oracle: what the cycle has commanded, cycle by cycle; pinocchio for where the TCP is; the table of states in
docs/jobs.md, written out by hand.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from independent_models import second_robot
from virtual_service import VirtualService

from app.services.motion.queue import motion_queue

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
RADIUS_M = 0.05
INTO_ITSELF = {"x": 0.0, "y": 0.0, "z": 0.1}
Json = dict[str, Any]


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    yield service
    service.post("/stop").raise_for_status()
    service.post("/scene", {"clear": True}).raise_for_status()
    service.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()


def place(**by: float) -> list[float]:
    """Home, with some joints changed: j0=0.5."""
    joints = list(HOME)
    for name, change in by.items():
        joints[int(name[1:])] += change
    return joints


def asked(
    run: VirtualService, body: Json, path: str = "/robot/move/joints", radius_m: float = 0.0
) -> httpx.Response:
    speed = {} if body.keys() & {"motions", "plan_id"} else {"speed": 0.3}
    return run.post(f"{path}?queue=true&blend_radius={radius_m}", speed | body)


def queued(
    run: VirtualService,
    body: Json,
    path: str = "/robot/move/joints",
    radius_m: float = 0.0,
    kind: str = "move",
) -> Json:
    answer = asked(run, body, path, radius_m)
    assert answer.status_code == 202, answer.text
    found: Json = answer.json()
    assert answer.headers["location"] == f"/jobs/{found['id']}"
    assert found["kind"] == kind
    return found


def through(*places: list[float]) -> list[Json]:
    return [{"joints": joints, "speed": 0.3} for joints in places]


def plan(
    run: VirtualService, start: list[float], *places: list[float], radii: tuple[float, ...] = ()
) -> Json:
    """A plan that begins there, of one motion or several."""
    body = {"motions": through(*places), "radii": list(radii), "start": start}
    found: Json = run.post("/robot/plan/sequence", body).raise_for_status().json()
    return found


def execution(run: VirtualService, found: Json) -> Json:
    return queued(run, {"plan_id": found["plan_id"]}, "/robot/execute", kind="execute")


def held(run: VirtualService) -> None:
    """Nothing of the queue begins."""
    run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()


def released(run: VirtualService) -> None:
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()


def ball_at(run: VirtualService, joints: list[float], radius_m: float = 0.05) -> None:
    """From now on a ball stands where the TCP is at these joints."""
    place = second_robot().path(np.array([joints]))[0][0].tolist()
    ball = {"shape": "sphere", "radius": radius_m, **dict(zip("xyz", place, strict=True))}
    run.post("/scene", {"objects": {"ball": ball}}).raise_for_status()


def seen(run: VirtualService, job: Json) -> Json:
    found: Json = run.get(f"/jobs/{job['id']}").raise_for_status().json()
    return found


def states(run: VirtualService, *jobs: Json) -> list[str]:
    return [seen(run, job)["state"] for job in jobs]


def until(run: VirtualService, job: Json, state: str = "finished") -> None:
    run.until(lambda: seen(run, job)["state"] == state)


def cancelled(run: VirtualService, job: Json) -> Json:
    answer = run.post(f"/jobs/{job['id']}/cancel")
    assert answer.status_code == 200, answer.text
    found: Json = answer.json()
    return found


def commanded(run: VirtualService, since: int) -> np.ndarray:
    return np.array(run.rig.commanded[since:])


def begun(run: VirtualService) -> int:
    """How many motions rtloop has begun."""
    return int(run.rig.loop.controller.motion_id)


def rests(positions: np.ndarray) -> int:
    """How many cycles the arm stood still between its first and its last movement."""
    moves = np.flatnonzero(np.abs(np.diff(positions, axis=0)).max(axis=1) > 1e-7)
    return int(moves[-1] - moves[0] + 1 - len(moves))


def within_limits(run: VirtualService, positions: np.ndarray) -> None:
    limits = run.rig.limits
    for order, bound in enumerate((limits.max_velocity, limits.max_acceleration, limits.max_jerk), start=1):
        assert (np.abs(np.diff(positions, order, axis=0)) / 1e-3**order / bound).max() < 1.005


def came_near(run: VirtualService, since: int, joints: list[float]) -> float:
    """How near the TCP came to where it would be at these joints, m."""
    path = second_robot().path(commanded(run, since))[0]
    goal = second_robot().path(np.array([joints]))[0][0]
    return float(np.linalg.norm(path - goal, axis=1).min())


def test_queued_moves_are_jobs_one_after_the_other_and_round_their_corners(run: VirtualService) -> None:
    since, motions = len(run.rig.commanded), begun(run)
    corner = place(j0=0.8)
    first = queued(run, {"joints": corner}, radius_m=RADIUS_M)
    second = queued(run, {"joints": place(j0=0.8, j1=0.5)})
    assert (first["state"], second["state"]) == ("queued", "queued")
    assert first["planned_duration_s"] > 0.5
    assert first["parent"] == second["parent"] is not None
    until(run, first, "running")
    run.until(lambda: seen(run, first)["progress"] > 0.3)
    assert states(run, first, second) == ["running", "queued"]
    assert [each["id"] for each in run.get("/jobs?state=queued").json()["jobs"]] == [second["id"]]
    third = queued(run, {"name": "home"}, "/robot/move/named")
    until(run, first)
    assert states(run, second, third) == ["running", "queued"]
    assert 0.0 <= seen(run, second)["progress"] < 0.5
    assert seen(run, second)["remaining_s"] > 0.0
    until(run, third)
    ended = [seen(run, each) for each in (first, second, third)]
    assert [each["state"] for each in ended] == ["finished"] * 3
    assert all((each["progress"], each["remaining_s"]) == (1.0, 0.0) for each in ended)
    assert begun(run) == motions + 1
    positions = commanded(run, since)
    assert 1e-3 < came_near(run, since, corner) < RADIUS_M
    within_limits(run, positions)
    np.testing.assert_allclose(positions[-1], HOME, atol=1e-9)
    run.until(lambda: run.get(f"/jobs/{first['parent']}").json()["state"] == "finished")


def test_all_kinds_of_motions_can_be_queued(run: VirtualService) -> None:
    jobs = [
        queued(run, {"name": "work"}, "/robot/move/named"),
        queued(run, {"joints": HOME, "planner": "auto"}),
        queued(run, {"x": 0.45, "y": 0.0, "z": 0.5, "b": 3.14159}, "/robot/move/pose"),
        queued(run, {"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159, "planner": "lin"}, "/robot/move/pose"),
        queued(
            run,
            {"centre": {"x": 0.5, "y": 0.1, "z": 0.5}, "axis": {"x": 0, "y": 0, "z": 1}, "angle": 0.5},
            "/robot/move/arc",
        ),
    ]
    until(run, jobs[-1])
    assert states(run, *jobs) == ["finished"] * 5


def test_a_move_to_where_the_arm_gets_to_is_over_when_that_is(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.4)}, radius_m=RADIUS_M)
    there = queued(run, {"joints": place(j0=0.4)}, radius_m=RADIUS_M)
    last = queued(run, {"joints": HOME})
    until(run, first)
    until(run, there)
    assert seen(run, there)["planned_duration_s"] == 0.0
    until(run, last)


def test_what_cannot_be_is_refused_and_the_others_go_on(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.6)})
    refused = asked(run, INTO_ITSELF, "/robot/move/pose")
    assert refused.status_code == 422, refused.text
    beyond = asked(run, {"joints": place(j0=9.0)})
    assert beyond.status_code == 422
    last = queued(run, {"joints": HOME})
    until(run, last)
    assert states(run, first, last) == ["finished", "finished"]


@pytest.mark.parametrize(
    ("query", "named"),
    [
        ("blend_radius=0.1", "queue=true"),
        ("queue=true&blend_radius=-1", "blend_radius"),
        ("queue=x", "queue"),
    ],
)
def test_a_wrong_query_is_refused(run: VirtualService, query: str, named: str) -> None:
    answer = run.post(f"/robot/move/joints?{query}", {"joints": HOME})
    assert answer.status_code == 422
    assert named in answer.json()["detail"]


def test_a_round_corner_keeps_constraints(run: VirtualService) -> None:
    """The first motion must not go down, where the second one leads: less of its radius is used."""
    corner, below, motions = place(j0=0.8), place(j0=0.8, j1=0.5), begun(run)
    height = float(second_robot().path(np.array([HOME]))[0][0][2])
    box = {"min": {"x": -2.0, "y": -2.0, "z": height - 0.003}, "max": {"x": 2.0, "y": 2.0, "z": 2.0}}
    near = []
    for constraints in ({}, {"constraints": {"box": box}}):
        since = len(run.rig.commanded)
        queued(run, {"joints": corner, **constraints}, radius_m=RADIUS_M)
        until(run, queued(run, {"joints": below}))
        near.append(came_near(run, since, corner))
        within_limits(run, commanded(run, since))
        until(run, queued(run, {"joints": HOME}))
    assert begun(run) == motions + 4
    assert 1e-3 < near[1] < 0.7 * near[0] < RADIUS_M


def test_the_queue_is_bounded(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_queue, "CAPACITY", 2)
    held(run)
    jobs = [queued(run, {"joints": place(j0=0.1 * number)}) for number in (1, 2)]
    refused = asked(run, {"joints": HOME})
    assert refused.status_code == 409
    assert refused.json()["detail"] == "the motion queue is full: 2 moves are waiting, allowed: 2"
    released(run)
    until(run, jobs[-1])


def test_a_sequence_counts_as_its_motions(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(motion_queue, "CAPACITY", 3)
    held(run)
    motions = through(place(j0=0.1), place(j0=0.2))
    first = queued(run, {"motions": motions}, "/robot/move/sequence")
    plans = [plan(run, place(j0=0.2), place(j0=0.3), HOME), plan(run, place(j0=0.2), HOME)]
    full = asked(run, {"motions": motions}, "/robot/move/sequence")
    too_many = asked(run, {"plan_id": plans[0]["plan_id"]}, "/robot/execute")
    assert [full.status_code, too_many.status_code] == [409, 409]
    assert "2 moves are waiting, allowed: 3" in too_many.json()["detail"]
    last = execution(run, plans[1])
    released(run)
    until(run, last)
    assert states(run, first, last) == ["finished", "finished"]


def test_other_motions_are_refused_while_the_queue_has_something(run: VirtualService) -> None:
    job = queued(run, {"joints": place(j0=0.5)})
    refused = run.post("/robot/move/named", {"name": "home"})
    assert refused.status_code == 409
    assert "the motion queue" in refused.json()["detail"]
    until(run, job)


def test_a_queued_job_is_cancelled_alone_and_what_follows_is_planned_anew(run: VirtualService) -> None:
    run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()
    first = queued(run, {"joints": place(j0=0.3)})
    second = queued(run, {"joints": place(j0=0.3, j1=0.4)})
    third = queued(run, {"joints": place(j0=-0.3)})
    before = seen(run, third)["planned_duration_s"]
    gone = cancelled(run, second)
    assert (gone["state"], gone["started_at"]) == ("cancelled", None)
    assert f"job {second['id']} was cancelled by" in gone["error"]["detail"]
    since = len(run.rig.commanded)
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    until(run, third)
    assert states(run, first, third) == ["finished", "finished"]
    assert before > 0.0
    positions = commanded(run, since)
    assert np.abs(positions[:, 1] - HOME[1]).max() < 1e-9
    within_limits(run, positions)
    np.testing.assert_allclose(positions[-1], place(j0=-0.3), atol=1e-9)


def test_one_to_which_the_motion_leads_already_is_cancelled_too(run: VirtualService) -> None:
    since = len(run.rig.commanded)
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    second = queued(run, {"joints": place(j0=0.8, j1=0.6)}, radius_m=RADIUS_M)
    third = queued(run, {"joints": place(j0=0.2)})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    run.until(lambda: len(run.app.state.services.queue._running.moves) == 3)
    assert cancelled(run, second)["state"] == "cancelled"
    until(run, third)
    assert states(run, first, second, third) == ["finished", "cancelled", "finished"]
    positions = commanded(run, since)
    assert np.abs(positions[:, 1] - HOME[1]).max() < 1e-6
    assert came_near(run, since, place(j0=0.8)) < RADIUS_M
    within_limits(run, positions)
    np.testing.assert_allclose(positions[-1], place(j0=0.2), atol=1e-9)


def test_an_arc_that_is_cut_off_is_not_begun_once_more(run: VirtualService) -> None:
    arc = {"centre": {"x": 0.5, "y": 0.0, "z": 0.5}, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}, "angle": 1.0}
    first = queued(run, arc, "/robot/move/arc")
    second = queued(run, {"joints": place(j0=0.5)})
    third = queued(run, {"joints": HOME})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    assert cancelled(run, second)["state"] == "cancelled"
    until(run, third, "cancelled")
    assert seen(run, first)["state"] == "failed"
    assert "cannot begin again" in seen(run, first)["error"]["detail"]
    assert "the move before it failed" in seen(run, third)["error"]["detail"]
    until(run, queued(run, {"joints": HOME}))


def test_what_was_relative_to_a_cancelled_move_fails_with_all_behind_it(run: VirtualService) -> None:
    run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()
    kept = queued(run, {"joints": place(j0=0.2)})
    gone = queued(run, {"joints": place(j0=0.4)})
    pose = {"x": 0.0, "y": 0.0, "z": -0.02, "frame_id": "tool", "planner": "lin"}
    relative = queued(run, pose, "/robot/move/pose")
    behind = queued(run, {"joints": HOME})
    cancelled(run, gone)
    assert states(run, kept, gone, relative, behind) == ["queued", "cancelled", "failed", "cancelled"]
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    last = queued(run, {"joints": place(j0=-0.1)})
    until(run, last)
    np.testing.assert_allclose(run.joints(), place(j0=-0.1), atol=1e-3)


def test_cancelling_what_moves_the_arm_ends_that_job_alone(run: VirtualService) -> None:
    since = len(run.rig.commanded)
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    second = queued(run, {"joints": place(j1=0.6)})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    assert cancelled(run, first)["state"] == "cancelled"
    until(run, second)
    assert states(run, first, second) == ["cancelled", "finished"]
    positions = commanded(run, since)
    assert positions[:, 0].max() < 0.7, "the arm came to rest on the path of the one that was cancelled"
    within_limits(run, positions)
    np.testing.assert_allclose(positions[-1], place(j1=0.6), atol=1e-9)


def test_cancelling_the_queue_itself_ends_all_its_jobs(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    second = queued(run, {"joints": place(j0=0.8, j1=0.6)})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    assert run.post(f"/jobs/{first['parent']}/cancel").json()["state"] == "cancelled"
    until(run, second, "cancelled")
    assert f"job {first['parent']} was cancelled" in seen(run, second)["error"]["detail"]
    assert run.rig.mode.name == "HOLD"
    until(run, queued(run, {"joints": HOME}))


@pytest.fixture
def slow_planning(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Call it with how long every planning takes from now on, s."""
    planning = run.app.state.services.planning
    compute = planning.compute

    def slow(seconds: float) -> None:
        async def late(*arguments: Any) -> Any:
            await asyncio.sleep(seconds)
            return await compute(*arguments)

        monkeypatch.setattr(planning, "compute", late)

    return slow


def adding(run: VirtualService, joints: list[float]) -> asyncio.Task[httpx.Response]:
    """A request for a queued motion that goes on while the test does."""
    body = {"joints": joints, "speed": 0.3}
    return run.begin(run.asking("POST", "/robot/move/joints?queue=true&timeout_s=60", json=body))


@pytest.mark.parametrize("which", ["running", "next", "last"])
def test_a_cancel_waits_for_no_planning_and_ends_that_job_alone(
    run: VirtualService, slow_planning: Callable[[float], None], which: str
) -> None:
    """Another client's motion is planned for ten seconds meanwhile; the arm rests within one."""
    running = queued(run, {"joints": place(j0=0.9)})
    others = [queued(run, {"joints": place(j0=0.9, j1=0.3)}), queued(run, {"joints": place(j1=0.3)})]
    run.until(lambda: seen(run, running)["progress"] > 0.1)
    run.until(lambda: len(run.app.state.services.queue._running.moves) == 3)
    waiting = queued(run, {"joints": place(j1=-0.2)})
    jobs = {"running": running, "next": others[0], "last": waiting}
    slow_planning(10.0)
    another = adding(run, place(j0=-0.3))
    run.sleep(0.5)
    begun_s = run.clock.now_s()
    assert cancelled(run, jobs[which])["state"] == "cancelled"
    assert run.clock.now_s() - begun_s < 1.0
    assert not another.done(), "it is still being planned"
    slow_planning(0.0)
    last = run.end(another).json()
    until(run, last)
    left = [each for each in (running, *others, waiting) if each is not jobs[which]]
    assert states(run, *left) == ["finished"] * 3
    np.testing.assert_allclose(commanded(run, -1)[-1], place(j0=-0.3), atol=1e-9)


def test_two_cancels_while_the_arm_comes_to_rest_end_both_jobs(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.9)})
    second = queued(run, {"joints": place(j0=0.9, j1=0.4)})
    third = queued(run, {"joints": place(j1=0.2)})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    run.until(lambda: len(run.app.state.services.queue._running.moves) == 3)
    asked = [run.begin(run.asking("POST", f"/jobs/{job['id']}/cancel")) for job in (first, second)]
    assert [run.end(each).json()["state"] for each in asked] == ["cancelled", "cancelled"]
    until(run, third)


def test_what_is_cancelled_in_the_cycle_in_which_it_begins_does_not_move_the_arm(
    run: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Between the check of a motion and its START: rtloop refuses it, and the others go on."""
    motion = run.app.state.services.motion
    check, tasks = motion.require_free_since, []
    held(run)
    first, second = queued(run, {"joints": place(j0=0.4)}), queued(run, {"joints": place(j1=0.2)})

    async def cancelling(*arguments: Any) -> None:
        if run.app.state.services.queue._running._joining and not tasks:
            tasks.append(run.begin(run.asking("POST", f"/jobs/{first['id']}/cancel")))
            await asyncio.sleep(0.01)
        await check(*arguments)

    monkeypatch.setattr(motion, "require_free_since", cancelling)
    since = len(run.rig.commanded)
    released(run)
    until(run, second)
    assert run.end(tasks[0]).json()["state"] == "cancelled"
    assert seen(run, first)["started_at"] is None
    assert np.abs(commanded(run, since)[:, 0] - HOME[0]).max() < 1e-9


def test_a_stop_clears_the_queue_and_is_the_reason(run: VirtualService) -> None:
    jobs = [queued(run, {"joints": place(j0=angle)}, radius_m=RADIUS_M) for angle in (0.8, 0.3)]
    jobs += [queued(run, {"joints": place(j1=angle)}) for angle in (0.3, 0.1)]
    run.until(lambda: seen(run, jobs[0])["progress"] > 0.2)
    assert run.post("/stop").json()["success"]
    assert states(run, *jobs) == ["cancelled"] * 4
    assert all("POST /stop" in seen(run, job)["error"]["detail"] for job in jobs)
    assert run.get("/jobs?state=queued").json()["jobs"] == []
    until(run, queued(run, {"joints": HOME}))


def test_a_stop_after_a_cancel_is_heard(run: VirtualService) -> None:
    """The arm is stopped for the cancelled one; another stop meanwhile ends the others too."""
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    second = queued(run, {"joints": place(j0=0.8, j1=0.6)})
    third = queued(run, {"joints": HOME})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    cancelling = run.begin(run.asking("POST", f"/jobs/{second['id']}/cancel"))
    run.sleep(0.005)
    stopped = run.post("/stop").json()
    assert stopped["success"]
    run.end(cancelling)
    assert states(run, first, second, third) == ["cancelled"] * 3
    before = run.joints()
    run.sleep(0.5)
    np.testing.assert_allclose(run.joints(), before, atol=1e-4)


def test_a_queued_job_cannot_be_paused_but_the_running_one_can(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    second = queued(run, {"joints": HOME})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    refused = run.post(f"/jobs/{second['id']}/pause")
    assert refused.status_code == 409
    assert "queued" in refused.json()["detail"]
    assert run.post(f"/jobs/{first['id']}/pause").json()["state"] == "paused"
    assert states(run, second) == ["queued"]
    run.sleep(1.0)
    assert run.post(f"/jobs/{first['id']}/resume").json()["state"] == "running"
    until(run, second)


def test_while_paused_a_queued_job_can_be_cancelled(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    second = queued(run, {"joints": place(j0=0.8, j1=0.6)})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    run.post(f"/jobs/{first['id']}/pause").raise_for_status()
    assert cancelled(run, second)["state"] == "cancelled"
    before = run.joints()
    run.sleep(0.5)
    np.testing.assert_allclose(run.joints(), before, atol=1e-4)
    run.post(f"/jobs/{first['id']}/resume").raise_for_status()
    until(run, first)
    np.testing.assert_allclose(run.joints(), place(j0=0.8), atol=1e-3)


def test_moves_of_rest_and_of_the_vendor_services_are_one_queue(run: VirtualService) -> None:
    run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()
    first = queued(run, {"joints": place(j0=0.4)})
    vendor = f"/{run.name}/MotionControl"
    added = run.post(f"{vendor}/moveJoint", {"q": place(j0=0.6), "v": 0.5, "a": 1.5})
    assert added.json()["code"] == 0
    last = queued(run, {"joints": HOME})
    assert run.post(f"{vendor}/getQueueSize", {}).json()["result"] == 3
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    since = len(run.rig.commanded)
    until(run, last)
    assert states(run, first) == ["finished"]
    assert came_near(run, since, place(j0=0.6)) < 1e-4


def test_a_sequence_is_one_job_and_rounds_the_corners_to_its_neighbours(run: VirtualService) -> None:
    since, motions = len(run.rig.commanded), begun(run)
    corners = [place(j0=0.6), place(j0=0.6, j1=0.3), place(j0=0.1, j1=0.3)]
    first = queued(run, {"joints": corners[0]}, radius_m=RADIUS_M)
    body = {"motions": through(*corners[1:]), "radii": [RADIUS_M]}
    both = queued(run, body, "/robot/move/sequence", RADIUS_M)
    last = queued(run, {"joints": HOME})
    assert both["planned_duration_s"] > first["planned_duration_s"]
    until(run, both, "running")
    assert states(run, first, last) == ["finished", "queued"]
    before = seen(run, both)
    run.until(lambda: seen(run, both)["progress"] > 0.6)
    assert seen(run, both)["remaining_s"] < before["remaining_s"]
    until(run, last)
    assert states(run, first, both, last) == ["finished"] * 3
    assert begun(run) == motions + 1
    positions = commanded(run, since)
    assert rests(positions) == 0
    assert all(1e-3 < came_near(run, since, corner) < RADIUS_M for corner in corners)
    within_limits(run, positions)
    np.testing.assert_allclose(positions[-1], HOME, atol=1e-9)


def test_of_a_sequence_that_cannot_be_it_is_said_which_motion(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.3)})
    motions = [*through(place(j0=0.4)), {**INTO_ITSELF, "speed": 0.3}]
    refused = asked(run, {"motions": motions}, "/robot/move/sequence")
    assert refused.status_code == 422
    assert refused.json()["detail"].startswith("motion 2: ")
    radii = asked(run, {"motions": motions, "radii": [0.1, 0.1]}, "/robot/move/sequence")
    assert radii.json()["detail"] == "radii: 2 motions need 1, one for each motion except the last; got 2"
    until(run, queued(run, {"joints": HOME}))
    assert states(run, first) == ["finished"]


def test_where_a_sequence_is_already_the_arm_stops(run: VirtualService) -> None:
    since = len(run.rig.commanded)
    motions = through(place(j0=0.3), place(j0=0.3), HOME)
    there = queued(run, {"motions": motions, "radii": [RADIUS_M, 0.0]}, "/robot/move/sequence")
    until(run, there)
    assert came_near(run, since, place(j0=0.3)) < 1e-4
    nowhere = queued(run, {"motions": through(HOME)}, "/robot/move/sequence")
    until(run, nowhere)
    assert seen(run, nowhere)["planned_duration_s"] == 0.0


def test_a_queued_sequence_is_cancelled_as_a_whole(run: VirtualService) -> None:
    since = len(run.rig.commanded)
    first = queued(run, {"joints": place(j0=0.8)}, radius_m=RADIUS_M)
    motions = through(place(j0=0.8, j1=0.4), place(j0=0.4, j1=0.4))
    both = queued(run, {"motions": motions}, "/robot/move/sequence", RADIUS_M)
    last = queued(run, {"joints": place(j0=0.2)})
    run.until(lambda: seen(run, first)["progress"] > 0.2)
    run.until(lambda: len(run.app.state.services.queue._running.moves) == 3)
    assert cancelled(run, both)["state"] == "cancelled"
    until(run, last)
    assert states(run, first, both, last) == ["finished", "cancelled", "finished"]
    positions = commanded(run, since)
    assert np.abs(positions[:, 1] - HOME[1]).max() < 1e-6
    np.testing.assert_allclose(positions[-1], place(j0=0.2), atol=1e-9)


def test_a_plan_is_run_in_its_turn_as_it_was_looked_at(run: VirtualService) -> None:
    """Bit for bit: what the cycle was handed over ends with the plan's own polynomials."""
    motions, corner = begun(run), place(j0=0.6)
    first = queued(run, {"joints": corner}, radius_m=RADIUS_M)
    ways = place(j0=0.6, j1=0.3), place(j0=0.2, j1=0.3)
    looked_at = plan(run, corner, *ways, radii=(RADIUS_M,))
    second = execution(run, looked_at)
    assert second["planned_duration_s"] == looked_at["duration_s"]
    until(run, second, "running")
    services = run.app.state.services
    exact = services.plans.get(looked_at["plan_id"]).forecast.trajectory.coefficients
    handed_over = services.link.commands.handed_over[1].coefficients
    np.testing.assert_array_equal(handed_over[-len(exact) :], exact)
    third = queued(run, {"joints": HOME})
    since = len(run.rig.commanded)
    until(run, third)
    assert begun(run) == motions + 1
    assert states(run, first, second, third) == ["finished"] * 3
    assert came_near(run, since, ways[-1]) < 1e-4, "the arm stops after it"
    again = execution(run, plan(run, HOME, corner))
    until(run, again)
    assert came_near(run, since, corner) < 1e-4


def test_a_plan_that_does_not_follow_is_refused_and_the_others_go_on(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.6)})
    elsewhere = plan(run, place(j0=0.5), HOME)
    refused = asked(run, {"plan_id": elsewhere["plan_id"]}, "/robot/execute")
    assert refused.status_code == 409
    assert (
        "joint1 will be at 0.600000 rad, 0.1 rad away from the start of the plan at 0.500000 rad"
    ) in refused.json()["detail"]
    there = plan(run, place(j0=0.6), HOME)
    rounded = asked(run, {"plan_id": there["plan_id"]}, "/robot/execute", RADIUS_M)
    assert rounded.status_code == 422
    assert "a plan cannot be blended" in rounded.json()["detail"]
    alone = run.post("/robot/execute?blend_radius=0.1", {"plan_id": there["plan_id"]})
    assert alone.status_code == 422
    assert "queue=true" in alone.json()["detail"]
    assert asked(run, {"plan_id": "none"}, "/robot/execute").status_code == 404
    last = execution(run, there)
    until(run, last)
    assert states(run, first) == ["finished"]


def test_a_plan_behind_one_that_is_taken_out_fails_with_all_behind_it(run: VirtualService) -> None:
    held(run)
    gone = queued(run, {"joints": place(j0=0.4)})
    planned = execution(run, plan(run, place(j0=0.4), place(j0=0.2)))
    behind = queued(run, {"joints": HOME})
    cancelled(run, gone)
    assert states(run, gone, planned, behind) == ["cancelled", "failed", "cancelled"]
    assert "0.4 rad away from the start of the plan at 0.400000 rad" in seen(run, planned)["error"]["detail"]
    released(run)


def test_what_the_scene_has_made_impossible_fails_in_its_turn(run: VirtualService) -> None:
    held(run)
    first = queued(run, {"joints": place(j0=0.3)}, radius_m=RADIUS_M)
    into = queued(run, {"joints": place(j0=1.3)}, radius_m=RADIUS_M)
    behind = queued(run, {"joints": HOME})
    ball_at(run, place(j0=0.8))
    released(run)
    until(run, behind, "cancelled")
    assert states(run, first, into) == ["finished", "failed"]
    error = seen(run, into)["error"]
    assert error["code"] == "collision"
    assert error["detail"].startswith("the scene has changed since the move was queued: ")
    assert "ball" in error["detail"]
    assert "the move before it failed" in seen(run, behind)["error"]["detail"]
    np.testing.assert_allclose(run.joints(), place(j0=0.3), atol=1e-3)


def test_a_plan_of_another_scene_fails_in_its_turn(run: VirtualService) -> None:
    first = queued(run, {"joints": place(j0=0.3)})
    planned = execution(run, plan(run, place(j0=0.3), HOME))
    held(run)
    ball_at(run, place(j0=-2.0))
    released(run)
    until(run, planned, "failed")
    assert states(run, first) == ["finished"]
    assert "the scene had version" in seen(run, planned)["error"]["detail"]


def test_a_move_may_be_taken_out_when_the_next_motion_is_about_to_begin(
    run: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    held(run)
    first, second, third = (queued(run, {"joints": place(j0=0.2, j1=each)}) for each in (0.0, 0.4, 0.1))
    planning = run.app.state.services.planning
    compute = planning.compute

    async def slow(*arguments: Any) -> Any:
        await asyncio.sleep(0.5)
        return await compute(*arguments)

    since = len(run.rig.commanded)
    with monkeypatch.context() as patched:
        patched.setattr(planning, "compute", slow)
        cancelling = run.begin(run.asking("POST", f"/jobs/{second['id']}/cancel"))
        run.sleep(0.1)  # what is behind it is being planned anew
        released(run)
        assert run.end(cancelling).json()["state"] == "cancelled"
        until(run, third)
    assert states(run, first, second, third) == ["finished", "cancelled", "finished"]
    assert commanded(run, since)[:, 1].max() < 0.1 + 1e-9
