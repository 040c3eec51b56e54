"""The tool on the flange (mass, TCP, shapes), and the direction of gravity.

Both are stored in one versioned document in one file, which the service writes and rtloop reads at start.
Positions are in the flange's frame. The flange is the model's site `flange`, or without such a site the TCP
of the model file.
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
from cobot.robot.scene import Scene, SceneObject, symmetric
from cobot.strict import sentences
from cobot.types import Array, Numbers3, Numbers6, Numbers7

MAX_REACH_M = 2.0
"""Maximum distance of the centre of mass, the TCP and each shape from the flange."""
UNIT = 1e-3
"""Maximum difference of a quaternion's length from 1."""
ROUNDING = 1e-9
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)


@checked(frozen=True, config=_STRICT)
class Tool:
    """A tool. It is immutable: each change makes a new tool with the next version.

    Attributes:
        version: version number; 0 is the model's own tool before any change.
        mass: mass of the tool and the load, kg, in addition to the masses in the model file.
        centre: centre of that mass, m.
        inertia: inertia about the centre of mass, along the flange's axes, kg·m²: xx, xy, xz, yy, yz, zz;
            None for a point mass.
        tcp: TCP pose; None means the TCP of the model file.
        shapes: solids for the collision checks, by name.
        gravity: acceleration of free fall in the base frame, m/s²; None means the gravity of the model file.
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
        """Inertia about the centre of mass, along the flange's axes, shape (3, 3), kg·m²."""
        return symmetric(self.inertia or (0.0,) * 6)

    def mounted(self, scene: Scene) -> Scene:
        """The scene with the tool's shapes attached. Their poses remain relative to the flange."""
        if not self.shapes:
            return scene
        shapes = {name: replace(each, attached=True) for name, each in self.shapes.items()}
        return replace(scene, objects={**scene.objects, **shapes})


BARE = Tool()
_FILE = TypeAdapter(Tool)


def check_tool(tool: Tool, max_payload_kg: float, gravity: Array) -> None:
    """Check that a tool is physically possible and within the limits.

    Args:
        gravity: gravity of the model file in the base frame, m/s².

    Raises:
        InputError: the quaternion or the inertia is invalid.
        LimitError: a limit is exceeded; the message gives the value and the limit.
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
"""Maximum difference of gravity between places on earth, m/s²."""


def check_gravity(gravity: Numbers3, present: Array) -> None:
    """Check that gravity has the same magnitude as in the model file. Only its direction may differ, as for a
    tilted base.

    Raises:
        LimitError: the magnitude differs.
    """
    size, wanted = math.hypot(*gravity), float(np.linalg.norm(present))
    if not abs(size - wanted) <= GRAVITY_TOLERANCE:
        raise LimitError(
            "gravity: a tilted base changes only its direction; its magnitude must be the model file's "
            f"{wanted:.4g} m/s² within {GRAVITY_TOLERANCE:g}, got {size:.4g} m/s²"
        )


def check_inertia(name: str, inertia: Array, mass: float) -> None:
    """Check that a body of this mass can have this inertia, shape (3, 3), kg·m².

    Raises:
        InputError, LimitError: no body of this mass can have this inertia.
    """
    moments = np.linalg.eigvalsh(inertia)
    shown = ", ".join(f"{moment:.4g}" for moment in moments)
    if moments[0] <= 0.0:
        raise InputError(
            f"{name}: must be positive definite, but its principal moments are {shown} kg·m²; leave it "
            "out for a point mass"
        )
    if moments[2] > (moments[0] + moments[1]) * (1.0 + ROUNDING):
        raise InputError(
            f"{name}: is physically impossible: of its principal moments {shown} kg·m² the largest exceeds "
            "the sum of the others"
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
    """The file with the tool of one robot.

    Attributes:
        default: the tool that is used while there is no file. Its version is 0 for the bare flange, which
            every process begins with, and 1 otherwise.
    """

    path: Path
    default: Tool = BARE

    def read(self) -> Tool:
        """Read the tool.

        Raises:
            ConfigError: the file cannot be read or is invalid.
        """
        try:
            return _FILE.validate_json(read_kept(self.path))
        except FileNotFoundError:
            return self.default
        except ValidationError as exc:
            raise ConfigError(
                f"{self.path}: is not a tool: {sentences(exc.errors())}; correct it, or remove it to start "
                "without a tool"
            ) from exc
        except OSError as exc:
            raise ConfigError(f"{self.path}: cannot be read: {exc.strerror}") from exc

    def read_checked(self, max_payload_kg: float, gravity: Array) -> Tool:
        """Read the tool and check it with `check_tool`.

        Raises:
            ConfigError: the file cannot be read or is invalid, or the check fails.
        """
        tool = self.read()
        try:
            check_tool(tool, max_payload_kg, gravity)
        except (InputError, LimitError) as exc:
            raise ConfigError(f"{self.path}: {exc}") from exc
        return tool

    def write(self, tool: Tool) -> None:
        """Replace the file. The new content is on disk when this returns.

        Raises:
            UnavailableError: there is no space or no permission; the old file is unchanged.
        """
        keep(self.path, _FILE.dump_json(tool, indent=1), "the tool")
