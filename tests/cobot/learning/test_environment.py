"""The Gymnasium environment. Oracle: Gymnasium's own checker."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_peers import need
from physical_cell import EXAMPLE
from plant_service import THE_CELL, ServiceOfPlant
from virtual_service import virtual_service

gymnasium = need("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from cobot.client import Robot  # noqa: E402
from cobot.errors import CollisionError, ConfigError, ExecutionError, InputError  # noqa: E402
from cobot.ipc.layout import GripperObject  # noqa: E402
from cobot.learning.cameras import Camera  # noqa: E402
from cobot.learning.environment import MARGIN_RAD, ArmEnv  # noqa: E402
from cobot.learning.tasks import Reach  # noqa: E402
from cobot.robot.description import RobotDescription  # noqa: E402
from cobot.robot.inverse_kinematics import inverse  # noqa: E402
from cobot.types import Pose  # noqa: E402

TINY = Camera("tiny", (1.4, -1.2, 1.0), (0.3, 0.0, 0.4), width=8, height=6)


@pytest.fixture
def arm() -> Iterator[ArmEnv]:
    made = ArmEnv()
    yield made
    made.close()


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")  # angles are neither
@pytest.mark.parametrize("control", ["relative", "absolute"])
def test_gymnasium_s_checker_finds_nothing(control: str) -> None:
    env = ArmEnv(control=control, cameras=(TINY,))
    check_env(env, skip_render_check=True)
    env.close()


def test_it_is_made_by_its_name_and_ends_when_its_steps_are_used_up() -> None:
    with gymnasium.make("cobot.learning:cobot/Reach-v0", max_episode_steps=3) as env:
        env.reset(seed=1)
        ends = [env.step(env.action_space.sample())[2:4] for _ in range(3)]
    assert ends == [(False, False), (False, False), (False, True)]


def test_the_same_seed_and_actions_lead_to_the_same_figures(arm: ArmEnv) -> None:
    actions = np.random.default_rng(5).uniform(-1.0, 1.0, (20, 7))

    def episode(seed: int) -> np.ndarray:
        seen = [arm.reset(seed=seed)[0], *(arm.step(action)[0] for action in actions)]
        return np.array([np.hstack([each[name] for name in sorted(each)]) for each in seen])

    first = episode(3)
    assert (episode(3) == first).all()
    assert not (episode(4) == first).all()


def test_a_relative_action_moves_each_joint_so_far_and_time_is_the_robot_s(arm: ArmEnv) -> None:
    before, info = arm.reset(seed=2)
    begun_s = info["time_s"]
    for _ in range(30):
        after, _, _, _, info = arm.step(np.array([0.3, 0, 0, 0, 0, 0, -0.3]))
    for _ in range(30):
        after, _, _, _, info = arm.step(np.zeros(7))
    assert info["time_s"] - begun_s == pytest.approx(2.0, abs=0.002)
    assert after["position"] - before["position"] == pytest.approx([0.3, 0, 0, 0, 0, 0, -0.3], abs=2e-3)
    assert info["interventions"] == {}


def test_no_target_is_beyond_the_limits(arm: ArmEnv) -> None:
    arm.reset(seed=2)
    for _ in range(200):
        seen, *_ = arm.step(np.array([0, 0, 0, 0, 0, 0, 1.0]))
    limit = arm.robot.limits.max_position[6] - MARGIN_RAD
    assert seen["position"][6] == pytest.approx(limit, abs=5e-3)


def test_an_arm_that_gets_there_is_done() -> None:
    env = ArmEnv(control="absolute", task=Reach(spread_rad=1e-6))
    env.reset(seed=1)
    _, reward, terminated, truncated, _ = env.step(env._home)
    assert (reward, terminated, truncated) == (1.0, True, False)
    env.close()


def test_cameras_see_the_arm_move(arm: ArmEnv) -> None:
    env = ArmEnv(cameras=(TINY,), render_mode="rgb_array")
    before, _ = env.reset(seed=1)
    picture = env.render()
    assert picture is not None
    assert (picture == before["camera_tiny"]).all()
    for _ in range(60):
        after, *_ = env.step(np.array([1.0, 0, 0, 0, 0, 0, 0]))
    assert not (after["camera_tiny"] == before["camera_tiny"]).all()
    env.close()


def test_an_episode_begins_where_one_says(arm: ArmEnv) -> None:
    start = [0.1, 0.5, 0.0, -1.4, 0.0, 1.2, 0.0]
    seen, _ = arm.reset(options={"start": start})
    assert seen["position"] == pytest.approx(start, abs=1e-3)
    with pytest.raises(CollisionError, match="options: start is in collision"):
        arm.reset(options={"start": [0.0, 2.0, 0.0, -2.0, 0.0, 0.0, 0.0]})


class Lift:
    """A task that is done when the fingers hold something."""

    def spaces(self) -> dict[str, gymnasium.spaces.Space[Any]]:
        return {}

    def reset(self, robot: RobotDescription, start: np.ndarray, random: np.random.Generator) -> None: ...

    def observe(self) -> dict[str, np.ndarray]:
        return {}

    def judge(self, observation: dict[str, Any]) -> tuple[float, bool]:
        return 0.0, bool(GripperObject(int(observation["gripper_object"])).is_held)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")
@pytest.mark.parametrize("control", ["relative", "absolute"])
def test_gymnasium_s_checker_finds_nothing_with_a_gripper(control: str) -> None:
    env = ArmEnv(control=control, cell=EXAMPLE)
    check_env(env, skip_render_check=True)
    assert env.action_space.shape == (8,)
    env.close()


def test_fingers_follow_the_last_number_of_an_action_and_hold_a_part() -> None:
    """Oracle: the cube of the cell, which is 0.05 m wide."""
    env = ArmEnv(control="absolute", cell=EXAMPLE, task=Lift())
    model = env.robot.model
    above, at = (
        inverse(model, Pose(np.array([0.5, -0.3, z]), np.array([0.0, 0.0, 1.0, 0.0])), env._home)
        for z in (0.36, 0.225)
    )
    seen, _ = env.reset(options={"start": above.tolist()})
    assert seen["gripper_width"] == pytest.approx([0.08], abs=1e-3)
    assert seen["gripper_object"] == GripperObject.NONE
    for share in np.linspace(0.0, 1.0, 45):
        seen, *_ = env.step(np.append(above + share * (at - above), 0.08))
    for _ in range(15):
        seen, _, done, *_ = env.step(np.append(at, 0.08))
    assert not done
    assert model.forward(seen["position"]).position[2] == pytest.approx(0.225, abs=2e-3)
    for _ in range(30):
        seen, _, done, *_ = env.step(np.append(at, 0.04))
    assert done
    assert seen["gripper_width"] == pytest.approx([0.05], abs=1e-3)
    assert seen["gripper_commanded_width"] == pytest.approx([0.04])
    assert seen["gripper_force"][0] > 5.0
    env.close()


def test_a_robot_without_a_gripper_has_the_columns_that_it_had(arm: ArmEnv) -> None:
    seen, _ = arm.reset(seed=1)
    assert set(seen) == {"position", "velocity", "effort", "external_effort", "tcp_pose", "goal"}
    assert arm.action_space.shape == (7,)


def test_the_gripper_of_a_service_is_moved(tmp_path: Path) -> None:
    """Oracle: what GET /robot/gripper reports."""
    with ServiceOfPlant(tmp_path, of_robot=THE_CELL).serving() as service:
        local = functools.partial(Robot, service.name, clock=service.clock, client=service.client)
        env = ArmEnv(
            url=service.url, connect=lambda url: (service.client(url), local(), service.clock), speed=1.0
        )
        assert env.action_space.shape == (8,)
        service.go_home()
        service.post("/robot/gripper/move", {"width": 0.02}).raise_for_status()
        env.reset(seed=1)
        for _ in range(30):
            seen, *_ = env.step(np.append(np.zeros(7), 0.5))
        assert seen["gripper_width"] == pytest.approx([0.06], abs=1e-3)
        reported = service.get("/robot/gripper").json()["state"]
        assert reported["width"] == pytest.approx(0.06, abs=1e-3)
        env.close()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": [0.0]}, r"options: start must have 7 numbers, got shape \(1,\)"),
        ({"start": "x"}, "options: start must be a list of numbers"),
        ({"start": [10**400] * 7}, "options: start must be a list of numbers"),
        ({"start": [np.nan] * 7}, "options: start must be finite"),
        (
            {"start": [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 3.04]},
            r"options: start: angle of joint7 is 3\.04 rad, allowed: -3\.03\d* to 3\.03\d* rad",
        ),
        ({"begin": [0.0] * 7}, "options: unknown key 'begin'; valid keys: start"),
        ([0.0] * 7, "options must be a dictionary"),
    ],
)
def test_no_episode_begins_but_where_one_says(arm: ArmEnv, options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        arm.reset(options=options)


def test_a_stop_truncates_the_episode_and_says_why(arm: ArmEnv) -> None:
    arm.reset(seed=1)
    arm.step(np.zeros(7))
    arm._arm.control.trigger_estop()
    for _ in range(5):
        *_, truncated, info = arm.step(np.zeros(7))
        if truncated:
            break
    assert truncated
    assert "ESTOP" in info["reason"]
    with pytest.raises(ExecutionError, match="reset the environment first"):
        arm.step(np.zeros(7))
    arm.reset(seed=1)
    assert not arm.step(np.zeros(7))[3]


def test_wrong_input_is_named(arm: ArmEnv) -> None:
    with pytest.raises(ExecutionError, match="there is no running episode"):
        arm.step(np.zeros(7))
    arm.reset(seed=1)
    for action, said in (
        (np.zeros(6), "must have 7 numbers"),
        (np.full(7, np.nan), "must be finite"),
        ("abc", "must be a list of numbers"),
        (None, "must have 7 numbers"),
    ):
        with pytest.raises(InputError, match=f"an action {said}"):
            arm.step(action)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"control": "torque"}, "control must be relative or absolute, got 'torque'"),
        ({"rate_hz": 0.5}, "rate_hz must be from 1 to 500, got 0.5"),
        ({"spread_rad": -1.0}, "spread_rad must be from 0 to 3"),
        ({"max_velocity_rad_s": 0.0}, "max_velocity_rad_s must be above 0"),
        ({"render_mode": "human"}, "render_mode must be None or rgb_array, got 'human'"),
        ({"cameras": (TINY, TINY)}, "each camera needs a different name"),
        ({"cameras": [1]}, r"cameras must be a list of learning\.cameras\.Camera, got \[1\]"),
        ({"cameras": TINY}, "cameras must be a list"),
        ({"rate_hz": "30"}, "rate_hz must be a number, got '30'"),
        ({"speed": None}, "speed must be a number, got None"),
        ({"task": 5}, "5 has no method spaces"),
        ({"config": 5}, "config must be the path of a settings file, got 5"),
    ],
)
def test_wrong_options_are_named(options: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said):
        ArmEnv(**options)


@pytest.mark.parametrize("kind", [str, Path])
def test_a_configuration_is_a_path_or_its_text(kind: Callable[[object], str | Path]) -> None:
    env = ArmEnv(config=kind(Path(__file__).parents[3] / "config/fr3.yaml"))
    assert env.robot.limits.max_position[3] < 0.0
    env.close()
    with pytest.raises(ConfigError, match="nowhere"):
        ArmEnv(config=kind("/nowhere/cobot-setting.yaml"))


def test_the_arm_of_a_service_is_an_environment_too(tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service:
        robot = functools.partial(Robot, clock=service.clock, client=service.client)
        env = ArmEnv(
            url="http://robot.test",
            spread_rad=0.05,
            connect=lambda url: (service.client(url), robot(service.name), service.clock),
        )
        seen, _ = env.reset(seed=1)
        assert seen["position"] == pytest.approx(service.joints(), abs=1e-3)
        before = service.joints()[0]
        for _ in range(30):
            *_, truncated, _ = env.step(np.array([0.2, 0, 0, 0, 0, 0, 0]))
        assert not truncated
        assert service.joints()[0] - before == pytest.approx(0.2, abs=0.05)
        env.reset(seed=2)
        service.post("/stop").raise_for_status()
        *_, truncated, info = env.step(np.zeros(7))
        assert truncated
        assert info["reason"]
        env.close()
        service.until(lambda: service.health()["robot"]["settled"])
