"""A session with LeRobot's own base classes, in its own Python: a robot is made from LeRobot's command line,
connected, moved by 60 actions and disconnected. Prints a report as JSON on the last line.

Usage: lerobot_session.py --robot.type=cobot --robot.url=... or the options of `bi_cobot`
"""

from __future__ import annotations

import ast
import json
import sys
import time
from dataclasses import dataclass
from importlib.metadata import requires, version
from pathlib import Path

import without_packages

without_packages.leave_out()

import draccus  # noqa: E402
import lerobot  # noqa: E402
import still_camera  # noqa: E402, F401 - registers a kind of camera
from lerobot.robots import Robot, RobotConfig, make_robot_from_config  # noqa: E402
from lerobot.utils.import_utils import register_third_party_plugins  # noqa: E402
from packaging.requirements import Requirement  # noqa: E402

ACTIONS, RATE_HZ, STEP_RAD = 60, 30, 0.005


@dataclass
class Command:
    """The part of LeRobot's commands that is about the robot."""

    robot: RobotConfig


def dataset_methods() -> dict[str, list[str]]:
    """Parameters of the methods of LeRobot's dataset, as its text states them: it cannot be imported here."""
    text = (Path(lerobot.__file__).parent / "datasets" / "lerobot_dataset.py").read_text(encoding="utf-8")
    (kind,) = (
        each
        for each in ast.parse(text).body
        if isinstance(each, ast.ClassDef) and each.name == "LeRobotDataset"
    )
    return {
        each.name: [argument.arg for argument in (*each.args.args, *each.args.kwonlyargs)]
        for each in kind.body
        if isinstance(each, ast.FunctionDef)
    }


def main() -> None:
    register_third_party_plugins()
    robot = make_robot_from_config(draccus.parse(Command, args=sys.argv[1:]).robot)
    robot.connect()
    try:
        begin = robot.get_observation()
        action = {name: begin[name] for name in robot.action_features}
        moved = [name for name in action if name.endswith("joint1.pos")]
        begun_s = time.monotonic()
        for tick in range(ACTIONS):
            for name in moved:
                action[name] += STEP_RAD
            assert robot.send_action(action) == action
            time.sleep(max(0.0, begun_s + (tick + 1) / RATE_HZ - time.monotonic()))
        end = robot.get_observation()
        connected = robot.is_connected
    finally:
        robot.disconnect()
    (needed,) = (Requirement(each) for each in requires("lerobot_robot_cobot") if each.startswith("lerobot"))
    print(
        json.dumps(
            {
                "version": version("lerobot"),
                "allowed": version("lerobot") in needed.specifier,
                "is a robot": isinstance(robot, Robot),
                "type": robot.robot_type,
                "connected": [connected, robot.is_connected],
                "features": sorted(robot.observation_features) == sorted(end),
                "change": {name: end[name] - begin[name] for name in moved},
                "pictures": {
                    name: [*end[name].shape, camera.looked, camera.waited]
                    for name, camera in robot.cameras.items()
                },
                "dataset": dataset_methods(),
            }
        )
    )


if __name__ == "__main__":
    main()
