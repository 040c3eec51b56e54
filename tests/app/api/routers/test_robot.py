"""A motion over HTTP and what ends it, on virtual time.

Oracle: what GET /health says about the arm.
"""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from planner_sentences import only
from virtual_service import URL, VirtualService

ROOT = Path(__file__).parents[4]


def test_a_stopped_motion_answers_its_own_client_too(service: VirtualService) -> None:
    body = {"joints": [1.5, 0.5, 0, -1.57, 0, 1.57, 0], "speed": 0.01}
    mover = service.begin(service.asking("POST", "/robot/move/joints", json=body))
    service.until(lambda: service.health()["robot"]["mode"] == "TRAJECTORY")
    service.sleep(1.0)
    assert service.post("/stop").json()["at_rest"]
    answer = service.end(mover).json()
    assert answer["success"] is False
    assert answer["code"] == "stopped"
    assert "POST /stop" in answer["message"]


def move(service: VirtualService, path: str, **body: object) -> dict[str, Any]:
    answer = service.post(f"/robot/move/{path}", json=body)
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


def tcp(service: VirtualService) -> np.ndarray:
    position = service.get("/robot/pose").json()["position"]
    return np.array([position[axis] for axis in "xyz"])


def at_work(service: VirtualService) -> np.ndarray:
    assert move(service, "named", name="work", speed=1.0)["success"]
    return tcp(service)


def test_arcs_polylines_and_speeds_in_units_over_http(service: VirtualService) -> None:
    begin = at_work(service)
    x, y, z = begin.tolist()
    down = {"b": 3.14159265358979}
    arc = {"centre": {"x": x - 0.1, "y": y, "z": z}, "axis": {"x": 0, "y": 0, "z": 2}}
    answer = move(service, "arc", **arc, angle=6.283185307179586, rise=0.05, speed_m_s=0.25)
    assert answer["success"], answer
    assert tcp(service) == pytest.approx(begin + np.array([0, 0, 0.05]), abs=1e-4)
    assert answer["duration_s"] > 0.2 * np.pi / 0.25
    at_work(service)
    goal = {"x": x - 0.1, "y": y + 0.1, "z": z}
    answer = move(service, "pose", **goal, **down, planner="circ", centre=arc["centre"], speed=1.0)
    assert answer["success"], answer
    at_work(service)
    through = [{"x": x, "y": y + 0.1, "z": z, **down}, {"x": x, "y": y + 0.1, "z": z + 0.1, **down}]
    answer = move(
        service, "pose", **goal, **down, planner="polyline", through=through, radius=0.02, speed_m_s=0.2
    )
    assert answer["success"], answer
    assert tcp(service) == pytest.approx(list(goal.values()), abs=1e-4)


def test_poses_in_the_frames_of_the_hand_and_of_the_world(service: VirtualService) -> None:
    begin = at_work(service)
    answer = move(service, "pose", x=0.0, y=0.0, z=0.05, planner="lin", frame_id="tool", speed=0.5)
    assert answer["success"], answer
    assert tcp(service) == pytest.approx(begin - np.array([0, 0, 0.05]), abs=1e-4), "the hand looks down"
    x, y, z = begin.tolist()
    assert move(service, "pose", x=x, y=y, z=z, b=np.pi, planner="lin", frame_id="world", speed=0.5)[
        "success"
    ]
    assert tcp(service) == pytest.approx(begin, abs=1e-4)


