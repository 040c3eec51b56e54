"""The scene as a client sees it: kept, in force at once, and stopping what it has made wrong."""

import asyncio
import base64
import contextlib

import numpy as np
import pytest
from virtual_service import VirtualService

from cobot.errors import ExecutionError, UnavailableError
from cobot.robot.scene import Scene, SceneFile, SceneObject
from cobot.types import LoopMode

WALL = {"shape": "box", "size": [0.02, 2.0, 2.0], "x": 0.0, "y": 0.0, "z": 0.0}
AHEAD = {"shape": "sphere", "radius": 0.15, "x": 0.5, "y": 0.0, "z": 0.9}


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    with VirtualService(tmp_path_factory.mktemp("scene")).serving() as made:
        yield made


@pytest.fixture(autouse=True)
def empty(robot):
    change(robot, clear=True)
    robot.go_home()


def change(robot, **changes):
    return robot.post("/scene", changes)


def put(robot, name, body):
    return change(robot, objects={name: body})


def file_of(robot):
    return SceneFile(robot.config.parent / "logs" / f"{robot.name}.scene.json")


def in_the_way(robot):
    """A ball where the hand will be after half of the way to joint 1 at 1 rad."""
    joints = robot.joints()
    joints[0] = 0.5
    x, y, z = robot.app.state.services.robot.model.forward(np.array(joints)).position.tolist()
    return {"shape": "sphere", "radius": 0.05, "x": x, "y": y, "z": z}


def there(robot, angle=1.0):
    return {"joints": [angle, *robot.joints()[1:]], "speed": 0.3}


def test_an_object_is_kept_and_the_version_rises(robot):
    before = robot.get("/scene").json()["version"]
    answer = put(robot, "ball", AHEAD | {"x": -0.8})
    assert answer.status_code == 200
    assert answer.json() == {"version": before + 1, "stopped": "", "contacts": []}
    scene = robot.get("/scene").json()
    assert scene["version"] == before + 1
    assert scene["objects"][0]["position"] == [-0.8, 0.0, 0.9]
    assert file_of(robot).read() == robot.app.state.services.scene.scene


def test_a_motion_into_it_is_refused_and_ompl_goes_around_it(robot):
    put(robot, "ball", in_the_way(robot))
    refused = robot.post("/robot/move/joints", there(robot)).json()
    assert refused["code"] == "collision"
    assert "ball" in refused["message"]
    around = robot.post("/robot/move/joints", there(robot) | {"planner": "ompl"}).json()
    assert around["success"], around


def test_a_motion_that_runs_into_a_new_object_is_stopped_with_the_reason(robot):
    begun = robot.begin(robot.asking("POST", "/robot/move/joints", json=there(robot)))
    ball = in_the_way(robot)
    robot.sleep(0.3)
    assert abs(robot.joints()[0]) < 0.3
    answer = put(robot, "ball", ball).json()
    assert "ball" in answer["stopped"]
    ended = robot.end(begun).json()
    assert ended["code"] == "stopped"
    assert "the scene has changed" in ended["message"]
    assert "ball" in ended["message"]
    assert robot.app.state.services.robot.collision.contacts(np.array(robot.joints())) == []


def test_a_motion_that_has_passed_it_goes_on(robot):
    ball = in_the_way(robot)
    begun = robot.begin(robot.asking("POST", "/robot/move/joints", json=there(robot, 1.4)))
    robot.until(lambda: robot.joints()[0] > 0.95)
    assert put(robot, "ball", ball).json()["stopped"] == ""
    assert robot.end(begun).json()["success"]


def test_a_plan_of_another_version_is_not_run(robot):
    plan = robot.post("/robot/plan/joints", there(robot)).json()
    put(robot, "ball", AHEAD | {"x": -0.8})
    answer = robot.post("/robot/execute", {"plan_id": plan["plan_id"]})
    assert answer.status_code == 409
    assert "scene had version" in answer.json()["detail"]


