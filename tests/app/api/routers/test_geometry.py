"""What GET /robot/geometry and GET /robot/clearance say.

Oracles: MuJoCo's own kinematics, at joint angles drawn at random; coal's distances; a capsule by hand.
"""

from __future__ import annotations

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import coal
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from virtual_service import VirtualService

from app.api.routers.geometry import rendered
from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.bodies import geometry_of
from cobot.robot.model import RobotModel
from cobot.shipped import FOLDER
from cobot.types import Array, JointLimits

ODD = """<mujoco><default><geom contype="1" conaffinity="1"/></default>
<asset><mesh name="wedge" vertex="0 0 0  0.1 0 0  0 0.2 0  0 0 0.3"/>
<material name="red" rgba="1 0 0 1"/></asset>
<worldbody><body name="base_link" pos="1 2 3" euler="10 20 30"><geom type="ellipsoid" size="0.1 0.2 0.3"/>
<body name="cart" pos="0 0 0.5"><joint name="rail" type="slide" axis="1 1 0" ref="0.25"/>
<geom type="box" size="0.1 0.1 0.05" material="red"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="arm" pos="0 0.1 0.2" euler="0 30 0">
<joint name="turn" axis="0 1 1" pos="0.1 0.02 0" ref="0.3"/><joint name="roll" axis="1 0 0"/>
<geom type="mesh" mesh="wedge" pos="0.1 0 0" euler="40 0 0"/><site name="tcp" pos="0 0 0.4" euler="0 0 50"/>
</body></body></body></worldbody></mujoco>"""
"""Slides, references, anchors, two joints of a body, a mesh, a base that is turned."""
TABLE = {"shape": "box", "size": [0.3, 0.4, 0.02], "x": 0.5, "y": -0.6, "z": 0.2, "a": 0.3}
HELD = {"shape": "cylinder", "radius": 0.02, "length": 0.1, "x": 0.4, "y": 0.0, "z": 0.55}
TOOL = {
    "name": "gripper",
    "mass": 0.5,
    "tcp": {"z": 0.15, "a": 0.4},
    "shapes": {"finger": {"shape": "box", "size": [0.02, 0.03, 0.1], "x": 0.0, "y": 0.0, "z": 0.06}},
}


def frames(found: dict[str, Any], joints: Array) -> list[tuple[Array, Rotation]]:
    """Where each body is, as the page computes it (app/panel/site/kinematics.js)."""
    placed: list[tuple[Array, Rotation]] = []
    for index, body in enumerate(found["bodies"]):
        place, turn = np.zeros(3), Rotation.identity()
        if index:
            place, turn = placed[body["parent"]]
        place = place + turn.apply(body["position"])
        turn = turn * Rotation.from_quat(body["quaternion"])
        for joint in body["joints"]:
            value, axis = joints[joint["index"]] - joint["reference"], np.array(joint["axis"])
            if joint["slides"]:
                place = place + turn.apply(axis * value)
                continue
            anchor = place + turn.apply(joint["anchor"])
            turn = turn * Rotation.from_rotvec(axis * value)
            place = anchor - turn.apply(joint["anchor"])
        placed.append((place, turn))
    return placed


def compare(found: dict[str, Any], mj: mujoco.MjModel, limits: JointLimits) -> None:
    """All shapes are where MuJoCo has them."""
    data, random = mujoco.MjData(mj), np.random.default_rng(14)
    for _ in range(20):
        joints = random.uniform(limits.min_position, limits.max_position)
        data.qpos[:] = joints
        mujoco.mj_kinematics(mj, data)
        geom = 0
        for (place, turn), body in zip(frames(found, joints), found["bodies"], strict=True):
            for shape in body["shapes"]:
                np.testing.assert_allclose(
                    place + turn.apply(shape["position"]), data.geom_xpos[geom], atol=1e-9
                )
                matrix = (turn * Rotation.from_quat(shape["quaternion"])).as_matrix()
                np.testing.assert_allclose(matrix.ravel(), data.geom_xmat[geom], atol=1e-9)
                geom += 1
        assert geom == mj.ngeom


