"""A new goal for a running motion over REST, on virtual time.

Oracles: what the cycle has commanded in each of its milliseconds, and the limits of the robot; where the arm
is in the end; the motion's own path without the request.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

import httpx
import numpy as np
import pytest
from sample_counts import samples
from virtual_service import PlanningHere, VirtualService

from app.services.motion.retarget import KINDS
from app.services.rights.claims import Claim
from app.services.rights.job import JobKind
from app.services.rights.stop_reason import StopReason
from app.services.state.link import RobotLink
from cobot.errors import ConflictError, ExecutionError, PlanningTimeout, UnavailableError
from cobot.ipc.layout import Command
from cobot.motions.requests import MotionRequest
from cobot.robot.scene import Scene
from cobot.types import LoopMode, PlannerName, Scaling

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
FAR = {"joints": [1.5, *HOME[1:]], "speed": 0.5}
BACK = {"joints": [-0.5, 0.3, *HOME[2:]], "speed": 0.5}
Json = dict[str, Any]


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    service.rig.commanded.clear()
    yield service
    service.post("/stop").raise_for_status()
    service.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()


def moving(run: VirtualService, body: Json = FAR, path: str = "/robot/move/joints") -> str:
    answer = run.post(f"{path}?wait=false", body)
    assert answer.status_code == 202, answer.text
    job = str(answer.json()["id"])
    run.until(lambda: run.get(f"/jobs/{job}").json()["progress"] > 0.2)
    return job


def new_goal(run: VirtualService, job: str, body: Json = BACK) -> httpx.Response:
    return run.post(f"/jobs/{job}/retarget", body)


def ended(run: VirtualService, job: str) -> Json:
    found: Json = run.get(f"/jobs/{job}?wait_s=30").json()
    return found


def require_within_limits(run: VirtualService) -> None:
    for rate in run.rig.rates():
        assert rate.max() <= 1.01


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("joints", BACK),
        ("joints", BACK | {"speed": 0.1}),
        ("named", {"name": "home", "speed": 0.3}),
        ("pose", {"x": 0.45, "y": 0.3, "z": 0.55, "b": 3.14, "planner": "lin", "speed": 0.3}),
        ("joints", BACK | {"planner": "ompl"}),
    ],
)
def test_the_arm_goes_to_the_new_goal_without_a_jump(run: VirtualService, path: str, body: Json) -> None:
    job = moving(run)
    answer = new_goal(run, job, body)
    assert answer.status_code == 200, answer.text
    found = answer.json()
    assert found["job"] == job
    assert 0.0 <= found["change_in_s"] <= found["settled_in_s"]
    assert ended(run, job)["state"] == "finished"
    there = run.joints()
    assert run.post(f"/robot/move/{path}", body).json()["success"]
    np.testing.assert_allclose(run.joints(), there, atol=2e-3)
    require_within_limits(run)


def test_the_job_and_the_motion_are_the_same_and_the_path_is_the_new_one(run: VirtualService) -> None:
    events = run.listen("/events?types=motion")
    job = moving(run)
    before = run.get("/robot/motion?samples=3").json()
    new_goal(run, job).raise_for_status()
    after = run.get("/robot/motion?samples=3").json()
    assert after["motion_id"] == before["motion_id"]
    np.testing.assert_allclose(after["path"][-1]["joints"], BACK["joints"], atol=1e-6)
    told = [events.event("motion")["data"]["what"] for _ in range(2)]
    assert told == ["begun", "retargeted"]
    assert ended(run, job)["state"] == "finished"
    events.close()


def test_a_motion_gets_one_new_goal_after_the_other(run: VirtualService) -> None:
    job = moving(run)
    for by in (0.8, -0.4, 0.2):
        run.sleep(0.15)
        goal = {"joints": [by, *HOME[1:]], "speed": 0.5}
        new_goal(run, job, goal).raise_for_status()
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), [0.2, *HOME[1:]], atol=2e-3)
    require_within_limits(run)


def test_a_waiting_client_gets_its_answer_at_the_new_goal(run: VirtualService) -> None:
    waiting = run.begin(run.asking("POST", "/robot/move/joints", json=FAR))
    job = run.until(lambda: run.get("/jobs?state=running").json()["jobs"])[0]["id"]
    run.until(lambda: run.get(f"/jobs/{job}").json()["progress"] > 0.2)
    new_goal(run, job).raise_for_status()
    assert run.end(waiting).json()["success"]
    np.testing.assert_allclose(run.joints(), BACK["joints"], atol=2e-3)


def test_a_slowed_down_motion_changes_too(run: VirtualService) -> None:
    run.post("/robot/speed_override", {"fraction": 0.3}).raise_for_status()
    job = moving(run)
    new_goal(run, job).raise_for_status()
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), BACK["joints"], atol=2e-3)


REFUSED = [
    ({"joints": [9.0, *HOME[1:]]}, 422, "joint1"),
    ({"joints": [0.0] * 3}, 422, "7 angles"),
    ({"name": "nowhere"}, 422, "nowhere"),
    ({"x": 3.0, "y": 0.0, "z": 0.5}, 422, "reach"),
    ({"x": 0.0, "y": 0.0, "z": 0.1, "planner": "ptp"}, 422, ""),
    ({"x": 0.1, "y": 0.0, "z": 0.0, "frame_id": "tool"}, 422, "base frame"),
    ({"axis": "z", "angle": 0.5}, 422, ""),
    ({"joints": HOME, "speed": 7.0}, 422, "speed"),
    ({"joints": HOME, "colour": "red"}, 422, "colour"),
    ({}, 422, ""),
    ([], 422, "object"),
    ({"joints": HOME, "actions": [{"at": {"fraction": 0.5}, "event": "x"}]}, 422, "actions"),
]


@pytest.mark.parametrize(("body", "status", "words"), REFUSED)
def test_a_goal_that_is_impossible_changes_nothing(
    run: VirtualService, body: Any, status: int, words: str
) -> None:
    job = moving(run)
    path = run.get("/robot/motion?samples=5").json()["path"]
    answer = new_goal(run, job, body)
    assert answer.status_code == status, answer.text
    assert words in answer.json()["detail"]
    assert run.get("/robot/motion?samples=5").json()["path"] == path
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), FAR["joints"], atol=2e-3)


def test_a_job_that_does_not_run_has_no_goal_to_change(run: VirtualService) -> None:
    assert new_goal(run, "job_none").status_code == 404
    job = moving(run)
    run.post(f"/jobs/{job}/pause").raise_for_status()
    paused = new_goal(run, job)
    assert (paused.status_code, "is paused" in paused.json()["detail"]) == (409, True)
    run.post(f"/jobs/{job}/resume").raise_for_status()
    assert ended(run, job)["state"] == "finished"
    over = new_goal(run, job)
    assert (over.status_code, "already ended" in over.json()["detail"]) == (409, True)


def test_moves_of_the_queue_keep_their_goals(run: VirtualService) -> None:
    first, second = (run.post("/robot/move/joints?queue=true", each).json()["id"] for each in (FAR, BACK))
    run.until(lambda: run.get(f"/jobs/{first}").json()["progress"] > 0.2)
    assert "queue" in new_goal(run, first).json()["detail"]
    assert "queued" in new_goal(run, second).json()["detail"]
    assert ended(run, second)["state"] == "finished"


def test_a_motion_with_actions_keeps_its_goal(run: VirtualService) -> None:
    job = moving(run, FAR | {"actions": [{"at": {"fraction": 0.9}, "event": "near"}]})
    answer = new_goal(run, job)
    assert (answer.status_code, "actions" in answer.json()["detail"]) == (409, True)
    assert ended(run, job)["state"] == "finished"


def test_a_client_without_control_changes_nothing(run: VirtualService) -> None:
    shown = {"X-Control-Token": run.post("/robot/control", {"timeout_s": 60.0}).json()["token"]}
    job = run.ask("POST", "/robot/move/joints?wait=false", json=FAR, headers=shown).json()["id"]
    run.until(lambda: run.get(f"/jobs/{job}").json()["progress"] > 0.2)
    refused = new_goal(run, job)
    assert (refused.status_code, "control" in refused.json()["detail"]) == (409, True)
    again = run.ask("POST", f"/jobs/{job}/retarget", json=BACK, headers=shown)
    assert again.status_code == 200, "the holder of control changes it"
    assert ended(run, job)["state"] == "finished"
    run.ask("DELETE", "/robot/control", headers=shown).raise_for_status()


def test_two_requests_at_once_are_one_change_or_one_after_the_other(run: VirtualService) -> None:
    job = moving(run)
    asked = [run.begin(run.asking("POST", f"/jobs/{job}/retarget", json=BACK)) for _ in range(2)]
    codes = sorted(run.end(each).status_code for each in asked)
    assert codes in ([200, 409], [200, 200])
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), BACK["joints"], atol=2e-3)


def test_a_stop_wins(run: VirtualService) -> None:
    job = moving(run)
    changing = run.begin(run.asking("POST", f"/jobs/{job}/retarget", json=BACK))
    run.post("/stop").raise_for_status()
    run.end(changing)
    assert ended(run, job)["state"] == "cancelled"
    assert run.rig.mode is LoopMode.HOLD
    still = run.joints()
    run.sleep(0.5)
    np.testing.assert_allclose(run.joints(), still, atol=1e-4)
    require_within_limits(run)


SLOW_S = 0.2


@pytest.fixture
def slow_planning(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """Let each planning take a time on the virtual clock, before it gives its result."""
    at_once = PlanningHere.compute

    def take(time_s: float) -> None:
        async def compute(self: PlanningHere, work: Any, timeout_s: float, scene: Scene | None = None) -> Any:
            if time_s > timeout_s:
                raise PlanningTimeout.after(timeout_s, "planning takes longer")
            await asyncio.sleep(time_s)
            return await at_once(self, work, timeout_s, scene)

        monkeypatch.setattr(PlanningHere, "compute", compute)

    return take


def test_if_planning_is_slow_the_arm_leaves_its_path_further_ahead(
    run: VirtualService, slow_planning: Callable[[float], None]
) -> None:
    job = moving(run)
    slow_planning(SLOW_S)
    answer = new_goal(run, job)
    assert answer.status_code == 200, answer.text
    assert answer.json()["planning_time_s"] >= 2.0 * SLOW_S, "the first place was too near for this planner"
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), BACK["joints"], atol=2e-3)
    require_within_limits(run)


def test_a_faster_simulation_leaves_its_path_further_ahead(
    run: VirtualService, slow_planning: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """More path time passes while a motion is planned. Oracle: the place at which the arm leaves its path."""
    slow_planning(0.05)
    changes_s = []
    for hurry in (1.0, 4.0):
        monkeypatch.setattr(RobotLink, "hurry", hurry)
        run.go_home()
        job = moving(run, FAR | {"speed": 0.2})
        for by in (1.4, 1.3):  # the second change uses the time that the first one took
            answer = new_goal(run, job, {"joints": [by, *HOME[1:]], "speed": 0.2})
            assert answer.status_code == 200, answer.text
        changes_s.append(answer.json()["change_in_s"])
        assert ended(run, job)["state"] == "finished"
    assert changes_s[1] - changes_s[0] == pytest.approx(3.0 * 2.0 * 0.05, abs=0.02)


def test_if_planning_outlasts_the_motion_the_arm_goes_to_its_former_goal(
    run: VirtualService, slow_planning: Callable[[float], None]
) -> None:
    job = moving(run)
    slow_planning(15.0)
    answer = new_goal(run, job)
    assert answer.status_code == 409, answer.text
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), FAR["joints"], atol=2e-3)


def test_all_attempts_together_keep_the_timeout(
    run: VirtualService, slow_planning: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    async def too_late(*_: Any) -> None:
        raise ExecutionError("the arm passed the place of the change")

    job = moving(run)
    run.post("/robot/speed_override", {"fraction": 0.02}).raise_for_status()
    slow_planning(12.0)
    monkeypatch.setattr(run.app.state.services.motion, "replace", too_late)
    begun_s = run.clock.now_s()
    answer = new_goal(run, job)
    assert run.clock.now_s() - begun_s < 20.0, "the timeout of the endpoint"
    assert (answer.status_code, answer.json()["code"]) == (422, "planning_timeout"), answer.text
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), FAR["joints"], atol=2e-3)


def test_a_stop_during_planning_wins_and_nothing_is_replaced(
    run: VirtualService, slow_planning: Callable[[float], None]
) -> None:
    job = moving(run)
    events = run.listen("/events?types=motion")
    slow_planning(SLOW_S)
    changing = run.begin(run.asking("POST", f"/jobs/{job}/retarget", json=BACK))
    run.sleep(0.5 * SLOW_S)
    run.post("/stop").raise_for_status()
    answer = run.end(changing)
    assert (answer.status_code, answer.json()["code"]) == (409, "stopped"), answer.text
    assert ended(run, job)["state"] == "cancelled"
    still = run.joints()
    run.sleep(2.0 * SLOW_S)
    np.testing.assert_allclose(run.joints(), still, atol=1e-4)
    assert events.event("motion")["data"]["what"] == "stopped"
    events.close()
    job = moving(run)
    new_goal(run, job).raise_for_status()
    assert ended(run, job)["state"] == "finished", "nothing is left of the request that was stopped"


def test_a_new_motion_that_is_stopped_at_once_is_no_success(
    run: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    motion = run.app.state.services.motion
    at_once = motion.replace

    async def replace(claim: Claim, *values: Any) -> None:
        await at_once(claim, *values)
        claim.interrupt(StopReason("the scene has changed", "scene").error)

    job = moving(run)
    monkeypatch.setattr(motion, "replace", replace)
    answer = new_goal(run, job)
    assert (answer.status_code, answer.json()["code"]) == (409, "stopped"), answer.text
    assert ended(run, job)["state"] == "cancelled"


def test_a_pause_during_planning_stays_one_and_the_arm_goes_to_the_new_goal_after_it(
    run: VirtualService, slow_planning: Callable[[float], None]
) -> None:
    job = moving(run)
    slow_planning(SLOW_S)
    changing = run.begin(run.asking("POST", f"/jobs/{job}/retarget", json=BACK))
    run.sleep(0.5 * SLOW_S)
    run.post("/robot/speed_override", {"fraction": 0.0}).raise_for_status()
    assert run.end(changing).status_code == 200
    run.sleep(1.0)
    still = run.joints()
    run.sleep(1.0)
    np.testing.assert_allclose(run.joints(), still, atol=1e-4)
    assert run.get(f"/jobs/{job}").json()["state"] == "paused"
    run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), BACK["joints"], atol=2e-3)
    require_within_limits(run)


def test_the_job_has_the_new_request_and_the_progress_of_the_new_way(run: VirtualService) -> None:
    """The oracle is the virtual clock: how long the arm really takes."""
    job = moving(run)
    before = run.get(f"/jobs/{job}").json()
    new_goal(run, job).raise_for_status()
    after, now_s = run.get(f"/jobs/{job}").json(), run.clock.now_s()
    assert after["requested"] == {"path": f"/jobs/{job}/retarget", "body": BACK}
    assert after["started_at"] == before["started_at"]
    assert 0.0 <= after["progress"] < before["progress"]
    progress = []
    while (present := run.get(f"/jobs/{job}").json())["state"] == "running":
        progress.append(present["progress"])
        run.sleep(0.05)
    assert progress == sorted(progress)
    assert run.clock.now_s() - now_s == pytest.approx(after["remaining_s"], abs=0.5)
    assert present["requested"]["path"] == f"/jobs/{job}/retarget"


def test_a_repeated_request_leads_to_the_same_goal(run: VirtualService) -> None:
    """A client whose answer was lost can ask again, with the same Idempotency-Key or without one."""
    job = moving(run)
    key = {"Idempotency-Key": "4d3f8a2e"}
    for headers in (key, key, {}):
        run.ask("POST", f"/jobs/{job}/retarget", json=BACK, headers=headers).raise_for_status()
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), BACK["joints"], atol=2e-3)
    assert new_goal(run, job).status_code == 409
    require_within_limits(run)


@pytest.mark.parametrize("kind", sorted(set(JobKind) - set(KINDS)))
def test_jobs_of_other_kinds_have_no_goal(run: VirtualService, kind: JobKind) -> None:
    services = run.app.state.services
    job = services.ownership.new_job(kind)
    goal = MotionRequest(None, np.array(HOME), PlannerName.PTP, Scaling(0.5))
    with pytest.raises(ConflictError, match=f"{kind}.*cancel it"):
        run.run(services.retargeting.retarget(job, goal, 1.0))


def test_an_obstacle_on_the_new_way_is_an_error_and_the_motion_goes_on(run: VirtualService) -> None:
    job = moving(run)
    beside = run.app.state.services.robot.model.forward(np.array([-0.6, *HOME[1:]])).position.tolist()
    ball = {"shape": "sphere", "radius": 0.05} | dict(zip("xyz", beside, strict=True))
    assert run.post("/scene", {"objects": {"ball": ball}}).json()["stopped"] == ""
    answer = new_goal(run, job, {"joints": [-1.2, *HOME[1:]], "speed": 0.5})
    assert (answer.status_code, answer.json()["code"]) == (422, "collision"), answer.text
    assert "ball" in answer.json()["detail"]
    assert ended(run, job)["state"] == "finished"
    np.testing.assert_allclose(run.joints(), FAR["joints"], atol=2e-3)
    run.post("/scene", {"clear": True}).raise_for_status()


@pytest.fixture(scope="module")
def around(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """A service that leads motions around what appears."""
    folder = tmp_path_factory.mktemp("around")
    with VirtualService(folder, more="planning: {replan_within_s: 0.1}\n").serving() as made:
        yield made


def ball_at(run: VirtualService, angle: float, radius: float = 0.05) -> Json:
    """A ball where the hand is when joint 1 has an angle."""
    joints = [angle, *HOME[1:]]
    x, y, z = run.app.state.services.robot.model.forward(np.array(joints)).position.tolist()
    return {"objects": {"ball": {"shape": "sphere", "radius": radius, "x": x, "y": y, "z": z}}}


@pytest.mark.parametrize("planner", ["ptp", "ompl", "auto"])
def test_a_motion_goes_around_an_object_that_appears(around: VirtualService, planner: str) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    around.rig.commanded.clear()
    nearest_m: list[float] = []
    services = around.app.state.services
    job = moving(around, FAR | {"speed": 0.3, "planner": planner})
    put = around.post("/scene", ball_at(around, 1.1))
    assert put.json()["stopped"] == "", put.text
    contacts = services.robot.collision.contacts
    while around.get(f"/jobs/{job}").json()["state"] == "running":
        around.sleep(0.05)
        nearest_m.append(len(contacts(np.array(around.joints()))))
    assert ended(around, job)["state"] == "finished"
    assert not any(nearest_m), "the arm touches nothing"
    np.testing.assert_allclose(around.joints(), FAR["joints"], atol=2e-3)
    require_within_limits(around)


def test_an_object_that_appears_while_a_change_is_planned_stops_the_motion(
    around: VirtualService, slow_planning: Callable[[float], None]
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    slow_planning(SLOW_S)
    changing = around.begin(around.asking("POST", f"/jobs/{job}/retarget", json=BACK))
    around.sleep(0.1 * SLOW_S)
    assert "ball" in around.post("/scene", ball_at(around, 1.1)).json()["stopped"]
    assert around.end(changing).status_code == 409
    assert ended(around, job)["state"] == "cancelled"
    around.post("/scene", {"clear": True}).raise_for_status()


def test_while_a_way_around_is_planned_the_goal_does_not_change(
    around: VirtualService, slow_planning: Callable[[float], None]
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    around.rig.commanded.clear()
    job = moving(around, FAR | {"speed": 0.3})
    slow_planning(0.05)
    body = ball_at(around, 1.1)
    putting = around.begin(around.asking("POST", "/scene", json=body))
    around.until(lambda: around.app.state.services.retargeting._busy)
    refused = new_goal(around, job)
    assert refused.status_code == 409, refused.text
    assert around.end(putting).json()["stopped"] == ""
    assert ended(around, job)["state"] == "finished"
    np.testing.assert_allclose(around.joints(), FAR["joints"], atol=2e-3)
    require_within_limits(around)
    around.post("/scene", {"clear": True}).raise_for_status()


def test_an_object_beside_the_path_changes_nothing_and_costs_no_search(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    path = around.get("/robot/motion?samples=5").json()["path"]
    searched = list[Any]()
    monkeypatch.setattr(
        "app.services.motion.planning_tasks.change_goal", lambda *asked: searched.append(asked)
    )
    assert around.post("/scene", ball_at(around, -1.0)).json()["stopped"] == ""
    assert not searched
    assert around.get("/robot/motion?samples=5").json()["path"] == path
    monkeypatch.undo()
    new_goal(around, job, FAR | {"speed": 0.3}).raise_for_status()  # nothing is left of the look
    assert ended(around, job)["state"] == "finished"


def test_an_object_too_near_to_go_around_stops_the_motion_without_a_search(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    searched = list[Any]()
    monkeypatch.setattr(
        "app.services.motion.planning_tasks.change_goal", lambda *asked: searched.append(asked)
    )
    assert "ball" in around.post("/scene", ball_at(around, around.joints()[0] + 0.25)).json()["stopped"]
    assert not searched
    assert ended(around, job)["state"] == "cancelled"
    around.post("/scene", {"clear": True}).raise_for_status()


def test_the_search_begins_before_the_scene_is_checked(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the order in which the planning process and the service get the scene."""
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    got, compute, scene = list[str](), PlanningHere.compute, around.app.state.services.scene
    examine = scene._examine

    async def search(*values: Any, **named: Any) -> Any:
        got.append("search")
        return await compute(*values, **named)

    async def check(*values: Any) -> Any:
        got.append("check")
        return await examine(*values)

    monkeypatch.setattr(PlanningHere, "compute", search)
    monkeypatch.setattr(scene, "_examine", check)
    assert around.post("/scene", ball_at(around, 1.1)).json()["stopped"] == ""
    assert got == ["search", "check"]
    assert ended(around, job)["state"] == "finished"
    around.post("/scene", {"clear": True}).raise_for_status()


