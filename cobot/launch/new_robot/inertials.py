"""The `<inertial>` elements of a robot's file: finds incomplete ones, and repairs those that no body can
have.

A tensor I about the centre of mass belongs to a body if and only if the second moments Σ = ½ tr(I) E - I of
its mass are positive semidefinite; the triangle inequality of the principal moments is the same condition
(Wensing, Kim, Slotine, "Linear matrix inequalities for physically-consistent inertial parameter
identification", IEEE RA-L 2017, equation 12). Therefore a tensor is repaired by removing the negative part of
Σ.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from cobot.errors import ConfigError
from cobot.launch.new_robot.volumes import Solid
from cobot.types import Array
from cobot.xml_file import where

FLOOR = 1e-6
"""Smallest second moment of a repaired tensor, as a share of the sum of all three second moments. It is above
0 because MuJoCo checks inertias without a tolerance.
"""
ROUNDING = 1e-3
"""Share of a tensor. Smaller changes only correct rounding errors in the file, so they are not reported."""
MAX_RADIUS, MIN_RADIUS = 30.0, 0.001
"""Largest and smallest plausible radius of gyration of a body, as a share of the size of its shapes. Between
them, the value in the file is used, because shapes may be smaller than the link. Beyond them, the inertia is
in different units, such as kg·mm².
"""
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
MASSLESS_KG = 1e-6
"""Mass that some files give to frames, kg, for programs that need a mass for each link."""


@dataclass(frozen=True, slots=True)
class Stated:
    """The usable data of an `<inertial>` element that MuJoCo rejects.

    Attributes:
        mass: mass, kg; None if the mass is missing too.
        why: the error in the element, for the report.
    """

    mass: float | None
    why: str


def set_aside(file: Path, root: Element) -> dict[str, Stated]:
    """Remove the `<inertial>` elements that lack a mass or an inertia from a URDF. Returns their data by
    link.

    Raises:
        ConfigError: a mass or an inertia is not a finite number.
    """
    found: dict[str, Stated] = {}
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        name = str(link.get("name"))
        mass = _number(file, name, inertial.find("mass"), "value")
        tensor = inertial.find("inertia")
        moments = (
            []
            if tensor is None
            else [_number(file, name, tensor, key) for key in MOMENTS if key in tensor.attrib]
        )
        if mass is None or mass <= 0.0:
            why = "its <inertial> has no mass" if mass is None else f"its mass in the file is {mass:g} kg"
            found[name] = Stated(None, why)
        elif not any(moments) and mass <= MASSLESS_KG:
            found[name] = Stated(None, f"its mass in the file is {mass:g} kg, without inertia")
        elif not any(moments):
            found[name] = Stated(mass, f"its inertia in the file is {'0' if moments else 'missing'}")
        if name in found:
            link.remove(inertial)
    return found


def repair(spec: mujoco.MjSpec, solids: dict[str, Solid]) -> list[str]:
    """Replace physically impossible inertias. Returns a sentence for each replacement.

    Args:
        solids: the shapes of each link that has any, by the link's name.
    """
    said = []
    for body in spec.bodies:
        if not body.explicitinertial or body.mass <= 0.0:
            continue
        solid = solids.get(body.name)
        sentence = _fit_size(body, solid) if solid and solid.reach > 0.0 else None
        sentence = sentence or _make_possible(body, spec.compiler.balanceinertia)
        if sentence:
            said.append(f"{body.name}: {sentence}")
    return said


def _fit_size(body: mujoco.MjsBody, solid: Solid) -> str | None:
    """Replace an inertia whose radius of gyration does not match the size of the shapes."""
    radius = math.sqrt(max(float(np.trace(_tensor(body))), 0.0) / (2.0 * body.mass))
    if MIN_RADIUS <= radius / solid.reach <= MAX_RADIUS:
        return None
    _set(body, 0.4 * body.mass * solid.reach**2 * np.eye(3))
    return (
        f"inertia replaced: {body.mass:g} kg with a radius of gyration of {radius:.3g} m do not fit shapes "
        f"that reach {solid.reach:.3g} m; the inertia of a ball of that radius is used"
    )


def _make_possible(body: mujoco.MjsBody, balance: bool) -> str | None:
    """Remove the negative part of the second moments, unless the file asks MuJoCo to balance the moments."""
    tensor = _tensor(body)
    principal = np.linalg.eigvalsh(tensor)
    moments, axes = np.linalg.eigh(0.5 * np.trace(tensor) * np.eye(3) - tensor)
    if balance and principal[0] > 0.0:
        return "inertia balanced, as balanceinertia in the file asks" if moments[0] < 0.0 else None
    cut = np.maximum(moments, FLOOR * np.abs(moments).sum())
    if (cut == moments).all():
        return None
    whole = axes @ np.diag(cut.sum() - cut) @ axes.T
    _set(body, whole)
    if np.abs(whole - tensor).max() <= ROUNDING * np.abs(tensor).max():
        return None
    return (
        f"inertia repaired: no body has the principal moments {_listed(principal)} kg·m², as each must be "
        f"above 0 and at most the sum of the others; used are {_listed(np.linalg.eigvalsh(whole))} kg·m²"
    )


def _listed(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def _tensor(body: mujoco.MjsBody) -> Array:
    xx, yy, zz, xy, xz, yz = body.fullinertia
    if math.isnan(xx):
        return np.diag(body.inertia)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def _set(body: mujoco.MjsBody, tensor: Array) -> None:
    if math.isnan(body.fullinertia[0]):
        body.inertia = np.diag(tensor)
    else:
        body.fullinertia = tensor[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


def _number(file: Path, link: str, element: Element | None, key: str) -> float | None:
    """An attribute as a number; None if it is missing."""
    text = None if element is None else element.get(key)
    if text is None:
        return None
    with contextlib.suppress(ValueError):
        if math.isfinite(value := float(text)):
            return value
    raise ConfigError(f"{where(file, element)}: link {link!r}: {key} {text!r} must be a finite number")
