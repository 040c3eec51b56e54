"""Motions that are planned, looked at and run, on virtual time.

Oracles: where /robot/joint_states says the arm is, and the limits of joint_limits.yaml.
"""

from __future__ import annotations

import asyncio
import itertools
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from virtual_service import VirtualService, virtual_service

from app.api.schemas.plan_answers import PlanAnswer
from app.services.rights.stop_reason import StopReason
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
THERE = [0.3, 0.2, 0.0, -1.5, 0.0, 1.5, 0.0]


def post(service: VirtualService, path: str, body: dict[str, Any]) -> Any:
    return service.post(path, json=body)


def joints(service: VirtualService) -> np.ndarray:
    return np.array(service.joints())


def at_home(service: VirtualService) -> None:
    answer = post(service, "/robot/move/joints", {"joints": HOME, "speed": 1.0}).json()
    assert answer["success"], answer


def planned(service: VirtualService, **more: Any) -> Any:
    answer = post(service, "/robot/plan/joints", {"joints": THERE, "speed": 1.0, **more})
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_plan_moves_nothing_and_runs_as_it_says(service: VirtualService) -> None:
    at_home(service)
    before = joints(service)
    plan = planned(service, samples=5)
    np.testing.assert_allclose(joints(service), before, atol=1e-4)
    assert len(plan["path"]) == 5
    np.testing.assert_allclose(plan["path"][0]["joints"], HOME, atol=1e-5)
    np.testing.assert_allclose(plan["path"][-1]["joints"], THERE, atol=1e-9)
    assert plan["path"][-1]["time_s"] == plan["duration_s"]
    for use in plan["utilisation"].values():
        assert 0.0 < max(use["share"]) <= 1.0 + 1e-9
    dense = planned(service, samples=1000)["path"]
    times, places, rates = (
        np.array([each[name] for each in dense]) for name in ("time_s", "joints", "velocities")
    )
    np.testing.assert_allclose(rates, np.gradient(places, times, axis=0), atol=5e-3)
    assert plan["closest_self"]["distance_m"] >= 0.0045
    answer = post(service, "/robot/execute", {"plan_id": plan["plan_id"]}).json()
    assert answer["success"], answer
    assert plan["duration_s"] <= answer["duration_s"] <= plan["duration_s"] + 1.0
    np.testing.assert_allclose(joints(service), THERE, atol=5e-3)


def test_the_path_of_the_motion_that_runs_is_told_to_everybody(service: VirtualService) -> None:
    """Oracle: the plan that it is."""
    at_home(service)
    nothing = {"motion_id": None, "duration_s": 0.0, "note": "", "path": []}
    assert service.get("/robot/motion").json() == nothing
    plan = planned(service, samples=7)
    job = post(service, "/robot/execute?wait=false", {"plan_id": plan["plan_id"]}).json()
    service.until(lambda: service.get("/robot/motion").json()["motion_id"])
    told = service.get(f"/robots/{service.name}/motion?samples=7").json()
    assert told["motion_id"] == service.get(f"/jobs/{job['id']}").json()["motion_id"]
    assert told["duration_s"] == plan["duration_s"]
    assert [list(point) for point in told["path"]] == [["time_s", "joints"]] * 7
    for name in ("time_s", "joints"):
        there, here = ([point[name] for point in each["path"]] for each in (plan, told))
        np.testing.assert_allclose(here, there, atol=1e-12)
    refused = service.get("/robot/motion?samples=1")
    assert (refused.status_code, refused.json()["code"]) == (422, "input")
    service.until(lambda: service.get(f"/jobs/{job['id']}").json()["state"] == "finished")
    assert service.get("/robot/motion").json() == nothing


def test_a_second_execute_says_how_far_the_arm_is_from_the_start(service: VirtualService) -> None:
    at_home(service)
    body = {"plan_id": planned(service)["plan_id"]}
    assert post(service, "/robot/execute", body).json()["success"]
    refused = post(service, "/robot/execute", body)
    assert refused.status_code == 409
    assert "joint1 is at 0.300000 rad, 0.3 rad away from" in refused.json()["detail"]
    assert "allowed: 1e-06 rad" in refused.json()["detail"]
    assert refused.json()["details"] == {"cause": "not_at_start"}
    at_home(service)
    assert post(service, "/robot/execute", body).json()["success"]