def test_a_check_that_takes_longer_than_the_setting_stops_the_motion(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm moves on during the check: it may have left the stretch in which it could still stop."""
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    at_once = asyncio.to_thread

    async def slowly(work: Any, *values: Any, **named: Any) -> Any:
        if getattr(work, "__name__", "") == "examine":
            await asyncio.sleep(0.15)
        return await at_once(work, *values, **named)

    monkeypatch.setattr(asyncio, "to_thread", slowly)
    assert "ball" in around.post("/scene", ball_at(around, 1.1)).json()["stopped"]
    assert ended(around, job)["state"] == "cancelled"
    around.post("/scene", {"clear": True}).raise_for_status()


def slow_storing(run: VirtualService, monkeypatch: pytest.MonkeyPatch, fails: bool) -> list[str]:
    """Let the disk take 50 ms for each scene. Returns what is stored and handed over, in their order."""
    told, services = list[str](), run.app.state.services
    store, replace = services.scene._store, services.motion.replace

    async def slowly(*values: Any) -> Any:
        await asyncio.sleep(0.05)
        if fails:
            raise UnavailableError("a disk is full: make room, see df")
        found = await store(*values)
        told.append("stored")
        return found

    async def hand_over(*values: Any) -> None:
        told.append("handed over")
        await replace(*values)

    monkeypatch.setattr(services.scene, "_store", slowly)
    monkeypatch.setattr(services.motion, "replace", hand_over)
    return told


def test_a_way_around_is_planned_while_the_scene_is_stored_and_handed_over_afterwards(
    around: VirtualService, slow_planning: Callable[[float], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The oracle is the virtual clock: one after the other would take longer than the setting permits."""
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    around.rig.commanded.clear()
    job = moving(around, FAR | {"speed": 0.3})
    slow_planning(0.06)
    told = slow_storing(around, monkeypatch, fails=False)
    put = around.post("/scene", ball_at(around, 1.1))
    assert put.json()["stopped"] == "", put.text
    assert told == ["stored", "handed over"]
    assert ended(around, job)["state"] == "finished"
    require_within_limits(around)


def test_a_scene_that_cannot_be_stored_leads_no_motion_around(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    path = around.get("/robot/motion?samples=5").json()["path"]
    told = slow_storing(around, monkeypatch, fails=True)
    put = around.post("/scene", ball_at(around, 1.1))
    assert put.status_code == 503, put.text
    around.sleep(0.2)
    assert told == []
    assert around.get("/robot/motion?samples=5").json()["path"] == path
    monkeypatch.undo()
    new_goal(around, job, FAR | {"speed": 0.3}).raise_for_status()  # nothing is left of the search
    assert ended(around, job)["state"] == "finished"


def test_a_motion_that_begins_while_a_scene_is_stored_is_stopped_too(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    body = ball_at(around, 1.1)
    slow_storing(around, monkeypatch, fails=False)
    putting = around.begin(around.asking("POST", "/scene", json=body))
    job = around.post("/robot/move/joints?wait=false", FAR | {"speed": 0.3}).json()["id"]
    assert "ball" in around.end(putting).json()["stopped"]
    assert ended(around, job)["state"] == "cancelled"
    monkeypatch.undo()
    around.post("/scene", {"clear": True}).raise_for_status()


def test_a_motion_that_waits_to_begin_until_rtloop_has_the_scene_is_stopped_too(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands are sent one after the other: its start may wait for that of the scene, after its check."""
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    body = ball_at(around, 1.1)
    commands = around.app.state.services.link.commands
    send, told = commands._send, list[str]()

    async def slowly(kind: Command, **values: Any) -> None:
        told.append(kind.name)
        if kind is Command.SCENE:
            await asyncio.sleep(0.05)
        await send(kind, **values)

    monkeypatch.setattr(commands, "_send", slowly)
    putting = around.begin(around.asking("POST", "/scene", json=body))
    around.until(lambda: "SCENE" in told)
    job = around.post("/robot/move/joints?wait=false", FAR | {"speed": 0.3}).json()["id"]
    around.end(putting).raise_for_status()
    found = ended(around, job)
    assert told.index("SCENE") < told.index("START")
    assert found["state"] == "cancelled", found
    assert "ball" in found["error"]["detail"]
    assert around.joints()[0] < 0.8
    monkeypatch.undo()
    around.post("/scene", {"clear": True}).raise_for_status()


def test_a_search_that_fails_with_an_unexpected_error_stops_the_motion(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A planning process passes on any exception of its libraries."""
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})

    async def compute(*_: Any) -> None:
        raise ValueError("a bug in a library")

    monkeypatch.setattr(PlanningHere, "compute", compute)
    put = around.post("/scene", ball_at(around, 1.1))
    assert put.status_code == 200, put.text
    assert "ball" in put.json()["stopped"]
    assert ended(around, job)["state"] == "cancelled"
    monkeypatch.undo()
    around.post("/scene", {"clear": True}).raise_for_status()


def test_a_way_around_that_comes_too_late_is_reported_as_such(
    around: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def slowly(*_: Any) -> Any:
        await asyncio.sleep(5.0)

    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    job = moving(around, FAR | {"speed": 0.3})
    monkeypatch.setattr(PlanningHere, "compute", slowly)
    assert "ball" in around.post("/scene", ball_at(around, 1.1)).json()["stopped"]
    assert ended(around, job)["state"] == "cancelled"
    assert any(line.endswith("no way around: too late") for line in around.lines)
    around.post("/scene", {"clear": True}).raise_for_status()


def test_without_the_setting_a_motion_stops(run: VirtualService) -> None:
    job = moving(run, FAR | {"speed": 0.3})
    assert "ball" in run.post("/scene", ball_at(run, 1.1)).json()["stopped"]
    assert ended(run, job)["state"] == "cancelled"
    run.post("/scene", {"clear": True}).raise_for_status()


@pytest.mark.parametrize(
    ("why", "angle", "body"),
    [
        ("a line has to stay one", 1.1, None),
        ("the goal itself is blocked", 1.5, FAR | {"speed": 0.3}),
        ("the object is too near", 0.45, FAR | {"speed": 1.0}),
    ],
)
def test_where_there_is_no_new_way_the_motion_stops(
    around: VirtualService, why: str, angle: float, body: Json | None
) -> None:
    around.post("/scene", {"clear": True}).raise_for_status()
    around.go_home()
    if body is None:
        here = around.get("/robot/pose").json()["position"]
        body = {"x": here["x"], "y": 0.35, "z": here["z"], "b": 3.14159265, "planner": "lin", "speed": 0.2}
        job = moving(around, body, "/robot/move/pose")
        ball = {"shape": "sphere", "radius": 0.05, "x": here["x"], "y": 0.35, "z": here["z"]}
        stopped = around.post("/scene", {"objects": {"ball": ball}}).json()["stopped"]
    else:
        job = moving(around, body)
        stopped = around.post("/scene", ball_at(around, angle)).json()["stopped"]
    assert "ball" in stopped, why
    assert ended(around, job)["state"] == "cancelled"


ATTACKS, REQUESTS, CHECKED_AFTER = 20, 20, 50
"""Number of attacks, of requests in each, and after how many requests what was commanded is checked. With
COBOT_SHARE_OF_SAMPLES=125 there are 50,000 requests."""
GARBAGE: list[Any] = [
    *(body for body, _, _ in REFUSED),
    {"joints": [1e308] * 7, "speed": 1.0},
    {"joints": HOME, "speed": 1e-300},
    {"joints": HOME, "planner": "ompl", "algorithm": "'; stop"},
    {"x": 1e9, "y": 0.0, "z": 0.0},
    {"name": "home\u0000" * 50},
    "home",
]


def hostile_goal(run: VirtualService, random: np.random.Generator) -> Any:
    """A random goal: most are possible, some are out of reach, in collision or no goal at all."""
    limits = run.rig.limits
    kind, speed = random.random(), float(random.uniform(0.01, 1.0))
    if kind < 0.1:
        return GARBAGE[random.integers(len(GARBAGE))]
    if kind < 0.3:
        joints = random.uniform(limits.min_position, limits.max_position)
    else:
        joints = np.clip(
            np.array(run.joints()) + random.normal(scale=10.0 ** random.uniform(-6.0, 0.0), size=7),
            1.001 * limits.min_position,
            1.001 * limits.max_position,
        )
    if kind < 0.8:
        planner = str(random.choice(["ptp", "ptp", "auto", "chomp" if kind > 0.795 else "auto"]))
        return {"joints": joints.tolist(), "speed": speed, "planner": planner}
    pose = run.app.state.services.robot.model.forward(joints)
    x, y, z = pose.position.tolist()
    planner = str(random.choice(["ptp", "lin"]))
    return {"x": x, "y": y, "z": z, "b": float(random.uniform(-3.0, 3.0)), "speed": speed, "planner": planner}


def disturb(run: VirtualService, random: np.random.Generator) -> None:
    """What else clients do meanwhile."""
    kind = random.random()
    if kind < 0.02:
        run.post("/stop").raise_for_status()
    elif kind < 0.08:
        run.post("/robot/speed_override", {"fraction": float(random.choice([0.0, 0.01, 0.3, 1.0, 1.0]))})
    run.sleep(float(random.choice([0.0, 0.003, 0.05, 0.3])))


def require_nothing_broken(run: VirtualService) -> None:
    require_within_limits(run)
    rows, limits = np.array(run.rig.commanded), run.rig.limits
    assert (rows >= limits.min_position - 1e-9).all()
    assert (rows <= limits.max_position + 1e-9).all()
    collision = run.app.state.services.robot.collision
    assert collision.clearance.distances(rows[::20], 0.1).min() >= collision.margin_m - 5.1e-4


@pytest.mark.parametrize("seed", range(ATTACKS))
def test_an_attack_with_new_goals_breaks_no_limit(run: VirtualService, seed: int) -> None:
    """Oracles: all commanded positions, their differences, and the distances between the bodies at them."""
    random, statuses = np.random.default_rng(seed), list[int]()
    job = moving(run)
    while len(statuses) < samples(REQUESTS):
        if run.get(f"/jobs/{job}").json()["state"] not in ("running", "paused"):
            run.post("/robot/speed_override", {"fraction": 1.0}).raise_for_status()
            run.sleep(2.0)
            body = {"joints": random.uniform(-1.0, 1.0, 7).tolist(), "speed": 1.0, "planner": "auto"}
            began = run.post("/robot/move/joints?wait=false", body)
            job = began.json().get("id", job)
        answer = new_goal(run, job, hostile_goal(run, random))
        statuses.append(answer.status_code)
        assert answer.status_code in (200, 404, 409, 422), answer.text
        assert "Traceback" not in answer.text
        disturb(run, random)
        if len(statuses) % CHECKED_AFTER == 0:
            require_nothing_broken(run)
            del run.rig.commanded[:-4]
    require_nothing_broken(run)
    assert 200 in statuses
