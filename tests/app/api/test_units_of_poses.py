"""Values in degrees, millimetres and milliseconds. Oracle: the documents' units."""

from __future__ import annotations

from typing import Any

import pytest
from virtual_service import VirtualService

DOWN = {"x": 0.45, "y": 0.0, "z": 0.5, "b": 3.14159}
TURNED = {**DOWN, "b": 180.0}
FAR = {**DOWN, "x": 450.0, "z": 500.0}
POINT, FAR_POINT = {"x": 0.4, "y": 0.1, "z": 0.5}, {"x": 400.0, "y": 100.0, "z": 500.0}
BOX = {"shape": "box", "size": [0.1, 0.1, 0.1]}
DEGREES = "b: is 180 rad, allowed: -9.5 to 9.5 rad; this looks like degrees: 180 degrees are 3.14159 rad"
MILLIMETRES = "look like millimetres; positions are in m"
VENDOR = {"pose": [0.45, 0.0, 0.5, 180.0, 0.0, 0.0], "v": 0.1, "a": 0.1}


@pytest.fixture(scope="module")
def run(service: VirtualService) -> VirtualService:
    return service


@pytest.mark.parametrize(
    ("path", "body", "place"),
    [
        ("/robot/move/pose", TURNED, ""),
        ("/robot/plan/pose", TURNED, ""),
        ("/robot/plan/pose", {**DOWN, "planner": "polyline", "through": [TURNED]}, "through[0]."),
        ("/robot/plan/path", {"poses": [DOWN, TURNED]}, "poses[1]."),
        ("/robot/plan/sequence", {"motions": [{"name": "work"}, TURNED]}, "motions[1]."),
        ("/scene", {"objects": {"part": {**BOX, **TURNED}}}, "objects.part."),
        ("/scene", {"frames": {"pallet": TURNED}}, "frames.pallet."),
        ("/robot/tool", {"tcp": {"z": 0.1, "b": 180.0}}, "tcp."),
    ],
)
def test_degrees_are_rejected_with_the_angle_in_radians(
    run: VirtualService, path: str, body: dict[str, Any], place: str
) -> None:
    answer = run.ask("POST", path, json=body)
    assert answer.status_code == 422
    assert answer.json()["detail"] == place + DEGREES


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("pose", FAR),
        ("pose", {**FAR, "planner": "lin"}),
        ("pose", {**FAR, "planner": "ompl"}),
        ("pose", {**DOWN, "y": 0.1, "planner": "circ", "via": FAR_POINT}),
        ("pose", {**DOWN, "y": 0.1, "planner": "circ", "centre": FAR_POINT}),
        ("pose", {**DOWN, "planner": "polyline", "through": [FAR]}),
        ("arc", {"centre": FAR_POINT, "axis": {"x": 0, "y": 0, "z": 1}, "angle": 0.5}),
        ("path", {"poses": [FAR]}),
        ("sequence", {"motions": [{"name": "work"}, FAR]}),
    ],
)
def test_millimetres_are_named_where_a_motion_is_refused(
    run: VirtualService, path: str, body: dict[str, Any]
) -> None:
    answer = run.ask("POST", f"/robot/plan/{path}", json={**body, "explain": False})
    assert answer.status_code == 422
    assert MILLIMETRES in answer.json()["detail"]
    assert "500" in answer.json()["detail"]


def test_a_goal_that_is_a_little_out_of_reach_is_not_called_millimetres(run: VirtualService) -> None:
    answer = run.ask("POST", "/robot/plan/pose", json={**DOWN, "x": 1.5, "explain": False})
    assert answer.status_code == 422
    assert "millimetres" not in answer.json()["detail"]