def test_an_unknown_plan_is_not_found(service: VirtualService) -> None:
    refused = post(service, "/robot/execute", {"plan_id": "nothing"})
    assert refused.status_code == 404
    detail = refused.json()["detail"]
    assert detail.startswith("there is no plan 'nothing'; only the newest 50 plans are kept, for 600 s")


def test_only_the_newest_plans_are_kept(service: VirtualService) -> None:
    """As where 50 are kept, the shipped number: with a few less there, it costs no 51 plans."""
    at_home(service)
    plans = service.app.state.services.plans
    kept, plans._kept = plans._kept, 3
    try:
        first, second = planned(service)["plan_id"], planned(service)["plan_id"]
        for _ in range(2):
            planned(service, samples=2)
        assert post(service, "/robot/execute", {"plan_id": first}).status_code == 404
        assert post(service, "/robot/execute", {"plan_id": second}).json()["success"]
    finally:
        plans._kept = kept
    assert kept == 50


def test_of_two_executes_of_a_plan_one_is_refused(service: VirtualService) -> None:
    at_home(service)
    body = {"plan_id": planned(service)["plan_id"]}
    both = [service.begin(service.asking("POST", "/robot/execute", json=body)) for _ in range(2)]
    answers = [service.end(each) for each in both]
    done, refused = sorted(answers, key=lambda each: each.status_code)
    assert done.json()["success"], done.text
    assert refused.status_code == 409
    assert "the robot is in use by POST /robot/execute" in refused.json()["detail"]
    np.testing.assert_allclose(joints(service), THERE, atol=5e-3)


