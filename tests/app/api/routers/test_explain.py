"""Refused plans over REST: the facts, and requests that work as they are.

Oracle: what is said to work is asked for, as it was answered. `python -m benchmarks explanations` asks 200.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from cobot_run import PATIENT_PLANNING
from scipy.spatial.transform import Rotation
from thorough import few
from virtual_service import PlanningHere, VirtualService, virtual_service

from benchmarks.planning.explanations import examined
from cobot.errors import LimitError

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """One for all tests here. No test waits for the time of an explanation to run out."""
    folder = tmp_path_factory.mktemp("robot")
    with virtual_service(folder, more=f"planning: {{explain_s: 18.0, {PATIENT_PLANNING}}}\n") as started:
        yield started


@pytest.fixture(autouse=True)
def at_home(service: VirtualService) -> None:
    service.go_home()


def refused(service: VirtualService, what: str, **body: Any) -> Any:
    answer = service.post(f"/robot/plan/{what}", json=body)
    assert answer.status_code == 422, answer.text
    return answer.json()


@pytest.mark.parametrize("seed", few([9, 10]))
def test_random_refusals_are_explained_and_what_works_works(service: VirtualService, seed: int) -> None:
    found = examined(service, 12, seed)
    assert found.wrong == []
    assert found.helped == 12, found.helpless
    assert set(found.works) >= {"goal", "start", "planner"}


def test_a_refusal_says_all_of_it_as_numbers(service: VirtualService) -> None:
    explain = refused(service, "joints", joints=[3.5, *HOME[1:]])["explain"]
    (check,) = explain["checks"]
    assert check == {
        "check": "limit",
        "quantity": "position",
        "value": 3.5,
        "limit": 2.97,
        "by": pytest.approx(0.53),
        "unit": "rad",
        "share": 1.0,
        "of": ["joint1"],
    }
    assert explain["budget_s"] == 18.0
    (works,) = explain["works"]
    assert (works["change"], works["endpoint"]) == ("goal", "/robot/plan/joints")
    assert works["body"] == {"joints": [2.97, *HOME[1:]]}
    assert explain["tried"][0]["change"] == "planner"


def test_a_refusal_and_its_explanation_are_one_task(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second task would wait for the planning process again."""
    tasks, compute = [], PlanningHere.compute

    async def note(planning: PlanningHere, work: Any, *rest: Any) -> Any:
        tasks.append(work)
        return await compute(planning, work, *rest)

    monkeypatch.setattr(PlanningHere, "compute", note)
    assert refused(service, "joints", joints=[3.5, *HOME[1:]])["explain"]["works"]
    assert len(tasks) == 1


def test_from_another_start_a_named_position_keeps_its_name(service: VirtualService) -> None:
    explain = refused(service, "named", name="home", start=[9.0, *HOME[1:]], speed=0.5)["explain"]
    (works,) = explain["works"]
    assert works["body"] == {"name": "home", "start": [2.97, *HOME[1:]], "speed": 0.5}


def test_without_explain_only_the_facts_are_said(service: VirtualService) -> None:
    explain = refused(service, "joints", joints=[3.5, *HOME[1:]], explain=False)["explain"]
    assert (len(explain["checks"]), explain["works"], explain["tried"]) == (1, [], [])
    assert explain["budget_s"] == 0.0


def test_a_refused_move_says_the_facts(service: VirtualService) -> None:
    far = {"x": 3.0, "y": 0.0, "z": 0.5}
    answer = service.post("/robot/move/pose", json=far).json()
    assert answer["success"] is False
    assert answer["explain"]["checks"][0]["check"] == "reach"
    assert answer["explain"]["works"] == []
    beyond = service.post("/robot/move/joints", json={"joints": [3.5, *HOME[1:]]})
    assert beyond.status_code == 422
    assert beyond.json()["explain"]["checks"][0]["of"] == ["joint1"]
    moved = service.post("/robot/move/joints", json={"joints": HOME}).json()
    assert moved["explain"] is None


