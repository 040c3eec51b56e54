"""The scene: objects around the arm, attached objects and named frames. The scene is one versioned document
in one file.

The file is replaced atomically. If a process is killed while it writes, either the old or the new file
remains.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked

from cobot.errors import ConfigError, InputError, exhausted
from cobot.robot.cloud import CloudTree
from cobot.robot.geometry.cells import tree_of
from cobot.robot.kept import read_kept, stage
from cobot.strict import sentences
from cobot.types import Array, Numbers3, Numbers6, Numbers7

Shape = Literal["box", "sphere", "cylinder", "capsule", "mesh", "height_field", "point_cloud"]
_STRICT = ConfigDict(extra="forbid", allow_inf_nan=False)

COMPOUND = ("mesh", "height_field", "point_cloud")
"""Shapes that consist of several solids."""
_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
}


@checked(frozen=True, config=_STRICT)
class SceneObject:
    """A solid object.

    Attributes:
        size: dimensions, m. Box: edges along x, y and z. Sphere: radius. Cylinder and capsule, which lie
            along z: radius and length; the length of a capsule excludes its round ends. All others: edges of
            the bounding box, for display.
        pose: pose of the object's centre, in the base frame, or in the TCP's frame if it is attached.
        touch: bodies and objects that the object may touch while it is attached.
        mass: mass, kg. The arm carries it only while the object is attached.
        centre: centre of mass in the object's frame, m; None means the centre of a solid with uniform
            density.
        inertia: inertia about the centre of mass, along the object's axes, kg·m²: xx, xy, xz, yy, yz, zz;
            None means the inertia of a solid with uniform density.
        boxes: the boxes of a mesh, a height field or a point cloud: centre and edges, along the object's
            axes, m. The boxes of a point cloud contain all its voxels. Streams, pictures and masses use them;
            planners use the voxels, unless the object is attached.
        hulls: the convex parts of a mesh that are not boxes: corners of each.
        tolerance: how far the solids of a mesh may reach beyond the mesh, or the boxes of a point cloud
            beyond its voxels, m; 0 if they are exact.
        cells: the voxels of a point cloud, as text from `cobot.robot.geometry.cells.packed`.
        voxel: edge of these voxels, m.
        voxels: number of these voxels.
    """

    shape: Shape
    size: tuple[float, ...]
    pose: Numbers7
    attached: bool = False
    touch: tuple[str, ...] = ()
    mass: float = 0.0
    centre: Numbers3 | None = None
    inertia: Numbers6 | None = None
    boxes: tuple[Numbers6, ...] = ()
    hulls: tuple[tuple[Numbers3, ...], ...] = ()
    tolerance: float = 0.0
    cells: str = ""
    voxel: float = 0.0
    voxels: int = 0

    @property
    def tree(self) -> CloudTree | None:
        """The voxels of a point cloud."""
        return tree_of(self.cells, self.voxel) if self.cells else None

    @property
    def solids(self) -> int:
        """The number of convex solids for collision checks."""
        return len(self.boxes) + len(self.hulls) if self.shape in COMPOUND else 1


@checked(frozen=True, config=_STRICT)
class Scene:
    """A scene. It is immutable: each change makes a new scene with the next version.

    Attributes:
        version: version number; 0 is the empty scene before any change.
        objects: the objects by name.
        frames: poses of the named frames, in the base frame.
        allowed: pairs of bodies or objects that may touch.
        loads: how often `load` has changed.
    """

    version: int = 0
    objects: dict[str, SceneObject] = field(default_factory=dict)
    frames: dict[str, Numbers7] = field(default_factory=dict)
    allowed: tuple[tuple[str, str], ...] = ()
    loads: int = 0

    @property
    def load(self) -> dict[str, SceneObject]:
        """The attached objects that have a mass. The arm carries this mass."""
        return {name: each for name, each in self.objects.items() if each.attached and each.mass > 0.0}

    def without(self, names: Collection[str]) -> Scene:
        """The same scene without some objects."""
        return replace(self, objects={name: each for name, each in self.objects.items() if name not in names})

    def may_touch(self) -> set[frozenset[str]]:
        """Pairs of bodies, by name, whose collisions are not checked."""
        held = {
            frozenset((name, other))
            for name, each in self.objects.items()
            if each.attached
            for other in each.touch
        }
        return held | {frozenset(pair) for pair in self.allowed}


_FILE = TypeAdapter(Scene)


@dataclass(frozen=True, slots=True)
class SceneFile:
    """The file with the scene of one robot.

    Attributes:
        fixed: the fixtures of a cell, which are objects in every scene of this robot but not in the file. If
            there are any, the first scene has version 1, because version 0 is the empty scene that every
            process begins with.
    """

    path: Path
    fixed: dict[str, SceneObject] = field(default_factory=dict)

    def read(self, *, by_voxels: bool = True) -> Scene:
        """Read the scene. Without a file, it contains only the fixed objects.

        Args:
            by_voxels: also check the voxels of point clouds, which takes up to 0.1 s. Without this check, the
                caller may only use the boxes.

        Raises:
            ConfigError: the file cannot be read or is invalid.
        """
        try:
            scene = scene_in(read_kept(self.path), by_voxels=by_voxels)
            return replace(scene, objects={**scene.objects, **self.fixed})
        except FileNotFoundError:
            return Scene(objects=dict(self.fixed), version=1 if self.fixed else 0)
        except ValidationError as exc:
            raise ConfigError(
                f"{self.path}: is not a scene: {sentences(exc.errors())}; correct it, or remove it to start "
                "without objects"
            ) from exc
        except InputError as exc:
            raise ConfigError(f"{self.path}: {exc}") from exc
        except OSError as exc:
            raise ConfigError(f"{self.path}: cannot be read: {exc.strerror}") from exc

    def write(self, scene: Scene) -> None:
        """Replace the file. The new content is on disk when this returns.

        Raises:
            UnavailableError: see `stage`.
        """
        self.stage(scene)()

    def stage(self, scene: Scene) -> Callable[[], None]:
        """Write the scene to a temporary file. Returns a function that puts this file in the place of the old
        one. See `cobot.robot.kept.stage`.

        Raises:
            UnavailableError: there is no space or no permission; the old file is unchanged. The returned
                function may raise it, too.
        """
        own = {name: each for name, each in scene.objects.items() if name not in self.fixed}
        return stage(self.path, _FILE.dump_json(replace(scene, objects=own), indent=1), "the scene")


def scene_in(text: bytes, *, by_voxels: bool = True) -> Scene:
    """The scene in the text of a file; see `SceneFile.read`.

    Raises:
        ValidationError: the text is not a scene.
        InputError: the voxels of a point cloud are damaged, or its boxes do not contain them.
    """
    scene = _FILE.validate_json(text)
    for name, each in scene.objects.items():
        try:
            _require_whole(each, by_voxels)
        except InputError as exc:
            raise InputError(f"objects.{name}.{exc}") from exc
    return scene


def _require_whole(each: SceneObject, by_voxels: bool) -> None:
    """Check a point cloud in a file, because planners use its voxels and streams use its boxes."""
    if each.cells and not each.boxes:
        raise InputError("boxes: are missing; add the point cloud again")
    if by_voxels and each.tree and not each.tree.is_within(np.array(each.boxes)):
        raise InputError("boxes: do not contain all voxels of the point cloud; add the point cloud again")


def symmetric(six: Numbers6) -> Array:
    """The symmetric matrix with the elements xx, xy, xz, yy, yz, zz. Shape: (3, 3)."""
    xx, xy, xz, yy, yz, zz = six
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def compiled(
    spec: mujoco.MjSpec, scene: Scene, base: str, tcp: str, *, by_voxels: bool = False
) -> mujoco.MjModel:
    """The model with the objects. Each object is a body with the object's name, on the base or on the body
    that carries the TCP.

    Args:
        by_voxels: a point cloud that is not attached becomes one box around all its voxels, instead of its
            boxes; see `clouds_in`.

    Raises:
        InputError: MuJoCo rejects the model; the message gives the reason.
    """
    spec = spec.copy()
    site = spec.site(tcp)
    for name, each in scene.objects.items():
        parent = spec.body(base)
        if each.attached:  # a site cannot have children, so they are on a body at its place
            parent = site.parent.add_body(pos=site.pos, quat=site.quat)
        body = parent.add_body(name=name, pos=list(each.pose[:3]), quat=list(each.pose[3:]))
        tree = each.tree if by_voxels and not each.attached else None
        if tree is None:
            _fill(spec, body, name, each)
        else:
            _fill_with_cloud(body, tree)
    try:
        return spec.compile()
    except ValueError as exc:
        if error := exhausted(exc):
            raise error from exc
        raise InputError(f"MuJoCo rejects the scene: {' '.join(str(exc).split())}") from exc


def clouds_in(mj: mujoco.MjModel, scene: Scene) -> dict[int, CloudTree]:
    """The voxels of the unattached point clouds, by geom. The geoms belong to a model that `compiled` has
    made with `by_voxels`.
    """
    trees = {name: each.tree for name, each in scene.objects.items() if not each.attached}
    return {int(mj.body_geomadr[mj.body(name).id]): tree for name, tree in trees.items() if tree is not None}


def _fill_with_cloud(body: mujoco.MjsBody, tree: CloudTree) -> None:
    """Add a box around all voxels, and a box that is as large as one voxel. `Clearance` moves the second box
    to each voxel in turn.

    Without a contact type, MuJoCo would discard the voxel from the model of a URDF. Code that lists the pairs
    must therefore leave it out.
    """
    bounds = tree.bounds.tolist()
    rule = {"mass": 0.0, "type": _GEOMS["box"], "pos": bounds[:3], "contype": 1, "conaffinity": 1}
    body.add_geom(size=[0.5 * edge for edge in bounds[3:]], **rule)
    body.add_geom(size=[0.5 * tree.voxel_m] * 3, **rule)


def _fill(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, each: SceneObject) -> None:
    """Add the geoms of an object to its body."""
    rule = {"mass": 0.0, "contype": 1, "conaffinity": 1}
    if each.shape not in COMPOUND:
        body.add_geom(type=_GEOMS[each.shape], size=_half(each), **rule)
    for box in each.boxes:
        body.add_geom(type=_GEOMS["box"], pos=box[:3], size=[0.5 * edge for edge in box[3:]], **rule)
    for index, corners in enumerate(each.hulls):
        mesh = spec.add_mesh(name=f"{name} {index}", uservert=np.ravel(corners).tolist())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=mesh.name, **rule)


def _half(each: SceneObject) -> list[float]:
    """The size in MuJoCo's form: radii and half lengths, always three numbers."""
    if each.shape == "box":
        return [0.5 * edge for edge in each.size]
    if each.shape == "sphere":
        return [each.size[0], 0.0, 0.0]
    return [each.size[0], 0.5 * each.size[1], 0.0]
