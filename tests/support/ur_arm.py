"""A six-axis arm of the structure of a Universal Robots UR5e, with round numbers for sizes.

As in the maker's descriptions, `base_link` is turned by half a turn about z from the controller's base, and
the z axis of `tool0` points out of the flange.
"""

from __future__ import annotations

from math import pi, radians
from pathlib import Path

from cobot.config import SETTINGS_FILE, Settings, load_settings
from cobot.launch.new_robot.new_robot import NewRobot

POSITIONS = {
    "home": (-20.0, -100.0, 100.0, -90.0, -90.0, 0.0),
    "work": (0.0, -80.0, 110.0, -120.0, -90.0, 0.0),
}
"""In degrees; the tool points down."""
JOINTS = [
    ("shoulder_pan_joint", "shoulder_link", "0 0 0.16", "0 0 0", 6.28, 150.0),
    ("shoulder_lift_joint", "upper_arm_link", "0 0 0", f"{pi / 2} 0 0", 6.28, 150.0),
    ("elbow_joint", "forearm_link", "-0.42 0 0", "0 0 0", 3.14, 150.0),
    ("wrist_1_joint", "wrist_1_link", "-0.39 0 0.13", "0 0 0", 6.28, 28.0),
    ("wrist_2_joint", "wrist_2_link", "0 -0.1 0", f"{pi / 2} 0 0", 6.28, 28.0),
    ("wrist_3_joint", "wrist_3_link", "0 0.1 0", f"{pi / 2} {pi} {pi}", 6.28, 28.0),
]
"""Name, link, place and turn of each joint, its range and its torque."""
SHAPES = {
    "base_link_inertia": ("0 0 0.04", "0.15 0.15 0.08", 4.0),
    "shoulder_link": ("0 0 0", "0.12 0.12 0.12", 3.7),
    "upper_arm_link": ("-0.21 0 0.13", "0.3 0.1 0.1", 8.4),
    "forearm_link": ("-0.2 0 0.01", "0.26 0.08 0.08", 2.3),
    "wrist_1_link": ("0 0 0", "0.08 0.08 0.08", 1.2),
    "wrist_2_link": ("0 0 0", "0.08 0.08 0.08", 1.2),
    "wrist_3_link": ("0 0 -0.02", "0.07 0.07 0.04", 0.25),
}
SPEED_RAD_S = pi


def ur_urdf() -> str:
    parts = ['<robot name="ur"><link name="base_link"/>', _link("base_link_inertia")]
    parts.append(_fixed("base_link-base_link_inertia", "base_link", "base_link_inertia", f"0 0 {pi}"))
    parts.append(
        '<link name="base"/>' + _fixed("base_link-base_fixed_joint", "base_link", "base", f"0 0 {pi}")
    )
    parent = "base_link_inertia"
    for name, link, place, turn, bound, torque in JOINTS:
        parts.append(_link(link))
        parts.append(
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{link}"/>'
            f'<origin xyz="{place}" rpy="{turn}"/><axis xyz="0 0 1"/>'
            f'<limit lower="{-bound}" upper="{bound}" velocity="{SPEED_RAD_S}" effort="{torque}"/></joint>'
        )
        parent = link
    parts.append(
        '<link name="flange"/>' + _fixed("wrist_3-flange", parent, "flange", f"0 {-pi / 2} {-pi / 2}")
    )
    parts.append('<link name="tool0"/>' + _fixed("flange-tool0", "flange", "tool0", f"{pi / 2} 0 {pi / 2}"))
    return "".join([*parts, "</robot>"])


def _fixed(name: str, parent: str, child: str, turn: str) -> str:
    return (
        f'<joint name="{name}" type="fixed"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 0" rpy="{turn}"/></joint>'
    )


def _link(name: str) -> str:
    place, size, mass = SHAPES[name]
    spin = 0.01 * mass
    return (
        f'<link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/>'
        f'<inertia ixx="{spin}" iyy="{spin}" izz="{spin}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="{place}"/><geometry><box size="{size}"/></geometry></collision></link>'
    )


def ur_folder(folder: Path) -> Path:
    """The robot's folder, as `cobot new-robot` makes it."""
    file, srdf = folder / "ur.urdf", folder / "ur.srdf"
    file.write_text(ur_urdf(), encoding="utf-8")
    srdf.write_text(_srdf(), encoding="utf-8")
    made = folder / "ur"
    NewRobot(file, srdf=srdf).write(made)
    return made


def _srdf() -> str:
    names = [each[0] for each in JOINTS]
    states = []
    for name, position in POSITIONS.items():
        rows = [
            f'<joint name="{joint}" value="{radians(value)}"/>'
            for joint, value in zip(names, position, strict=True)
        ]
        states.append(f'<group_state name="{name}" group="arm">{"".join(rows)}</group_state>')
    group = "".join(f'<joint name="{joint}"/>' for joint in names)
    return f'<robot name="ur"><group name="arm">{group}</group>{"".join(states)}</robot>'


def ur_settings(folder: Path, period_ms: int = 8, **options: object) -> Settings:
    """Its settings with the backend `ur`."""
    settings = load_settings(ur_folder(folder) / SETTINGS_FILE)
    return with_options(settings, period_ms, **options)


def with_options(settings: Settings, period_ms: int = 8, **options: object) -> Settings:
    backend = settings.robot.backend.model_copy(
        update={"type": "ur", "options": {"address": "127.0.0.1", **options}}
    )
    return settings.model_copy(
        update={
            "robot": settings.robot.model_copy(update={"backend": backend}),
            "rt": settings.rt.model_copy(update={"period_s": period_ms * 1e-3}),
        }
    )