def test_the_hand_holds_what_is_attached_and_leaves_it_where_it_detaches(robot):
    pose = robot.get("/robot/pose").json()["position"]
    x, y, z = (pose[key] for key in "xyz") if isinstance(pose, dict) else pose
    part = {"shape": "box", "size": [0.04, 0.04, 0.04], "x": x, "y": y, "z": z - 0.1}
    assert put(robot, "part", part).status_code == 200
    assert change(robot, attach={"part": ["link7"]}).status_code == 200
    held = robot.get("/scene").json()["objects"][0]
    assert held["attached"]
    assert held["position"] == pytest.approx([0.0, 0.0, 0.1], abs=2e-3)
    assert change(robot, attach={"part": []}).status_code == 409
    wall = in_the_way(robot)  # lower: only the part would touch it
    put(robot, "wall", wall | {"z": wall["z"] - 0.15})
    refused = robot.post("/robot/move/joints", there(robot)).json()
    assert "part and wall" in refused["message"] or "wall and part" in refused["message"]
    change(robot, objects={"wall": None})
    assert robot.post("/robot/move/joints", there(robot)).json()["success"]
    assert change(robot, detach=["part"]).status_code == 200
    left = robot.get("/scene").json()["objects"][0]
    turned = np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]]) @ [x, y]
    assert left["position"] == pytest.approx([*turned, z - 0.1], abs=5e-3)
    assert not left["attached"]


def test_a_named_frame_is_one_of_frame_id(robot):
    assert change(robot, frames={"pallet": {"x": 0.4, "y": 0.0, "z": 0.5}}).status_code == 200
    moved = robot.post(
        "/robot/move/pose", {"x": 0.05, "y": 0.0, "z": 0.05, "b": 3.14159, "frame_id": "pallet", "speed": 0.5}
    ).json()
    assert moved["success"], moved
    ball = {"shape": "sphere", "radius": 0.01, "x": 0.0, "y": 0.3, "z": 0.0, "frame_id": "pallet"}
    assert put(robot, "ball", ball).status_code == 200
    assert robot.get("/scene").json()["objects"][0]["position"] == pytest.approx([0.4, 0.3, 0.5])


def test_allowed_pairs_may_touch(robot):
    put(robot, "ball", in_the_way(robot))
    pairs = [["ball", f"link{number}"] for number in range(1, 8)]
    assert change(robot, allowed=pairs).status_code == 200
    assert robot.post("/robot/move/joints", there(robot)).json()["success"]


BOX = {"shape": "box", "size": [0.1, 0.1, 0.1], "x": 1.0, "y": 0.0, "z": 0.0}


@pytest.mark.parametrize(
    ("changes", "status", "message"),
    [
        ({}, 422, "nothing to change; valid fields: clear, detach"),
        ({"object": {}}, 422, "did you mean 'objects'?"),
        ({"objects": {"a": BOX | {"size": [0.1, 0.1]}}}, 422, "objects.a.size"),
        ({"objects": {"a": BOX | {"size": [0.1, 0.1, -1.0]}}}, 422, "equal to 0.0001, got -1.0"),
        ({"objects": {"a": BOX | {"radius": 0.1}}}, 422, "radius is not allowed; a box needs size"),
        ({"objects": {"a": {"shape": "sphere", "x": 0.0, "y": 0.0, "z": 0.0}}}, 422, "radius is missing"),
        ({"objects": {"a": BOX | {"shape": "cone"}}}, 422, "objects.a.shape"),
        ({"objects": {"a": BOX | {"x": 1e9}}}, 422, "objects.a.x: is 1e+09 m, allowed: -100 to 100 m"),
        ({"objects": {"a": BOX | {"frame_id": "nowhere"}}}, 422, "no frame 'nowhere'"),
        ({"objects": {"a": BOX | {"frame_id": "link7"}}}, 422, "moves with the joints"),
        ({"objects": {"link7": BOX}}, 422, "'link7' is a body"),
        ({"objects": {"a b": BOX}}, 422, "a b"),
        ({"objects": {"a": None}}, 404, "there is no object 'a'; valid names: none"),
        ({"frames": {"a": None}}, 404, "there is no frame 'a'"),
        ({"attach": {"a": []}}, 404, "there is no object 'a'"),
        ({"detach": ["a"]}, 404, "there is no object 'a'"),
        ({"allowed": [["a", "link7"]]}, 404, "there is no body or object 'a'; valid names:"),
        ({"allowed": [["link7"]]}, 422, "allowed[0]"),
        ({"objects": {"good": BOX}, "attach": {"bad": []}}, 404, "there is no object 'bad'"),
    ],
)
def test_what_is_wrong_changes_nothing(robot, changes, status, message):
    before = robot.get("/scene").json()
    answer = change(robot, **changes)
    assert (answer.status_code, message in answer.json()["detail"]) == (status, True), answer.text
    assert robot.get("/scene").json() == before