def shows_the_tcp(service: VirtualService, found: dict[str, Any]) -> None:
    """Where GET /robot/pose has it."""
    place, turn = frames(found, np.array(service.joints()))[found["tcp"]["body"]]
    pose = service.get("/robot/pose").json()
    expected = [pose["position"][axis] for axis in "xyz"]
    np.testing.assert_allclose(place + turn.apply(found["tcp"]["position"]), expected, atol=1e-4)
    quaternion = Rotation.from_quat([pose["orientation"]["quaternion"][axis] for axis in "xyzw"])
    turned = turn * Rotation.from_quat(found["tcp"]["quaternion"])
    assert (turned.inv() * quaternion).magnitude() < 1e-3


def test_every_shape_is_where_mujoco_has_it_with_tool_and_scene(
    service: VirtualService, robot: RobotDescription
) -> None:
    plain = service.get("/robot/geometry").json()
    compare(plain, robot.model.mj, robot.limits)
    assert {body["part"] for body in plain["bodies"]} == {"robot"}
    service.post("/robot/tool", TOOL).raise_for_status()
    service.post("/scene", {"objects": {"table": TABLE, "held": HELD}}).raise_for_status()
    service.post("/scene", {"attach": {"held": ["finger", "link7"]}}).raise_for_status()
    found = service.get("/robot/geometry").json()
    parts = {body["name"]: body["part"] for body in found["bodies"] if body["part"] != "robot"}
    assert parts == {"finger": "tool", "table": "scene", "held": "scene"}
    shapes = {body["name"]: body["shapes"] for body in found["bodies"]}
    assert shapes["table"][0]["size"] == pytest.approx(TABLE["size"])
    assert shapes["held"][0]["size"] == pytest.approx([0.02, 0.1])
    shows_the_tcp(service, found)
    assert found["bodies"][found["base"]]["name"] == "base_link"


def solid(shape: dict[str, Any]) -> Any:
    size = shape["size"]
    match shape["shape"]:
        case "box":
            return coal.Box(*size)
        case "capsule":
            return coal.Capsule(*size)
        case "cylinder":
            return coal.Cylinder(*size)
    return None


def placed_solids(found: dict[str, Any], joints: Array) -> list[tuple[dict[str, Any], Any, Any]]:
    """Of each solid its body, its shape and its place, in the base frame, where this arm has the world."""
    return [
        (
            body,
            made,
            coal.Transform3s(
                (turn * Rotation.from_quat(shape["quaternion"])).as_matrix(),
                place + turn.apply(shape["position"]),
            ),
        )
        for (place, turn), body in zip(frames(found, joints), found["bodies"], strict=True)
        for shape in body["shapes"]
        if shape["collides"] and (made := solid(shape)) is not None
    ]


def test_the_clearance_has_the_nearest_points_of_both_parts(service: VirtualService) -> None:
    service.post("/scene", {"clear": True}).raise_for_status()
    service.post("/robot/tool", {"clear": True}).raise_for_status()
    tilted = {**TABLE, "x": 0.45, "y": -0.35, "z": 0.4, "b": 0.2, "c": 0.5}
    service.post("/scene", {"objects": {"table": tilted}}).raise_for_status()
    move = {"joints": [-0.4, 0.7, 0.2, -1.2, 0.3, 0.9, 0.1], "speed": 1.0}
    assert service.post("/robot/move/joints", move).json()["success"]
    nearest = service.get("/robot/clearance").json()["closest_environment"]
    solids = placed_solids(service.get("/robot/geometry").json(), np.array(service.joints()))
    ((_, table, there),) = [each for each in solids if each[0]["name"] == "table"]
    found = []
    for body, link, here in (each for each in solids if each[0]["part"] == "robot"):
        result = coal.DistanceResult()
        distance = coal.distance(link, here, table, there, coal.DistanceRequest(), result)
        found.append((distance, body["name"], result.getNearestPoint1(), result.getNearestPoint2()))
    distance, name, *points = min(found, key=lambda each: each[0])
    assert 0.01 < distance < 0.28, "nearer than the floor"
    assert sorted(nearest["between"]) == sorted([name, "table"])
    assert nearest["distance_m"] == pytest.approx(distance, abs=1e-4)
    if nearest["between"][0] == "table":
        points.reverse()
    np.testing.assert_allclose(nearest["points"], points, atol=1e-3)


def test_a_distance_that_no_joint_changes_does_not_hide_the_others(service: VirtualService) -> None:
    """The first link turns 98 mm over the floor; the second is a capsule of 80 mm with its axis at 360 mm."""
    service.post("/scene", {"clear": True}).raise_for_status()
    service.post("/robot/tool", {"clear": True}).raise_for_status()
    assert service.post("/robot/move/named", {"name": "home", "speed": 1.0}).json()["success"]
    found = service.get("/robot/clearance").json()
    assert found["closest_environment"]["between"] == ["floor", "link2"]
    assert found["closest_environment"]["distance_m"] == pytest.approx(0.36 - 0.08, abs=1e-3)
    assert found["closest_self"]["distance_m"] < 0.1


