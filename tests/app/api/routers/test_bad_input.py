"""What no motion and no plan can honour is refused with 422 that says what, the value and the limit.

Oracle: the table. Each is asked of the motion and of its plan; none of them moves the arm.
"""

from __future__ import annotations

import json
from typing import Any

import pytest
from planner_sentences import only
from virtual_service import VirtualService

NAN = float("nan")
JOINTS = [0.3, 0.2, 0.0, -1.5, 0.0, 1.5, 0.0]
POSE = {"x": 0.45, "y": 0.1, "z": 0.5, "b": 3.14159}
VIA = {"x": 0.4, "y": 0.0, "z": 0.5}
ARC = {"centre": VIA, "axis": {"x": 0.0, "y": 0.0, "z": 1.0}, "angle": 0.5}
LINES = POSE | {"planner": "polyline", "through": [POSE]}


def held(**constraints: Any) -> dict[str, Any]:
    return {"joints": JOINTS, "planner": "ompl", "constraints": constraints}


BAD: list[tuple[str, dict[str, Any], list[str]]] = [
    ("joints", {"joints": JOINTS, "speed": 0.0}, ["speed", "greater than or equal to 0.01", "got 0.0"]),
    ("joints", {"joints": JOINTS, "speed": -0.5}, ["speed", "greater than or equal to 0.01", "got -0.5"]),
    ("joints", {"joints": JOINTS, "speed": 1.01}, ["speed", "less than or equal to 1", "got 1.01"]),
    ("joints", {"joints": JOINTS, "speed": NAN}, ["speed", "got NaN"]),
    (
        "joints",
        {"joints": JOINTS, "accel_scale": -0.1},
        ["accel_scale", "greater than or equal to 0", "-0.1"],
    ),
    ("joints", {"joints": [NAN, *JOINTS[1:]]}, ["joints[0]", "finite number", "got NaN"]),
    ("joints", {"joints": JOINTS[:6]}, ["joints must have 7 angles, got 6"]),
    ("joints", {"joints": [9.0, *JOINTS[1:]]}, ["joint1 is 9 rad, allowed: -2.97 to 2.97 rad"]),
    ("joints", {"joints": JOINTS, "planner": "lin"}, ["planner", "'ptp'", "got 'lin'"]),
    ("joints", {"joints": JOINTS, "planner": "ompl", "algorithm": "A*"}, ["algorithm", "RRTConnect", "'A*'"]),
    (
        "joints",
        {"joints": JOINTS, "algorithm": "RRTstar"},
        ["algorithm: RRTstar is for planner ompl", "not for ptp"],
    ),
    (
        "joints",
        {"joints": JOINTS, "planner": "chomp", "algorithm": "PRM"},
        ["algorithm: PRM", "not for chomp"],
    ),
    ("named", {"name": "nowhere"}, ["'nowhere'", "valid names: home"]),
    ("pose", POSE | {"x": NAN}, ["x", "finite number", "got NaN"]),
    ("pose", POSE | {"a": float("inf")}, ["a", "finite number", "got Infinity"]),
    ("pose", POSE | {"planner": "auto", "via": VIA}, [f"via: {only('via', 'auto')}"]),
    ("pose", POSE | {"planner": "lin", "via": VIA}, [f"via: {only('via', 'lin')}"]),
    ("pose", POSE | {"planner": "circ"}, ["via: is missing", "circ"]),
    ("pose", POSE | {"planner": "circ", "via": VIA | {"x": NAN}}, ["via.x", "finite number", "got NaN"]),
    ("pose", POSE | {"planner": "lin", "radius": 0.1}, [f"radius: {only('radius_m', 'lin')}"]),
    ("pose", LINES | {"radius": -0.1}, ["radius", "greater than or equal to 0", "got -0.1"]),
    ("pose", LINES | {"radius": NAN}, ["radius", "got NaN"]),
    ("pose", LINES | {"through": []}, ["through: is empty", "polyline", "lin"]),
    ("pose", LINES | {"through": [POSE | {"z": NAN}]}, ["through[0].z", "finite number", "got NaN"]),
    ("pose", POSE | {"y": -4.5e183}, ["y: is -4.5e+183 m, allowed: -1000 to 1000 m"]),
    (
        "pose",
        POSE | {"frame_id": "pallet"},
        ["frame_id: there is no frame 'pallet'", "valid names: base_link"],
    ),
    ("pose", POSE | {"frame_id": "link3"}, ["frame_id: 'link3' moves with the joints", "valid names:"]),
    ("pose", POSE | {"planner": "lin", "speed_m_s": 0.0}, ["speed_m_s: is 0 m/s", "up to 1 m/s"]),
    ("pose", POSE | {"planner": "lin", "speed_rad_s": -1.0}, ["speed_rad_s: is -1 rad/s", "up to 2 rad/s"]),
    ("pose", POSE | {"speed_m_s": 0.1}, [f"speed_m_s: {only('tcp_speed', 'ptp')}"]),
    ("pose", POSE | {"quaternion": [0.0] * 4}, ["unknown key 'quaternion'", "valid keys: x, y, z"]),
    (
        "joints",
        held(box={"min": {"x": 1.0, "y": 0, "z": 0}, "max": {"x": 0.5, "y": 1, "z": 1}}),
        ["min.x is 1 m"],
    ),
    ("joints", held(orientation={"within_rad": -0.1}), ["constraints.orientation.within_rad", "got -0.1"]),
    (
        "joints",
        held(orientation={"within_rad": 4.0}),
        ["within_rad", "less than or equal to 3.14", "got 4.0"],
    ),
    (
        "joints",
        held(orientation={"within_rad": 0.1, "direction": {"x": 0.0, "y": 0.0, "z": 0.0}}),
        ["constraints.orientation.direction: has a length of 0, so it has no direction"],
    ),
    ("joints", held(joints={"joint1": [1.0, -1.0]}), ["is 1 to -1 rad; the smaller angle must come first"]),
    ("joints", held(joints={"joint9": [-1.0, 1.0]}), ["there is no such joint; valid names: joint1"]),
    ("sequence", {"motions": []}, ["motions", "at least 1 item"]),
    ("sequence", {"motions": [{"joints": JOINTS}, {"name": "home"}], "radii": [-0.1]}, ["radii[0]", "-0.1"]),
    (
        "sequence",
        {"motions": [{"joints": JOINTS}, {"name": "home"}], "radii": [NAN]},
        ["radii[0]", "got NaN"],
    ),
    ("arc", ARC | {"angle": 0.0}, ["angle: is 0 rad", "rise"]),
    ("arc", ARC | {"angle": NAN}, ["angle", "got NaN"]),
    ("arc", ARC | {"angle": 300.0}, ["angle: is 300 rad, allowed: -200 to 200 rad", "looks like degrees"]),
    (
        "arc",
        ARC | {"axis": {"x": 0.0, "y": 0.0, "z": 0.0}},
        ["axis: has a length of 0, so it has no direction"],
    ),
    ("arc", ARC | {"constraints": {"joints": {"joint9": [0, 1]}}}, ["there is no such joint"]),
    ("sequence", {"motions": [ARC | {"rise": NAN}]}, ["motions[0].rise", "got NaN"]),
    ("sequence", {"motions": ["home"]}, ["motions[0]", "got 'home'"]),
    ("sequence", {"motions": [{"named": "home"}]}, ["'named' (did you mean 'name'?)"]),
]
"""The endpoint after /robot/move/ and /robot/plan/, a body, and what the detail says."""
PLANS = [
    ("path", {"poses": []}, ["poses", "at least 1 item"]),
    ("path", {"poses": [POSE], "radius": -0.1}, ["radius", "greater than or equal to 0", "got -0.1"]),
    ("path", {"poses": [POSE | {"x": NAN}]}, ["poses[0].x", "finite number", "got NaN"]),
    ("path", {"poses": [POSE], "frame_id": "link3"}, ["frame_id: 'link3' moves with the joints"]),
    ("joints", {"joints": JOINTS, "start": [NAN, *JOINTS[1:]]}, ["start[0]", "got NaN"]),
    ("joints", {"joints": JOINTS, "samples": 1001}, ["samples", "less than or equal to 1000", "got 1001"]),
    ("joints", {"joints": JOINTS, "explain": "yes"}, ["explain", "got 'yes'"]),
]
ALL = [(f"/robot/move/{what}", body, said) for what, body, said in BAD]
ALL += [(f"/robot/plan/{what}", body, said) for what, body, said in BAD + PLANS]
POINTS = [{"positions": JOINTS, "time_from_start": 3.0}]
ALL += [("/trajectory/send", {"points": POINTS, "smoothing_rad": NAN}, ["smoothing_rad", "got NaN"])]


@pytest.mark.parametrize(("path", "body", "said"), ALL, ids=[f"{each[0]}-{each[2][0]}" for each in ALL])
def test_it_says_what_is_wrong_and_what_is_possible(
    service: VirtualService, path: str, body: dict[str, Any], said: list[str]
) -> None:
    before = service.joints()
    # httpx would not write NaN, which Python's json takes.
    answer = service.ask("POST", path, content=json.dumps(body), headers={"Content-Type": "application/json"})
    assert answer.status_code == 422, answer.text
    detail = answer.json()["detail"]
    assert [words for words in said if words not in detail] == [], detail
    assert service.joints() == pytest.approx(before, abs=1e-4)


@pytest.mark.parametrize("name", ["run\x1b[2J", "run\n1", "run\x7f", "run\x00"])
def test_no_folder_has_a_name_that_acts_on_a_terminal(service: VirtualService, name: str) -> None:
    answer = service.ask(
        "POST", "/sequences/start", files={"config": ("s.json", b"{}")}, data={"bag_path": name}
    )
    assert answer.status_code == 422, answer.text
    assert "bag_path: string should match pattern" in answer.json()["detail"]
    assert not (service.config.parent / "recordings" / name.replace("\x00", "")).exists()
