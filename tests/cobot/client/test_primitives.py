"""Primitives as calls of the service. Oracle: the REST client's methods, noted; scipy for the angles."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.client import Client
from cobot.client.primitives import PARAMETERS, PRIMITIVES, primitive
from cobot.errors import InputError
from cobot.motions.bodies import MoveArc, MoveJoints, MoveNamed, MovePose
from cobot.motions.signal_bodies import SignalFields

DOF = 7
TURN = Rotation.from_euler("ZYX", [0.3, -0.4, 0.5])
POSE = [0.4, 0.1, 0.6, *TURN.as_quat(scalar_first=True).tolist()]
JOINTS = [0.1 * n for n in range(DOF)]


class Noted:
    """In the client's place: remembers the one call."""

    def __init__(self) -> None:
        self.calls: list[tuple[str, tuple[Any, ...], dict[str, Any]]] = []

    def __getattr__(self, name: str) -> Any:
        def call(*values: Any, **fields: Any) -> dict[str, Any]:
            self.calls.append((name, values, fields))
            return {}

        return call


def called(name: str, /, **params: Any) -> tuple[str, tuple[Any, ...], dict[str, Any]]:
    noted = Noted()
    primitive(name, params, DOF)(cast(Client, noted))
    (call,) = noted.calls
    return call


def test_joints_and_named_positions_are_moved_to() -> None:
    assert called("Home", speed=1) == ("move_named", (), {"name": "home", "speed": 1.0})
    assert called("MoveNamed", name="away") == ("move_named", (), {"name": "away"})
    rates = {"speed": 0.5, "accel_scale": 0.2, "planner": "auto"}
    assert called("MoveJ", target=JOINTS, **rates) == ("move_joints", (), {"joints": JOINTS, **rates})


@pytest.mark.parametrize(("name", "planner"), [("MovePTP", "ptp"), ("MoveL", "lin"), ("MoveC", "circ")])
def test_a_pose_is_moved_to_by_its_planner_with_kukas_angles(name: str, planner: str) -> None:
    via = {"via": [0.3, 0.2, 0.5]} if name == "MoveC" else {}
    method, values, fields = called(name, target=POSE, **via)
    assert (method, values, fields["planner"]) == ("move_pose", (), planner)
    assert [fields[key] for key in "xyz"] == POSE[:3]
    np.testing.assert_allclose([fields[key] for key in "abc"], [0.3, -0.4, 0.5], atol=1e-12)
    assert fields.get("via") == ({"x": 0.3, "y": 0.2, "z": 0.5} if via else None)


def test_paths_take_points_and_poses_as_lists_and_all_else_as_the_service_does() -> None:
    x, y, z = POSE[:3]
    _, _, fields = called("MovePolyline", target=POSE, through=[POSE, POSE], radius=0.02, speed_m_s=0.1)
    assert (fields["planner"], fields["radius"], fields["speed_m_s"]) == ("polyline", 0.02, 0.1)
    for pose in fields["through"]:
        assert [pose[key] for key in "xyz"] == [x, y, z]
        np.testing.assert_allclose([pose[key] for key in "abc"], [0.3, -0.4, 0.5], atol=1e-12)
    method, _, fields = called("MoveArc", centre=POSE[:3], axis=[0, 0, 1], angle=6.28, rise=0.1)
    assert method == "move_arc"
    expected = {
        "centre": {"x": x, "y": y, "z": z},
        "axis": {"x": 0, "y": 0, "z": 1},
        "angle": 6.28,
        "rise": 0.1,
    }
    assert fields == expected
    assert called("MoveC", target=POSE, centre=POSE[:3])[2]["centre"] == {"x": x, "y": y, "z": z}
    held = {"orientation": {"within_rad": 0.1}}
    assert called("MoveFree", target=POSE, constraints=held)[2]["planner"] == "auto"
    assert called("MoveFree", target=POSE, planner="chomp", frame_id="world")[2]["planner"] == "chomp"


@pytest.mark.parametrize(
    ("name", "params", "sentence"),
    [
        ("Fly", {}, f"there is no primitive 'Fly'; valid names: {', '.join(PRIMITIVES)}"),
        ("Home", {"name": "away"}, "Home: name is 'home' and cannot be changed"),
        ("MoveL", {"target": POSE, "planner": "ptp"}, "MoveL: planner is 'lin' and cannot be changed"),
        (
            "Home",
            {"wait": False},
            "Home: there is no parameter 'wait'; valid names: speed, accel_scale, planner",
        ),
        (
            "MoveL",
            {"target": POSE, "velocity": 1},
            "MoveL: there is no parameter 'velocity'; valid names: target",
        ),
        (
            "MoveArc",
            {"axis": [0, 0, 1], "centre": [0, 0, 1], "angle": 1, "z": 0},
            "MoveArc: there is no parameter",
        ),
        ("MovePolyline", {"target": POSE}, "MovePolyline: through is missing"),
        ("MovePolyline", {"target": POSE, "through": 3}, "MovePolyline: through must be a list of poses"),
        ("MovePolyline", {"target": POSE, "through": [POSE, [1]]}, "MovePolyline: through[1] must have 7"),
        ("MoveArc", {"axis": [0, 0, 1], "angle": 1.0}, "MoveArc: centre is missing"),
        ("MoveJ", {"target": JOINTS[:6]}, "MoveJ: target"),
        ("MoveL", {"target": [*POSE[:6], float("nan")]}, "MoveL: target"),
        ("MoveL", {"target": [*POSE[:3], 0, 0, 0, 0]}, "MoveL: target: the quaternion must not be zero"),
    ],
)
def test_what_is_wrong_is_refused_before_anything_is_asked(
    name: str, params: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError) as caught:
        primitive(name, params, DOF)
    assert str(caught.value).startswith(sentence)


def test_the_parameters_are_the_fields_that_the_service_takes() -> None:
    """Oracle: the bodies of the REST API. Actions and conditions are no parameters of primitives."""
    signals = set(SignalFields.model_fields)
    target = {"x", "y", "z", "a", "b", "c"}
    for method, body in (("move_named", MoveNamed), ("move_joints", MoveJoints), ("move_arc", MoveArc)):
        assert set(PARAMETERS[method]) - {"target"} == set(body.model_fields) - {"joints"} - signals, method
    assert set(PARAMETERS["move_pose"]) - {"target"} == set(MovePose.model_fields) - target - signals