@pytest.mark.parametrize("tool", [TOOL, {"tcp": TOOL["tcp"]}, {"tcp": {"x": 0.1, "c": 1.0}, "mass": 1.0}])
def test_the_tcp_is_that_of_the_tool(service: VirtualService, tool: dict[str, Any]) -> None:
    """Also where neither shapes nor objects need a model of their own for the collision checks."""
    service.post("/scene", {"clear": True}).raise_for_status()
    service.post("/robot/tool", {"clear": True, **tool}).raise_for_status()
    shows_the_tcp(service, service.get("/robot/geometry").json())


def test_what_has_not_changed_is_not_sent_again(service: VirtualService) -> None:
    first = service.get("/robot/geometry")
    again = {"headers": {"If-None-Match": first.headers["ETag"]}}
    assert service.ask("GET", "/robot/geometry", **again).status_code == 304
    service.post("/scene", {"objects": {"post": {**TABLE, "y": 0.7}}}).raise_for_status()
    changed = service.ask("GET", "/robot/geometry", **again)
    assert changed.status_code == 200
    assert changed.headers["ETag"] != first.headers["ETag"]
    names = [body["name"] for body in changed.json()["bodies"]]
    assert "post" in names


def test_the_joints_have_their_limits(service: VirtualService, robot: RobotDescription) -> None:
    joints = service.get("/robot/geometry").json()["joints"]
    assert [joint["name"] for joint in joints] == list(robot.limits.names)
    for name in ("min_position", "max_position", "max_velocity", "max_effort"):
        assert [joint[name] for joint in joints] == getattr(robot.limits, name).tolist()
    assert not any(joint["slides"] for joint in joints)


def test_an_odd_arm_is_drawn_as_mujoco_has_it(tmp_path: Path) -> None:
    (tmp_path / "odd.xml").write_text(ODD, encoding="utf-8")
    ones = np.ones(3)
    limits = JointLimits(("rail", "turn", "roll"), -ones, ones, ones, ones, ones, ones)
    model = RobotModel.load(tmp_path / "odd.xml", limits)
    robot: Any = SimpleNamespace(
        model=model, limits=model.limits, collision=CollisionChecker(model), base_frame="base_link"
    )
    found = json.loads(rendered(geometry_of(robot), model.limits))
    compare(found, model.mj, limits)
    assert [joint["slides"] for joint in found["joints"]] == [True, False, False]
    shapes = [shape for body in found["bodies"] for shape in body["shapes"]]
    assert [shape["shape"] for shape in shapes] == ["ellipsoid", "box", "mesh"]
    assert shapes[0]["size"] == [0.1, 0.2, 0.3]
    assert shapes[1]["rgba"] == [1.0, 0.0, 0.0, 1.0]
    (mesh,) = found["meshes"]
    vertices = np.array(mesh["vertices"]).reshape(-1, 3)
    edges = np.linalg.norm(vertices[:, None] - vertices[None], axis=2)
    assert edges.max() == pytest.approx(np.hypot(0.2, 0.3), abs=1e-5), "the longest edge of the wedge"
    assert sorted(set(mesh["triangles"])) == list(range(len(vertices)))


def test_visuals_and_their_meshes_have_tags(service: VirtualService) -> None:
    """Oracle of the meshes: the files that ship with cobot."""
    found = service.get("/robot/visuals")
    looks = found.json()["visuals"]
    assert [each["link"] for each in looks] == ["base_link", *(f"link{number}" for number in range(1, 8))]
    again = {"headers": {"If-None-Match": found.headers["ETag"]}}
    assert service.ask("GET", "/robot/visuals", **again).status_code == 304
    for look in looks:
        mesh = service.get(f"/robot/visuals/{look['mesh']}")
        assert mesh.headers["content-type"] == "model/gltf-binary"
        file = FOLDER / "config" / "visuals" / "iiwa14" / f"{look['link']}.glb"
        assert mesh.content == file.read_bytes()
    missing = service.get(f"/robot/visuals/{len(looks)}")
    assert missing.status_code == 404
    assert "there is no mesh 8; the robot has 8" in missing.json()["detail"]