@pytest.mark.parametrize(
    ("path", "body", "detail"),
    [
        (
            "pose",
            {"frame_id": "link4"},
            "frame_id: 'link4' moves with the joints; valid names: base_link, tool, world",
        ),
        (
            "pose",
            {"frame_id": "moon"},
            "frame_id: there is no frame 'moon'; valid names: base_link, tool, world",
        ),
        (
            "pose",
            {"planner": "lin", "speed_m_s": 1.5},
            "speed_m_s: is 1.5 m/s, allowed: above 0 and up to 1 m/s",
        ),
        (
            "pose",
            {"planner": "lin", "speed_rad_s": -1},
            "speed_rad_s: is -1 rad/s, allowed: above 0 and up to 2",
        ),
        ("pose", {"speed_m_s": 0.1}, f"speed_m_s: {only('tcp_speed', 'ptp')}"),
        ("pose", {"planner": "lin", "radius": 0.1}, f"radius: {only('radius_m', 'lin')}"),
        (
            "pose",
            {"planner": "lin", "through": [{"x": 0, "y": 0, "z": 0}]},
            f"through: {only('through', 'lin')}",
        ),
        ("pose", {"planner": "lin", "centre": {"x": 0, "y": 0, "z": 0}}, f"centre: {only('arc', 'lin')}"),
        (
            "pose",
            {"planner": "circ", "axis": {"x": 0, "y": 0, "z": 1}},
            "axis: requires centre, which is missing",
        ),
        ("pose", {"planner": "polyline", "through": [{"x": 0, "y": 0}]}, "through[0].z: is missing"),
        ("arc", {"angle": 1.0, "axis": {"x": 0, "y": 0, "z": 1}}, "centre: is missing"),
    ],
)
def test_what_a_path_cannot_be_is_said_before_anything_moves(
    service: VirtualService, path: str, body: dict[str, object], detail: str
) -> None:
    goal = {"x": 0.5, "y": 0.0, "z": 0.5} if path == "pose" else {}
    answer = service.post(f"/robot/move/{path}", json=goal | body)
    assert answer.status_code == 422
    assert detail in answer.json()["detail"]


UPRIGHT = {"orientation": {"within_rad": 0.1}}


def test_a_tool_stays_upright_over_http(service: VirtualService) -> None:
    x, y, z = at_work(service).tolist()
    goal = {"x": x, "y": y + 0.3, "z": z, "b": 3.14159265358979, "planner": "ompl", "speed": 1.0}
    assert move(service, "pose", **goal, constraints=UPRIGHT)["success"]
    assert tcp(service) == pytest.approx([x, y + 0.3, z], abs=1e-4)
    refused = move(
        service, "joints", joints=[0, 0.5, 0, -1.57, 0, 0.5, 0], planner="ptp", constraints=UPRIGHT
    )
    assert refused["success"] is False
    assert "constraints.orientation: the tool's axis is" in refused["message"]


@pytest.mark.parametrize(
    ("constraints", "message"),
    [
        ({"orientation": {"within_rad": 0}}, "constraints.orientation.within_rad"),
        (
            {"orientation": {"within_rad": 0.1, "tool_axis": {"x": 0, "y": 0, "z": 0}}},
            "tool_axis: has a length of 0",
        ),
        (
            {"box": {"min": {"x": 1, "y": 0, "z": 0}, "max": {"x": 1, "y": 1, "z": 1}}},
            "min.x is 1 m; it must be below",
        ),
        ({"box": {"min": {"x": 1, "y": 0, "z": 0}}}, "constraints.box.max"),
        ({"joints": {"elbow": [0, 1]}}, "there is no such joint; valid names: joint1"),
        ({"joints": {"joint1": [1, 0]}}, "constraints.joints.joint1: is 1 to 0 rad"),
        ({"joints": {"joint1": [3, 4]}}, "is 3 to 4 rad, beyond the limits of -2.9"),
        ({"joints": {"joint1": [0]}}, "constraints.joints.joint1"),
        ({"upright": True}, "upright"),
    ],
)
def test_constraints_that_are_none_are_named(
    service: VirtualService, constraints: dict[str, object], message: str
) -> None:
    answer = service.post("/robot/move/joints", json={"joints": [0.0] * 7, "constraints": constraints})
    assert answer.status_code == 422, answer.text
    assert message in answer.json()["detail"]


def test_the_example_draws_its_paths(service: VirtualService) -> None:
    example = runpy.run_path(str(ROOT / "examples" / "paths.py"))
    with service.client(URL) as robot:
        example["draw"](robot)
    height = example["HEIGHT"] + 0.06 + 0.05
    assert tcp(service) == pytest.approx([0.4, -0.1, height], abs=1e-4)


def test_the_example_carries_a_glass(service: VirtualService) -> None:
    example = runpy.run_path(str(ROOT / "examples" / "upright.py"))
    with service.client(URL) as robot:
        example["carry"](robot)
    assert tcp(service)[1] == pytest.approx(0.0, abs=1e-4)
