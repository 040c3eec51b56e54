"""Arms of the structure of seven makers' public descriptions: their names of links and joints, axes, kinds of
joints, frames at both ends, and what the descriptions leave out. Sizes and masses are round numbers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import pi

TURN = 2.0 * pi


@dataclass(frozen=True)
class MakerJoint:
    """A joint and the link after it.

    Attributes:
        origin: place and turn in the link before it: x y z, m, and roll pitch yaw, rad.
        bounds: range, rad; None for a continuous joint.
        limit: velocity, rad/s, and effort, N·m.
    """

    name: str
    link: str
    origin: tuple[str, str]
    axis: str
    bounds: tuple[float, float] | None
    limit: tuple[float, float]


@dataclass(frozen=True)
class MakerArm:
    """
    Attributes:
        before: links from the root to the arm's first link, joined by fixed joints.
        after: fixed frames after the last link: name, parent, place and turn.
        tcp: the frame in which the description ends.
        mass_kg: mass of the first link; each further link is lighter by a tenth of it. 0: no masses.
        further: further elements of the file.
    """

    before: list[str]
    joints: list[MakerJoint]
    after: list[tuple[str, str, str, str]]
    tcp: str
    mass_kg: float = 4.0
    further: str = ""
    turned_base: str = field(default="0 0 0")


def _upright(names: list[str], links: list[str], axes: list[str], places: list[str],
             bounds: list[tuple[float, float] | None], velocity: float, effort: float,
             turns: list[str] | None = None) -> list[MakerJoint]:  # fmt: skip
    turns = turns or ["0 0 0"] * len(names)
    rows = zip(names, links, axes, places, turns, bounds, strict=True)
    return [
        MakerJoint(name, link, (place, turn), axis, bound, (velocity, effort))
        for name, link, axis, place, turn, bound in rows
    ]


def _numbered(pattern: str, count: int = 6) -> list[str]:
    return [pattern.format(number) for number in range(1, count + 1)]


UR5E = MakerArm(
    before=["world", "base_link", "base_link_inertia"],
    joints=_upright(
        ["shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", *_numbered("wrist_{}_joint", 3)],
        ["shoulder_link", "upper_arm_link", "forearm_link", *_numbered("wrist_{}_link", 3)],
        ["0 0 1"] * 6,
        ["0 0 0.16", "0 0 0", "-0.42 0 0", "-0.39 0 0.13", "0 -0.1 0", "0 0.1 0"],
        [(-TURN, TURN), (-TURN, TURN), (-pi, pi), (-TURN, TURN), (-TURN, TURN), (-TURN, TURN)],
        pi,
        150.0,
        ["0 0 0", f"{pi / 2} 0 0", "0 0 0", "0 0 0", f"{pi / 2} 0 0", f"{pi / 2} {pi} {pi}"],
    ),
    after=[
        ("ft_frame", "wrist_3_link", "0 0 0", f"{pi} 0 0"),
        ("flange", "wrist_3_link", "0 0 0", f"0 {-pi / 2} {-pi / 2}"),
        ("tool0", "flange", "0 0 0", f"{pi / 2} 0 {pi / 2}"),
    ],
    tcp="tool0",
    turned_base=f"0 0 {pi}",
)
CRX = MakerArm(
    before=["base_link"],
    joints=_upright(
        _numbered("J{}"),
        _numbered("J{}_link"),
        ["0 0 1", "0 1 0", "0 -1 0", "-1 0 0", "0 -1 0", "-1 0 0"],
        ["0 0 0.25", "0 0 0", "0 0 0.54", "0 0 0", "0.54 0 0", "0 -0.15 0"],
        [(-pi, pi), (-pi, pi), (-4.7, 4.7), (-3.3, 3.3), (-pi, pi), (-3.9, 3.9)],
        2.1,
        0.0,
    ),
    after=[
        ("flange", "J6_link", "0.16 0 0", "0 0 0"),
        ("tool0", "flange", "0 0 0", f"{pi} {-pi / 2} 0"),
    ],
    tcp="tool0",
)
KR10 = MakerArm(
    before=["base_link"],
    joints=_upright(
        _numbered("joint_a{}"),
        _numbered("link_{}"),
        ["0 0 -1", "0 1 0", "0 1 0", "-1 0 0", "0 1 0", "-1 0 0"],
        ["0 0 0.4", "0.025 0 0", "0.56 0 0", "0.515 0 0.025", "0 0 0", "0.09 0 0"],
        [(-2.96, 2.96), (-3.31, 0.78), (-2.09, 2.72), (-3.22, 3.22), (-2.09, 2.09), (-6.1, 6.1)],
        5.0,
        0.0,
    ),
    after=[("tool0", "link_6", "0 0 0", f"0 {pi / 2} 0")],
    tcp="tool0",
    mass_kg=0.0,
)
GP7 = MakerArm(
    before=["base_link"],
    joints=_upright(
        [f"joint_{number}_{letter}" for number, letter in enumerate("slurbt", start=1)],
        [f"link_{number}_{letter}" for number, letter in enumerate("slurbt", start=1)],
        ["0 0 1", "0 1 0", "0 -1 0", "-1 0 0", "0 -1 0", "-1 0 0"],
        ["0 0 0.33", "0.04 0 0", "0 0 0.445", "0.44 0 0.04", "0 0 0", "0.08 0 0"],
        [(-2.96, 2.96), (-1.13, 2.53), (-2.04, 4.45), (-3.31, 3.31), (-2.35, 2.35), (-TURN, TURN)],
        6.5,
        0.0,
    ),
    after=[
        ("flange", "link_6_t", "0 0 0", "0 0 0"),
        ("tool0", "flange", "0 0 0", f"{pi} {-pi / 2} 0"),
    ],
    tcp="tool0",
    mass_kg=0.0,
)
XARM6 = MakerArm(
    before=["world", "link_base"],
    joints=_upright(
        _numbered("joint{}"),
        _numbered("link{}"),
        ["0 0 1"] * 6,
        ["0 0 0.267", "0 0 0", "0.05 -0.285 0", "0.08 0.34 0", "0 0 0", "0.08 0.1 0"],
        [(-TURN, TURN), (-2.06, 2.09), (-3.93, 0.19), (-TURN, TURN), (-1.69, pi), (-TURN, TURN)],
        3.14,
        50.0,
        ["0 0 0", f"{-pi / 2} 0 0", "0 0 0", f"{-pi / 2} 0 0", f"{pi / 2} 0 0", f"{-pi / 2} 0 0"],
    ),
    after=[("link_eef", "link6", "0 0 0", "0 0 0")],
    tcp="link_eef",
    mass_kg=2.0,
    further='<transmission name="tran1"><type>transmission_interface/SimpleTransmission</type>'
    '<joint name="joint1"><hardwareInterface>PositionJointInterface</hardwareInterface></joint>'
    "</transmission>"
    '<gazebo reference="link1"><selfCollide>true</selfCollide></gazebo>',
)
GEN3 = MakerArm(
    before=["base_link"],
    joints=_upright(
        _numbered("joint_{}", 7),
        ["shoulder_link", "half_arm_1_link", "half_arm_2_link", "forearm_link", "spherical_wrist_1_link",
         "spherical_wrist_2_link", "bracelet_link"],
        ["0 0 1"] * 7,
        ["0 0 0.156", "0 0.005 -0.128", "0 -0.21 -0.006", "0 0.006 -0.21", "0 -0.208 -0.006", "0 0 -0.106",
         "0 -0.106 0"],
        [None, (-2.24, 2.24), None, (-2.57, 2.57), None, (-2.09, 2.09), None],
        1.39,
        39.0,
        [f"{pi} 0 0", f"{pi / 2} 0 0", f"{-pi / 2} 0 0", f"{pi / 2} 0 0", f"{-pi / 2} 0 0", f"{pi / 2} 0 0",
         f"{-pi / 2} 0 0"],
    ),
    after=[
        ("end_effector_link", "bracelet_link", "0 0 -0.062", f"{pi} 0 0"),
        ("camera_link", "end_effector_link", "0 0.056 0", f"0 0 {pi}"),
    ],
    tcp="end_effector_link",
    mass_kg=1.4,
)  # fmt: skip
M1013 = MakerArm(
    before=["world", "base_link"],
    joints=_upright(
        _numbered("joint_{}"),
        _numbered("link_{}"),
        ["0 0 1"] * 6,
        ["0 0 0.1525", "0 0.0345 0", "0.62 0 0", "0 -0.559 0", "0 0 0", "0 -0.121 0"],
        [(-TURN, TURN), (-TURN, TURN), (-2.79, 2.79), (-TURN, TURN), (-TURN, TURN), (-TURN, TURN)],
        2.1,
        346.0,
        ["0 0 0", f"0 {-pi / 2} {-pi / 2}", f"0 0 {pi / 2}", f"{pi / 2} 0 0", f"{-pi / 2} 0 0",
         f"{pi / 2} 0 0"],
    ),
    after=[],
    tcp="link_6",
)  # fmt: skip
MAKERS = {
    "ur5e": UR5E,
    "crx10ia": CRX,
    "kr10": KR10,
    "gp7": GP7,
    "xarm6": XARM6,
    "gen3": GEN3,
    "m1013": M1013,
}


def maker_urdf(arm: MakerArm) -> str:
    """The description as a URDF."""
    parts = ['<robot name="arm">']
    parent = ""
    for number, name in enumerate(arm.before):
        solid = number == len(arm.before) - 1
        parts.append(_link(name, 2.0 * arm.mass_kg if solid else 0.0, 0.06 if solid else 0.0))
        if parent:
            turn = arm.turned_base if solid else "0 0 0"
            parts.append(_fixed(name, parent, "0 0 0", turn))
        parent = name
    for number, joint in enumerate(arm.joints):
        parts.append(_link(joint.link, (1.0 - 0.1 * number) * arm.mass_kg, 0.04))
        kind = "continuous" if joint.bounds is None else "revolute"
        bounds = "" if joint.bounds is None else f'lower="{joint.bounds[0]}" upper="{joint.bounds[1]}" '
        velocity, effort = joint.limit
        parts.append(
            f'<joint name="{joint.name}" type="{kind}"><parent link="{parent}"/><child link="{joint.link}"/>'
            f'<origin xyz="{joint.origin[0]}" rpy="{joint.origin[1]}"/><axis xyz="{joint.axis}"/>'
            f'<limit {bounds}velocity="{velocity}" effort="{effort}"/></joint>'
        )
        parent = joint.link
    for name, before, place, turn in arm.after:
        parts += [_link(name, 0.0, 0.0), _fixed(name, before, place, turn)]
    return "".join([*parts, arm.further, "</robot>"])


def _link(name: str, mass: float, radius: float) -> str:
    spin = 0.01 * mass
    inertial = (
        f'<inertial><mass value="{mass}"/><inertia ixx="{spin}" iyy="{spin}" izz="{spin}" ixy="0" ixz="0" '
        'iyz="0"/></inertial>'
    )
    ball = f'<collision><geometry><sphere radius="{radius}"/></geometry></collision>'
    return f'<link name="{name}">{inertial if mass else ""}{ball if radius else ""}</link>'


def _fixed(name: str, parent: str, place: str, turn: str) -> str:
    return (
        f'<joint name="{parent}-{name}" type="fixed"><parent link="{parent}"/><child link="{name}"/>'
        f'<origin xyz="{place}" rpy="{turn}"/></joint>'
    )
