"""Motions through round corners, over HTTP and from a sequence file, on virtual time.

Oracles: the motions one by one, and where /robot/joint_states says the arm is.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.spatial import cKDTree
from virtual_service import VirtualService

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
CORNER = [0.6, 0.2, 0.0, -1.5, 0.0, 1.5, 0.0]
END = [0.6, 0.6, 0.0, -1.2, 0.0, 1.5, 0.0]
GO = {"speed": 1.0}
MOTIONS = [{"joints": CORNER, **GO}, {"joints": END, **GO}]


def post(service: VirtualService, body: Any) -> Any:
    return service.post("/robot/move/sequence", json=body)


def done(service: VirtualService, body: Any) -> Any:
    answer = post(service, body).json()
    assert answer["success"], answer
    return answer


def test_with_radii_it_goes_through_and_is_sooner_there(service: VirtualService) -> None:
    durations, slowest = [], []
    for radii in ([], [0.1]):
        done(service, {"motions": [{"name": "home", **GO}]})
        begun = len(service.rig.commanded)
        durations.append(done(service, {"motions": MOTIONS, "radii": radii})["duration_s"])
        np.testing.assert_allclose(service.joints(), END, atol=5e-3)
        slowest.append(speed_in_the_corner(np.array(service.rig.commanded[begun:])))
    assert durations[1] < durations[0] - 0.15
    assert slowest[0] < 1e-3
    assert slowest[1] > 0.2


def test_in_a_round_corner_a_slow_or_paused_motion_is_where_the_fast_one_was(service: VirtualService) -> None:
    body = {"motions": MOTIONS, "radii": [0.1]}
    done(service, {"motions": [{"name": "home", **GO}]})
    begun = len(service.rig.commanded)
    done(service, body)
    fast = np.array(service.rig.commanded[begun:])
    done(service, {"motions": [{"name": "home", **GO}]})
    begun = len(service.rig.commanded)
    moving = service.begin(service.asking("POST", "/robot/move/sequence", json=body))
    near = 0.15

    def override(fraction: float) -> None:
        service.post("/robot/speed_override", json={"fraction": fraction}).raise_for_status()

    try:
        service.until(lambda: np.linalg.norm(service.rig.commanded[-1] - np.array(CORNER)) < 4.0 * near)
        override(0.33)
        service.until(lambda: np.linalg.norm(service.rig.commanded[-1] - np.array(CORNER)) < near)
        override(0.0)
        service.sleep(0.5)
        assert np.array_equal(*service.rig.commanded[-2:]), "it stands in the corner"
        override(0.33)
        assert service.end(moving).json()["success"]
    finally:
        override(1.0)
    slow = np.array(service.rig.commanded[begun:])
    assert len(slow) > len(fast) + 500
    assert off_the_way(slow, fast).max() < 1e-5
    assert (np.linalg.norm(slow - np.array(CORNER), axis=1) < near).sum() > 500


def off_the_way(rows: np.ndarray, way: np.ndarray) -> np.ndarray:
    """How far each row is from the polyline through others, rad."""
    _, nearest = cKDTree(way).query(rows)
    found = np.full(len(rows), np.inf)
    for shift in (-1, 0):
        begin = np.clip(nearest + shift, 0, len(way) - 2)
        chord = way[begin + 1] - way[begin]
        share = ((rows - way[begin]) * chord).sum(axis=1) / np.maximum((chord**2).sum(axis=1), 1e-30)
        foot = way[begin] + np.clip(share, 0.0, 1.0)[:, None] * chord
        found = np.minimum(found, np.linalg.norm(rows - foot, axis=1))
    return found


def speed_in_the_corner(rows: np.ndarray) -> float:
    """The least of the fastest joint within 0.05 s of the corner, by what each cycle commanded, rad/s."""
    speeds = np.abs(np.diff(rows, axis=0)).max(axis=1) / 1e-3
    corner = int(np.linalg.norm(rows - np.array(CORNER), axis=1).argmin())
    return float(speeds[corner - 50 : corner + 50].min())


def test_all_kinds_of_motions_go_over_into_each_other(service: VirtualService) -> None:
    done(service, {"motions": [{"name": "home", **GO}]})
    down = {"x": 0.0, "y": 0.0, "z": 0.1, "planner": "lin", "frame_id": "tool", **GO}
    motions = [{"name": "work", **GO}, down, {"joints": END, **GO}, {"joints": END, **GO}]
    done(service, {"motions": motions, "radii": [0.03, 0.03, 0.03]})
    np.testing.assert_allclose(service.joints(), END, atol=5e-3)


def test_corners_are_round_beside_constraints_too(service: VirtualService) -> None:
    held = {"constraints": {"joints": {"joint3": [-1, 1]}}}
    done(service, {"motions": [{**each, **held} for each in MOTIONS], "radii": [0.1]})


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (
            {"motions": MOTIONS, "radii": [-0.1]},
            "radii[0]: must be greater than or equal to 0, got -0.1",
        ),
        (
            {"motions": MOTIONS, "radii": [0.1, 0.1]},
            "radii: 2 motions need 1, one for each motion except the last; got 2",
        ),
        ({"motions": [{"joints": HOME, "sped": 1}]}, "motions[0]: unknown key 'sped'"),
    ],
)
def test_what_makes_no_sense_is_refused(service: VirtualService, body: Any, message: str) -> None:
    answer = post(service, body)
    assert answer.status_code == 422
    assert message in answer.json()["detail"]


def test_a_motion_that_is_not_possible_is_named_and_nothing_moves(service: VirtualService) -> None:
    before = service.joints()
    far = {"x": 9.0, "y": 0.0, "z": 0.5, "planner": "lin"}
    answer = post(service, {"motions": [MOTIONS[0], far], "radii": [0.1]}).json()
    assert not answer["success"]
    assert answer["message"].startswith("motion 2: ")
    np.testing.assert_allclose(service.joints(), before, atol=1e-4)
