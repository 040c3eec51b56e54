"""Targets of every kind, as the runner asks for them, at the whole service on virtual time.

Oracle: where GET /robot/pose says the TCP is, and the numbers in the file.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from virtual_service import URL, VirtualService

from cobot.errors import CobotError
from cobot.runner.moving import go
from cobot.runner.schema import read_sequence, sequence_of

EXAMPLE = Path(__file__).parents[3] / "examples" / "paths.json"
HELIX = {"centre": {"x": 0.4, "y": 0.1, "z": 0.5}, "axis": {"x": 0, "y": 0, "z": 1}, "angle": 1.0}


def tcp(service: VirtualService) -> np.ndarray:
    position = service.get("/robot/pose").json()["position"]
    return np.array([position[axis] for axis in "xyz"])


def test_every_planner_of_the_api_moves_the_arm_in_a_sequence(service: VirtualService) -> None:
    service.go_home()
    client, places, notes = service.client(URL), [], []
    chains = read_sequence(EXAMPLE).groups()
    for chain in chains:
        answer = go(client, [target for _, target in chain])
        places.append(tcp(service))
        notes.append(answer["note"])
    assert [number for chain in chains for number, _ in chain] == [0, 1, 2, 3, 4, 5]
    assert len(chains) == 5  # the helix goes over into the half circle
    corner, top = np.array([0.4, -0.1, 0.4]), np.array([0.55, 0.1, 0.45])
    expected = np.array([corner, corner, top, top + np.array([0.0, 0.0, 0.05])])
    np.testing.assert_allclose(places[1:], expected, atol=2e-3)
    assert notes[0] == ""  # it is there already
    assert notes[1].startswith("auto used ptp")


@pytest.mark.parametrize(
    ("target", "said"),
    [
        ({**HELIX, "speed_m_s": 9.0}, "speed_m_s: is 9 m/s, allowed: above 0 and up to 1 m/s"),
        ({**HELIX, "frame_id": "moon"}, "frame_id: there is no frame 'moon'"),
        ({**HELIX, "constraints": {"joints": {"joint9": [0, 1]}}}, "joint9: there is no such joint"),
        ({"named": "work", "algorithm": "PRM"}, "algorithm: PRM is for planner ompl and auto only"),
        ({"x": 0.5, "y": 0, "z": 0.5, "planner": "polyline"}, "through: is empty"),
    ],
)
def test_what_only_the_robot_knows_is_refused_by_the_service(
    service: VirtualService, target: dict[str, object], said: str
) -> None:
    (chain,) = sequence_of({"waypoints": [target]}).groups()
    with pytest.raises(CobotError, match=said):
        go(service.client(URL), [each for _, each in chain])
