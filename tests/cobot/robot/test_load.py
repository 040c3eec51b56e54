"""What is attached weighs. Oracle: MuJoCo's own model with solids of that mass on the body of the TCP."""

import mujoco
import numpy as np
import pytest

from cobot.config import load_settings
from cobot.errors import LimitError
from cobot.robot.description import load_robot
from cobot.robot.load import check_load, homogeneous
from cobot.robot.scene import Scene, SceneObject
from cobot.robot.tool import Tool

ROBOT = load_robot(load_settings(None))
HOME = np.array(ROBOT.positions["home"].joints)
TURN = (0.5, 0.5, -0.5, 0.5)
GEOMS = {
    "box": (mujoco.mjtGeom.mjGEOM_BOX, (0.1, 0.2, 0.3), (0.05, 0.1, 0.15)),
    "sphere": (mujoco.mjtGeom.mjGEOM_SPHERE, (0.07,), (0.07, 0.0, 0.0)),
    "cylinder": (mujoco.mjtGeom.mjGEOM_CYLINDER, (0.05, 0.3), (0.05, 0.15, 0.0)),
    "capsule": (mujoco.mjtGeom.mjGEOM_CAPSULE, (0.05, 0.3), (0.05, 0.15, 0.0)),
}


@pytest.mark.parametrize("shape", GEOMS)
def test_a_solid_of_one_density_is_mujocos(shape):
    kind, size, half = GEOMS[shape]
    spec = mujoco.MjSpec()
    spec.worldbody.add_body().add_geom(type=kind, size=half, mass=2.0)
    centre, inertia = homogeneous(SceneObject(shape, size, (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0), mass=2.0))
    assert np.diag(inertia) == pytest.approx(spec.compile().body_inertia[1], rel=1e-9)
    assert not centre.any()


def test_the_dynamics_are_those_of_a_model_with_the_solids_on_it():
    scene = Scene(
        3,
        {
            "part": SceneObject("box", GEOMS["box"][1], (0.02, 0.1, 0.2, *TURN), attached=True, mass=2.0),
            "rod": SceneObject("capsule", GEOMS["capsule"][1], (0.0, -0.1, 0.1, *TURN), True, mass=1.0),
            "table": SceneObject("box", (1.0, 1.0, 0.1), (0.5, 0.0, 0.0, *TURN), mass=50.0),
        },
        loads=2,
    )
    spec = ROBOT.model.spec.copy()
    site = spec.site("tcp")
    tcp = site.parent.add_body(pos=site.pos, quat=site.quat)
    for name in ("part", "rod"):
        each = scene.objects[name]
        kind, _, half = GEOMS[each.shape]
        body = tcp.add_body(pos=each.pose[:3], quat=each.pose[3:])
        body.add_geom(type=kind, size=half, mass=each.mass, contype=0, conaffinity=0)
    mj = spec.compile()
    data, random = mujoco.MjData(mj), np.random.default_rng(5)
    ROBOT.model.carry(Tool(), scene)
    try:
        assert ROBOT.model.carried.version == 2
        for _ in range(10):
            data.qpos[:], data.qvel[:] = random.uniform(-1.0, 1.0, (2, 7))
            mujoco.mj_forward(mj, data)
            found = ROBOT.model.bias_torques(data.qpos, data.qvel)
            assert found == pytest.approx(data.qfrc_bias, abs=1e-9)
            full = np.zeros((7, 7))
            mujoco.mj_fullM(mj, data, full)
            assert ROBOT.model.mass_matrix(data.qpos) == pytest.approx(full, abs=1e-9)
    finally:
        ROBOT.model.carry(Tool())


def test_what_is_too_heavy_with_the_tool_is_refused_by_name():
    part = SceneObject("sphere", (0.05,), (0.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0), attached=True, mass=4.0)
    scene, tool = Scene(1, {"part": part}, loads=1), Tool(1, mass=3.0)
    with pytest.raises(LimitError, match=r"at most 5 kg .*got 7 kg: the tool of 3 kg, with part of 4 kg"):
        check_load(ROBOT.model, ROBOT.limits, tool, scene, HOME, 5.0)
    stretched = np.array([0.0, 1.57, 0.0, 0.0, 0.0, 0.0, 0.0])
    far = SceneObject("sphere", (0.05,), (0.0, 0.0, 1.5, 1.0, 0.0, 0.0, 0.0), attached=True, mass=12.0)
    with pytest.raises(LimitError, match=r"would need .* N·m to hold 15 kg, with part of 12 kg"):
        check_load(ROBOT.model, ROBOT.limits, tool, Scene(1, {"part": far}, loads=1), stretched, 20.0)
    assert ROBOT.model.carried == Tool()
