"""Arms whose sizes are far from the iiwa's, as URDF text, and the folders that `cobot new-robot` makes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import yaml
from converted_arms import new_robot

from cobot.config import SETTINGS_FILE

TURN, SLIDE = "revolute", "prismatic"
Z, Y, X = "0 0 1", "0 1 0", "1 0 0"


@dataclass(frozen=True, slots=True)
class Link:
    """A joint and the slender link that it moves, which leads along z to the next joint.

    Attributes:
        length_m, mass_kg: of the link; it is a rod with a tenth of its length as radius.
        effort: N·m, of a slide N.
        bound: the joint moves from minus to plus this, rad or m.
        damping, friction: as in the file's <dynamics>.
    """

    axis: str
    length_m: float
    mass_kg: float
    effort: float
    velocity: float
    bound: float = 2.6
    kind: str = TURN
    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True, slots=True)
class Extreme:
    """An arm and the payload that its settings permit."""

    links: list[Link]
    payload_kg: float


def _row(kind: list[tuple[str, float, float, float, float]], **more: float) -> list[Link]:
    return [Link(*values, **more) for values in kind]  # type: ignore[arg-type]


EXTREMES = {
    "light": Extreme(
        _row(
            [(Z, 0.05, 0.05, 0.5, 6.0), (Y, 0.11, 0.04, 0.5, 6.0), (Y, 0.11, 0.03, 0.5, 6.0),
             (Y, 0.05, 0.02, 0.5, 6.0), (Z, 0.03, 0.01, 0.5, 6.0)],
            friction=0.05, damping=0.02,
        ),
        0.05,
    ),
    "heavy": Extreme(
        _row(
            [(Z, 0.6, 400.0, 9000.0, 1.8), (Y, 1.2, 300.0, 12000.0, 1.8), (Y, 0.9, 180.0, 7000.0, 1.8),
             (Z, 0.5, 80.0, 1500.0, 3.0), (Y, 0.2, 30.0, 1500.0, 3.0), (Z, 0.1, 10.0, 600.0, 4.0)],
            friction=20.0,
        ),
        150.0,
    ),
    "long": Extreme(
        _row(
            [(Z, 0.15, 8.0, 330.0, 2.1), (Y, 0.62, 12.0, 330.0, 2.1), (Y, 0.57, 4.0, 150.0, 3.1),
             (Y, 0.11, 0.3, 54.0, 3.2), (Z, 0.1, 0.2, 54.0, 3.2), (Y, 0.05, 0.02, 54.0, 3.2)]
        ),
        10.0,
    ),
    "slides": Extreme(
        [
            Link(X, 0.2, 40.0, 900.0, 0.8, 0.7, SLIDE, damping=200.0, friction=60.0),
            Link(Y, 0.2, 15.0, 400.0, 0.8, 0.4, SLIDE, friction=20.0),
            *_row([(Z, 0.3, 2.0, 40.0, 3.0), (Y, 0.3, 1.0, 40.0, 3.0), (Y, 0.2, 0.4, 20.0, 3.0)]),
        ],
        2.0,
    ),
    "lossy": Extreme(
        _row(
            [(Z, 0.2, 2.0, 50.0, 3.1), (Y, 0.3, 1.5, 50.0, 3.1), (Z, 0.2, 1.0, 30.0, 3.1),
             (Y, 0.2, 0.8, 30.0, 3.1), (Z, 0.1, 0.4, 30.0, 3.1), (Y, 0.08, 0.2, 20.0, 3.1),
             (Z, 0.03, 0.05, 20.0, 3.1)],
            damping=10.0, friction=1.0,
        ),
        2.0,
    ),
}  # fmt: skip
"""A desk arm of 0.5 N·m, a robot for 150 kg, thin links with a wrist of some grams, a gantry whose slides
rub, and seven joints whose damping and dry friction take more than half of their efforts at full speed.
"""


def urdf(name: str) -> str:
    parts = [f'<robot name="{name}"><link name="base_link"/>']
    parent, way = "base_link", 0.1
    for number, link in enumerate(EXTREMES[name].links, start=1):
        parts += [_solid(f"link{number}", link), _joint(f"a{number}", parent, f"link{number}", way, link)]
        parent, way = f"link{number}", link.length_m
    parts.append(
        f'<link name="tool0"/><joint name="tip" type="fixed"><origin xyz="0 0 {way}"/>'
        f'<parent link="{parent}"/><child link="tool0"/></joint></robot>'
    )
    return "".join(parts)


def extreme_robot(name: str, folder: Path) -> Path:
    """The folder of a robot that the command has made in this folder."""
    made = folder / name
    new_robot(folder / f"{name}.urdf", urdf(name), made)
    file = made / SETTINGS_FILE
    settings = yaml.safe_load(file.read_text(encoding="utf-8"))
    settings["robot"]["max_payload_kg"] = EXTREMES[name].payload_kg
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")
    return made


def _solid(name: str, link: Link) -> str:
    """Its collision shape is shorter than the way to the next joint, so that neighbours do not touch."""
    length, mass, radius = link.length_m, link.mass_kg, 0.1 * link.length_m
    across = mass * (length**2 / 12.0 + radius**2 / 4.0)
    return (
        f'<link name="{name}"><inertial><origin xyz="0 0 {0.5 * length}"/><mass value="{mass}"/><inertia '
        f'ixx="{across}" iyy="{across}" izz="{0.5 * mass * radius**2}" ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><origin xyz="0 0 {0.5 * length}"/><geometry><cylinder radius="{radius}" '
        f'length="{0.4 * length}"/></geometry></collision></link>'
    )


def _joint(name: str, parent: str, child: str, way: float, link: Link) -> str:
    return (
        f'<joint name="{name}" type="{link.kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {way}"/><axis xyz="{link.axis}"/><limit lower="{-link.bound}" '
        f'upper="{link.bound}" effort="{link.effort}" velocity="{link.velocity}"/>'
        f'<dynamics damping="{link.damping}" friction="{link.friction}"/></joint>'
    )