def test_nothing_is_attached_while_the_arm_moves(robot):
    put(robot, "ball", AHEAD | {"x": -0.8})
    begun = robot.begin(robot.asking("POST", "/robot/move/joints", json=there(robot)))
    robot.until(lambda: robot.rig.mode is LoopMode.TRAJECTORY)
    refused = change(robot, attach={"ball": []})
    assert refused.status_code == 409
    assert "the arm is moving" in refused.json()["detail"]
    assert robot.end(begun).json()["success"]


def test_what_is_changed_together_knows_each_other(robot):
    table = BOX | {"frame_id": "pallet"}
    frames = {"pallet": {"x": 0.0, "y": 0.5, "z": 0.0}}
    assert change(robot, frames=frames, objects={"table": table}, attach={"table": []}).status_code == 200
    assert change(robot, detach=["table"]).status_code == 200
    assert robot.get("/scene").json()["objects"][0]["position"] == pytest.approx([1.0, 0.5, 0.0])


def test_a_scene_that_cannot_be_written_changes_nothing(robot, monkeypatch):
    before = robot.get("/scene").json()

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    answer = put(robot, "ball", AHEAD)
    assert answer.status_code == 503
    assert "disk is full" in answer.json()["detail"]
    assert robot.get("/scene").json() == before
    assert file_of(robot).read().version == before["version"]
    monkeypatch.undo()
    version = put(robot, "ball", AHEAD).json()["version"]
    assert version > before["version"] + 1, "planning processes may know another scene by that version"


def test_a_change_is_completed_if_its_client_leaves(robot, monkeypatch):
    """Between the file and the command, which is when the file, the service and rtloop differ."""
    service = robot.app.state.services.scene
    tell, told = service._tell, []

    async def tell_late(scene):
        told.append(scene)
        await asyncio.sleep(0.1)
        await tell(scene)

    monkeypatch.setattr(service, "_tell", tell_late)
    asked = robot.begin(robot.asking("POST", "/scene", json={"objects": {"ball": AHEAD | {"x": -0.8}}}))
    robot.until(lambda: told)
    asked.cancel()
    robot.until(lambda: asked.cancelled() and not service.turn.locked())
    assert service.scene == file_of(robot).read() == told[0]
    assert int(info(robot)["scene_version"]) == service.scene.version


@pytest.mark.parametrize(
    "error", [ExecutionError("no"), UnavailableError("no answer"), RuntimeError("a defect")]
)
def test_a_scene_that_rtloop_does_not_take_over_is_not_left_on_disk(robot, monkeypatch, error):
    before = file_of(robot).read()

    async def reject(version):
        assert file_of(robot).read().version == version
        raise error

    with monkeypatch.context() as patched, contextlib.suppress(RuntimeError):
        patched.setattr(robot.app.state.services.link.commands, "read_scene", reject)
        assert put(robot, "ball", AHEAD | {"x": -0.8}).status_code in (409, 503)
    assert file_of(robot).read() == robot.app.state.services.scene.scene == before


