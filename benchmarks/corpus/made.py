"""Robot descriptions drawn at random: serial arms of every size and kind.

Each is a URDF that a robot could have: links are tubes with the mass and inertia of their shape, and drives
hold the stretched arm with a reserve. What varies: the order of axes, reach from 0.2 to 3.5 m, density,
efforts, velocities, friction, damping, the mounting of the base, and what files leave out or spell in unusual
ways.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.corpus.real import Description

COUNT = 96
SEED = 26
GRAVITY_M_S2 = 9.81
X, Y, Z = "1 0 0", "0 1 0", "0 0 1"
TURN, SLIDE = "revolute", "prismatic"
KINDS: dict[str, tuple[tuple[str, str], ...]] = {
    "three_joints": ((TURN, Z), (TURN, Y), (TURN, Y)),
    "palletizer": ((TURN, Z), (TURN, Y), (TURN, Y), (TURN, Z)),
    "scara": ((TURN, Z), (TURN, Z), (SLIDE, Z), (TURN, Z)),
    "desktop": ((TURN, Z), (TURN, Y), (TURN, Y), (TURN, Y), (TURN, Z)),
    "universal": ((TURN, Z), (TURN, Y), (TURN, Y), (TURN, Y), (TURN, Z), (TURN, Y)),
    "spherical_wrist": ((TURN, Z), (TURN, Y), (TURN, Y), (TURN, Z), (TURN, Y), (TURN, Z)),
    "redundant": ((TURN, Z), (TURN, Y), (TURN, Z), (TURN, Y), (TURN, Z), (TURN, Y), (TURN, Z)),
    "gantry": ((SLIDE, X), (SLIDE, Y), (SLIDE, Z), (TURN, Z), (TURN, Y)),
    "on_a_rail": ((SLIDE, X), (TURN, Z), (TURN, Y), (TURN, Y), (TURN, Z), (TURN, Y), (TURN, Z)),
}
"""Kind and axis of each joint in the frame of its link. Links extend along z, those of a SCARA along x."""
FLAT = ("scara",)
LIMIT = '<limit lower="{:.4g}" upper="{:.4g}" velocity="{:.4g}" effort="{:.5g}"/>'
MOUNTINGS = ("0 0 0", "0 3.141592653589793 0", "0 1.5707963267948966 0", "0.3 0.2 0")
"""Floor, ceiling, wall, slanted: roll, pitch, yaw of the base, rad."""


@dataclass(slots=True)
class Link:
    """A tube from its joint to the next one, along x or z."""

    flat: bool
    length_m: float
    radius_m: float
    mass_kg: float

    def point(self, share: float) -> str:
        """A point on the tube's axis, as an origin. 1 is the end of the tube."""
        along = f"{share * self.length_m:.6g}"
        return f"{along} 0 0" if self.flat else f"0 0 {along}"

    @property
    def inertial(self) -> str:
        across = self.mass_kg * (3.0 * self.radius_m**2 + self.length_m**2) / 12.0
        along = 0.5 * self.mass_kg * self.radius_m**2
        first, last = (along, across) if self.flat else (across, along)
        return (
            f'<inertial><origin xyz="{self.point(0.5)}"/><mass value="{self.mass_kg:.6g}"/><inertia '
            f'ixx="{first:.6g}" iyy="{across:.6g}" izz="{last:.6g}" ixy="0" ixz="0" iyz="0"/></inertial>'
        )

    @property
    def shape(self) -> str:
        """The shape of the link. It is a little shorter than the link, so that neighbours do not touch."""
        length = max(0.2 * self.length_m, self.length_m - 2.5 * self.radius_m)
        geometry = f'<geometry><cylinder radius="{self.radius_m:.6g}" length="{length:.6g}"/></geometry>'
        turn = f"0 {np.pi / 2.0!r} 0" if self.flat else "0 0 0"
        place = f'<origin xyz="{self.point(0.5)}" rpy="{turn}"/>'
        return f"<collision>{place}{geometry}</collision><visual>{place}{geometry}</visual>"


