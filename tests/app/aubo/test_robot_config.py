"""RobotConfig, without processes.

Oracle: joint_limits.yaml and cobot-setting.yaml as PyYAML reads them; the MJCF file as ElementTree does.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from flange_tools import AXES, INERTIA, TILTED, loaded
from independent_models import LIMITS, mjcf_root
from scipy.spatial.transform import Rotation
from vendor_calls import Caller, ToolHere, run

from app.services.motion.tool_and_limits import RobotSettings
from cobot.codes import Code
from cobot.robot.description import RobotDescription
from cobot.robot.tool import BARE, Tool

ROWS = yaml.safe_load(LIMITS.read_text(encoding="utf-8"))["joint_limits"]
PLANNING = yaml.safe_load(LIMITS.with_name("cobot-setting.yaml").read_text(encoding="utf-8"))["planning"]


def column(name: str) -> list[float]:
    return [row[name] for row in ROWS.values()]


@pytest.fixture
def ask(robot: RobotDescription) -> Iterator[Caller]:
    services: Any = SimpleNamespace(
        robot=robot,
        settings=RobotSettings(robot),
        streams=SimpleNamespace(period_s=0.001),
        tool=ToolHere(robot),
    )
    yield Caller(services, "RobotConfig")
    robot.model.carry(BARE)


def test_what_the_arm_is(ask: Caller) -> None:
    async def check() -> None:
        assert await ask("getDof") == len(ROWS)
        assert await ask("getName") == "iiwa"
        assert await ask("getRobotType") == mjcf_root().get("model")
        assert await ask("getJointNames") == list(ROWS)
        assert await ask("getCycletime") == 0.001
        assert await ask("getJointMinPositions") == column("min_position")
        assert await ask("getJointMaxPositions") == column("max_position")
        assert await ask("getJointMaxSpeeds") == column("max_velocity")
        assert await ask("getJointMaxAccelerations") == column("max_acceleration")
        assert await ask("getJointMaxTorques") == column("max_effort")
        for rate, names in (("Speeds", "velocity"), ("Accelerations", "acceleration")):
            expected = [PLANNING[f"max_linear_{names}"], PLANNING[f"max_angular_{names}"]]
            assert await ask(f"getTcpMax{rate}") == expected

    run(check())


@pytest.mark.parametrize(
    ("method", "field", "name", "share"),
    [
        ("JointMinPositions", "positions", "min_position", 0.9),
        ("JointMaxPositions", "positions", "max_position", 0.9),
        ("JointMaxSpeeds", "speeds", "max_velocity", 0.5),
        ("JointMaxAccelerations", "accelerations", "max_acceleration", 0.5),
    ],
)
def test_joint_limits_can_be_tightened_and_set_back(
    ask: Caller, method: str, field: str, name: str, share: float
) -> None:
    async def check() -> None:
        whole = column(name)
        tight = [share * value for value in whole]
        assert await ask(f"set{method}", **{field: tight}) == 0
        assert await ask(f"get{method}") == tight
        assert await ask(f"set{method}", **{field: whole}) == 0  # what was tightened may be widened again
        wide = [1.01 * value for value in whole]
        assert f"{field}: joint1 is" in await ask.fails(f"set{method}", Code.LIMIT, **{field: wide})
        short = await ask.fails(f"set{method}", Code.INPUT, **{field: tight[:6]})
        assert short == f"{field} must have 7 numbers, got 6"
        await ask(f"set{method}", **{field: tight})
        await ask("resetLimits")
        assert await ask(f"get{method}") == whole

    run(check())


def test_limits_between_which_nothing_could_move_are_refused(ask: Caller) -> None:
    async def check() -> None:
        await ask("setJointMaxPositions", positions=[1.0] * 7)
        await ask.fails("setJointMinPositions", Code.LIMIT, positions=[1.0] * 7)
        await ask.fails("setJointMaxSpeeds", Code.LIMIT, speeds=[0.0] * 7)
        await ask.fails("setJointMaxAccelerations", Code.LIMIT, accelerations=[-1.0] * 7)
        await ask.fails("setTcpMaxSpeeds", Code.LIMIT, speeds=[0.0, 1.0])

    run(check())


@pytest.mark.parametrize("rate", ["Speeds", "Accelerations"])
def test_limits_of_the_tip_can_be_tightened_and_set_back(ask: Caller, rate: str) -> None:
    async def check() -> None:
        whole = await ask(f"getTcpMax{rate}")
        name = rate.lower()
        await ask(f"setTcpMax{rate}", **{name: [0.1, 0.2]})
        assert await ask(f"getTcpMax{rate}") == [0.1, 0.2]
        wide = await ask.fails(f"setTcpMax{rate}", Code.LIMIT, **{name: [whole[0] * 1.01, 0.2]})
        assert f"is {whole[0] * 1.01:g}, allowed: 0.001 to {whole[0]:g}" in wide
        await ask.fails(f"setTcpMax{rate}", Code.INPUT, **{name: [0.1]})
        await ask("resetLimits")
        assert await ask(f"getTcpMax{rate}") == whole

    run(check())


def test_the_tool_is_what_was_set(ask: Caller) -> None:
    async def check() -> None:
        assert await ask("getTcpOffset") == [0.0] * 6
        offset = [0.1, -0.2, 0.3, 0.4, -0.5, 0.6]
        await ask("setTcpOffset", offset=offset)
        np.testing.assert_allclose(await ask("getTcpOffset"), offset, atol=1e-12)
        assert "up to 2 m" in await ask.fails("setTcpOffset", Code.LIMIT, offset=[3.0, *offset[1:]])
        await ask.fails("setTcpOffset", Code.INPUT, offset=offset[:5])

    run(check())


def test_the_size_of_gravity_and_the_collision_level_are_answered_and_never_changed(ask: Caller) -> None:
    async def check() -> None:
        option = mjcf_root().find("option")
        text = "0 0 -9.81" if option is None else option.get("gravity", "0 0 -9.81")
        gravity = [float(word) for word in text.split()]
        assert await ask("getGravity") == gravity
        assert await ask("setGravity", gravity=gravity) == 0
        moon = await ask.fails("setGravity", Code.NOT_SUPPORTED, gravity=[0.0, 0.0, -1.62])
        assert "must be the model file's" in moon
        await ask.fails("setGravity", Code.INPUT, gravity=[0.0])
        assert json.loads(await ask("getPayload")) == [0.0, [0.0] * 3, [0.0] * 3, [0.0] * 6]
        nothing: dict[str, Any] = {"cog": [0.0] * 3, "aom": [0.0] * 3, "inertia": [0.0] * 6}
        assert await ask("setPayload", m=0.0, **nothing) == 0
        assert await ask("getCollisionLevel") == 0
        assert await ask("setCollisionLevel", level=0) == 0
        await ask.fails("setCollisionLevel", Code.NOT_SUPPORTED, level=5)

    run(check())


def test_gravity_of_a_tilted_base_is_that_of_pinocchio(ask: Caller, robot: RobotDescription) -> None:
    async def check() -> None:
        joints = np.array([0.3, 0.5, -0.2, -1.0, 0.4, 0.9, 0.1])
        assert await ask("setGravity", gravity=list(TILTED)) == 0
        np.testing.assert_allclose(await ask("getGravity"), TILTED, atol=1e-9)
        expected = loaded(Tool(gravity=TILTED)).gravity(joints)
        np.testing.assert_allclose(robot.model.gravity_torques(joints), expected, atol=1e-9)
        assert await ask("setGravity", gravity=[0.0, 0.0, -9.81]) == 0
        assert robot.model.tool.gravity is None

    run(check())


def test_a_payload_is_what_was_set_and_weighs_as_in_pinocchio(ask: Caller, robot: RobotDescription) -> None:
    async def check() -> None:
        joints = np.array([0.3, 0.5, -0.2, -1.0, 0.4, 0.9, 0.1])
        moments, axes = np.linalg.eigh(AXES)
        axes[:, 0] *= np.linalg.det(axes)
        aom = Rotation.from_matrix(axes).as_euler("xyz").tolist()
        diagonal = [moments[0], 0.0, 0.0, moments[1], 0.0, moments[2]]
        centre = [0.02, -0.05, 0.12]
        assert await ask("setPayload", m=10.0, cog=centre, aom=aom, inertia=diagonal) == 0
        mass, cog, turn, inertia = json.loads(await ask("getPayload"))
        assert (mass, cog, turn) == (10.0, centre, [0.0] * 3)
        np.testing.assert_allclose(inertia, INERTIA, atol=1e-12)
        other = loaded(Tool(mass=10.0, centre=(0.02, -0.05, 0.12), inertia=INERTIA))
        np.testing.assert_allclose(robot.model.gravity_torques(joints), other.gravity(joints), atol=1e-9)
        np.testing.assert_allclose(robot.model.mass_matrix(joints), other.mass_matrix(joints), atol=1e-9)
        point: dict[str, Any] = {"cog": [0.0] * 3, "aom": [0.0] * 3, "inertia": [0.0] * 6}
        assert "14 kg" in await ask.fails("setPayload", Code.LIMIT, m=15.0, **point)
        await ask.fails("setPayload", Code.LIMIT, m=-1.0, **point)
        await ask.fails("setPayload", Code.INPUT, m=1.0, **(point | {"cog": [0.0]}))
        wrong = point | {"inertia": [0.1, 0.0, 0.0, 0.1, 0.0, 0.3]}
        assert "is physically impossible" in await ask.fails("setPayload", Code.INPUT, m=1.0, **wrong)
        assert json.loads(await ask("getPayload"))[0] == 10.0
        assert await ask("setPayload", m=0.0, **point) == 0
        assert json.loads(await ask("getPayload")) == [0.0, [0.0] * 3, [0.0] * 3, [0.0] * 6]

    run(check())