def test_who_puts_something_where_the_arm_is_hears_of_it(robot):
    x, y, z = robot.app.state.services.robot.model.forward(np.array(robot.joints())).position.tolist()
    contacts = put(robot, "ball", {"shape": "sphere", "radius": 0.05, "x": x, "y": y, "z": z}).json()[
        "contacts"
    ]
    assert any("ball" in each for each in contacts)


CORNERS = [[x, y, z] for x in (-0.04, 0.04) for y in (-0.04, 0.04) for z in (-0.04, 0.04)]
SIDES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6]]
SIDES += [[0, 6, 4], [1, 5, 7], [1, 7, 3]]
OTHERS = {
    "point_cloud": {"points": [[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.03, 0.0]], "voxel": 0.05},
    "height_field": {"heights": [[0.02, 0.05], [0.05, None]], "resolution": 0.04, "floor": -0.02},
    "mesh": {"vertices": CORNERS, "triangles": SIDES},
}


@pytest.mark.parametrize("shape", OTHERS)
def test_other_shapes_are_in_the_way_too_and_kept(robot, shape):
    place = {key: value for key, value in in_the_way(robot).items() if key in "xyz"}
    assert put(robot, "thing", {"shape": shape, **OTHERS[shape], **place}).status_code == 200
    (told,) = robot.get("/scene").json()["objects"]
    assert (told["shape"], told["solids"]) == (shape, {"point_cloud": 1, "height_field": 3, "mesh": 1}[shape])
    refused = robot.post("/robot/move/joints", there(robot)).json()
    assert "thing" in refused["message"]
    around = robot.post("/robot/move/joints", there(robot) | {"planner": "ompl"}).json()
    assert around["success"], around
    assert file_of(robot).read() == robot.app.state.services.scene.scene


def test_more_solids_than_a_stream_can_watch_are_refused(robot):
    field = {"shape": "height_field", "resolution": 0.01, "x": 3.0, "y": 0.0, "z": 0.0}
    heights = np.random.default_rng(8).uniform(0.1, 0.2, (10, 30)).tolist()
    assert put(robot, "field", field | {"heights": heights}).status_code == 200
    more = put(robot, "more", field | {"heights": heights})
    assert more.status_code == 422
    assert "consist of 600 solids (field of 300, more of 300), allowed: 500" in more.json()["detail"]
    cloud = {"shape": "point_cloud", "points_base64": encoded(np.zeros((1, 3))), "voxel": 0.1, "x": 3.0}
    assert put(robot, "cloud", cloud | {"y": 0.0, "z": 0.0}).status_code == 200


def encoded(points):
    return base64.b64encode(np.asarray(points, dtype="<f4").tobytes()).decode()


