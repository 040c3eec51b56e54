"""Primitives as calls of the service. Oracle: the REST client's methods, noted; scipy for the angles."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cobot.client import Client
from cobot.client.primitives import PRIMITIVES, primitive
from cobot.errors import InputError

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
    assert called("Home", speed=1) == ("move_named", ("home",), {"speed": 1.0})
    assert called("MoveNamed", name="away") == ("move_named", ("away",), {})
    rates = {"speed": 0.5, "accel_scale": 0.2}
    assert called("MoveJ", target=JOINTS, **rates) == ("move_joints", (JOINTS,), rates)


@pytest.mark.parametrize(("name", "planner"), [("MovePTP", "ptp"), ("MoveL", "lin"), ("MoveC", "circ")])
def test_a_pose_is_moved_to_by_its_planner_with_kukas_angles(name: str, planner: str) -> None:
    via = {"via": [0.3, 0.2, 0.5]} if name == "MoveC" else {}
    method, values, fields = called(name, target=POSE, **via)
    assert (method, values, fields["planner"]) == ("move_pose", (), planner)
    assert [fields[key] for key in "xyz"] == POSE[:3]
    np.testing.assert_allclose([fields[key] for key in "abc"], [0.3, -0.4, 0.5], atol=1e-12)
    assert fields.get("via") == ({"x": 0.3, "y": 0.2, "z": 0.5} if via else None)


@pytest.mark.parametrize(
    ("name", "params", "sentence"),
    [
        ("Fly", {}, f"there is no primitive 'Fly'; valid are: {', '.join(PRIMITIVES)}"),
        ("Home", {"target": JOINTS}, "Home: unknown parameter 'target'; valid are: speed, accel_scale"),
        ("MoveC", {"target": POSE}, "MoveC: via is missing"),
        ("MoveJ", {"target": JOINTS[:6]}, "MoveJ: target"),
        ("MoveL", {"target": [*POSE[:6], float("nan")]}, "MoveL: target"),
        ("MoveL", {"target": [*POSE[:3], 0, 0, 0, 0]}, "MoveL: the quaternion of target must not be zero"),
    ],
)
def test_what_is_wrong_is_refused_before_anything_is_asked(
    name: str, params: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(InputError) as caught:
        primitive(name, params, DOF)
    assert str(caught.value).startswith(sentence)
