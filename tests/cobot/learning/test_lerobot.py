"""The plug-in of LeRobot, against a stand-in for LeRobot's base classes."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from lerobot_stand_in import (
    PLUGIN,
    Camera,
    Dataset,
    DeviceAlreadyConnectedError,
    DeviceNotConnectedError,
    LatestCamera,
    RobotConfig,
    plugin_beside_it,
)
from plant_service import THE_CELL, ServiceOfPlant
from virtual_service import VirtualService, virtual_service
from wheels import build

from cobot.client import Robot
from cobot.client.states import GripperReading
from cobot.ipc.layout import GripperObject
from cobot.learning.episodes import EpisodeWriter


@pytest.fixture
def plugin(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    with plugin_beside_it(monkeypatch) as made:
        yield made


def test_lerobot_finds_them_by_their_names(plugin: ModuleType) -> None:
    kinds = RobotConfig.kinds
    assert kinds == {"cobot": plugin.CobotRobotConfig, "bi_cobot": plugin.BiCobotRobotConfig}
    # LeRobot makes the class of a plug-in's robot by taking `Config` from the name of its configuration.
    for config, robot in ((kinds["cobot"], plugin.CobotRobot), (kinds["bi_cobot"], plugin.BiCobotRobot)):
        assert getattr(plugin, config.__name__.removesuffix("Config")) is robot


def test_it_moves_the_arm_and_sees_it(plugin: ModuleType, tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service:
        local = partial(Robot, service.name, clock=service.clock, client=service.client)
        config = plugin.CobotRobotConfig(id="one", cameras={"front": Camera()})
        robot = plugin.CobotRobot(config, connect=lambda url, token: local())
        names = [f"joint{number}.pos" for number in range(1, 8)]
        assert list(robot.action_features) == names
        assert robot.observation_features == {**dict.fromkeys(names, float), "front": (6, 8, 3)}
        assert not robot.is_connected
        with pytest.raises(DeviceNotConnectedError, match=r"call connect\(\) first"):
            robot.get_observation()
        robot.connect()
        assert robot.is_connected
        assert robot.is_calibrated
        with pytest.raises(DeviceAlreadyConnectedError):
            robot.connect()
        seen = robot.get_observation()
        assert seen["front"].shape == (6, 8, 3)
        action = {name: seen[name] for name in names}
        for _ in range(30):
            action["joint1.pos"] += 0.01
            assert robot.send_action(action) == action
            service.sleep(1 / 30)
        assert robot.get_observation()["joint1.pos"] - seen["joint1.pos"] == pytest.approx(0.3, abs=0.05)
        with pytest.raises(ValueError, match=r"the action has no 'joint7\.pos'"):
            robot.send_action(dict.fromkeys(names[:6], 0.0))
        robot.disconnect()
        robot.disconnect()
        assert not robot.is_connected
        service.until(lambda: service.health()["robot"]["settled"])


def test_a_gripper_has_columns_after_those_of_the_joints(plugin: ModuleType, tmp_path: Path) -> None:
    with ServiceOfPlant(tmp_path, of_robot=THE_CELL).serving() as service:
        service.go_home()
        local = partial(Robot, service.name, clock=service.clock, client=service.client)
        robot = plugin.CobotRobot(plugin.CobotRobotConfig(gripper=True), connect=lambda url, token: local())
        names = [f"joint{number}.pos" for number in range(1, 8)]
        columns = ["gripper.pos", "gripper.commanded_pos", "gripper.force", "gripper.held"]
        assert list(robot.action_features) == [*names, "gripper.pos"]
        assert list(robot.observation_features) == [*names, *columns]
        robot.connect()
        seen = robot.get_observation()
        assert list(seen) == [*names, *columns]
        assert seen["gripper.pos"] == pytest.approx(0.08, abs=1e-3)
        action = {name: seen[name] for name in [*names, "gripper.pos"]} | {"gripper.pos": 0.03}
        for _ in range(30):
            assert robot.send_action(action) == action
            service.sleep(1 / 30)
        seen = robot.get_observation()
        assert seen["gripper.pos"] == pytest.approx(0.03, abs=1e-3)
        assert (seen["gripper.commanded_pos"], seen["gripper.held"]) == (pytest.approx(0.03), 0.0)
        assert service.get("/robot/gripper").json()["state"]["width"] == pytest.approx(0.03, abs=1e-3)
        with pytest.raises(ValueError, match=r"the action has no 'gripper\.pos'"):
            robot.send_action(dict.fromkeys(names, 0.0))
        robot.disconnect()


def test_a_gripper_that_the_robot_does_not_have_is_said(plugin: ModuleType, tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service:
        local = partial(Robot, service.name, clock=service.clock, client=service.client)
        robot = plugin.CobotRobot(plugin.CobotRobotConfig(gripper=True), connect=lambda url, token: local())
        with pytest.raises(DeviceNotConnectedError, match=r"robot\.gripper is true, but .* has no gripper"):
            robot.connect()


def test_what_keeps_it_from_the_arm_is_said(plugin: ModuleType, tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service:
        local = partial(Robot, service.name, clock=service.clock, client=service.client)
        two = plugin.CobotRobotConfig(joints=["a", "b"])
        with pytest.raises(
            DeviceNotConnectedError, match="names 2 joints, but the robot of http://localhost:8007 has 7"
        ):
            plugin.CobotRobot(two, connect=lambda url, token: local()).connect()
        robot = plugin.CobotRobot(plugin.CobotRobotConfig(), connect=lambda url, token: local())
        robot.connect()
        action = robot.get_observation()
        service.post("/stop").raise_for_status()
        service.sleep(1.0)
        with pytest.raises(DeviceNotConnectedError, match="the session has ended"):
            robot.send_action(action)
        robot.disconnect()
    nobody = plugin.CobotRobot(plugin.CobotRobotConfig(url="nonsense"))
    with pytest.raises(DeviceNotConnectedError, match="nonsense"):
        nobody.connect()


def test_numbers_that_are_none_are_rejected(plugin: ModuleType) -> None:
    from lerobot_robot_cobot.columns import targets

    with pytest.raises(ValueError, match=r"a of the action is nan; it must be a finite number"):
        targets({"a": float("nan")}, {"a": float})


def test_the_latest_picture_is_taken_where_a_camera_has_it(plugin: ModuleType) -> None:
    from lerobot_robot_cobot.pictures import latest_pictures

    latest = LatestCamera()
    found = latest_pictures({"waits": Camera(), "latest": latest})
    assert {name: picture[0, 0, 0] for name, picture in found.items()} == {"waits": 7, "latest": 9}
    latest.stale = True
    with pytest.raises(TimeoutError, match="too old"):
        latest_pictures({"latest": latest})


def two_arms(plugin: ModuleType, pair: VirtualService, **left: object) -> Any:
    """The pair as one robot of LeRobot, its cameras `left_wrist` and `top`."""

    def connect(url: str, token: str | None) -> Robot:
        return Robot(url, clock=pair.clock, client=pair.client)

    arms = [
        plugin.CobotArmConfig(url=name, **options)
        for name, options in zip(
            pair.names, ({"cameras": {"wrist": LatestCamera()}, **left}, {}), strict=True
        )
    ]
    config = plugin.BiCobotRobotConfig(
        id="two", left_arm_config=arms[0], right_arm_config=arms[1], cameras={"top": Camera()}
    )
    return plugin.BiCobotRobot(config, connect)


def test_two_arms_are_one_robot(plugin: ModuleType, tmp_path: Path) -> None:
    with virtual_service(tmp_path, robots=2) as pair:
        robot = two_arms(plugin, pair)
        joints = [f"joint{number}.pos" for number in range(1, 8)]
        actions = [f"{side}_{name}" for side in ("left", "right") for name in joints]
        assert list(robot.action_features) == actions
        assert (
            set(robot.observation_features) == {*actions, "left_wrist", "top"} == {*actions, *robot.cameras}
        )
        robot.connect()
        assert robot.is_connected
        with pytest.raises(DeviceAlreadyConnectedError):
            robot.connect()
        seen = robot.get_observation()
        assert set(seen) == set(robot.observation_features)
        action = {name: seen[name] for name in actions}
        for _ in range(30):
            action["left_joint1.pos"] += 0.01
            action["right_joint1.pos"] -= 0.005
            assert robot.send_action(action) == action
            pair.sleep(1 / 30)
        moved = [robot.get_observation()[f"{side}_joint1.pos"] for side in ("left", "right")]
        assert moved == pytest.approx([0.3, -0.15], abs=0.05)
        away = action | {"left_joint1.pos": action["left_joint1.pos"] + 0.05}
        for wrong in ({"left_joint1.pos": 1.0}, away | {"right_joint7.pos": float("nan")}):
            with pytest.raises(ValueError, match=r"(of the action is nan|the action has no)"):
                robot.send_action(wrong)
        pair.sleep(0.5)
        assert robot.is_connected
        arrived = robot.get_observation()["left_joint1.pos"]
        assert arrived == pytest.approx(action["left_joint1.pos"], abs=0.02)
        robot.disconnect()
        robot.disconnect()
        assert not robot.is_connected


def test_a_gripper_of_two_arms_has_the_name_of_its_arm(plugin: ModuleType, tmp_path: Path) -> None:
    """The right arm has one, the left arm has none. Each is an arm of a service of its own."""
    for name in ("left", "right"):
        (tmp_path / name).mkdir()
    right_service = ServiceOfPlant(tmp_path / "right", of_robot=THE_CELL)
    with virtual_service(tmp_path / "left") as left, right_service.serving() as right:
        right.go_home()
        services = {each.name: each for each in (left, right)}

        def connect(url: str, token: str | None) -> Robot:
            return Robot(url, clock=services[url].clock, client=services[url].client)

        arms = [plugin.CobotArmConfig(url=each.name, gripper=each is right) for each in (left, right)]
        config = plugin.BiCobotRobotConfig(left_arm_config=arms[0], right_arm_config=arms[1])
        robot = plugin.BiCobotRobot(config, connect)
        joints = [f"{side}_joint{number}.pos" for side in ("left", "right") for number in range(1, 8)]
        columns = ["gripper.pos", "gripper.commanded_pos", "gripper.force", "gripper.held"]
        assert list(robot.action_features) == [*joints, "right_gripper.pos"]
        assert list(robot.observation_features) == [*joints, *(f"right_{name}" for name in columns)]
        robot.connect()
        seen = robot.get_observation()
        assert seen["right_gripper.pos"] == pytest.approx(0.08, abs=1e-3)
        action = {name: seen[name] for name in joints} | {"right_gripper.pos": 0.03}
        for _ in range(30):
            assert robot.send_action(action) == action
            for service in (left, right):
                service.sleep(1 / 30)
        seen = robot.get_observation()
        assert seen["right_gripper.pos"] == pytest.approx(0.03, abs=1e-3)
        assert right.get("/robot/gripper").json()["state"]["width"] == pytest.approx(0.03, abs=1e-3)
        with pytest.raises(ValueError, match=r"the action has no 'right_gripper\.pos'"):
            robot.send_action({name: action[name] for name in joints})
        robot.disconnect()


def test_when_one_arm_stops_the_other_stops_too(plugin: ModuleType, tmp_path: Path) -> None:
    with virtual_service(tmp_path, robots=2) as pair:
        robot = two_arms(plugin, pair)
        robot.connect()
        action = {name: robot.get_observation()[name] for name in robot.action_features}
        for _ in range(10):  # the left arm moves
            action["left_joint1.pos"] += 0.02
            robot.send_action(action)
            pair.sleep(1 / 30)
        pair.post(f"/robots/{pair.names[1]}/stop").raise_for_status()
        pair.sleep(0.1)
        with pytest.raises(DeviceNotConnectedError, match=rf"{pair.names[1]}: the session has ended"):
            robot.send_action(action)
        assert not robot.is_connected
        with Robot(pair.names[0], clock=pair.clock, client=pair.client) as left:
            pair.until(left.stopped)
        robot.connect()  # both are free
        robot.disconnect()


def test_an_arm_that_cannot_be_connected_leaves_the_other_one_free(
    plugin: ModuleType, tmp_path: Path
) -> None:
    with virtual_service(tmp_path, robots=2) as pair:
        robot = two_arms(plugin, pair)
        robot.config.right_arm_config.joints = ["a"]
        robot = plugin.BiCobotRobot(robot.config, robot._arms["left_"]._connect)
        with pytest.raises(
            DeviceNotConnectedError,
            match=r"names 1 joints, but the robot of "
            rf"{pair.names[1]} has 7",
        ):
            robot.connect()
        assert not any(camera.is_connected for camera in robot.cameras.values())
        two_arms(plugin, pair).connect()


def test_cameras_of_two_arms_have_different_names(plugin: ModuleType) -> None:
    config = plugin.BiCobotRobotConfig(
        left_arm_config=plugin.CobotArmConfig(cameras={"top": Camera()}),
        right_arm_config=plugin.CobotArmConfig(),
        cameras={"left_top": Camera()},
    )
    with pytest.raises(ValueError, match="two cameras have the same name: left_top"):
        plugin.BiCobotRobot(config)


def episode(path: Path, *, rate_hz: float = 10.0) -> Path:
    with EpisodeWriter(path, ["joint1", "joint2"], rate_hz, task="wave") as made:
        for frame in range(3):
            picture = np.full((6, 8, 3), frame, np.uint8)
            made.add(frame / rate_hz, [frame, 0], [0, 0], [frame + 1, 0], {"front": picture})
    return path


def test_episodes_become_a_dataset(
    plugin: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from lerobot_robot_cobot.dataset import main

    files = [str(episode(tmp_path / f"{name}.mcap")) for name in ("one", "two")]
    assert main([str(tmp_path / "set"), *files]) == 0
    assert "2 episodes, 6 frames" in capsys.readouterr().out
    made = Dataset.made
    assert made.finalized
    assert made.options["fps"] == 10
    assert made.options["features"]["observation.images.front"]["shape"] == (6, 8, 3)
    assert made.options["features"]["action"]["names"] == ["joint1.pos", "joint2.pos"]
    assert [frame["action"][0] for frame in made.frames] == [1.0, 2.0, 3.0] * 2
    assert made.frames[2]["observation.images.front"][0, 0, 0] == 2
    assert made.frames[0]["task"] == "wave"


def test_the_gripper_of_episodes_is_in_the_state_and_the_action(plugin: ModuleType, tmp_path: Path) -> None:
    from lerobot_robot_cobot.dataset import to_dataset

    unknown = GripperReading(
        float("nan"), float("nan"), float("nan"), moving=False, object=GripperObject.UNKNOWN
    )
    held = GripperReading(0.05, 0.04, 40.0, moving=False, object=GripperObject.HELD_INSIDE)
    with EpisodeWriter(tmp_path / "one.mcap", ["joint1"], 10.0) as made:
        for frame, reading in enumerate((unknown, held)):
            made.add(frame / 10.0, [1.0], [0.0], [2.0], gripper=reading)
    made_set = to_dataset([tmp_path / "one.mcap"], "local/cobot", tmp_path / "set")
    features = made_set.options["features"]
    columns = ["gripper.pos", "gripper.commanded_pos", "gripper.force", "gripper.held"]
    assert features["observation.state"]["names"] == ["joint1.pos", *columns]
    assert features["observation.state"]["shape"] == (5,)
    assert features["action"]["names"] == ["joint1.pos", "gripper.pos"]
    states = [frame["observation.state"].tolist() for frame in made_set.frames]
    assert states == [[1, 0, 0, 0, 0], pytest.approx([1, 0.05, 0.04, 40, 1])]
    assert [frame["action"].tolist() for frame in made_set.frames] == [[2, 0], pytest.approx([2, 0.04])]
    with pytest.raises(ValueError, match="its joints, gripper, cameras or rate differ"):
        to_dataset([tmp_path / "one.mcap", episode(tmp_path / "two.mcap")], "local/cobot", tmp_path / "set")


def test_episodes_that_do_not_fit_are_named(
    plugin: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from lerobot_robot_cobot.dataset import main, to_dataset

    one, two = episode(tmp_path / "one.mcap"), episode(tmp_path / "two.mcap", rate_hz=20.0)
    assert main([str(tmp_path / "set"), str(one), str(two)]) == 1
    assert "two.mcap: its joints, gripper, cameras or rate differ" in capsys.readouterr().err
    assert main([str(tmp_path / "set"), str(tmp_path / "three.mcap")]) == 1
    assert "three.mcap: No such file" in capsys.readouterr().err
    with pytest.raises(ValueError, match="there is no episode"):
        to_dataset([], "local/cobot", tmp_path / "set")


def test_it_is_a_distribution_of_its_own(tmp_path: Path) -> None:

    shutil.copytree(
        PLUGIN, tmp_path / "plugin", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__")
    )
    wheel = build(tmp_path / "plugin", tmp_path)
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        (metadata,) = (archive.read(name).decode() for name in names if name.endswith("METADATA"))
    assert wheel.name.startswith("lerobot_robot_cobot-")
    assert {name for name in names if name.endswith(".py")} == {
        f"lerobot_robot_cobot/{file.name}" for file in (PLUGIN / "lerobot_robot_cobot").glob("*.py")
    }
    assert "Name: lerobot_robot_cobot" in metadata
    assert "Requires-Dist: lerobot" in metadata
