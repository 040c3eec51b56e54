"""Jobs over REST, on virtual time.

Oracle: the table of states in docs/jobs.md, written out by hand; where the arm is; what the same request
answers when it waits.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from virtual_service import VirtualService

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.5, *HOME[1:]]
FAR = {"joints": [1.5, *HOME[1:]], "speed": 0.2}
INTO_ITSELF = {"x": 0.0, "y": 0.0, "z": 0.1, "planner": "ptp"}
ENDS = ("finished", "failed", "cancelled", "interrupted")
Json = dict[str, Any]


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    yield service
    service.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()


def begun(run: VirtualService, body: Json, path: str = "/robot/move/joints") -> Json:
    answer = run.post(f"{path}?wait=false", body)
    assert answer.status_code == 202, answer.text
    found: Json = answer.json()
    assert answer.headers["location"] == f"/jobs/{found['id']}"
    return found


def seen(run: VirtualService, job: Json, wait_s: float = 0.0) -> Json:
    answer = run.get(f"/jobs/{job['id']}?wait_s={wait_s}")
    assert answer.status_code == 200, answer.text
    found: Json = answer.json()
    return found


def told(run: VirtualService, job: Json, what: str) -> httpx.Response:
    return run.post(f"/jobs/{job['id']}/{what}")


def running(run: VirtualService, body: Json = FAR) -> Json:
    """A job that moves the arm already."""
    job = begun(run, body)
    run.until(lambda: seen(run, job)["progress"] > 0.02)
    return job


def test_a_motion_that_nobody_waits_for_is_a_job_from_its_plan_to_its_end(run: VirtualService) -> None:
    job = begun(run, {"joints": AWAY, "speed": 0.5})
    assert (job["state"], job["kind"], job["robot"]) == ("planning", "move", run.name)
    assert job["owner"] == "anonymous from 127.0.0.1"
    assert "0.5" in job["request"]
    assert job["error"] is None
    run.until(lambda: seen(run, job)["progress"] > 0.3)
    halfway = seen(run, job)
    assert halfway["state"] == "running"
    share = 1.0 - halfway["remaining_s"] / halfway["planned_duration_s"]
    assert share == pytest.approx(halfway["progress"])
    end = seen(run, job, 60.0)
    assert (end["state"], end["progress"], end["remaining_s"], end["error"]) == ("finished", 1.0, 0.0, None)
    assert end["created_at"] <= end["started_at"] <= end["ended_at"]
    np.testing.assert_allclose(run.joints(), AWAY, atol=1e-3)


def test_a_motion_that_is_waited_for_is_the_same_job(run: VirtualService) -> None:
    task = run.begin(run.asking("POST", "/robot/move/joints", json=FAR))
    run.sleep(1.0)
    (job,) = run.get("/jobs?state=running&n=1").json()["jobs"]
    assert told(run, job, "cancel").json()["state"] == "cancelled"
    answer = run.end(task)
    assert answer.status_code == 200
    assert answer.json()["code"] == "stopped"
    assert answer.json()["message"] == seen(run, job)["error"]["detail"]


def test_where_the_arm_is_already_a_job_finishes_without_a_motion(run: VirtualService) -> None:
    end = seen(run, begun(run, {"joints": HOME}), 10.0)
    assert (end["state"], end["motion_id"], end["progress"]) == ("finished", None, 1.0)


def test_an_impossible_motion_fails_with_the_error_of_the_blocking_endpoint(run: VirtualService) -> None:
    job = seen(run, begun(run, INTO_ITSELF, "/robot/move/pose"), 60.0)
    blocking = run.post("/robot/move/pose", INTO_ITSELF).json()
    assert job["state"] == "failed"
    assert not blocking["success"]
    assert job["error"] == {"detail": blocking["message"], **{k: blocking[k] for k in ("code", "explain")}}


@pytest.mark.parametrize(
    ("path", "body", "status"),
    [
        ("/robot/move/joints", {"joints": [9.0] * 7}, 422),
        ("/robot/move/joints", {"joints": HOME, "sped": 1.0}, 422),
        ("/robot/move/named", {"name": "nowhere"}, 422),
        ("/robot/execute", {"plan_id": "none"}, 404),
        ("/trajectory/send", {"points": [{"positions": [1.0] * 7, "time_from_start": 0.0}]}, 422),
    ],
)
def test_what_is_refused_is_refused_at_once(run: VirtualService, path: str, body: Json, status: int) -> None:
    before = run.get("/jobs?n=1000").json()["jobs"]
    waited, not_waited = run.post(path, body), run.post(f"{path}?wait=false", body)
    assert waited.status_code == not_waited.status_code == status
    assert waited.json() == not_waited.json()
    new = [job for job in run.get("/jobs?n=1000").json()["jobs"] if job not in before]
    assert all(job["state"] == "failed" for job in new)


def test_one_motion_at_a_time_by_jobs_too(run: VirtualService) -> None:
    running(run)
    refused = run.post("/robot/move/joints?wait=false", FAR)
    assert (refused.status_code, refused.json()["code"]) == (409, "conflict")
    assert "in use by POST /robot/move/joints" in refused.json()["detail"]


def test_in_an_emergency_stop_a_job_is_refused_at_once(run: VirtualService) -> None:
    run.rig.memory.outside_estops.add()
    run.until(lambda: run.health()["robot"]["mode"] == "ESTOP")
    refused = run.post("/robot/move/joints?wait=false", FAR)
    assert (refused.status_code, refused.json()["code"]) == (503, "not_ready")
    run.post("/robot/reset").raise_for_status()


def test_a_cancelled_job_leaves_the_arm_at_rest_on_its_path(run: VirtualService) -> None:
    job = running(run)
    ended = told(run, job, "cancel").json()
    assert (ended["state"], ended["error"]["code"]) == ("cancelled", "stopped")
    assert f"job {job['id']} was cancelled by anonymous from 127.0.0.1" in ended["error"]["detail"]
    assert 0.0 < ended["progress"] < 1.0
    details = ended["error"]["details"]
    assert (details["cause"], details["by"]) == ("cancelled", "anonymous from 127.0.0.1")
    assert details["share"] == pytest.approx(ended["progress"], abs=0.01)
    here = run.joints()
    run.sleep(1.0)
    np.testing.assert_allclose(run.joints(), here, atol=1e-3)
    again = told(run, job, "cancel")
    assert (again.status_code, again.json()["code"]) == (409, "conflict")
    assert "has already ended: cancelled" in again.json()["detail"]


def test_a_stop_cancels_a_job_with_the_stop_as_the_reason(run: VirtualService) -> None:
    job = running(run)
    run.post("/stop").raise_for_status()
    ended = seen(run, job)
    assert ended["state"] == "cancelled"
    assert ended["error"]["detail"].startswith("stopped by POST /stop")
    assert ended["error"]["details"]["cause"] == "stop"


def test_a_job_pauses_on_its_path_and_goes_on(run: VirtualService) -> None:
    job = running(run)
    paused = told(run, job, "pause").json()
    assert paused["state"] == "paused"
    run.sleep(5.0)
    assert seen(run, job)["progress"] == paused["progress"]
    assert told(run, job, "resume").json()["state"] == "running"
    assert told(run, job, "resume").status_code == 409
    assert seen(run, job, 60.0)["state"] == "finished"


def test_a_pause_that_comes_too_late_says_so_and_holds_nothing_that_comes_next(run: VirtualService) -> None:
    job = running(run)
    while (left_s := seen(run, job)["remaining_s"]) > 0.01:
        run.sleep(max(left_s - 0.005, 0.002))
    refused = told(run, job, "pause")
    assert refused.status_code == 409
    assert refused.json()["detail"] == f"job {job['id']} has already ended: finished"
    assert seen(run, job)["state"] == "finished"
    assert run.post("/robot/move/joints", {"joints": AWAY, "speed": 1.0}).json()["success"]


def test_a_paused_job_can_be_cancelled_and_the_next_one_moves(run: VirtualService) -> None:
    job = running(run)
    told(run, job, "pause").raise_for_status()
    assert told(run, job, "cancel").json()["state"] == "cancelled"
    assert run.post("/robot/move/joints", {"joints": AWAY, "speed": 1.0}).json()["success"]


def test_the_speed_override_goes_from_nothing_to_full_speed_while_the_arm_moves(run: VirtualService) -> None:
    job = running(run)
    assert run.post("/robot/speed_override", {"fraction": 0.5}).json() == {"fraction": 0.5}
    found = seen(run, job)
    left_s = (1.0 - found["progress"]) * found["planned_duration_s"]
    assert found["remaining_s"] == pytest.approx(left_s / 0.5)
    run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()
    run.sleep(3.0)
    held = seen(run, job)
    assert (held["state"], held["remaining_s"]) == ("paused", None)
    run.sleep(10.0)
    assert seen(run, job)["progress"] == held["progress"]
    refused = told(run, job, "resume")
    assert refused.status_code == 409
    assert "the speed override is 0" in refused.json()["detail"]
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    assert run.get("/robot/speed_override").json() == {"fraction": 1.0}
    assert seen(run, job, 60.0)["state"] == "finished"


def test_a_pause_outlasts_a_speed_override_of_0(run: VirtualService) -> None:
    job = running(run)
    told(run, job, "pause").raise_for_status()
    for fraction in (0.0, 1.0):
        run.post("/robot/speed_override", {"fraction": fraction}).raise_for_status()
    assert seen(run, job)["state"] == "paused"
    told(run, job, "resume").raise_for_status()
    assert seen(run, job, 60.0)["state"] == "finished"


@pytest.mark.parametrize("fraction", [-0.1, 0.005, 1.1, "1", None])
def test_a_wrong_speed_override_is_refused(run: VirtualService, fraction: Any) -> None:
    refused = run.post("/robot/speed_override", {"fraction": fraction})
    assert refused.status_code == 422
    assert "fraction" in refused.json()["detail"]


def test_who_does_not_wait_has_as_long_as_the_motion_takes(run: VirtualService) -> None:
    run.post("/robot/speed_override", {"fraction": 0.02}).raise_for_status()
    job = begun(run, {"joints": AWAY, "speed": 0.5})
    for _ in range(4):
        assert seen(run, job, 60.0)["state"] == "running" or seen(run, job)["state"] == "finished"
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    assert seen(run, job, 60.0)["state"] == "finished"


@pytest.mark.parametrize("number", ["0", "a" * 100, "%00", "..%2F..%2Fetc", "💥", "-1"])
@pytest.mark.parametrize("what", ["", "/cancel", "/pause", "/resume"])
def test_an_unknown_job_is_not_found(run: VirtualService, number: str, what: str) -> None:
    answer = run.post(f"/jobs/{number}{what}") if what else run.get(f"/jobs/{number}")
    assert (answer.status_code, answer.json()["code"]) == (404, "not_found"), answer.text


@pytest.mark.parametrize("query", ["wait_s=61", "wait_s=-1", "wait_s=nan", "wait_s=1e999", "more=1"])
def test_a_wait_is_bounded(run: VirtualService, query: str) -> None:
    assert run.get(f"/jobs/0?{query}").status_code == 422


def test_a_huge_id_is_refused(run: VirtualService) -> None:
    assert run.get(f"/jobs/{'9' * 5000}").status_code == 422


def test_a_wait_ends_with_its_time_while_the_job_goes_on(run: VirtualService) -> None:
    job = running(run)
    before_s = run.clock.now_s()
    assert seen(run, job, 2.0)["state"] == "running"
    assert run.clock.now_s() - before_s == pytest.approx(2.0, abs=0.1)


def test_a_trajectory_and_a_plan_are_jobs_too(run: VirtualService) -> None:
    points = {"points": [{"positions": AWAY, "time_from_start": 4.0}]}
    sent = begun(run, points, "/trajectory/send")
    assert seen(run, sent, 60.0)["state"] == "finished"
    plan = run.post("/robot/plan/joints", {"joints": HOME, "speed": 0.5}).json()
    executed = begun(run, {"plan_id": plan["plan_id"]}, "/robot/execute")
    assert seen(run, executed, 60.0)["state"] == "finished"
    kinds = {job["id"]: job["kind"] for job in run.get("/jobs?n=2").json()["jobs"]}
    assert kinds == {executed["id"]: "execute", sent["id"]: "trajectory"}


def test_an_accepted_trajectory_is_followed_to_its_end(run: VirtualService) -> None:
    points = {"points": [{"positions": AWAY, "time_from_start": 4.0}]}
    motion = run.post("/trajectory/send", points).json()["motion_id"]
    (job,) = run.get("/jobs?n=1").json()["jobs"]
    assert (job["kind"], job["motion_id"], job["state"]) == ("trajectory", motion, "running")
    assert seen(run, job, 60.0)["state"] == "finished"


def test_the_queue_of_the_vendor_services_is_a_job(run: VirtualService) -> None:
    path = f"/{run.name}/MotionControl/moveJoint"
    assert run.post(path, {"q": AWAY, "v": 0.3, "a": 1.0}).json()["code"] == 0
    (job,) = run.get("/jobs?n=1").json()["jobs"]
    assert job["kind"] == "queue"
    assert seen(run, job, 60.0)["state"] == "finished"


def test_jobs_are_listed_by_state_the_newest_first(run: VirtualService) -> None:
    first = seen(run, begun(run, {"joints": AWAY, "speed": 1.0}), 60.0)
    second = running(run)
    listed = run.get("/jobs?n=2").json()["jobs"]
    assert [job["id"] for job in listed] == [second["id"], first["id"]]
    assert {job["state"] for job in run.get("/jobs?state=running&state=paused").json()["jobs"]} == {"running"}
    assert all(job["state"] in ENDS for job in run.get("/jobs?state=finished&state=failed").json()["jobs"])
    assert run.get("/jobs?state=moving").status_code == 422


def test_others_may_cancel_but_not_resume_under_a_lease(run: VirtualService) -> None:
    token = run.post("/robot/control", {"timeout_s": 60.0}).json()["token"]
    shown = {"X-Control-Token": token}
    answer = run.ask("POST", "/robot/move/joints?wait=false", json=FAR, headers=shown)
    job = answer.json()
    run.until(lambda: seen(run, job)["progress"] > 0.0)
    assert told(run, job, "pause").json()["state"] == "paused"
    assert told(run, job, "resume").status_code == 409
    assert run.ask("POST", f"/jobs/{job['id']}/resume", headers=shown).json()["state"] == "running"
    assert told(run, job, "cancel").json()["state"] == "cancelled"
    run.ask("DELETE", "/robot/control", headers=shown).raise_for_status()


def test_a_change_of_state_is_told(run: VirtualService) -> None:
    ring = run.app.state.services.link.events.ring
    before = ring.newest
    job = running(run)
    for what in ("pause", "resume", "cancel"):
        told(run, job, what).raise_for_status()
    states = ["planning", "running", "paused", "running", "cancelled"]
    told_of = [json.loads(event.text)["data"] for event in ring.since(before, 100) if event.type == "job"]
    assert [(data["job"], data["state"]) for data in told_of] == [(job["id"], state) for state in states]
