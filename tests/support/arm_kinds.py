"""Twelve kinds of arms, as URDF or MJCF files of their own: the four of the stress test, and arms with four
and five joints, light and heavy ones, with a linkage, fingers and a jaw, and one of two on a stand.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import mujoco
import pinocchio

from benchmarks.arms import (
    DOWN,
    JOINTS,
    ORDINARY,
    SLIDE,
    SPHERICAL,
    TIPS,
    TURN,
    Build,
    Joint,
    Point,
    Y,
    Z,
    description,
)

BENT = (0.3, 0.2, 0.3, 0.4, 0.9, 0.2)
ELBOW: list[Joint] = [
    (TURN, Z, (0.0, 0.0, 0.1), (-2.9, 2.9)),
    (TURN, Y, (0.0, 0.0, 0.3), (-1.9, 1.9)),
    (TURN, Y, (0.0, 0.0, 0.65), (-2.4, 2.4)),
    (TURN, Y, (0.0, 0.0, 0.95), (-2.0, 2.0)),
    (TURN, Z, (0.0, 0.0, 1.1), (-2.9, 2.9)),
]
"""A turntable, three joints in a plane, and a roll."""
BOX = '<collision><geometry><box size="{size}"/></geometry></collision>'
LINK = (
    '<link name="{name}"><inertial><origin xyz="0 0 0.02"/><mass value="{mass}"/><inertia ixx="{turning}" '
    'iyy="{turning}" izz="{turning}" ixy="0" ixz="0" iyz="0"/></inertial>{shape}</link>'
    '<joint name="{joint}" type="{kind}"><parent link="{parent}"/><child link="{name}"/>'
    '<origin xyz="{place}"/><axis xyz="{axis}"/>'
    '<limit lower="{low}" upper="{high}" velocity="0.5" effort="20"/>{mimic}</joint>'
)


def further(name: str, joint: str, parent: str, kind: str, place: str, axis: str, low: float, high: float, *,
            mass: float, size: str, mimic: str = "") -> str:  # fmt: skip
    """A link with a box that is not part of the chain, and the joint above it."""
    shape = BOX.format(size=size)
    turning = 0.1 * mass * max(map(float, size.split())) ** 2
    return LINK.format(name=name, joint=joint, parent=parent, kind=kind, place=place, axis=axis, low=low,
                       high=high, mass=mass, turning=turning, shape=shape,
                       mimic=f"<mimic {mimic}/>" if mimic else "")  # fmt: skip


def scaled(joints: Sequence[Joint], by: float) -> list[Joint]:
    return [(kind, axis, (by * x, by * y, by * z), bounds) for kind, axis, (x, y, z), bounds in joints]


HAND = (
    '<link name="hand"/><joint name="hand_joint" type="fixed"><parent link="tool0"/><child link="hand"/>'
    "</joint>"
    '<link name="hand_tcp"/><joint name="hand_tcp_joint" type="fixed"><parent link="hand"/>'
    '<child link="hand_tcp"/><origin xyz="0 0 0.1"/></joint>'
    + further("left_finger", "finger_joint1", "hand", "prismatic", "0 0.02 0.06", "0 1 0", 0.005, 0.04,
              mass=0.05, size="0.02 0.01 0.04")
    + further("right_finger", "finger_joint2", "hand", "prismatic", "0 -0.02 0.06", "0 -1 0", 0.005, 0.04,
              mass=0.05, size="0.02 0.01 0.04", mimic='joint="finger_joint1"')
)  # fmt: skip
RODS = (
    further("rod", "rod_joint", "link1", "revolute", "-0.2 0 0.3", "0 1 0", -3, 3,
            mass=3.0, size="0.03 0.03 0.5", mimic='joint="a2"')
    + further("lever", "lever_joint", "rod", "revolute", "0 0 0.55", "0 1 0", -3, 3,
              mass=2.0, size="0.2 0.03 0.03", mimic='joint="a2" multiplier="-1"')
)  # fmt: skip
JAW = further("moving_jaw", "jaw", "link5", "revolute", "0.01 0 0.06", "0 1 0", 0.1, 1.2,
              mass=0.01, size="0.01 0.01 0.03")  # fmt: skip


@dataclass(frozen=True, slots=True)
class Kind:
    """An arm, and what of it is needed to make and to judge it.

    Attributes:
        ready: bent, away from singularities and limits.
        held: where the joints stay that are not the arm's.
        tcp: its link in the URDF.
        options: of `cobot new-robot`.
        in_mjcf: the file is MJCF; the URDF is for the judge.
        doubled: the file has two of these arms; names of the first begin with `left_`.
    """

    joints: Sequence[Joint]
    tip: Point
    ready: Sequence[float]
    build: Build = ORDINARY
    extra: str = ""
    held: Mapping[str, float] = field(default_factory=dict)
    tcp: str = "tool0"
    options: Sequence[str] = ()
    in_mjcf: bool = False
    doubled: bool = False


SOLID = Build(inertia=None)
LIGHT = Build(0.015, 0.008, 0.02, 0.5, None, (1.5, 3.0, 2.0, 1.0, 0.5, 0.5), 0.05, 0.03)
HEAVY = Build(0.2, 0.1, 20.0, 200.0, None, (15000.0, 25000.0, 12000.0, 1500.0, 1500.0, 800.0))
KINDS: dict[str, Kind] = {
    "srs": Kind(JOINTS["srs"], TIPS["srs"], (0.3, 0.5, 0.2, -1.2, 0.1, 0.8, 0.2)),
    "ur": Kind(JOINTS["ur"], TIPS["ur"], (0.3, -1.3, 1.5, -1.7, -1.4, 0.2)),
    "spherical": Kind(SPHERICAL, TIPS["spherical"], BENT),
    "gantry": Kind(JOINTS["gantry"], TIPS["gantry"], (0.1, 0.05, *BENT)),
    "five": Kind(ELBOW, (0.0, 0.0, 1.25), (0.3, 0.5, 0.9, 0.8, 0.2), SOLID),
    "scara": Kind(
        [
            (TURN, Z, (0.0, 0.0, 0.4), (-2.3, 2.3)),
            (TURN, Z, (0.35, 0.0, 0.4), (-2.5, 2.5)),
            (SLIDE, DOWN, (0.65, 0.0, 0.45), (0.0, 0.25)),
            (TURN, DOWN, (0.65, 0.0, 0.35), (-3.1, 3.1)),
        ],
        (0.65, 0.0, 0.15),
        (0.3, 0.8, 0.1, 0.2),
        SOLID,
    ),
    "light": Kind(scaled(SPHERICAL, 0.5), (0.425, 0.0, 0.5), BENT, LIGHT),
    "heavy": Kind(scaled(SPHERICAL, 3.0), (2.55, 0.0, 3.0), BENT, HEAVY),
    "linkage": Kind(SPHERICAL, TIPS["spherical"], BENT, SOLID, RODS,
                    held={"rod_joint": 0.0, "lever_joint": 0.0}),
    "fingers": Kind(JOINTS["srs"], TIPS["srs"], (0.3, 0.5, 0.2, -1.2, 0.1, 0.8, 0.2), SOLID, HAND,
                    held={"finger_joint1": 0.04, "finger_joint2": 0.04}, tcp="hand_tcp"),  # open
    "jaw": Kind(scaled(ELBOW, 0.4), (0.0, 0.0, 0.5), (0.3, 0.5, 0.9, 0.8, 0.2), LIGHT, JAW, {"jaw": 0.1},
                in_mjcf=True),
    "two": Kind(JOINTS["ur"], TIPS["ur"], (0.3, -1.3, 1.5, -1.7, -1.4, 0.2), SOLID, tcp="left_tool0",
                held={f"right_a{index}": 0.0 for index in range(1, 7)}, options=("--tcp", "left_tool0"),
                doubled=True),
}  # fmt: skip


def urdf_of(name: str) -> str:
    kind = KINDS[name]
    text = description(name, kind.joints, kind.tip, kind.build, kind.extra)
    return _two_of(text) if kind.doubled else text


def file_of(name: str) -> tuple[str, str]:
    """The text that is given to `cobot new-robot`, and what its file's name ends in."""
    if not KINDS[name].in_mjcf:
        return urdf_of(name), ".urdf"
    kept = '<mujoco><compiler fusestatic="false"/></mujoco></robot>'
    spec = mujoco.MjSpec.from_string(urdf_of(name).replace("</robot>", kept))
    for joint, effort in zip(spec.joints, KINDS[name].build.efforts, strict=True):
        joint.armature = 0.01
        motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_position(kp=20.0)
        motor.forcelimited, motor.forcerange = mujoco.mjtLimited.mjLIMITED_TRUE, [-effort, effort]
    spec.compile()
    return spec.to_xml(), ".xml"


def judged(name: str) -> pinocchio.Model:
    """Pinocchio's model, with all joints locked that are not the arm's."""
    kind, model = KINDS[name], pinocchio.buildModelFromXML(urdf_of(name))
    place = pinocchio.neutral(model)
    for joint, at in kind.held.items():
        place[model.joints[model.getJointId(joint)].idx_q] = at
    return pinocchio.buildReducedModel(model, [model.getJointId(joint) for joint in kind.held], place)


def _two_of(text: str) -> str:
    inner = re.sub(r"</?robot[^>]*>", "", text)
    parts = ['<robot name="two"><link name="stand"/>']
    for side, y in (("left", 0.6), ("right", -0.6)):
        parts.append(re.sub(r'(name|link)="', rf'\1="{side}_', inner))
        parts.append(
            f'<joint name="{side}_mount" type="fixed"><parent link="stand"/><child link="{side}_base_link"/>'
            f'<origin xyz="0 {y} 0.5"/></joint>'
        )
    return "".join([*parts, "</robot>"])