@pytest.mark.parametrize(
    ("path", "body", "words"),
    [
        (
            "/robot/plan/pose",
            {**DOWN, "x": 1450.0},
            "x: is 1450 m, allowed: -1000 to 1000 m; this looks like mill",
        ),
        (
            "/scene",
            {"objects": {"part": {**BOX, **FAR}}},
            "objects.part.x: is 450 m, allowed: -100 to 100 m",
        ),
        ("/robot/tool", {"tcp": {"z": 150.0}}, "150 mm are 0.15 m"),
        (
            "/robot/plan/arc",
            {"centre": POINT, "axis": {"x": 0, "y": 0, "z": 1}, "angle": 360.0},
            "angle: is 360 rad, allowed: -200 to 200 rad; this looks like degrees",
        ),
    ],
)
def test_a_number_beyond_its_range_names_the_unit_that_it_looks_like(
    run: VirtualService, path: str, body: dict[str, Any], words: str
) -> None:
    answer = run.ask("POST", path, json=body)
    assert answer.status_code == 422
    assert words in answer.json()["detail"]


def test_angles_of_a_turn_and_more_are_valid(run: VirtualService) -> None:
    plan = {**DOWN, "a": 6.28318, "b": 3.14159 + 6.28318, "samples": 2, "explain": False}
    assert run.ask("POST", "/robot/plan/pose", json=plan).status_code == 200


@pytest.mark.parametrize(
    ("method", "arguments", "words"),
    [
        ("MotionControl/moveLine", VENDOR, "pose: rx is 180 rad"),
        ("MotionControl/moveLine", {**VENDOR, "pose": [450.0, 0.0, 500.0, 0.0, 3.1, 0.0]}, MILLIMETRES),
        ("RobotConfig/setTcpOffset", {"offset": [0.0, 0.0, 150.0, 0.0, 0.0, 0.0]}, "offset: z is 150 m"),
    ],
)
def test_vendor_services_name_the_unit_too(
    run: VirtualService, method: str, arguments: dict[str, Any], words: str
) -> None:
    answer = run.ask("POST", f"/{run.name}/{method}", json=arguments).json()
    assert answer["code"] != 0
    assert words in answer["message"]


def test_a_calculation_takes_any_unit(run: VirtualService) -> None:
    answer = run.ask("POST", f"/{run.name}/Math/poseInverse", json={"pose": [450.0, 0, 500.0, 180.0, 0, 0]})
    assert answer.json()["code"] == 0


@pytest.mark.parametrize(
    ("path", "body", "advice"),
    [
        ("/robot/control", {"timeout_s": 60000}, "timeout_s: ...; milliseconds: 60000 ms are 60 s"),
        ("/robot/freedrive", {"timeout_s": 3000}, "timeout_s: ...; milliseconds: 3000 ms are 3 s"),
        (
            "/robot/move/pose",
            {**DOWN, "planner": "polyline", "through": [DOWN], "radius": 50},
            "radius: ...; millimetres: 50 mm are 0.05 m",
        ),
        (
            "/robot/move/sequence",
            {"motions": [{"name": "work"}, {"name": "home"}], "radii": [50]},
            "radii[0]: ...; millimetres: 50 mm are 0.05 m",
        ),
        ("/robot/force/insert", {"force": 10, "depth": 20}, "depth: ...; millimetres: 20 mm are 0.02 m"),
    ],
)
def test_milliseconds_and_millimetres_are_named_where_a_limit_is_exceeded(
    run: VirtualService, path: str, body: dict[str, Any], advice: str
) -> None:
    answer = run.ask("POST", path, json=body)
    assert answer.status_code == 422
    place, words = advice.split(" ...; ")
    (found,) = [each for each in answer.json()["detail"].split(f"{place} ")[1:] if "looks like" in each]
    assert f"; this looks like {words}" in found


def test_milliseconds_are_named_in_a_query_if_they_would_be_allowed(run: VirtualService) -> None:
    for wait_s, words in (("30000", "; this looks like milliseconds: 30000 ms are 30 s"), ("3e7", "")):
        detail = run.ask("GET", "/jobs/any", params={"wait_s": wait_s}).json()["detail"]
        assert detail.endswith(f"got '{wait_s}'{words}")
