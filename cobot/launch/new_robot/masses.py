"""The masses that `cobot new-robot` assumes for links without a usable `<inertial>`.

Each assumed mass is reported. In the result, every link of the specification has an inertial.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from cobot.errors import ConfigError
from cobot.launch.new_robot.inertials import Stated, repair
from cobot.launch.new_robot.volumes import Solid, solid
from cobot.launch.robot_file.saving import compiled
from cobot.launch.robot_file.typed import typed
from cobot.types import Array

DENSITY_KG_M3 = 1100.0
"""Mass per volume of the collision shapes, kg/m³. Meshes are replaced by their convex hulls, and overlaps are
counted once. The value is the median of 71 robots with known masses, see docs/your-robot.md.
"""
DENSITIES_KG_M3 = (1.0, 30_000.0)
MAX_MASS_KG = 10_000.0
BALL_SHARE, MIN_BALL_M = 0.125, 0.005
"""Radius of the ball that replaces a moving link without a shape: a share of the mean distance between
joints, and the minimum radius, m.
"""
NOTHING_KG = 1e-9
"""Mass that a massless link gets while MuJoCo computes the masses of the shapes."""
FROM_GEOM = mujoco.mjtInertiaFromGeom


@dataclass(frozen=True, slots=True)
class Wishes:
    """The masses and densities that the user has given.

    Attributes:
        density: density of links without an inertial, kg/m³. None means `DENSITY_KG_M3`, or for MJCF the
            densities in the file.
        masses: each link's mass by name, kg.
    """

    density: float | None = None
    masses: Mapping[str, float] = field(default_factory=dict)

    def check(self, file: Path, links: list[str]) -> None:
        """Check the options.

        Raises:
            ConfigError: a value is beyond its range, or a link does not exist.
        """
        low, high = DENSITIES_KG_M3
        if self.density is not None and not low <= self.density <= high:
            raise ConfigError(f"--density is {self.density:g} kg/m³, allowed: {low:g} to {high:g} kg/m³")
        for link, mass in self.masses.items():
            if link not in links:
                raise ConfigError(
                    f"{file}: --mass: the robot has no link {link!r}; valid names: {', '.join(links)}"
                )
            if not 0.0 < mass <= MAX_MASS_KG:
                raise ConfigError(f"--mass of {link} is {mass:g} kg, allowed: above 0 to {MAX_MASS_KG:g} kg")


@dataclass(slots=True)
class _Link:
    body: mujoco.MjsBody
    index: int
    stated: Stated | None
    missing: bool
    solid: Solid | None = None

    @property
    def name(self) -> str:
        return self.body.name or "(no name)"


def settle(
    file: Path, spec: mujoco.MjSpec, wishes: Wishes, stated: Mapping[str, Stated] | None
) -> tuple[list[str], bool]:
    """Give each link an inertial.

    Returns a sentence for each inertial that is not from the file, and whether the mass of a moving link has
    been assumed.

    Args:
        stated: the data that `inertials.set_aside` found in a URDF; None for MJCF.

    Raises:
        ConfigError: a mass option is invalid, or MuJoCo rejects the specification.
    """
    wishes.check(file, [body.name for body in spec.bodies[1:] if body.name])
    settling = _Settling(file, spec, wishes, stated)
    return settling.run(), settling.assumed


class _Settling:
    def __init__(
        self, file: Path, spec: mujoco.MjSpec, wishes: Wishes, stated: Mapping[str, Stated] | None
    ) -> None:
        self._file, self._spec, self._wishes = file, spec, wishes
        self._said: list[str] = []
        self.assumed = False
        self._by_shapes = spec.compiler.inertiafromgeom == FROM_GEOM.mjINERTIAFROMGEOM_TRUE
        self._of_file = stated is None and wishes.density is None
        self._density = wishes.density or DENSITY_KG_M3
        self._links = [self._link(body, (stated or {}).get(body.name)) for body in spec.bodies[1:]]
        if not self._of_file:
            self._give_density()
        self._mj, solids = self._weigh(file)
        for link in self._links:
            link.solid = solid(self._mj, link.index, solids)

    def run(self) -> list[str]:
        spec, total = self._spec, float(self._spec.compiler.settotalmass)
        for link in self._links:
            if link.missing:
                self._assume(link)
        self._require_some_mass()
        self._report_massless()
        self._said += repair(spec, {each.name: each.solid for each in self._links if each.solid})
        for link in self._links:
            if link.name in self._wishes.masses:
                self._replace(link, self._wishes.masses[link.name])
        spec.compiler.inertiafromgeom = FROM_GEOM.mjINERTIAFROMGEOM_AUTO
        spec.compiler.settotalmass = -1.0
        self._report_bounds()
        if total > 0.0:
            self._scale_all(total)
        return self._said

    def _link(self, body: mujoco.MjsBody, stated: Stated | None) -> _Link:
        if body.explicitinertial and body.mass <= 0.0:
            stated = Stated(None, f"its mass in the file is {body.mass:g} kg")
        missing = stated is not None or not body.explicitinertial
        if self._by_shapes and body.geoms:
            missing, stated = True, Stated(None, "inertiafromgeom in the file asks for it")
        if missing:
            body.explicitinertial, body.mass = False, 0.0
        return _Link(body, 0, stated, missing)

    def _give_density(self) -> None:
        """Set the density of the shapes of links that have no inertial. Shapes that are only visual keep a
        density of 0.
        """
        meshes = {mesh.name: mesh for mesh in self._spec.meshes}
        for link in self._links:
            shapes = list(link.body.geoms) if link.missing else []
            for shape in shapes:
                if math.isnan(shape.mass) and shape.density > 0.0:
                    shape.density = self._density
                if shape.meshname in meshes:
                    meshes[shape.meshname].inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX

    def _weigh(self, file: Path) -> tuple[mujoco.MjModel, Array]:
        """MuJoCo's model with the masses of the shapes, and a mask of the shapes that have a mass. The
        inertias in the file are ignored.
        """
        draft = self._spec.copy()
        draft.compiler.boundmass = draft.compiler.boundinertia = NOTHING_KG
        draft.compiler.settotalmass = -1.0
        for body in draft.bodies:
            if body.explicitinertial:
                _set_inertial(body, 1.0, np.zeros(3), np.ones(3))
        mj = compiled(file, draft)
        for link, body in zip(self._links, draft.bodies[1:], strict=True):
            link.index = body.id
        solids = np.zeros(mj.ngeom, dtype=bool)
        for shape in draft.geoms:
            solids[shape.id] = shape.density > 0.0 or shape.mass > 0.0
        return mj, solids

    def _moves(self, link: _Link) -> bool:
        return bool(self._mj.body_weldid[link.index] != 0)

    def _assume(self, link: _Link) -> None:
        mj, index = self._mj, link.index
        weight, stated = float(mj.body_mass[index]), link.stated
        why = stated.why if stated else "the file has no <inertial> for it"
        if weight > 2.0 * NOTHING_KG:
            overlap = 1.0 if self._of_file or link.solid is None else link.solid.overlap
            mass = (stated.mass if stated else None) or weight * overlap
            self.assumed |= self._is_open(link) and not self._of_file and not (stated and stated.mass)
            moments = mj.body_inertia[index] * mass / weight
            _set_inertial(link.body, mass, mj.body_ipos[index], moments, mj.body_iquat[index])
            self._note(link, f"{self._origin(link, mass)}: {why}")
        elif stated and stated.mass:
            radius = self._ball_radius()
            set_ball(link.body, stated.mass, radius)
            self._note(link, f"{stated.mass:g} kg as in the file, in a ball of {1e3 * radius:.3g} mm: {why}")

    def _origin(self, link: _Link, mass: float) -> str:
        if link.stated and link.stated.mass:
            return f"{mass:.4g} kg as in the file, with the inertia of its shapes"
        volume = f" ({1e3 * link.solid.volume:.3g} L)" if link.solid else ""
        if self._of_file:
            return f"mass {mass:.4g} kg of its shapes{volume} at the densities of the file"
        return f"mass {mass:.4g} kg assumed, {self._density:g} kg/m³ times its shapes{volume}"

    def _note(self, link: _Link, sentence: str) -> None:
        if self._is_open(link):
            self._said.append(f"{link.name}: {sentence}")

    def _is_open(self, link: _Link) -> bool:
        """Whether a link moves and the user has not specified its mass."""
        return self._moves(link) and link.name not in self._wishes.masses

    def _require_some_mass(self) -> None:
        """Raise ConfigError if no moving link has a mass, because every mass would be a guess."""
        moving = [link for link in self._links if self._moves(link)]
        masses = self._wishes.masses
        if moving and not any(each.body.explicitinertial or each.name in masses for each in moving):
            option = typed("--mass", f"{moving[0].name}=KG")
            raise ConfigError(
                f"{self._file}: no link that moves has an <inertial> with a mass, nor a <collision> from "
                f"which its inertia could be assumed; add them, or give masses: {option}"
            )

    def _report_massless(self) -> None:
        """Turn a moving link into a small ball if neither the link nor the links fixed to it have a mass."""
        frames = []
        for link in self._links:
            if link.body.explicitinertial or not self._moves(link):
                continue
            welded = self._mj.body_weldid == self._mj.body_weldid[link.index]
            if any(welded[each.index] and each.body.explicitinertial for each in self._links):
                frames.append(link.name)
                continue
            radius = self._ball_radius()
            mass = self._density * 4.0 / 3.0 * math.pi * radius**3
            set_ball(link.body, mass, radius)
            self.assumed |= self._is_open(link)
            self._note(
                link,
                f"mass {mass:.3g} kg assumed, a ball of {1e3 * radius:.3g} mm: the link moves, but the "
                "file has neither a shape nor an <inertial> for it",
            )
        if frames:
            self._said.append(
                f"mass 0 kg, without shape and fixed to a link that has mass: {', '.join(frames)}"
            )
        still = [each for each in self._links if each.missing and each.body.geoms and not self._moves(each)]
        if still:
            names = ", ".join(f"{link.name} ({link.body.mass:.3g} kg)" for link in still)
            self._said.append(
                f"masses of shapes, without effect as these links do not move and have no <inertial>: {names}"
            )

    def _ball_radius(self) -> float:
        mj = self._mj
        moving = mj.body_weldid != 0
        length = float(np.linalg.norm(mj.body_pos[moving], axis=1).sum()) / max(mj.njnt, 1)
        return float(max(MIN_BALL_M, BALL_SHARE * length))

    def _replace(self, link: _Link, mass: float) -> None:
        body = link.body
        if body.explicitinertial:
            whose = "assumed inertia" if link.missing else "inertia of the file"
            _scale(body, mass / body.mass)
            self._said.append(f"{link.name}: mass {mass:g} kg by --mass, and its {whose} in proportion")
            return
        radius = (3.0 * mass / (4.0 * math.pi * self._density)) ** (1.0 / 3.0)
        set_ball(body, mass, radius)
        self._said.append(
            f"{link.name}: mass {mass:g} kg by --mass, in a ball of {1e3 * radius:.3g} mm because the "
            "link has no shape"
        )

    def _report_bounds(self) -> None:
        """Report the file's bounds on masses and inertias, which MuJoCo applies when it compiles the
        model.
        """
        compiler = self._spec.compiler
        for what, bound, unit in (
            ("masses", compiler.boundmass, "kg"),
            ("moments of inertia", compiler.boundinertia, "kg·m²"),
        ):
            if bound > 0.0:
                self._said.append(f"{what} are raised to at least {bound:g} {unit}, as the file asks")

    def _scale_all(self, total: float) -> None:
        bodies = [body for body in self._spec.bodies if body.explicitinertial]
        present = math.fsum(body.mass for body in bodies)
        for body in bodies:
            _scale(body, total / present)
        self._said.append(
            f"all masses scaled from {present:.4g} kg to {total:g} kg in total, as settotalmass in the file "
            "asks"
        )


def _set_inertial(
    body: mujoco.MjsBody, mass: float, centre: Array, moments: Array, turn: Array | None = None
) -> None:
    body.explicitinertial, body.mass, body.ipos, body.inertia = True, mass, centre, moments
    body.iquat = np.array([1.0, 0.0, 0.0, 0.0]) if turn is None else turn
    body.fullinertia = np.array([math.nan, 0.0, 0.0, 0.0, 0.0, 0.0])


def set_ball(body: mujoco.MjsBody, mass: float, radius: float) -> None:
    """Give a body the mass, kg, and the inertia of a ball around its origin with this radius, m."""
    _set_inertial(body, mass, np.zeros(3), np.full(3, 0.4 * mass * radius**2))


def _scale(body: mujoco.MjsBody, factor: float) -> None:
    body.mass *= factor
    body.inertia = body.inertia * factor
    body.fullinertia = body.fullinertia * factor