def shell(robot, count):
    """Points on a sphere around the hand, open towards the base."""
    hand = robot.app.state.services.robot.model.forward(np.array(robot.joints())).position
    ways = np.random.default_rng(9).normal(size=(count, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    return (hand + 0.5 * ways)[ways @ (hand / np.linalg.norm(hand)) > 0.2]


def test_a_large_cloud_is_checked_by_voxels_and_streams_have_boxes_around_all_of_them(robot):
    """The oracle for streams is numpy: each voxel is in a box."""
    points = shell(robot, 160_000)
    far = {"shape": "point_cloud", "voxel": 0.01, "x": 0.0, "y": 0.0, "z": 0.0}
    body = far | {"points_base64": encoded(points)}
    assert len(body["points_base64"]) < 2 * 2**20
    assert put(robot, "cloud", body).status_code == 200
    (told,) = robot.get("/scene").json()["objects"]
    expected = np.unique(np.floor(points.astype("<f4").astype(float) / 0.01).astype(int), axis=0)
    assert (told["voxels"], told["voxel"]) == (len(expected), 0.01)
    assert len(expected) > 10_000
    assert 400 < told["solids"] <= 500
    assert 0.0 < told["tolerance"] < 0.2
    service, file = robot.app.state.services.scene, file_of(robot)
    assert file.read() == service.scene
    assert file.path.stat().st_size < 600_000
    boxes = np.array(service.scene.objects["cloud"].boxes)
    for middle in 0.01 * (expected[::97] + 0.5):
        assert (np.abs(middle - boxes[:, :3]) + 0.005 <= 0.5 * boxes[:, 3:] + 1e-6).all(axis=1).any()
    # Other objects take the room of its boxes, and give it back.
    field = {"shape": "height_field", "resolution": 0.01, "x": 3.0, "y": 0.0, "z": 0.0}
    heights = np.random.default_rng(8).uniform(0.1, 0.2, (10, 40)).tolist()
    assert put(robot, "field", field | {"heights": heights}).status_code == 200
    coarse = {each["name"]: each for each in robot.get("/scene").json()["objects"]}["cloud"]
    assert coarse["solids"] <= 100
    assert coarse["tolerance"] > told["tolerance"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("app.services.motion.scene_edits.MAX_VOXELS", 2 * len(expected) - 1)
        refused = put(robot, "again", body)
    assert refused.status_code == 422
    limit = f"{2 * len(expected)} voxels together, allowed: {2 * len(expected) - 1}"
    assert f"objects: their point clouds have {limit}: remove a cloud" in refused.json()["detail"]
    refused = change(robot, attach={"cloud": []})
    assert refused.status_code == 422
    assert "is a point cloud whose voxels make more than 500 boxes together" in refused.json()["detail"]
    assert change(robot, objects={"field": None}).status_code == 200
    assert robot.get("/scene").json()["objects"] == [told]


def test_a_voxel_in_the_way_is_planned_around_and_a_gap_of_the_voxels_is_free(robot):
    place = in_the_way(robot)
    points = np.random.default_rng(10).uniform(-0.04, 0.04, (3000, 3)) + [place[axis] for axis in "xyz"]
    sparse = shell(robot, 40_000)
    body = {"shape": "point_cloud", "voxel": 0.01, "x": 0.0, "y": 0.0, "z": 0.0}
    assert (
        put(robot, "cloud", body | {"points_base64": encoded(np.vstack([points, sparse]))}).status_code == 200
    )
    refused = robot.post("/robot/move/joints", there(robot)).json()
    assert "cloud" in refused["message"]
    around = robot.post("/robot/move/joints", there(robot) | {"planner": "ompl"}).json()
    assert around["success"], around
    nearest = robot.get("/robot/clearance").json()
    assert "cloud" in str(nearest)


@pytest.mark.parametrize(
    ("points", "voxel", "says"),
    [
        (
            encoded([[0, 0, 0], [1, np.nan, 0]]),
            0.01,
            "objects.cloud: points_base64: point 1 is [1, nan, 0], allowed",
        ),
        (
            encoded([[0, np.inf, 0]]),
            0.01,
            "point 0 is [0, inf, 0], allowed: finite numbers from -100 to 100 m",
        ),
        (encoded([[0, 0, 0], [0, 0, 1e4]]), 0.01, "point 1 is [0, 0, 10000], allowed"),
        (encoded(np.zeros((0, 3))), 0.01, "objects.cloud: points_base64: has 0 bytes; each point has 12"),
        (encoded([[0, 0, 0]])[:-4], 0.01, "has 9 bytes; each point has 12"),
        ("no base64!", 0.01, "objects.cloud: points_base64: is not base64"),
        ("не base64", 0.01, "objects.cloud: points_base64: is not base64"),
        (encoded([[0, 0, 0]]), 0.0, "voxel: must be greater than or equal to 0.0001"),
        (encoded([[0, 0, 0]]), 1e-9, "voxel: must be greater than or equal to 0.0001"),
        (encoded([[0, 0, 0]]), None, "voxel is missing; a point_cloud needs points_base64 and voxel"),
        (None, 0.1, "points is missing; a point_cloud needs points and voxel, or points_base64 and voxel"),
    ],
)
def test_a_cloud_that_is_wrong_is_refused_and_nothing_changes(robot, points, voxel, says):
    before = robot.get("/scene").json()
    body = {"shape": "point_cloud", "points_base64": points, "voxel": voxel, "x": 3.0, "y": 0.0, "z": 0.0}
    refused = put(robot, "cloud", body)
    assert refused.status_code == 422
    assert says in refused.json()["detail"]
    assert robot.get("/scene").json() == before


def info(robot):
    assert robot.rig.memory.info.try_read()
    return robot.rig.memory.info.data


def test_what_is_attached_weighs_in_plans_the_cycle_and_the_simulation(robot):
    model, x = robot.app.state.services.robot.model, robot.get("/robot/pose").json()["position"]
    before = model.gravity_torques(np.array(robot.joints()))
    part = {"shape": "box", "size": [0.1, 0.1, 0.1], "x": 0.5, "y": 0.0, "z": 0.4, "mass": 5.0}
    assert put(robot, "part", part).status_code == 200
    assert model.gravity_torques(np.array(robot.joints())) == pytest.approx(before, abs=1e-3)
    answer = change(robot, attach={"part": ["link6", "link7"]})
    assert answer.status_code == 200, answer.text
    assert robot.get("/robot/tool").json()["mass"] == 0.0, x
    lifted = model.gravity_torques(np.array(robot.joints()))
    assert np.abs(lifted - before).max() > 5.0
    rtloop = robot.rig.robot.model
    assert rtloop.carried.mass == model.carried.mass == 5.0
    assert info(robot)["tool_version"] == model.carried.version
    heavy = change(robot, objects={"more": part | {"mass": 50.0}}, attach={"more": ["link6", "link7"]})
    assert heavy.status_code == 422
    assert "more of 50 kg" in heavy.json()["detail"]
    there_and_back = robot.post("/robot/move/joints", there(robot, 0.2)).json()
    assert there_and_back["success"], there_and_back
    robot.sleep(0.5)
    assert robot.joints()[0] == pytest.approx(0.2, abs=2e-3)
    assert robot.get("/scene").json()["objects"][0]["mass"] == 5.0
    assert change(robot, detach=["part"]).status_code == 200
    assert rtloop.carried.mass == model.carried.mass == 0.0
    assert robot.get("/scene").json()["objects"][0]["mass"] == 5.0


def test_what_it_carries_does_not_change_while_the_arm_moves(robot):
    part = {"shape": "sphere", "radius": 0.02, "x": 0.5, "y": 0.0, "z": 0.4, "mass": 1.0}
    assert change(robot, objects={"part": part}, attach={"part": ["link6", "link7"]}).status_code == 200
    begun = robot.begin(robot.asking("POST", "/robot/move/joints", json=there(robot)))
    robot.until(lambda: robot.rig.mode is LoopMode.TRAJECTORY)
    refused = put(robot, "part", None)
    assert refused.status_code == 409
    assert "its load can be changed only while it is at rest" in refused.json()["detail"]
    assert robot.end(begun).json()["success"]


def test_a_service_killed_between_file_and_command_has_the_cycle_learn_of_it_from_the_next_one(tmp_path):
    """The file is all that such a service leaves."""
    service = VirtualService(tmp_path)
    x, y, z = 0.0, 0.0, 0.1
    ball = SceneObject("sphere", (0.05,), (x, y, z, 1.0, 0.0, 0.0, 0.0), attached=True, mass=1.5)
    file_of(service).write(Scene(5, {"ball": ball}, loads=3))
    assert service.rig.robot.model.carried.mass == 0.0
    with service.serving():
        service.until(lambda: int(info(service)["scene_version"]) == 5)
        assert int(info(service)["tool_version"]) == 3
        assert service.rig.robot.model.carried.mass == 1.5
        service.until(lambda: not service.rig.loop.controller.tool_and_scene.surroundings.busy)
        assert service.rig.loop.controller.tool_and_scene.surroundings.version == 5
        seen = service.rig.loop.controller.commands.command_seen
        service.sleep(2.0)
        assert service.rig.loop.controller.commands.command_seen == seen


def test_the_scene_is_there_again_after_a_restart(tmp_path):
    service = VirtualService(tmp_path)
    file = file_of(service)
    ball = SceneObject("sphere", (0.05,), (0.5, 0.4, 0.3, 1.0, 0.0, 0.0, 0.0))
    file.write(Scene(5, {"ball": ball}))
    with service.serving():
        assert service.get("/scene").json()["version"] == 5
        services = service.app.state.services
        assert services.planning.scene == services.robot.collision.scene == Scene(5, {"ball": ball})
        assert put(service, "other", AHEAD | {"x": -0.8}).json()["version"] == 6
    assert list(file.read().objects) == ["ball", "other"]


def test_a_change_is_handed_over_to_the_cycle(robot):
    seen = robot.rig.loop.controller.commands.command_seen
    assert put(robot, "ball", AHEAD | {"x": -0.8}).status_code == 200
    assert robot.rig.loop.controller.commands.command_seen == seen + 1


def test_it_does_not_change_while_somebody_streams(robot):
    before = file_of(robot).read()
    robot.until(lambda: not robot.rig.loop.controller.tool_and_scene.surroundings.busy)
    assert robot.rig.stream() == ""
    robot.sleep(0.05)
    refused = put(robot, "ball", AHEAD)
    assert refused.status_code == 409
    assert "a streaming session is active (mode JOINT_IMPEDANCE)" in refused.json()["detail"]
    assert file_of(robot).read() == before
    robot.rig.memory.session.data["open"] = 0
    robot.rig.memory.session.publish()
    robot.until(lambda: robot.rig.mode.name == "HOLD")
    robot.sleep(1.0)
    assert put(robot, "ball", AHEAD).status_code == 200


def test_a_moved_object_stays_what_it_is(robot):
    """Also a mesh, whose file is not kept. Oracle: the object before."""
    corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
    triangles = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
    mesh = {"shape": "mesh", "vertices": corners, "triangles": triangles, "x": 0.0, "y": -0.9, "z": 0.2}
    put(robot, "wedge", mesh | {"mass": 0.3})
    (before,) = robot.get("/scene").json()["objects"]
    change(robot, frames={"there": {"x": 0.0, "y": 0.5, "z": 0.0}})
    moved = change(robot, move={"wedge": {"x": 0.0, "y": 0.4, "z": 0.3, "frame_id": "there"}})
    assert moved.status_code == 200, moved.text
    (after,) = robot.get("/scene").json()["objects"]
    assert after == before | {"position": [0.0, 0.9, 0.3]}
    for changes, status, said in (
        ({"move": {"nothing": {"x": 0, "y": 0, "z": 0}}}, 404, "there is no object 'nothing'"),
        ({"move": {"wedge": {"x": 1000.0, "y": 0, "z": 0}}}, 422, "move.wedge.x"),
    ):
        answer = change(robot, **changes)
        assert (answer.status_code, said in answer.json()["detail"]) == (status, True), answer.text
    change(robot, attach={"wedge": []})
    held = change(robot, move={"wedge": {"x": 0, "y": 0.9, "z": 0}})
    assert (held.status_code, "is attached: detach it" in held.json()["detail"]) == (409, True)


def test_planning_processes_take_a_scene_over_before_the_next_plan_asks_for_it(robot, monkeypatch):
    """One as soon as the scene is known, so that it can plan a way around; the others once it is in force."""
    planning, told = robot.app.state.services.planning, []

    async def note(scene=None, processes=None):
        told.append((scene or planning.scene, processes))

    monkeypatch.setattr(planning, "prepare", note)
    put(robot, "ball", AHEAD)
    scene = robot.app.state.services.scene.scene
    assert "ball" in scene.objects
    assert told == [(scene, 1), (scene, None)]
