"""The cell file, which describes the hand, parts, fixtures, belts and switches of the simulation.

All lengths are in metres, and all positions are in the robot's base frame.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, ClassVar, Literal, NamedTuple

from pydantic import ConfigDict, Field, PrivateAttr, field_validator, model_validator

from cobot.cell.meshes import MeshShape, file_beside, mesh_shape
from cobot.config.section import parse
from cobot.errors import ConfigError
from cobot.robot.io_points import IoKind
from cobot.strict import StrictModel, shown
from cobot.yaml_file import read_mapping

CELL_FILE = "cell.yaml"
MAX_PARTS = 32
MAX_FIXTURES = 64
MAX_BELTS = 8
MAX_SWITCHES = 16
MAX_OUTPUTS = 16
MAX_EXAMPLES = 16
MAX_EXAMPLE_BYTES = 400_000
"""Maximum size of the file of an example program."""
EXAMPLE_KINDS = {".json": "sequence", ".lua": "lua"}
"""Kinds of example programs, by the endings of their files."""
HAND = "hand"
"""Name of the hand, and first part of the names of its inputs and outputs."""
CUP = "cup"
"""Name of the suction cup, and first part of the names of its inputs and outputs."""
COUNT = "count"
"""Last part of the name of the input that gives the count of a light barrier."""
SPEED = "speed"
"""Last part of the name of the output that sets a belt's speed."""
SUCTION, VACUUM = "suction", "vacuum"
"""Last parts of two names: the cup's output, and the cup's sensor, which reports kPa."""
SHAPES = {"box": 3, "cylinder": 2, "sphere": 1}
"""Shapes of parts and fixtures, with the number of lengths that describe each."""

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]{0,31}$")]
Coordinate = Annotated[float, Field(ge=-20.0, le=20.0)]
Point = Annotated[tuple[Coordinate, Coordinate, Coordinate], Field(strict=False)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
Angles = Annotated[tuple[Angle, Angle, Angle], Field(strict=False)]
Friction = Annotated[float, Field(ge=0.0, le=5.0)]
Edge = Annotated[float, Field(ge=0.002, le=1.0)]
Edges = Annotated[tuple[Edge, Edge, Edge], Field(strict=False)]
Mass = Annotated[float, Field(ge=0.001, le=100.0)]
BeltSpeed = Annotated[float, Field(ge=-2.0, le=2.0)]


class CellEntry(StrictModel):
    """Base of all entries of the file."""

    model_config = ConfigDict(frozen=True)


class Hand(CellEntry):
    """A hand with two parallel fingers at the flange. The fingers move along the flange's x axis, and its z
    axis points out of the hand.

    Attributes:
        stroke_m: largest width between the fingers.
        max_force_n: each finger's largest force.
        max_speed_m_s: largest speed of the width.
        mass_kg: mass of the hand with its fingers.
        palm_m: edges of the palm along x, y and z.
        finger_m: edges of a finger: thickness (x), width (y) and length (z).
        tcp_from_tip_m: distance of the TCP from the fingertips.
    """

    stroke_m: Annotated[float, Field(ge=0.005, le=0.5)] = 0.08
    max_force_n: Annotated[float, Field(ge=1.0, le=2000.0)] = 100.0
    max_speed_m_s: Annotated[float, Field(ge=0.01, le=1.0)] = 0.2
    mass_kg: Annotated[float, Field(ge=0.05, le=50.0)] = 0.8
    palm_m: Edges = (0.12, 0.06, 0.07)
    finger_m: Edges = (0.012, 0.022, 0.055)
    tcp_from_tip_m: Annotated[float, Field(ge=0.0, le=1.0)] = 0.01

    @model_validator(mode="after")
    def _has_its_tcp_between_the_fingers(self) -> Hand:
        if self.tcp_from_tip_m > self.finger_m[2]:
            raise ValueError(
                f"tcp_from_tip_m is {self.tcp_from_tip_m:g}; it must be at most the length of a finger, "
                f"{self.finger_m[2]:g} m"
            )
        return self

    @property
    def closed_m(self) -> float:
        """Smallest width between the fingers."""
        return 0.0

    @property
    def tcp_m(self) -> float:
        """Distance of the TCP from the flange."""
        return self.palm_m[2] + self.finger_m[2] - self.tcp_from_tip_m


class Cup(CellEntry):
    """A suction cup at the flange. The flange's z axis points out of the cup; the TCP is at the centre of the
    lip.

    Attributes:
        force_n: pull at which a part comes off at full vacuum.
        vacuum_kpa: full vacuum of a cup on a part, as a difference from the pressure of the air.
        evacuate_s: time constant with which the vacuum builds up.
        radius_m: radius of the lip.
        length_m: distance of the lip from the flange.
        mass_kg: mass of the cup with its holder.
    """

    force_n: Annotated[float, Field(ge=0.1, le=5000.0)] = 60.0
    vacuum_kpa: Annotated[float, Field(ge=1.0, le=100.0)] = 70.0
    evacuate_s: Annotated[float, Field(ge=0.005, le=5.0)] = 0.05
    radius_m: Annotated[float, Field(ge=0.003, le=0.2)] = 0.015
    length_m: Annotated[float, Field(ge=0.02, le=0.5)] = 0.1
    mass_kg: Annotated[float, Field(ge=0.01, le=50.0)] = 0.3


class CellSolid(CellEntry):
    """A fixture: a solid that does not move.

    Attributes:
        size_m: box: edges along x, y and z; cylinder (along z): radius and length; sphere: radius. A mesh has
            a file instead.
        file: for a mesh: STL or OBJ file in the cell file's folder.
        scale: for a mesh: metres per unit of its file.
        tolerance_m: for a mesh: how far its solids may reach beyond its non-convex parts.
        hull: for a mesh: whether its convex hull is used.
        position_m: position of its centre; for a mesh, of the centre of its bounding box.
        rotation_deg: angles about the fixed x, y and z axes of the base frame, in this order.
        friction: coefficient of friction. Between two solids, the larger friction applies; between a solid
            and a part, the friction of the part.
    """

    MAX_LENGTH_M: ClassVar[float] = 10.0

    shape: Literal["box", "cylinder", "sphere", "mesh"]
    size_m: Annotated[tuple[float, ...], Field(strict=False)] = ()
    file: Annotated[str, Field(max_length=1000)] | None = None
    scale: Annotated[float, Field(ge=1e-6, le=1e3)] = 1.0
    tolerance_m: Annotated[float, Field(ge=0.0005, le=0.1)] = 0.003
    hull: bool = False
    position_m: Point
    rotation_deg: Angles = (0.0, 0.0, 0.0)
    friction: Friction = 0.8
    _mesh: MeshShape | None = PrivateAttr(default=None)

    @property
    def mesh(self) -> MeshShape:
        """The mesh that the file contains. Call `read_mesh` first."""
        assert self._mesh is not None
        return self._mesh

    @property
    def bounds_m(self) -> tuple[float, ...]:
        """`size_m`; for a mesh, the edges of its bounding box."""
        return self.mesh.size if self.shape == "mesh" else self.size_m

    def read_mesh(self, folder: Path) -> None:
        """Read a mesh file from the folder of the cell file.

        Raises:
            ConfigError: see `mesh_shape`.
        """
        if self.file is not None:
            self._mesh = mesh_shape(
                folder, self.file, self.scale, self.tolerance_m, self.hull, self.MAX_LENGTH_M
            )

    @model_validator(mode="after")
    def _is_a_mesh_or_has_lengths(self) -> CellSolid:
        if self.shape == "mesh" and self.file is None:
            raise ValueError("file is missing: a mesh needs an STL or OBJ file")
        if self.shape == "mesh" and self.size_m:
            raise ValueError("size_m: is not allowed for a mesh, whose size comes from its file; use scale")
        if self.shape != "mesh" and self.file is not None:
            raise ValueError(f"file: a {self.shape} must not have a file; did you mean shape: mesh?")
        return self

    @model_validator(mode="after")
    def _has_its_lengths(self) -> CellSolid:
        if self.shape == "mesh":
            return self
        wanted = SHAPES[self.shape]
        if len(self.size_m) != wanted:
            raise ValueError(
                f"size_m has {len(self.size_m)} {'length' if len(self.size_m) == 1 else 'lengths'}; a "
                f"{self.shape} needs {wanted}"
            )
        for length in self.size_m:
            if not (math.isfinite(length) and 0.002 <= length <= self.MAX_LENGTH_M):
                raise ValueError(
                    f"size_m: {shown(length)} is out of range, allowed: 0.002 to {self.MAX_LENGTH_M:g} m"
                )
        return self


class CellPart(CellSolid):
    """A loose body. It falls, slides, and can be grasped and dropped."""

    MAX_LENGTH_M: ClassVar[float] = 2.0

    mass_kg: Mass


class Belt(CellEntry):
    """A conveyor belt: a box whose surface moves along its own x axis. The output NAME.speed sets its
    speed.
    """

    size_m: Annotated[
        tuple[
            Annotated[float, Field(ge=0.05, le=10.0)],
            Annotated[float, Field(ge=0.02, le=5.0)],
            Annotated[float, Field(ge=0.005, le=2.0)],
        ],
        Field(strict=False),
    ]
    position_m: Point
    rotation_deg: Angles = (0.0, 0.0, 0.0)
    friction: Friction = 0.8
    speed_m_s: BeltSpeed = 0.0


class LightBarrier(CellEntry):
    """A boolean input that is true while something is between two points. With `count`, a second input
    NAME.count counts how often it became true.
    """

    type: Literal["light_barrier"]
    from_m: Point
    to_m: Point
    count: bool = False

    @model_validator(mode="after")
    def _has_a_length(self) -> LightBarrier:
        if math.dist(self.from_m, self.to_m) < 1e-3:
            raise ValueError("from_m and to_m are the same point; they must be at least 0.001 m apart")
        return self


class ContactSwitch(CellEntry):
    """A boolean input that is true while something presses on a fixture, a belt or a part.

    Attributes:
        body: name of the fixture, belt or part.
        force_n: total normal force at which it switches.
    """

    type: Literal["contact"]
    body: str
    force_n: Annotated[float, Field(ge=0.01, le=10_000.0)] = 0.5


class Distance(CellEntry):
    """An analog input that measures the distance (m) from a point to the nearest object in front of it. The
    value is at most `range_m`.
    """

    type: Literal["distance"]
    from_m: Point
    direction: Point
    range_m: Annotated[float, Field(ge=0.01, le=20.0)]

    @field_validator("direction")
    @classmethod
    def _is_a_direction(cls, direction: tuple[float, float, float]) -> tuple[float, float, float]:
        if math.hypot(*direction) < 1e-6:
            raise ValueError("direction is [0, 0, 0]; it must not be zero")
        return direction


class Output(CellEntry):
    """An output that has no effect in the simulation, for example one for a lamp."""

    kind: Annotated[IoKind, Field(strict=False)]


ExampleFile = Annotated[str, Field(max_length=1000, pattern=r"^.*\.(json|lua)$")]
ExampleLabel = Annotated[str, Field(min_length=1, max_length=100)]


class ExampleProgram(NamedTuple):
    """A program that comes with the cell, for users to run and to copy.

    Attributes:
        label: display name.
        file: path relative to the cell file's folder.
        text: content of the sequence file or the Lua program.
    """

    label: str
    file: Path
    text: str

    @property
    def kind(self) -> str:
        """ "sequence" or "lua"."""
        return EXAMPLE_KINDS[self.file.suffix]


Switch = Annotated[LightBarrier | ContactSwitch | Distance, Field(discriminator="type")]


class Cell(CellEntry):
    """A cell.

    Attributes:
        floor_m: height of the floor in the base frame; None for no floor.
        examples: files of example programs, by label.
    """

    floor_m: Coordinate | None = 0.0
    hand: Hand | None = None
    cup: Cup | None = None
    parts: Annotated[dict[Name, CellPart], Field(default_factory=dict, max_length=MAX_PARTS)]
    fixtures: Annotated[dict[Name, CellSolid], Field(default_factory=dict, max_length=MAX_FIXTURES)]
    belts: Annotated[dict[Name, Belt], Field(default_factory=dict, max_length=MAX_BELTS)]
    switches: Annotated[dict[Name, Switch], Field(default_factory=dict, max_length=MAX_SWITCHES)]
    outputs: Annotated[dict[Name, Output], Field(default_factory=dict, max_length=MAX_OUTPUTS)]
    examples: Annotated[dict[ExampleLabel, ExampleFile], Field(default_factory=dict, max_length=MAX_EXAMPLES)]
    _programs: tuple[ExampleProgram, ...] = PrivateAttr(default=())

    @property
    def programs(self) -> tuple[ExampleProgram, ...]:
        """The example programs; empty until `read_examples` has read their files."""
        return self._programs

    def read_examples(self, folder: Path) -> None:
        """Read the files of the example programs, which are in the cell file's folder.

        Raises:
            ConfigError: a file is missing, too large, or is not text.
        """
        found = []
        for label, name in self.examples.items():
            try:
                content = file_beside(folder, name).read_bytes()
                if len(content) > MAX_EXAMPLE_BYTES:
                    raise ConfigError(f"file: {name} has {len(content)} bytes, allowed: {MAX_EXAMPLE_BYTES}")
                found.append(ExampleProgram(label, Path(name), content.decode()))
            except ConfigError as exc:
                raise ConfigError(f"examples: {label}: {exc}") from exc
            except (OSError, ValueError) as exc:
                why = getattr(exc, "strerror", None) or "it is not UTF-8 text"
                raise ConfigError(f"examples: {label}: file: {name}: {why}") from exc
        self._programs = tuple(found)

    @model_validator(mode="after")
    def _has_one_gripper(self) -> Cell:
        if self.hand is not None and self.cup is not None:
            raise ValueError("hand and cup are both given; the arm has one flange: leave one of them out")
        return self

    @model_validator(mode="after")
    def _has_each_name_once(self) -> Cell:
        bodies = [*self.parts, *self.fixtures, *self.belts]
        points = [*self.switches, *self.outputs, *self.belts]
        for names in (bodies, points):
            for index, name in enumerate(names):
                if name in (HAND, CUP):
                    raise ValueError(f"the name {name!r} is reserved for the tool at the flange")
                if name in names[:index]:
                    raise ValueError(f"the name {name!r} occurs twice: give each entry a different name")
        for name, switch in self.switches.items():
            if isinstance(switch, ContactSwitch) and switch.body not in bodies:
                raise ValueError(
                    f"switches.{name}.body: there is no {shown(switch.body)}; "
                    f"valid names: {', '.join(bodies) or 'none'}"
                )
        return self

    @property
    def files(self) -> list[Path]:
        """The files of its meshes and examples, relative to the cell file's folder."""
        solids = (*self.parts.values(), *self.fixtures.values())
        names = [*(each.file for each in solids if each.file is not None), *self.examples.values()]
        return sorted({Path(os.path.normpath(each)) for each in names})

    def solids(self) -> Iterator[tuple[str, CellSolid | Belt]]:
        """All fixtures and belts, with their names."""
        yield from self.fixtures.items()
        yield from self.belts.items()


def load_cell(path: Path) -> Cell:
    """Read a cell file. For a folder, read its `cell.yaml`.

    Raises:
        ConfigError: the file is missing or invalid. The error names the file, the key, the value and the
            valid values.
    """
    file = cell_file(path)
    cell = parse(Cell, file, read_mapping(file))
    for section, solids in (("parts", cell.parts), ("fixtures", cell.fixtures)):
        for name, solid in solids.items():
            try:
                solid.read_mesh(file.parent)
            except ConfigError as exc:
                raise ConfigError(f"{file}: {section}.{name}.{exc}") from exc
    try:
        cell.read_examples(file.parent)
    except ConfigError as exc:
        raise ConfigError(f"{file}: {exc}") from exc
    return cell


def cell_file(path: Path) -> Path:
    """The cell file for a path, which may be a folder.

    Raises:
        ConfigError: there is no cell file.
    """
    file = path / CELL_FILE if path.is_dir() else path
    if not file.exists():
        raise ConfigError(f"{file}: no such file; it must be a cell file, or a folder with a {CELL_FILE}")
    return file
