"""RobotConfig, without processes.

Oracle: joint_limits.yaml and cobot-setting.yaml as PyYAML reads them; the MJCF file as ElementTree does.
"""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from second_opinion import LIMITS, mjcf_root
from vendor_calls import Caller, run

from app.aubo.codes import Code
from app.services.motion.tool_and_limits import RobotSettings
from cobot.robot.description import RobotDescription

ROWS = yaml.safe_load(LIMITS.read_text(encoding="utf-8"))["joint_limits"]
PLANNING = yaml.safe_load(LIMITS.with_name("cobot-setting.yaml").read_text(encoding="utf-8"))["planning"]


def column(name: str) -> list[float]:
    return [row[name] for row in ROWS.values()]


@pytest.fixture
def ask(robot: RobotDescription) -> Caller:
    services: Any = SimpleNamespace(
        robot=robot, settings=RobotSettings(robot), streams=SimpleNamespace(period_s=0.001)
    )
    return Caller(services, "RobotConfig")


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
        assert f"possible is from 0.001 to {whole[0]:g}" in wide
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
        assert "at most 2 m" in await ask.fails("setTcpOffset", Code.LIMIT, offset=[3.0, *offset[1:]])
        await ask.fails("setTcpOffset", Code.INPUT, offset=offset[:5])

    run(check())


def test_what_the_model_alone_decides_is_answered_and_never_changed(ask: Caller) -> None:
    async def check() -> None:
        option = mjcf_root().find("option")
        text = "0 0 -9.81" if option is None else option.get("gravity", "0 0 -9.81")
        gravity = [float(word) for word in text.split()]
        assert await ask("getGravity") == gravity
        assert await ask("setGravity", gravity=gravity) == 0
        moon = await ask.fails("setGravity", Code.NOT_SUPPORTED, gravity=[0.0, 0.0, -1.62])
        assert "part of the model's file" in moon
        await ask.fails("setGravity", Code.INPUT, gravity=[0.0])
        assert json.loads(await ask("getPayload")) == [0.0, [0.0] * 3, [0.0] * 3, [0.0] * 6]
        nothing: dict[str, Any] = {"cog": [0.0] * 3, "aom": [0.0] * 3, "inertia": [0.0] * 6}
        assert await ask("setPayload", m=0.0, **nothing) == 0
        await ask.fails("setPayload", Code.NOT_SUPPORTED, m=1.5, **nothing)
        assert await ask("getCollisionLevel") == 0
        assert await ask("setCollisionLevel", level=0) == 0
        await ask.fails("setCollisionLevel", Code.NOT_SUPPORTED, level=5)

    run(check())