def test_who_may_plan_and_execute_and_that_another_service_knows_no_plan(
    service: VirtualService, tmp_path: Path
) -> None:
    """An observer may neither: a plan takes the computer's time from those who move the arm."""
    at_home(service)
    known = planned(service)["plan_id"]
    file = TokenFile(tmp_path / "tokens.json")
    tokens = {role: file.create(role.name.lower(), role) for role in (Role.OBSERVER, Role.OPERATOR)}
    with virtual_service(tmp_path, more="web: {authentication: required, tokens: tokens.json}\n") as other:

        def asked(role: Role, path: str, body: dict[str, Any]) -> Any:
            return other.ask("POST", path, json=body, headers={"Authorization": f"Bearer {tokens[role]}"})

        sequence = {"motions": [{"joints": THERE}]}
        arc = {"centre": {"x": 0.4, "y": 0.1, "z": 0.6}, "axis": {"x": 0, "y": 0, "z": 1}, "angle": 0.5}
        poses = {"poses": [{"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159}]}
        for path, body in (
            ("/robot/plan/joints", {"joints": THERE}),
            ("/robot/plan/named", {"name": "home"}),
            ("/robot/plan/sequence", sequence),
            ("/robot/plan/arc", arc),
            ("/robot/plan/path", poses | {"start": [0.0, 0.5, 0.0, -1.57, 0.0, 1.07, 0.0]}),
        ):
            refused = asked(Role.OBSERVER, path, body)
            assert refused.status_code == 403
            assert "needs the role agent" in refused.json()["detail"]
            made = asked(Role.OPERATOR, path, body)
            assert made.status_code == 200, made.text
        plan = asked(Role.OPERATOR, "/robot/plan/joints", {"joints": THERE, "speed": 1.0}).json()
        body = {"plan_id": plan["plan_id"]}
        assert asked(Role.OBSERVER, "/robot/execute", body).status_code == 403
        forgotten = asked(Role.OPERATOR, "/robot/execute", {"plan_id": known})  # as after a restart
        assert forgotten.status_code == 404
        assert "until the service restarts; plan again" in forgotten.json()["detail"]
        assert asked(Role.OPERATOR, "/robot/execute", body).json()["success"]


def test_the_schema_shows_a_plan(service: VirtualService) -> None:
    models = service.get("/openapi.json").json()["components"]["schemas"]
    (example,) = models["PlanAnswer"]["examples"]
    assert PlanAnswer.model_validate(example).path[0].joints == HOME


def test_a_plan_expires(service: VirtualService) -> None:
    at_home(service)
    plans = service.app.state.services.plans
    shipped_s, plans.lifetime_s = plans.lifetime_s, 5.0
    try:
        plan = planned(service)
        assert plan["expires_in_s"] == 5.0
        service.sleep(4.0)
        body = {"plan_id": plan["plan_id"]}
        assert post(service, "/robot/execute", body).json()["success"]
        at_home(service)
        assert post(service, "/robot/execute", body).status_code == 404
    finally:
        plans.lifetime_s = shipped_s
    assert shipped_s == 600.0


def test_while_the_arm_moves_a_plan_needs_a_start_and_none_is_run(service: VirtualService) -> None:
    at_home(service)
    body = {"plan_id": planned(service)["plan_id"]}
    mover = service.begin(service.asking("POST", "/robot/move/joints", json={"joints": THERE, "speed": 0.02}))
    service.until(lambda: service.health()["robot"]["mode"] == "TRAJECTORY")
    refused = post(service, "/robot/plan/named", {"name": "home"})
    assert refused.status_code == 409
    assert "give `start`" in refused.json()["detail"]
    assert planned(service, start=HOME)["duration_s"] > 0.0
    refused = post(service, "/robot/execute", body)
    assert refused.status_code == 409
    assert "in use by POST /robot/move/joints" in refused.json()["detail"]
    assert service.post("/stop").json()["at_rest"]
    service.end(mover)


def test_a_plan_under_other_limits_is_refused(service: VirtualService) -> None:
    at_home(service)
    plan = planned(service)
    kept = service.app.state.services.plans._plans[plan["plan_id"]].limits.max_velocity
    kept.flags.writeable = True
    kept[2] *= 2.0
    refused = post(service, "/robot/execute", {"plan_id": plan["plan_id"]})
    assert refused.status_code == 409
    assert "max_velocity of joint3 was" in refused.json()["detail"]


def test_where_the_arm_is_already_nothing_is_to_be_run(service: VirtualService) -> None:
    at_home(service)
    plan = post(service, "/robot/plan/joints", {"joints": HOME, "start": HOME}).json()
    assert plan["duration_s"] == 0.0
    assert len(plan["path"]) == 1


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ({"joints": THERE, "start": [0.0]}, "start must have 7 angles, got 1"),
        ({"joints": THERE, "start": [9.0] * 7}, "start: the angle of joint1 is 9 rad"),
        ({"joints": THERE, "samples": 1}, "samples"),
        ({"joints": [9.0] * 7}, "joint1"),
    ],
)
def test_bad_input_is_refused(service: VirtualService, body: dict[str, Any], reason: str) -> None:
    refused = post(service, "/robot/plan/joints", body)
    assert refused.status_code == 422
    assert reason in refused.json()["detail"]


def test_a_pose_is_planned_along_a_line(service: VirtualService) -> None:
    at_home(service)
    pose = service.get("/robot/pose").json()
    at, turn = pose["position"], pose["orientation"]["euler_rad"]
    body = {"x": at["x"], "y": at["y"], "z": at["z"] - 0.1, **turn, "planner": "lin", "samples": 7}
    plan = post(service, "/robot/plan/pose", body).json()
    line = np.array([point["position"] for point in plan["path"]])
    np.testing.assert_allclose(line[:, :2], np.tile([at["x"], at["y"]], (7, 1)), atol=5e-4)


def test_a_kept_plan_is_shown_as_it_was_answered(service: VirtualService) -> None:
    at_home(service)
    plan = planned(service, samples=5)
    shown = service.get(f"/robot/plans/{plan['plan_id']}").json()
    assert 0.0 < shown.pop("expires_in_s") <= plan.pop("expires_in_s")
    assert shown == plan
    assert service.get("/robot/plans/none").status_code == 404


def test_what_becomes_of_plans_is_told(service: VirtualService) -> None:
    with service.listen("/events?types=plan") as events:
        plan = planned(service)
        made = events.event("plan")["data"]
        assert (made["what"], made["plan"], made["planners"]) == ("made", plan["plan_id"], ["ptp"])
        assert made["duration_s"] == plan["duration_s"]
        for approved, what in ((True, "approved"), (False, "withdrawn")):
            post(service, "/robot/approve", {"plan_id": plan["plan_id"], "approved": approved})
            told = events.event("plan")["data"]
            assert (told["what"], told["plan"]) == (what, plan["plan_id"])


def test_a_change_of_the_speed_override_is_told_once(service: VirtualService) -> None:
    with service.listen("/events?types=speed") as events:
        for fraction in (0.5, 0.5, 1.0):
            post(service, "/robot/speed_override", {"fraction": fraction})
        assert [events.event("speed")["data"]["fraction"] for _ in range(2)] == [0.5, 1.0]


def rehearsed(service: VirtualService, plan: str) -> Any:
    return service.post(f"/robot/plans/{plan}/rehearse")


def test_a_rehearsal_says_what_running_the_plan_then_does_and_moves_nothing(service: VirtualService) -> None:
    """Oracle: the execution of the same plan."""
    at_home(service)
    plan = planned(service)
    answer = rehearsed(service, plan["plan_id"]).json()
    np.testing.assert_allclose(joints(service), HOME, atol=2e-3)
    assert (answer["runs_through"], answer["problem"]) == (True, None)
    assert answer["planned_duration_s"] == plan["duration_s"]
    assert max(answer["off"]) < 0.02
    torque = plan["utilisation"]["torque"]["share"]
    np.testing.assert_allclose(max(answer["effort"]), max(torque), rtol=0.2)
    for near in ("closest_self", "closest_environment"):
        assert answer[near]["between"] == plan[near]["between"]
        assert answer[near]["distance_m"] == pytest.approx(plan[near]["distance_m"], abs=2e-3)
    ran = post(service, "/robot/execute", {"plan_id": plan["plan_id"]}).json()
    assert answer["duration_s"] == pytest.approx(ran["duration_s"], abs=0.3)


def test_a_rehearsal_while_the_arm_moves_does_not_disturb_it(service: VirtualService) -> None:
    at_home(service)
    plan = planned(service, start=THERE, joints=HOME)["plan_id"]
    moving = service.begin(service.asking("POST", "/robot/move/joints", json={"joints": THERE, "speed": 0.3}))
    service.sleep(0.5)
    assert rehearsed(service, plan).json()["runs_through"]
    assert service.end(moving).json()["success"]
    assert post(service, "/robot/execute", {"plan_id": plan}).json()["success"]


def test_what_cannot_be_rehearsed_is_refused(service: VirtualService) -> None:
    at_home(service)
    assert rehearsed(service, "nothing").status_code == 404
    assert rehearsed(service, "x" * 65).status_code == 422
    plan = planned(service)["plan_id"]
    light = rehearsed(service, plan).json()["effort"]
    assert post(service, "/robot/tool", {"mass": 5.0}).is_success
    try:
        refused = rehearsed(service, plan)
        assert refused.status_code == 409
        assert "the tool had version" in refused.json()["detail"]
        heavier = rehearsed(service, planned(service)["plan_id"]).json()
        assert heavier["runs_through"], heavier
        assert heavier["effort"][1] > 1.2 * light[1]
    finally:
        assert post(service, "/robot/tool", {"mass": 0.0}).is_success


def test_a_plan_that_moves_nothing_runs_through(service: VirtualService) -> None:
    at_home(service)
    answer = rehearsed(service, planned(service, start=THERE)["plan_id"]).json()
    assert (answer["runs_through"], answer["duration_s"], answer["planned_duration_s"]) == (True, 0.0, 0.0)
    assert answer["off"] == [0.0] * 7
    assert max(answer["effort"]) > 0.0


def test_a_plan_of_a_full_circle_runs_again_and_again(service: VirtualService) -> None:
    """Each run begins where the one before has ended, to 1e-6 rad, or it is refused."""
    start = [0.2, 0.5, -0.3, -1.3, 0.4, 0.9, 0.1]
    assert post(service, "/robot/move/joints", {"joints": start, "speed": 1.0}).json()["success"]
    at = service.get("/robot/pose").json()["position"]
    centre = {"x": at["x"] - 0.05, "y": at["y"], "z": at["z"]}
    arc = {"centre": centre, "axis": {"x": 0, "y": 0, "z": 1}, "angle": 6.2832, "speed": 1.0}
    plan = post(service, "/robot/plan/arc", arc).json()
    np.testing.assert_allclose(plan["path"][-1]["joints"], start, atol=1e-9)
    for _ in range(6):
        answer = post(service, "/robot/execute", {"plan_id": plan["plan_id"]})
        assert answer.json()["success"], answer.text
    drifting = post(service, "/robot/plan/arc", arc | {"cyclic": False}).json()
    assert np.abs(np.array(drifting["path"][-1]["joints"]) - start).max() > 1e-4


def test_closed_lines_run_again_and_again(service: VirtualService) -> None:
    """A triangle in one plan, and a line there and back in two: each run begins where the last has ended, to
    1e-6 rad, or it is refused.
    """
    assert post(service, "/robot/move/joints", {"joints": THERE, "speed": 1.0}).json()["success"]
    legs = {"frame_id": "tool", "speed": 1.0, "samples": 2}
    corners = [{"x": x, "y": y, "z": 0.0} for x, y in ((-0.05, 0.0), (-0.05, 0.08), (0.0, 0.0))]
    triangle = post(service, "/robot/plan/path", legs | {"poses": corners, "cyclic": True}).json()
    there = post(service, "/robot/plan/path", legs | {"poses": corners[:1]}).json()
    begin, end = (each["joints"] for each in there["path"])
    at_start = service.get("/robot/pose").json()
    x, y, z = (at_start["position"][axis] for axis in "xyz")
    back = {"x": x, "y": y, "z": z, **at_start["orientation"]["euler_rad"], "planner": "lin"}
    back |= {"end_joints": begin, "start": end, "speed": 1.0, "samples": 2}
    returning = post(service, "/robot/plan/pose", back).json()
    for _ in range(3):
        for plan in (triangle, there, returning):
            answer = post(service, "/robot/execute", {"plan_id": plan["plan_id"]})
            assert answer.json()["success"], answer.text


def test_a_line_back_ends_in_the_joints_that_are_asked_for(service: VirtualService) -> None:
    first = planned(service, samples=2)
    here = first["path"][-1]
    assert post(service, "/robot/move/joints", {"joints": THERE, "speed": 1.0}).json()["success"]
    x, y, z = here["position"]
    turn = service.get("/robot/pose").json()["orientation"]["euler_rad"]
    away = {"x": x, "y": y + 0.2, "z": z - 0.1, **turn, "planner": "lin", "speed": 1.0}
    there = post(service, "/robot/plan/pose", away | {"samples": 2}).json()
    back = {"x": x, "y": y, "z": z, "planner": "lin", "end_joints": THERE, "speed": 1.0, "samples": 2}
    back |= {"start": there["path"][-1]["joints"], **_angles(here["quaternion"])}
    plan = post(service, "/robot/plan/pose", back)
    assert plan.status_code == 200, plan.text
    np.testing.assert_allclose(plan.json()["path"][-1]["joints"], THERE, atol=1e-9)
    for wrong, said in (
        (THERE[:6], "end_joints: must have 7 angles, got 6"),
        (HOME, "end_joints: their pose is"),
        ([9.0, *THERE[1:]], "end_joints: the angle of joint1 is 9 rad"),
    ):
        refused = post(service, "/robot/plan/pose", back | {"end_joints": wrong})
        assert refused.status_code == 422
        assert said in refused.json()["detail"]


def _angles(quaternion: list[float]) -> dict[str, float]:
    """KUKA's angles of x, y, z, w, by scipy."""
    a, b, c = Rotation.from_quat(quaternion).as_euler("ZYX").tolist()
    return {"a": a, "b": b, "c": c}


def test_a_rotation_of_the_tool_can_be_free(service: VirtualService) -> None:
    at_home(service)
    body = {"x": 0.45, "y": 0.2, "z": 0.4, "b": np.pi, "free_axes": ["rz"], "samples": 2}
    for planner in ("ptp", "lin", "ompl"):
        end = post(service, "/robot/plan/pose", body | {"planner": planner}).json()["path"][-1]
        np.testing.assert_allclose(end["position"], [0.45, 0.2, 0.4], atol=1e-6)
        down = Rotation.from_quat(end["quaternion"]).as_matrix()[:, 2]
        np.testing.assert_allclose(down, [0.0, 0.0, -1.0], atol=1e-6)
    for axes, said in (
        (["c"], "free_axes[0]: must be 'rx', 'ry' or 'rz', got 'c'"),
        (["rx", "rz"], "free_axes: rx and rz together already allow every orientation"),
    ):
        refused = post(service, "/robot/plan/pose", body | {"free_axes": axes})
        assert refused.status_code == 422
        assert said in refused.json()["detail"]


def test_a_plan_is_approved_and_run_by_its_address(service: VirtualService) -> None:
    at_home(service)
    path = f"/v1/robot/plans/{planned(service)['plan_id']}"
    for query, by in (("", "anonymous"), ("?approved=false", None)):
        assert service.post(f"{path}/approve{query}").json()["approved_by"] == by
    headers = {"Idempotency-Key": "once"}
    answers = [service.post(f"{path}/execute", headers=headers) for _ in range(2)]
    assert answers[0].json()["success"], answers[0].text
    assert answers[0].content == answers[1].content
    np.testing.assert_allclose(joints(service), THERE, atol=1e-3)
    for what in ("approve", "execute"):
        answer = service.post(f"/robot/plans/plan_none/{what}")
        assert (answer.status_code, answer.json()["code"]) == (404, "not_found")


WALL = {"shape": "box", "size": [0.6, 0.04, 0.85], "x": 0.55, "y": 0.0, "z": 0.425}
LEFT, RIGHT = ([angle, 0.5, *HOME[2:]] for angle in (-0.8, 0.8))


@pytest.fixture
def walled(service: VirtualService, monkeypatch: pytest.MonkeyPatch) -> Iterator[VirtualService]:
    """A wall between two positions. Each look at the clock takes a search for faster motions 1/32 s."""
    ticks = itertools.count()
    clock = SimpleNamespace(monotonic=lambda: next(ticks) / 32)
    monkeypatch.setattr("cobot.planners.search.improve.time", clock)
    post(service, "/robot/move/joints", {"joints": LEFT, "speed": 1.0})
    assert post(service, "/scene", {"objects": {"wall": WALL}}).status_code == 200
    yield service
    assert post(service, "/scene", {"clear": True}).status_code == 200


def over(service: VirtualService, planner: str = "ompl", **more: Any) -> Any:
    body = {"joints": RIGHT, "speed": 1.0, "planner": planner, **more}
    answer = post(service, "/robot/plan/joints", body)
    assert answer.status_code == 200, answer.text
    return answer.json()


def test_a_plan_with_a_budget_is_faster_and_runs(walled: VirtualService) -> None:
    first, better = over(walled), over(walled, budget_s=0.75)
    assert first["planning"] == {
        "quality": "first",
        "first_duration_s": first["duration_s"],
        "tries": 0,
        "improvements": 0,
        "lower_bound_s": None,
    }
    assert better["planning"]["quality"] == "improved"
    assert better["planning"]["first_duration_s"] == first["duration_s"]
    assert better["planning"]["lower_bound_s"] < better["duration_s"] < first["duration_s"]
    assert better["planning"]["tries"] == 24
    assert over(walled, budget_s=0.75)["duration_s"] == better["duration_s"]
    assert post(walled, "/robot/execute", {"plan_id": better["plan_id"]}).json()["success"]
    np.testing.assert_allclose(joints(walled), RIGHT, atol=5e-3)


def test_a_plan_is_improved_and_stays_as_it_is(walled: VirtualService) -> None:
    first = over(walled)
    path = f"/robot/plans/{first['plan_id']}/improve"
    better = post(walled, path, {"budget_s": 0.75, "samples": 9}).json()
    assert better["plan_id"] != first["plan_id"]
    assert better["duration_s"] == over(walled, budget_s=0.75)["duration_s"] < first["duration_s"]
    assert len(better["path"]) == 9
    assert walled.get(f"/robot/plans/{first['plan_id']}").json()["duration_s"] == first["duration_s"]
    further = post(walled, f"/robot/plans/{better['plan_id']}/improve", {"budget_s": 0.75}).json()
    assert further["planning"]["tries"] > better["planning"]["tries"]
    assert further["duration_s"] <= better["duration_s"]
    nothing = post(walled, path, {"budget_s": 0.0}).json()
    assert (nothing["plan_id"], nothing["planning"]["quality"]) == (first["plan_id"], "first")


def test_a_plan_that_cannot_be_improved_says_so(walled: VirtualService) -> None:
    near = {"joints": [-0.9, *LEFT[1:]], "speed": 1.0}
    direct = over(walled, "ptp", joints=near["joints"], budget_s=5.0)
    assert (direct["planning"]["quality"], direct["planning"]["tries"]) == ("final", 0)
    path = f"/robot/plans/{direct['plan_id']}/improve"
    assert post(walled, path, {}).json()["plan_id"] == direct["plan_id"]
    both = post(walled, "/robot/plan/sequence", {"motions": [near, near]}).json()
    assert both["planning"] is None
    answer = post(walled, f"/robot/plans/{both['plan_id']}/improve", {})
    assert answer.status_code == 422
    assert "is of 2 motions; only a plan of one motion can be improved" in answer.text
    assert post(walled, "/robot/plans/plan_0/improve", {}).status_code == 404
    for budget_s in (-1.0, 10.5):
        assert post(walled, path, {"budget_s": budget_s}).status_code == 422
    post(walled, "/scene", {"clear": True})
    changed = post(walled, path, {})
    assert changed.status_code == 409
    assert "the scene had version" in changed.text


def test_an_improvement_ends_in_time_while_other_plans_are_made(
    walled: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The oracles are the endpoint's timeout and the service's virtual clock."""
    services, first = walled.app.state.services, over(walled)
    turn, compute, others = services.plans._turn, services.planning.compute, []

    async def then_other_plans(work: Any, timeout_s: float) -> Any:
        if not others:
            others.append(asyncio.ensure_future(turn.acquire()))
            await asyncio.sleep(0)
        return await compute(work, timeout_s)

    monkeypatch.setattr(services.planning, "compute", then_other_plans)
    path, begun_s = f"/robot/plans/{first['plan_id']}/improve", walled.clock.now_s()
    answer = post(walled, path, {"budget_s": 0.75})
    assert answer.status_code == 422
    assert answer.json()["code"] == "planning_timeout"
    assert "not improved within 20 s, because other plans are being made" in answer.text
    assert walled.clock.now_s() - begun_s == pytest.approx(20.0, abs=0.1)
    begun_s = walled.clock.now_s()
    assert post(walled, path, {"budget_s": 0.75}).json()["plan_id"] == first["plan_id"]
    assert walled.clock.now_s() - begun_s == pytest.approx(1.75, abs=0.1)
    turn.release()
    assert post(walled, path, {"budget_s": 0.75}).json()["duration_s"] < first["duration_s"]


def test_a_motion_with_a_budget_is_planned_then_goes(walled: VirtualService) -> None:
    body = {"joints": RIGHT, "speed": 1.0, "planner": "ompl"}
    answer = post(walled, "/robot/move/joints", body | {"budget_s": 0.75}).json()
    assert answer["success"], answer
    assert answer["planning"]["quality"] == "improved"
    assert answer["planning"]["tries"] == 24
    np.testing.assert_allclose(joints(walled), RIGHT, atol=5e-3)


def test_a_stop_during_the_budget_ends_the_motion_before_it_begins(
    walled: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    slices: list[None] = []

    async def stopped_meanwhile(*arguments: Any) -> Any:
        slices.append(None)
        if len(slices) == 2:
            await walled.app.state.services.stopping.stop_motion(StopReason("the test stops it", "request"))
        return await plan(*arguments)

    planning = walled.app.state.services.planning
    plan = planning.compute
    monkeypatch.setattr(planning, "compute", stopped_meanwhile)
    body = {"joints": RIGHT, "speed": 1.0, "planner": "ompl", "budget_s": 2.0}
    answer = post(walled, "/robot/move/joints", body).json()
    assert (answer["success"], answer["motion_id"]) == (False, None)
    assert answer["code"] == "stopped"
    assert len(slices) == 2
    np.testing.assert_allclose(joints(walled), LEFT, atol=5e-3)