@dataclass(slots=True)
class RandomArm:
    """An arm of a kind and a size, from which the text of a URDF is made."""

    kind: str
    rng: np.random.Generator

    def text(self) -> str:
        """The text of the URDF, with joint names such as robot makers use."""
        links = self._links()
        style = self._choose("joint{}", "arm_joint_{}", "left arm/joint {}", "J{}", "shoulder_{}_joint")
        mounting = self._choose(*MOUNTINGS) if self.rng.random() < 0.4 else MOUNTINGS[0]
        parts = [
            f'<robot name="{self.kind}"><link name="world"/><link name="base">{links[0].shape}</link>',
            f'<joint name="mount" type="fixed"><origin rpy="{mounting}"/><parent link="world"/>',
            '<child link="base"/></joint>',
        ]
        for index, (joint, axis) in enumerate(KINDS[self.kind]):
            parent = "base" if index == 0 else f"link{index}"
            inertial = "" if self.rng.random() < 0.03 else links[index + 1].inertial
            parts += [
                f'<link name="link{index + 1}">{inertial}{links[index + 1].shape}</link>',
                f'<joint name="{style.format(index + 1)}" type="{joint}">',
                f'<origin xyz="{links[index].point(1.0)}"/><parent link="{parent}"/>',
                f'<child link="link{index + 1}"/><axis xyz="{axis}"/>',
                self._limit(joint, links[index + 1 :]),
                self._dynamics(joint, links[index + 1 :]),
                "</joint>",
            ]
        tip = f'<origin xyz="{links[-1].point(1.0)}"/>'
        parts.append(
            f'<link name="tool0"/><joint name="tool" type="fixed">{tip}<parent link="link{len(links) - 1}"/>'
            '<child link="tool0"/></joint></robot>'
        )
        return "".join(parts)

    def _links(self) -> list[Link]:
        reach, slenderness = np.exp(self.rng.uniform(np.log(0.2), np.log(3.5))), self.rng.uniform(8.0, 25.0)
        density = self.rng.uniform(600.0, 2700.0)
        shares = self.rng.uniform(0.3, 1.0, len(KINDS[self.kind]) + 1)
        lengths = reach * shares / shares.sum()
        taper = np.linspace(1.0, self.rng.uniform(0.3, 0.8), len(lengths))
        radii = np.minimum(0.5 * reach / slenderness * taper, 0.4 * lengths)
        return [
            Link(self.kind in FLAT, float(length), float(radius), float(density * np.pi * radius**2 * length))
            for length, radius in zip(lengths, radii, strict=True)
        ]

    def _limit(self, joint: str, outer: list[Link]) -> str:
        """The limits of a joint. The efforts hold the stretched arm with a reserve. Some files have no
        efforts.
        """
        reach, held = self._load(outer)
        reserve = self.rng.uniform(1.6, 5.0)
        effort = 0.0 if self.rng.random() < 0.1 else reserve * held * (reach if joint == TURN else 1.0)
        if joint == SLIDE:
            span, velocity = self.rng.uniform(0.4, 1.5) * reach, self.rng.uniform(0.1, 1.0)
            return LIMIT.format(-0.5 * span, 0.5 * span, velocity, effort)
        low, high = -self.rng.uniform(1.2, 3.1), self.rng.uniform(1.2, 3.1)
        velocity = self.rng.uniform(1.0, 4.0) / np.sqrt(max(reach, 0.25))
        return (
            f'<limit lower="{low:.4g}" upper="{high:.4g}" velocity="{velocity:.4g}" effort="{effort:.5g}"/>'
        )

    def _dynamics(self, joint: str, outer: list[Link]) -> str:
        reach, held = self._load(outer)
        scale = held * (reach if joint == TURN else 1.0)
        kind = self._choose("none", "none", "small", "large")
        if kind == "none":
            return ""
        friction = scale * (self.rng.uniform(0.0, 0.05) if kind == "small" else self.rng.uniform(0.1, 0.4))
        damping = scale * (self.rng.uniform(0.0, 0.02) if kind == "small" else self.rng.uniform(0.02, 0.2))
        return f'<dynamics friction="{friction:.4g}" damping="{damping:.4g}"/>'

    def _load(self, outer: list[Link]) -> tuple[float, float]:
        """Reach of the links beyond a joint, m, and their weight, N."""
        return sum(link.length_m for link in outer), GRAVITY_M_S2 * sum(link.mass_kg for link in outer)

    def _choose(self, *values: str) -> str:
        return values[int(self.rng.integers(len(values)))]


def spell_latin1(text: str) -> bytes:
    return f'<?xml version="1.0" encoding="ISO-8859-1"?><!-- Größe: 1 m -->{text}'.encode("latin-1")


def spell_utf16(text: str) -> bytes:
    return f'<?xml version="1.0" encoding="UTF-16"?>{text}'.encode("utf-16")


def leave_namespace(text: str) -> bytes:
    return text.replace("<robot ", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro" ', 1).encode()


def turn_without_end(text: str) -> bytes:
    """Make the last joint continuous."""
    head, _, tail = text.rpartition('type="revolute"')
    return (f'{head}type="continuous"{tail}' if head else text).encode()


SPELLINGS: tuple[Callable[[str], bytes], ...] = (
    str.encode,
    spell_latin1,
    spell_utf16,
    leave_namespace,
    turn_without_end,
)


def made_descriptions(folder: Path, count: int = COUNT, seed: int = SEED) -> Iterator[Description]:
    """Write the files to a folder. The same seed always gives the same files."""
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(count):
        rng = np.random.default_rng((seed, number))
        kind = list(KINDS)[number % len(KINDS)]
        spell = SPELLINGS[(number // len(KINDS)) % len(SPELLINGS)]
        file = folder / f"{kind}_{number}.urdf"
        file.write_bytes(spell(RandomArm(kind, rng).text()))
        yield Description(f"made/{file.stem}", file)
