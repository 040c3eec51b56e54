"""A robot's shape: its bodies, joints and solids, including those of its tool and its scene."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import numpy.typing as npt

from cobot.robot.description import RobotDescription
from cobot.types import Array, Numbers7, Pose

SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_PLANE): "plane",
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
    int(mujoco.mjtGeom.mjGEOM_ELLIPSOID): "ellipsoid",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_MESH): "mesh",
}
SLIDE = mujoco.mjtJoint.mjJNT_SLIDE
NO_COLOUR = [0.5, 0.5, 0.5, 1.0]
"""Default colour of MuJoCo. A geometry of this colour uses the colour of its material instead."""
COLORS = {"tool": [0.1, 0.55, 0.6, 1.0], "scene": [0.45, 0.5, 0.62, 1.0]}
"""Colours of the parts that do not belong to the robot's model."""
Version = tuple[int, int, bytes]
Mesh = tuple[Array, npt.NDArray[np.int32]]


@dataclass(frozen=True, slots=True)
class BodyJoint:
    """A joint that moves its body and all child bodies.

    Attributes:
        index: index in the robot's order of joints.
        slides: true if the joint slides along its axis, false if it turns about its axis.
        axis, anchor: axis direction, and a point on it, in the body's frame.
        reference: joint position for which the pose of the body is given, rad or m.
    """

    index: int
    slides: bool
    axis: list[float]
    anchor: list[float]
    reference: float


@dataclass(frozen=True, slots=True)
class Shape:
    """One solid of a body.

    Attributes:
        kind: one of `SHAPES`.
        size: dimensions, m. Box: edges. Sphere: radius. Cylinder, capsule: radius and length. Ellipsoid:
            three radii. Plane: edges (0: infinite). Mesh: empty.
        pose: pose in the body's frame.
        rgba: colour, each component from 0 to 1.
        mesh: index in the list of meshes.
        collides: whether the collision checks use the solid; if not, it is only displayed.
    """

    kind: str
    size: list[float]
    pose: Numbers7
    rgba: list[float]
    mesh: int | None
    collides: bool


@dataclass(frozen=True, slots=True)
class Body:
    """A rigid body.

    Attributes:
        parent: index of the parent body, which comes before it. The first body is the world, which is its own
            parent.
        part: "robot", "tool" or "scene".
        pose: pose in the parent's frame, with all its joints at their references.
        joints: joints that move the body, in order.
    """

    name: str
    parent: int
    part: str
    pose: Numbers7
    joints: list[BodyJoint]
    shapes: list[Shape]


@dataclass(frozen=True, slots=True)
class Geometry:
    """The geometry of one robot.

    Attributes:
        base: index of the body whose frame is used for all poses of the API.
        tcp: index of the body that carries the TCP, and the pose of the TCP in the frame of this body.
        meshes: for each mesh, the vertices, shape (n, 3), m, and the triangles, shape (k, 3).
    """

    bodies: list[Body]
    base: int
    tcp: tuple[int, Numbers7]
    meshes: list[Mesh]


def geometry_version(robot: RobotDescription) -> Version:
    """The version of the geometry. It depends on scene, tool and position limits, and changes whenever the
    result of `geometry_of` changes.
    """
    limits = robot.limits
    ranges = limits.min_position.tobytes() + limits.max_position.tobytes()
    return robot.collision.scene.version, robot.collision.tool.version, ranges


def geometry_of(robot: RobotDescription) -> Geometry:
    """The robot's geometry that streams use for collision checks, and the visual geometry."""
    mj = robot.collision.mj_in_boxes
    tcp = robot.model.mj.site(robot.model.tcp_site)
    return Geometry(
        bodies=[_body(robot, mj, index) for index in range(mj.nbody)],
        base=mj.body(robot.base_frame).id,
        tcp=(int(mj.site_bodyid[mj.site(tcp.name).id]), Pose(tcp.pos, tcp.quat).numbers),
        meshes=[_mesh(mj, index) for index in range(mj.nmesh)],
    )


def _body(robot: RobotDescription, mj: mujoco.MjModel, index: int) -> Body:
    name = str(mj.body(index).name)
    first, first_joint = int(mj.body_geomadr[index]), int(mj.body_jntadr[index])
    part = "scene" if name in robot.collision.scene.objects else "robot"
    part = "tool" if name in robot.collision.tool.shapes else part
    return Body(
        name=name,
        parent=int(mj.body_parentid[index]),
        part=part,
        pose=_pose(mj.body_pos[index], mj.body_quat[index]),
        joints=[_joint(mj, first_joint + offset) for offset in range(mj.body_jntnum[index])],
        shapes=[
            _shape(mj, geom, COLORS.get(part))
            for geom in range(first, first + mj.body_geomnum[index])
            if int(mj.geom_type[geom]) in SHAPES
        ],
    )


def _joint(mj: mujoco.MjModel, index: int) -> BodyJoint:
    return BodyJoint(
        index=index,
        slides=bool(mj.jnt_type[index] == SLIDE),
        axis=mj.jnt_axis[index].tolist(),
        anchor=mj.jnt_pos[index].tolist(),
        reference=float(mj.qpos0[mj.jnt_qposadr[index]]),
    )


def _shape(mj: mujoco.MjModel, geom: int, color: list[float] | None) -> Shape:
    kind = SHAPES[int(mj.geom_type[geom])]
    material = int(mj.geom_matid[geom])
    own = mj.geom_rgba[geom].tolist() != NO_COLOUR
    rgba = mj.geom_rgba[geom] if own or material < 0 else mj.mat_rgba[material]
    return Shape(
        kind=kind,
        size=_size(kind, mj.geom_size[geom].tolist()),
        pose=_pose(mj.geom_pos[geom], mj.geom_quat[geom]),
        rgba=color or rgba.astype(float).round(4).tolist(),
        mesh=int(mj.geom_dataid[geom]) if kind == "mesh" else None,
        collides=bool(mj.geom_contype[geom] or mj.geom_conaffinity[geom]),
    )


def _size(kind: str, size: list[float]) -> list[float]:
    """The full size of a shape. MuJoCo's sizes are half sizes."""
    if kind == "mesh":
        return []
    if kind in ("sphere", "ellipsoid"):
        return size[: 1 if kind == "sphere" else 3]
    if kind in ("cylinder", "capsule"):
        return [size[0], 2.0 * size[1]]
    return [2.0 * half for half in size[: 2 if kind == "plane" else 3]]


def _mesh(mj: mujoco.MjModel, index: int) -> Mesh:
    vertex, face = int(mj.mesh_vertadr[index]), int(mj.mesh_faceadr[index])
    return (
        mj.mesh_vert[vertex : vertex + mj.mesh_vertnum[index]],
        mj.mesh_face[face : face + mj.mesh_facenum[index]],
    )


def _pose(position: Array, quaternion: Array) -> Numbers7:
    x, y, z = position.tolist()
    w, i, j, k = quaternion.tolist()
    return x, y, z, w, i, j, k
