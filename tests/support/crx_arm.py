"""A six-axis arm of the structure of a FANUC CRX-10iA: its axes and their senses, round numbers for sizes.

Joint 3 and the wrist turn the other way round than joint 2, as in FANUC's descriptions; the forearm is level
and the upper arm upright where all joints are zero. The site `flange` is FANUC's face plate: z ahead, x up.
"""

from __future__ import annotations

from pathlib import Path

from cobot.config import SETTINGS_FILE, Settings, load_settings
from cobot.launch.new_robot.new_robot import NewRobot

JOINT_2_HEIGHT_M = 0.25
AXES = [
    ("J1", "0 0 1", f"0 0 {JOINT_2_HEIGHT_M}", 180, 120),
    ("J2", "0 1 0", "0 0 0", 100, 120),
    ("J3", "0 -1 0", "0 0 0.55", 130, 180),
    ("J4", "-1 0 0", "0.1 0 0", 190, 180),
    ("J5", "0 -1 0", "0.45 0 0", 120, 180),
    ("J6", "-1 0 0", "0.1 -0.15 0", 190, 180),
]
"""Name, axis and place of each joint, its range and its velocity in degrees."""
SHAPES = {
    "base_link": ("0 0 0.08", "0.2 0.2 0.16"),
    "J1": ("0 0 -0.05", "0.14 0.14 0.1"),
    "J2": ("0 0.1 0.27", "0.1 0.06 0.4"),
    "J3": ("0 0 0", "0.1 0.08 0.1"),
    "J4": ("0.2 0 0", "0.3 0.07 0.07"),
    "J5": ("0.02 -0.08 0", "0.08 0.08 0.08"),
    "J6": ("0.02 0 0", "0.04 0.06 0.06"),
}
CRX_RT = {"tracking_error_rad": 0.6, "frozen_after_s": 0.3}
"""As docs/fanuc.md recommends them for an arm that lags by 0.1 to 0.2 s."""
POSITIONS = {
    "home": (30.0, -5.0, 0.0, 0.0, -80.0, 0.0),
    "work": (0.0, 10.0, -20.0, 0.0, -60.0, 0.0),
}
"""In degrees."""
MASSES = {"base_link": 8.0, "J1": 4.0, "J2": 6.0, "J3": 3.0, "J4": 3.0, "J5": 1.5, "J6": 0.5}


def crx_urdf() -> str:
    parts = ['<robot name="crx">', _link("base_link")]
    parent = "base_link"
    for name, axis, place, range_deg, speed_deg in AXES:
        bound, speed = range_deg * 0.017453292519943295, speed_deg * 0.017453292519943295
        parts.append(_link(name))
        parts.append(
            f'<joint name="joint{name[1]}" type="revolute"><parent link="{parent}"/><child link="{name}"/>'
            f'<origin xyz="{place}"/><axis xyz="{axis}"/>'
            f'<limit lower="{-bound}" upper="{bound}" velocity="{speed}" effort="300"/></joint>'
        )
        parent = name
    parts.append(
        '<link name="tool0"/><joint name="face_plate" type="fixed"><parent link="J6"/><child link="tool0"/>'
        '<origin xyz="0.05 0 0" rpy="3.141592653589793 -1.5707963267948966 0"/></joint></robot>'
    )
    return "".join(parts)


def _link(name: str) -> str:
    place, size = SHAPES[name]
    mass = MASSES[name]
    spin = 0.004 * mass
    return (
        f'<link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/>'
        f'<inertia ixx="{spin}" iyy="{spin}" izz="{spin}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="{place}"/><geometry><box size="{size}"/></geometry></collision></link>'
    )


def crx_folder(folder: Path, **positions: tuple[float, ...]) -> Path:
    """The robot's folder, as `cobot new-robot` makes it, with two positions in which the tool points down.

    positions: others of these names, in degrees.
    """
    file, srdf = folder / "crx.urdf", folder / "crx.srdf"
    file.write_text(crx_urdf(), encoding="utf-8")
    srdf.write_text(_srdf({**POSITIONS, **positions}), encoding="utf-8")
    made = folder / "crx"
    NewRobot(file, srdf=srdf).write(made)
    return made


def _srdf(positions: dict[str, tuple[float, ...]]) -> str:
    names = [f"joint{number}" for number in range(1, 7)]
    states = []
    for name, position in positions.items():
        rows = [
            f'<joint name="{joint}" value="{value * 0.017453292519943295}"/>'
            for joint, value in zip(names, position, strict=True)
        ]
        states.append(f'<group_state name="{name}" group="arm">{"".join(rows)}</group_state>')
    group = "".join(f'<joint name="{joint}"/>' for joint in names)
    return f'<robot name="crx"><group name="arm">{group}</group>{"".join(states)}</robot>'


def crx_settings(folder: Path, period_ms: int = 8, **options: object) -> Settings:
    """Its settings with the backend `fanuc`."""
    settings = load_settings(crx_folder(folder) / SETTINGS_FILE)
    backend = settings.robot.backend.model_copy(update={"type": "fanuc", "options": options})
    return settings.model_copy(
        update={
            "robot": settings.robot.model_copy(update={"backend": backend}),
            "rt": settings.rt.model_copy(update={"period_s": period_ms * 1e-3}),
        }
    )
