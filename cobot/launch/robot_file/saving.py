"""Compiles a specification, and saves it as model.xml."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco
import numpy as np

from cobot.errors import ConfigError

EXACT = {
    "body": {"pos": "pos", "quat": "quat"},
    "joint": {"pos": "pos", "axis": "axis", "range": "range"},
    "site": {"pos": "pos", "quat": "quat"},
}
INERTIAL = {"pos": "ipos", "quat": "iquat", "mass": "mass", "diaginertia": "inertia"}
"""Attributes that are written to model.xml at full precision, and the names of their fields in MuJoCo."""


def compiled(file: Path, spec: mujoco.MjSpec) -> mujoco.MjModel:
    """Compile a specification.

    Raises:
        ConfigError: MuJoCo rejects it; the message gives MuJoCo's reason, and a remedy for links without
            inertia.
    """
    try:
        return spec.compile()
    except ValueError as exc:
        said = " ".join(str(exc).split())
        advice = "; each link that moves needs an <inertial>" if "inertia" in said else ""
        raise ConfigError(f"{file}: MuJoCo cannot load it: {said}{advice}") from exc


def save(spec: mujoco.MjSpec, folder: Path) -> None:
    """Save model.xml. Mesh names are relative to the file, and numbers have all their digits.

    MuJoCo writes six digits, which is only exact to some micrometres.
    """
    mj, root = spec.compile(), ElementTree.fromstring(spec.to_xml().replace(f"{folder}/", ""))
    for tag, fields in EXACT.items():
        for element in root.iter(tag):
            if name := element.get("name"):
                _refine(element, getattr(mj, tag)(name), fields)
    for body in root.iter("body"):
        if body.get("name") and (inertial := body.find("inertial")) is not None:
            _refine(inertial, mj.body(body.get("name")), INERTIAL)
    ElementTree.ElementTree(root).write(folder / "model.xml", encoding="utf-8")


def _refine(element: Element, compiled: object, fields: dict[str, str]) -> None:
    """Replace rounded numbers with the same numbers at full precision."""
    for attribute, field_name in fields.items():
        if (text := element.get(attribute)) is not None:
            rounded, exact = np.array(text.split(), dtype=float), np.ravel(getattr(compiled, field_name))
            if rounded.shape == exact.shape and np.allclose(rounded, exact, rtol=1e-5, atol=1e-9):
                element.set(attribute, " ".join(repr(float(value)) for value in exact))
