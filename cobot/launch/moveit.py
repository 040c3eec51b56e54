"""`cobot moveit-config FOLDER`: a package that lets MoveIt 2 plan for a robot of this configuration.

The package contains the configuration in MoveIt's files: the URDF on /robot_description; an SRDF with the
named positions and the pairs of links that cobot's own collision checker ignores; the limits; and the
controller. The controller is cobot itself: its action /NAME/follow_joint_trajectory has the name that
MoveIt's simple controller manager expects, so no ros2_control is needed.

Source:
https://moveit.picknik.ai/main/doc/examples/controller_configuration/controller_configuration_tutorial.html
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import yaml

from cobot.config import Settings
from cobot.errors import ConfigError
from cobot.robot.collision import geom_pairs
from cobot.robot.description import RobotDescription, load_robot
from cobot.ros.urdf import link_name, urdf

SCALING = 0.5
"""Fraction of the limits that MoveIt uses by default."""
HUMBLE_ADAPTERS = {
    "planning_plugin": "ompl_interface/OMPLPlanner",
    "request_adapters": " ".join(
        f"default_planner_request_adapters/{name}"
        for name in (
            "AddTimeOptimalParameterization",
            "ResolveConstraintFrames",
            "FixWorkspaceBounds",
            "FixStartStateBounds",
            "FixStartStateCollision",
            "FixStartStatePathConstraints",
        )
    ),
}
LATER_ADAPTERS = {
    "planning_plugins": ["ompl_interface/OMPLPlanner"],
    "request_adapters": [
        "default_planning_request_adapters/ResolveConstraintFrames",
        "default_planning_request_adapters/ValidateWorkspaceBounds",
        "default_planning_request_adapters/CheckStartStateBounds",
        "default_planning_request_adapters/CheckStartStateCollision",
    ],
    "response_adapters": [
        "default_planning_response_adapters/AddTimeOptimalParameterization",
        "default_planning_response_adapters/ValidateSolution",
    ],
}

PACKAGE_XML = """<?xml version="1.0"?>
<package format="3">
  <name>{package}</name>
  <version>0.1.0</version>
  <description>MoveIt 2 for the robot {name} of cobot. Made by `cobot moveit-config`.</description>
  <maintainer email="cobot@example.com">cobot</maintainer>
  <license>Apache-2.0</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <exec_depend>moveit_kinematics</exec_depend>
  <exec_depend>moveit_planners_ompl</exec_depend>
  <exec_depend>moveit_ros_move_group</exec_depend>
  <exec_depend>moveit_ros_visualization</exec_depend>
  <exec_depend>moveit_simple_controller_manager</exec_depend>
  <exec_depend>rviz2</exec_depend>
  <export>
    <build_type>ament_cmake</build_type>
  </export>
</package>
"""
CMAKE_LISTS = """cmake_minimum_required(VERSION 3.8)
project({package})

find_package(ament_cmake REQUIRED)
install(DIRECTORY config launch DESTINATION share/${{PROJECT_NAME}})
ament_package()
"""
LAUNCH = '''"""MoveIt for the robot {name} that `cobot run` runs; `rviz:=true` shows it."""

import os
from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CONFIG = Path(get_package_share_directory("{package}")) / "config"


def text(name):
    return (CONFIG / name).read_text(encoding="utf-8")


def generate_launch_description():
    robot = {{
        "robot_description": text("{name}.urdf"),
        "robot_description_semantic": text("{name}.srdf"),
        "robot_description_kinematics": yaml.safe_load(text("kinematics.yaml")),
        "robot_description_planning": yaml.safe_load(text("joint_limits.yaml")),
    }}
    humble = "_humble" if os.environ.get("ROS_DISTRO") == "humble" else ""
    planning = yaml.safe_load(text(f"ompl_planning{{humble}}.yaml"))
    controllers = yaml.safe_load(text("moveit_controllers.yaml"))
    states = [("joint_states", "/{name}/joint_states")]
    return LaunchDescription(
        [
            DeclareLaunchArgument("rviz", default_value="false"),
            Node(
                package="moveit_ros_move_group",
                executable="move_group",
                output="screen",
                parameters=[robot, planning, controllers],
                remappings=states,
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                parameters=[robot, planning],
                remappings=states,
                condition=IfCondition(LaunchConfiguration("rviz")),
            ),
        ]
    )
'''


def write_moveit_config(settings: Settings, folder: Path) -> Path:
    """Write the package for the default robot into a folder. Returns the folder of the package.

    Raises:
        ConfigError: the folder cannot be written, or already contains such a package.
    """
    made = folder / package_name(settings)
    if made.exists():
        raise ConfigError(f"{made} exists: remove it, or name another folder")
    try:
        for path, content in moveit_files(settings).items():
            (made / path).parent.mkdir(parents=True, exist_ok=True)
            (made / path).write_text(content, encoding="utf-8")
    except OSError as exc:
        raise ConfigError(f"cannot write {made}: {exc.strerror}") from exc
    return made


def package_name(settings: Settings) -> str:
    return f"{settings.robot.name.lower()}_moveit_config"


def moveit_files(settings: Settings) -> dict[str, str]:
    """The content of each file. The keys are the files' paths in the package folder."""
    robot = load_robot(settings)
    description = urdf(robot.model.mj, robot.limits, robot.model.tcp_site)
    name, group = settings.robot.name, settings.robot.group
    words = {"package": package_name(settings), "name": name}
    return {
        "package.xml": PACKAGE_XML.format(**words),
        "CMakeLists.txt": CMAKE_LISTS.format(**words),
        "launch/moveit.launch.py": LAUNCH.format(**words),
        f"config/{name}.urdf": description,
        f"config/{name}.srdf": srdf(robot, settings, ElementTree.fromstring(description).attrib["name"]),
        "config/kinematics.yaml": _yaml({group: kinematics()}),
        "config/joint_limits.yaml": _yaml(joint_limits(robot)),
        "config/moveit_controllers.yaml": _yaml(controllers(robot)),
        "config/ompl_planning.yaml": _yaml(planning(group, LATER_ADAPTERS)),
        "config/ompl_planning_humble.yaml": _yaml(planning(group, HUMBLE_ADAPTERS)),
    }


