"""What is mounted on the flange: its mass, where its tip is, its shapes; and which way down is.

One document with a version, in one file, which the service writes and rtloop reads when it starts. Places are
in the frame of the flange: the model's site `flange`, or, without one, the TCP of the model's file.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from cobot.errors import ConfigError, InputError, LimitError
from cobot.robot.kept import keep, read_kept
from cobot.robot.scene import Numbers3, Numbers6, Scene, SceneObject, symmetric
from cobot.strict import sentences
from cobot.types import Array, Numbers7

MAX_REACH_M = 2.0
"""Neither the centre of mass nor the TCP nor a shape is further from the flange."""
UNIT = 1e-3
"""So much may a unit quaternion's length differ from 1."""
ROUNDING = 1e-9
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@checked(frozen=True, config=_STRICT)
class Tool:
    """Immutable: a change makes a new one, with the next version.

    Attributes:
        version: 0 is the model's own, that nobody has changed yet.
        mass: of tool and load, kg, on top of what the model's file has.
        centre: of that mass, m.
        inertia: about the centre, along the flange's axes, kg·m²: xx, xy, xz, yy, yz, zz; None: a point.
        tcp: None: that of the model's file.
        shapes: solids for the collision checks, by name.
        gravity: the acceleration of free fall in the base frame, m/s²; None: that of the model's file.
    """

    version: int = 0
    name: str = ""
    mass: float = 0.0
    centre: Numbers3 = (0.0, 0.0, 0.0)
    inertia: Numbers6 | None = None
    tcp: Numbers7 | None = None
    shapes: dict[str, SceneObject] = field(default_factory=dict)
    gravity: Numbers3 | None = None

    @property
    def inertia_matrix(self) -> Array:
        """About the centre of mass, along the flange's axes, shape (3, 3), kg·m²."""
        return symmetric(self.inertia or (0.0,) * 6)

    def mounted(self, scene: Scene) -> Scene:
        """The scene with the tool's shapes among what is attached; their poses stay those of the flange."""
        if not self.shapes:
            return scene
        shapes = {name: replace(each, attached=True) for name, each in self.shapes.items()}
        return replace(scene, objects={**scene.objects, **shapes})


BARE = Tool()
_FILE = TypeAdapter(Tool)


def check_tool(tool: Tool, max_payload_kg: float, gravity: Array) -> None:
    """See that there can be such a tool.

    Args:
        gravity: of the model's file, in the base frame, m/s².

    Raises:
        InputError: a quaternion or an inertia that is none.
        LimitError: more than is allowed; with the value and the limit.
    """
    if not 0.0 <= tool.mass <= max_payload_kg:
        raise LimitError(
            f"mass: must be from 0 to {max_payload_kg:g} kg (robot.max_payload_kg), got {tool.mass:g} kg"
        )
    _require_near("centre", tool.centre)
    if tool.inertia is not None:
        check_inertia("inertia", tool.inertia_matrix, tool.mass)
    if tool.tcp is not None:
        _require_near("tcp", tool.tcp[:3])
        _require_unit("tcp", tool.tcp[3:])
    for name, each in tool.shapes.items():
        _require_near(f"shapes.{name}", each.pose[:3])
        _require_unit(f"shapes.{name}", each.pose[3:])
    if tool.gravity is not None:
        check_gravity(tool.gravity, gravity)


GRAVITY_TOLERANCE = 0.1
"""Free fall differs by so much from place to place on earth, m/s²."""


def check_gravity(gravity: Numbers3, present: Array) -> None:
    """See that a base may be tilted so: gravity's size stays that of the model's file.

    Raises:
        LimitError: it does not.
    """
    size, wanted = math.hypot(*gravity), float(np.linalg.norm(present))
    if not abs(size - wanted) <= GRAVITY_TOLERANCE:
        raise LimitError(
            f"gravity: a tilted base turns it, but its size is part of the model's file and stays "
            f"{wanted:.4g} m/s² within {GRAVITY_TOLERANCE:g}, got {size:.4g} m/s²"
        )


def check_inertia(name: str, inertia: Array, mass: float) -> None:
    """See that some body of this mass has it: shape (3, 3), kg·m².

    Raises:
        InputError, LimitError: none has.
    """
    moments = np.linalg.eigvalsh(inertia)
    shown = ", ".join(f"{moment:.4g}" for moment in moments)
    if moments[0] <= 0.0:
        raise InputError(
            f"{name}: must be positive definite, its principal moments are {shown} kg·m²; "
            "leave it out for a point mass"
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        raise InputError(
            f"{name}: no body has it: of its principal moments {shown} kg·m² the largest is above the sum "
            "of the others"
        )
    largest = mass * MAX_REACH_M**2
    if moments[2] > largest:
        raise LimitError(
            f"{name}: its principal moments are {shown} kg·m²; {mass:g} kg within {MAX_REACH_M:g} m have at "
            f"most {largest:g} kg·m²"
        )


def _require_near(name: str, point: tuple[float, ...]) -> None:
    distance = math.hypot(*point)
    if not distance <= MAX_REACH_M:
        raise LimitError(f"{name}: must be at most {MAX_REACH_M:g} m from the flange, got {distance:.4g} m")


def _require_unit(name: str, turn: tuple[float, ...]) -> None:
    length = math.hypot(*turn)
    if not abs(length - 1.0) <= UNIT:
        raise InputError(f"{name}: the quaternion's length must be 1 within {UNIT:g}, got {length:.4g}")


@dataclass(frozen=True, slots=True)
class ToolFile:
    """Where the tool of one robot is kept."""

    path: Path

    def read(self) -> Tool:
        """The tool; the model's own if there is no file.

        Raises:
            ConfigError: it cannot be read, or is none.
        """
        try:
            return _FILE.validate_json(read_kept(self.path))
        except FileNotFoundError:
            return BARE
        except ValidationError as exc:
            raise ConfigError(
                f"{self.path}: is no tool: {sentences(exc.errors())}; mend it, or remove it to begin "
                "without a tool"
            ) from exc
        except OSError as exc:
            raise ConfigError(f"{self.path}: cannot be read: {exc.strerror}") from exc

    def read_checked(self, max_payload_kg: float, gravity: Array) -> Tool:
        """The same, if there can be such a tool; see `check_tool`.

        Raises:
            ConfigError: there cannot, or see `read`.
        """
        tool = self.read()
        try:
            check_tool(tool, max_payload_kg, gravity)
        except (InputError, LimitError) as exc:
            raise ConfigError(f"{self.path}: {exc}") from exc
        return tool

    def write(self, tool: Tool) -> None:
        """Replace the file, on the disk when this returns.

        Raises:
            UnavailableError: there is no room or no permission; the old one is there as it was.
        """
        keep(self.path, _FILE.dump_json(tool, indent=1), "the tool")