def test_of_a_sequence_it_is_said_which_motion_and_what_works_is_of_it_alone(service: VirtualService) -> None:
    there = [0.3, *HOME[1:]]
    refusal = refused(service, "sequence", motions=[{"joints": there}, {"x": 3.0, "y": 0.0, "z": 0.5}])
    assert refusal["detail"].startswith("motion 2: ")
    explain = refusal["explain"]
    assert explain["motion"] == 2
    assert explain["works"]
    for works in explain["works"]:
        assert works["body"]["start"] == pytest.approx(there)
        assert service.post(works["endpoint"], json=works["body"]).status_code == 200


def test_the_client_raises_with_what_works(service: VirtualService) -> None:
    robot = service.client(service.url)
    with pytest.raises(LimitError) as caught:
        robot.plan("joints", joints=[3.5, *HOME[1:]])
    assert caught.value.explain is not None
    (works,) = caught.value.explain["works"]
    assert robot.plan("joints", **works["body"])["duration_s"] == works["duration_s"]


def test_what_has_no_facts_is_an_ordinary_error(service: VirtualService) -> None:
    assert "explain" not in refused(service, "joints", joints=[0.0])


def test_a_path_is_planned_as_the_polyline_that_moves(service: VirtualService) -> None:
    poses = [
        {"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159},
        {"x": 0.45, "y": -0.1, "z": 0.5, "b": 3.14159},
    ]
    how = {"radius": 0.02, "speed": 0.5}
    plan = service.post("/robot/plan/path", json={"poses": poses, **how}).json()
    same = service.post(
        "/robot/plan/pose", json={**poses[1], "through": poses[:1], "planner": "polyline", **how}
    ).json()
    assert plan["duration_s"] == same["duration_s"]
    assert plan["path"][-1]["joints"] == same["path"][-1]["joints"]
    assert service.post("/robot/execute", json={"plan_id": plan["plan_id"]}).json()["success"]
    at = service.get("/robot/pose").json()["position"]
    assert at == pytest.approx({"x": 0.45, "y": -0.1, "z": 0.5}, abs=2e-3)


def test_a_sequence_is_planned_as_it_moves(service: VirtualService) -> None:
    motions = [{"joints": [0.6, 0.2, *HOME[2:]], "speed": 1.0}, {"name": "work", "speed": 1.0}]
    stopping = service.post("/robot/plan/sequence", json={"motions": motions}).json()
    plan = service.post("/robot/plan/sequence", json={"motions": motions, "radii": [0.1]}).json()
    assert plan["duration_s"] < stopping["duration_s"]
    done = service.post("/robot/execute", json={"plan_id": plan["plan_id"]}).json()
    assert done["success"], done
    service.go_home()
    moved = service.post("/robot/move/sequence", json={"motions": motions, "radii": [0.1]}).json()
    assert moved["duration_s"] == pytest.approx(done["duration_s"], abs=0.05)
    refusal = service.post("/robot/plan/sequence", json={"motions": motions, "radii": [0.1, 0.1]})
    assert refusal.json()["detail"] == "radii: 2 motions need 1, one for each motion except the last; got 2"


def test_where_a_line_cannot_end_in_the_joints_that_are_asked_for_any_end_works(
    service: VirtualService,
) -> None:
    """The same pose with the wrist turned over: no line leads to it."""
    start = [0.2, 0.5, -0.3, -1.3, 0.4, 0.9, 0.1]
    goal = service.post("/robot/plan/joints", json={"joints": start, "samples": 2}).json()["path"][-1]
    a, b, c = Rotation.from_quat(goal["quaternion"]).as_euler("ZYX").tolist()
    x, y, z = goal["position"]
    over = [*start[:4], start[4] - np.pi, -start[5], start[6] + np.pi]
    near = [*start[:6], start[6] - 0.3]
    line = {"x": x, "y": y, "z": z, "a": a, "b": b, "c": c, "planner": "lin", "start": near}
    works = refused(service, "pose", **line, end_joints=over)["explain"]["works"]
    end = next(each for each in works if each["change"] == "end")
    assert "end_joints" not in end["body"]
    assert service.post(end["endpoint"], json=end["body"]).status_code == 200