def srdf(robot: RobotDescription, settings: Settings, model_name: str) -> str:
    """The SRDF: the group from the base to the TCP, the named positions, and the links that may touch."""
    root = Element("robot", name=model_name)
    group = settings.robot.group
    chain = {"base_link": settings.robot.base_frame, "tip_link": settings.robot.tcp}
    SubElement(SubElement(root, "group", name=group), "chain", chain)
    for position in robot.positions.values():
        state = SubElement(root, "group_state", name=position.name, group=group)
        for joint, value in zip(robot.limits.names, position.joints, strict=True):
            SubElement(state, "joint", name=joint, value=repr(value))
    for first, second, reason in unchecked_links(robot):
        SubElement(root, "disable_collisions", link1=first, link2=second, reason=reason)
    ElementTree.indent(root)
    return '<?xml version="1.0"?>\n' + ElementTree.tostring(root, encoding="unicode") + "\n"


def unchecked_links(robot: RobotDescription) -> list[tuple[str, str, str]]:
    """Pairs of links that MoveIt must ignore, with the reason: the links are neighbours, or the model allows
    their contact.
    """
    model = robot.model.mj
    checked = {frozenset(map(int, model.geom_bodyid[list(pair)])) for pair in geom_pairs(model)}
    bodies = sorted({int(body) for body in model.geom_bodyid if body})
    return [
        (link_name(model, first), link_name(model, second), reason)
        for first, second in combinations(bodies, 2)
        if frozenset((first, second)) not in checked
        for reason in ("Adjacent" if model.body_parentid[second] == first else "Never",)
    ]


def kinematics() -> dict[str, Any]:
    return {
        "kinematics_solver": "kdl_kinematics_plugin/KDLKinematicsPlugin",
        "kinematics_solver_search_resolution": 0.005,
        "kinematics_solver_timeout": 0.05,
    }


def joint_limits(robot: RobotDescription) -> dict[str, Any]:
    """The limits that are not in the URDF. MoveIt's time parameterization needs the acceleration limits."""
    limits = robot.limits
    each = {
        name: {
            "has_velocity_limits": True,
            "max_velocity": float(limits.max_velocity[index]),
            "has_acceleration_limits": True,
            "max_acceleration": float(limits.max_acceleration[index]),
            "has_jerk_limits": True,
            "max_jerk": float(limits.max_jerk[index]),
        }
        for index, name in enumerate(limits.names)
    }
    scaling = {f"default_{kind}_scaling_factor": SCALING for kind in ("velocity", "acceleration")}
    return {**scaling, "joint_limits": each}


def controllers(robot: RobotDescription) -> dict[str, Any]:
    """MoveIt's settings for its controllers. MoveIt calls the action `controller/action_ns`, so the robot's
    name is used as the controller name.
    """
    action = {
        "type": "FollowJointTrajectory",
        "action_ns": "follow_joint_trajectory",
        "default": True,
        "joints": list(robot.limits.names),
    }
    return {
        "moveit_controller_manager": "moveit_simple_controller_manager/MoveItSimpleControllerManager",
        "moveit_simple_controller_manager": {"controller_names": [robot.name], robot.name: action},
        # cobot itself stays on the path and within its limits, and people may slow it down during a motion.
        "trajectory_execution": {"execution_duration_monitoring": False, "allowed_start_tolerance": 0.01},
    }


def planning(group: str, adapters: Mapping[str, Any]) -> dict[str, Any]:
    """MoveIt's settings for the OMPL pipeline.

    Args:
        adapters: names of the pipeline's plugins, which differ between Humble and later releases.
    """
    return {
        "planning_pipelines": ["ompl"],
        "default_planning_pipeline": "ompl",
        "ompl": {
            **adapters,
            "planner_configs": {"RRTConnect": {"type": "geometric::RRTConnect"}},
            group: {"default_planner_config": "RRTConnect", "planner_configs": ["RRTConnect"]},
        },
    }


def _yaml(content: dict[str, Any]) -> str:
    return yaml.safe_dump(content, sort_keys=False)
