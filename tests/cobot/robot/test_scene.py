"""Objects around the arm: distances by formula and by MuJoCo, and a file that survives whoever writes it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from cobot.config import load_settings
from cobot.errors import ConfigError, UnavailableError
from cobot.robot.description import load_robot
from cobot.robot.scene import Scene, SceneFile, SceneObject

ROBOT = load_robot(load_settings(None))
HOME = np.array(ROBOT.positions["home"].joints)
LEVEL = (1.0, 0.0, 0.0, 0.0)
EACH = {
    "ball": SceneObject("sphere", (0.1,), (0.5, 0.4, 0.3, *LEVEL)),
    "post": SceneObject("cylinder", (0.05, 0.6), (0.5, -0.4, 0.3, *LEVEL)),
    "pipe": SceneObject("capsule", (0.05, 0.4), (-0.5, 0.1, 0.6, 0.6, 0.0, 0.8, 0.0)),
    "table": SceneObject("box", (0.6, 0.8, 0.04), (0.6, 0.0, 0.1, *LEVEL)),
    "part": SceneObject("box", (0.05, 0.06, 0.1), (0.0, 0.0, 0.08, *LEVEL), attached=True, touch=("link7",)),
}


def _distances(scene, joints):
    checker = ROBOT.collision.among(scene)
    found = checker.clearance.distances(joints[None], 5.0)[0]
    return {frozenset(checker.names(index)): float(each) for index, each in enumerate(found)}


def test_objects_are_where_they_were_put_as_formulas_say():
    scene = Scene(
        1, {**EACH, "other": SceneObject("sphere", (0.02,), (0.0, 0.0, 0.3, *LEVEL), attached=True)}
    )
    tcp = ROBOT.model.forward(HOME)
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, tcp.quaternion)
    held = tcp.position + matrix.reshape(3, 3) @ [0.0, 0.0, 0.3]
    expected = np.linalg.norm(held - [0.5, 0.4, 0.3]) - 0.1 - 0.02
    assert _distances(scene, HOME)[frozenset(("other", "ball"))] == pytest.approx(expected, abs=1e-9)


def test_objects_are_as_far_away_as_mujoco_says():
    random = np.random.default_rng(13)
    scene = Scene(1, EACH)
    model = ROBOT.model.among(scene)
    data = mujoco.MjData(model)
    limits = ROBOT.limits
    checker = ROBOT.collision.among(scene)
    for joints in random.uniform(limits.min_position, limits.max_position, (20, limits.dof)):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        found = checker.clearance.distances(joints[None], 5.0)[0]
        for index, (first, second) in enumerate(checker.pairs):
            if not set(checker.names(index)) & set(EACH):
                continue
            expected = mujoco.mj_geomDistance(model, data, first, second, 5.0, None)
            if expected > 1e-3:
                assert found[index] == pytest.approx(expected, abs=2e-5), checker.names(index)


def test_what_may_touch_is_not_looked_at():
    pairs = _distances(Scene(1, EACH), HOME)
    assert frozenset(("part", "link7")) not in pairs
    assert frozenset(("part", "table")) in pairs
    assert frozenset(("ball", "table")) not in pairs  # both stand still
    allowed = Scene(1, EACH, allowed=(("part", "table"),))
    assert frozenset(("part", "table")) not in _distances(allowed, HOME)


def test_what_stands_is_no_part_of_the_robot_and_what_is_held_is():
    checker = ROBOT.collision.among(Scene(1, EACH))
    own = {frozenset(checker.names(pair)): each for pair, each in enumerate(checker.are_own())}
    assert own[frozenset(("part", "link3"))]
    assert not own[frozenset(("table", "link3"))]


def test_an_empty_scene_leaves_the_model_as_it_is():
    assert ROBOT.model.among(Scene(7)) is ROBOT.model.mj
    assert ROBOT.collision.scene == Scene()


def test_a_scene_comes_back_from_its_file(tmp_path):
    file = SceneFile(tmp_path / "new" / "iiwa.scene.json")
    assert file.read() == Scene()
    scene = Scene(3, EACH, {"pallet": (0.1, 0.2, 0.3, *LEVEL)}, (("table", "link1"),))
    file.write(scene)
    assert file.read() == scene
    assert [each.name for each in file.path.parent.iterdir()] == ["iiwa.scene.json"]


@pytest.mark.parametrize("content", ["", "[]", '{"version": 1, "nonsense": 2}', '{"objects": {"a": 1}}'])
def test_what_is_no_scene_is_refused_with_the_way_out(tmp_path, content):
    path = tmp_path / "scene.json"
    path.write_text(content)
    with pytest.raises(ConfigError, match=r"scene.json: is not a scene: .*remove it"):
        SceneFile(path).read()


def test_a_write_that_fails_leaves_the_old_scene(tmp_path, monkeypatch):
    file = SceneFile(tmp_path / "scene.json")
    file.write(Scene(1, EACH))

    def full(*_):
        raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UnavailableError, match="the scene is unchanged"):
        file.write(Scene(2))
    assert file.read() == Scene(1, EACH)


WRITER = """
import sys
from pathlib import Path
from cobot.robot.scene import Scene, SceneFile, SceneObject
file, version = SceneFile(Path(sys.argv[1])), 0
while True:
    version += 1
    each = SceneObject("sphere", (0.1,), (float(version), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0))
    file.write(Scene(version, {f"ball{index}": each for index in range(100)}))
    print(version, flush=True)
"""


def test_a_writer_killed_at_any_moment_leaves_the_old_scene_or_the_new_one(tmp_path):
    path = tmp_path / "scene.json"
    process = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, cwd=Path(__file__).parents[3]
    )
    assert process.stdout is not None
    told = 0
    for _ in range(20):
        told = int(process.stdout.readline())
    process.send_signal(signal.SIGKILL)
    told = max([told, *(int(line) for line in process.stdout.read().split())])
    process.wait()
    process.stdout.close()
    scene = SceneFile(path).read()
    assert scene.version in (told, told + 1)
    assert {each.pose[0] for each in scene.objects.values()} == {float(scene.version)}
