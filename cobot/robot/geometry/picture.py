"""A picture of the arm with its tool and its surroundings, drawn without a graphics card or a browser."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import trimesh

from cobot.errors import ConfigError, NotFoundError
from cobot.robot.description import RobotDescription
from cobot.robot.geometry.bodies import geometry_of
from cobot.robot.geometry.visuals import RobotVisuals, visuals_of
from cobot.types import Array, PictureView, Pose

VIEWS: dict[PictureView, tuple[float, float]] = {
    "iso": (-50.0, 25.0),
    "front": (0.0, 8.0),
    "side": (-90.0, 8.0),
    "top": (0.0, 89.9),
}
"""Direction from which the camera looks in each view: degrees about z from the x axis, and degrees above the
floor.
"""
WIDTH, HEIGHT = 640, 480
OVERSAMPLING = 2
MARGIN = 0.08
"""Free border around the arm, as a share of the picture."""
BACKGROUND = np.array([0.93, 0.94, 0.96])
SHADOW = 0.86
"""Brightness of the shadow on the floor, relative to the background."""
LIGHT = np.array([0.3, -0.5, 0.81])
AMBIENT = 0.4
NO_COLOR = (0.6, 0.62, 0.66)
STEPS = np.unique(np.round(2.0 ** np.arange(0.0, 10.1, 0.5)).astype(int))
"""Numbers of steps along an edge of a triangle. The picture uses the smallest number that leaves no gap."""
MAX_DRAWN_BYTES = 10_000_000
"""Maximum size of all meshes of a robot together. A picture of a robot with 23 MB of meshes took 7 to 10 s
and 1.5 GB of memory.
"""
MAX_MESHES = 64
"""Maximum number of meshes that are kept in memory for the next pictures."""
_MESHES: dict[tuple[Path, bytes, tuple[float, ...]], list[Facets]] = {}
"""Meshes by file, hash of the file content, and scale."""


@dataclass(frozen=True, slots=True)
class Facets:
    """Triangles in the base frame.

    Attributes:
        corners: coordinates of the three corners of each triangle, shape (n, 3, 3), m.
        colors: red, green and blue of each triangle, 0 to 1, shape (n, 3).
    """

    corners: Array
    colors: Array

    def placed(self, pose: Pose, color: Sequence[float] | None = None) -> Facets:
        """A copy of the triangles at a pose. If a colour is given, all of them get it."""
        colors = self.colors if color is None else np.broadcast_to(np.asarray(color[:3]), self.colors.shape)
        return Facets(pose.apply(self.corners), colors)


def draw(
    robot: RobotDescription, positions: Array, view: PictureView = "iso", others: Iterable[Facets] = ()
) -> bytes:
    """Draw the robot as a PNG, with a shadow on the plane z = 0 of its base frame.

    Links are drawn with their visuals if they have any, and other bodies as the collision checks see them. If
    the meshes of the visuals exceed `MAX_DRAWN_BYTES`, all bodies are drawn as the collision checks see them.

    Args:
        positions: joint positions, rad (m for a linear joint).
        others: triangles of parts that the robot's model does not have.

    Raises:
        ConfigError, NotFoundError: the visuals of the robot cannot be read, or there is nothing to draw.
    """
    facets = list(_bodies(robot, positions))
    facets += others
    if not facets:
        raise NotFoundError("the robot has neither visuals nor shapes for collision checks to draw")
    corners = np.concatenate([each.corners for each in facets])
    colors = np.concatenate([each.colors for each in facets])
    return _png(_rendered(corners, colors, view))


@lru_cache(64)
def solid(shape: str, size: tuple[float, ...]) -> Facets:
    """The surface of a solid, relative to the solid's centre.

    Args:
        size: dimensions, m. Box: edges. Sphere: radius. Cylinder, capsule: radius and length. Ellipsoid:
            three radii.
    """
    match shape:
        case "box":
            mesh = trimesh.creation.box(extents=size)
        case "cylinder":
            mesh = trimesh.creation.cylinder(radius=size[0], height=size[1], sections=40)
        case "capsule":
            mesh = trimesh.creation.capsule(radius=size[0], height=size[1], count=[24, 24])
        case _:
            mesh = trimesh.creation.icosphere(subdivisions=3)
            mesh.apply_scale(size if shape == "ellipsoid" else size[0])
    return surface(mesh.vertices, mesh.faces)


def surface(vertices: Array, triangles: npt.NDArray[np.integer]) -> Facets:
    """The triangles of a mesh, in grey."""
    corners = np.asarray(vertices, dtype=float)[np.asarray(triangles)]
    return Facets(corners, np.tile(NO_COLOR, (len(corners), 1)))


def _bodies(robot: RobotDescription, positions: Array) -> Iterator[Facets]:
    mj = robot.collision.mj
    data = mujoco.MjData(mj)
    data.qpos[:] = positions
    mujoco.mj_kinematics(mj, data)
    base = Pose(*_of_body(mj, data, robot.base_frame)).inverse()
    visuals = visuals_of(robot.model_file)
    links = [mj.body(body).name for body in range(mj.nbody)]
    drawn = visuals.visuals if _size_of(visuals) <= MAX_DRAWN_BYTES else []
    for visual in drawn:
        if visual.link not in links:
            raise ConfigError(
                f"the visuals of {robot.model_file} name the link {visual.link!r}, which the model does "
                f"not have; valid names: {', '.join(links)}"
            )
        pose = (
            base
            @ Pose(*_of_body(mj, data, visual.link))
            @ Pose.from_numbers([*visual.position, *visual.quaternion])
        )
        if visual.shape == "mesh":
            for part in _glb(visuals, visuals.number(visual) or 0, tuple(visual.sizes())):
                yield part.placed(pose, visual.color)
        else:
            yield solid(visual.shape, tuple(visual.sizes())).placed(pose, visual.color or NO_COLOR)
    seen = {visual.link for visual in drawn}
    geometry = geometry_of(robot)
    for index, body in enumerate(geometry.bodies):
        if body.name in seen:
            continue
        place = base @ Pose(data.xpos[index], data.xquat[index])
        for shape in body.shapes:
            if shape.collides and shape.kind != "plane":
                mesh = None if shape.mesh is None else geometry.meshes[shape.mesh]
                facets = solid(shape.kind, tuple(shape.size)) if mesh is None else surface(*mesh)
                yield facets.placed(place @ Pose.from_numbers(shape.pose), shape.rgba)


def _size_of(visuals: RobotVisuals) -> int:
    """The total size of all meshes, in bytes. Missing files are reported later, when they are read."""
    return sum(file.stat().st_size for file in visuals.meshes.values() if file.is_file())


def _of_body(mj: mujoco.MjModel, data: mujoco.MjData, name: str) -> tuple[Array, Array]:
    body = mj.body(name).id
    return data.xpos[body], data.xquat[body]


def _glb(visuals: RobotVisuals, number: int, scale: tuple[float, ...]) -> list[Facets]:
    content = visuals.read_mesh(number)
    file = list(visuals.meshes.values())[number]
    key = file, sha256(content).digest(), scale
    if key not in _MESHES:
        found = _read_glb(file, content, scale)
        while len(_MESHES) >= MAX_MESHES:
            _MESHES.pop(next(iter(_MESHES)), None)
        _MESHES[key] = found
    return _MESHES[key]


def _read_glb(file: Path, content: bytes, scale: tuple[float, ...]) -> list[Facets]:
    try:
        meshes = trimesh.load_scene(io.BytesIO(content), file_type="glb").dump()
        return [
            Facets(mesh.triangles * np.asarray(scale), _colors(mesh))
            for mesh in meshes
            if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
        ]
    except Exception as exc:  # the class depends on what is wrong
        raise ConfigError(
            f"{file}: is not a valid GLB file: {exc}; convert the robot again with `cobot new-robot`"
        ) from exc


def _colors(mesh: trimesh.Trimesh) -> Array:
    visual = mesh.visual
    if isinstance(visual, trimesh.visual.ColorVisuals):
        return np.asarray(visual.face_colors)[:, :3] / 255.0
    color = np.asarray(visual.material.main_color)[:3] / 255.0
    return np.tile(color, (len(mesh.faces), 1))


def _rendered(corners: Array, colors: Array, view: PictureView) -> npt.NDArray[np.uint8]:
    """An image of shape (HEIGHT, WIDTH, 3). Each pixel shows the nearest triangle."""
    width, height = OVERSAMPLING * WIDTH, OVERSAMPLING * HEIGHT
    right, up, towards = _camera(view)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    lit = np.abs((normals / np.maximum(lengths, 1e-12)) @ (LIGHT / np.linalg.norm(LIGHT)))
    shaded = colors * (AMBIENT + (1.0 - AMBIENT) * lit[:, None])
    shadow = corners - corners[..., 2:] / LIGHT[2] * LIGHT
    # The shadow lies below all parts, even if the floor is not at z = 0.
    points = np.stack([np.concatenate([corners, shadow]) @ axis for axis in (right, up, towards)], axis=-1)
    points[len(corners) :, :, 2] -= 1e3
    flat = np.broadcast_to(BACKGROUND * SHADOW, shaded.shape)
    low, high = points[: len(corners), :, :2].min((0, 1)), points[: len(corners), :, :2].max((0, 1))
    scale = (1.0 - 2.0 * MARGIN) * min(width / (high[0] - low[0] + 1e-9), height / (high[1] - low[1] + 1e-9))
    middle = 0.5 * (low + high)
    points[..., 0] = 0.5 * width + scale * (points[..., 0] - middle[0])
    points[..., 1] = 0.5 * height - scale * (points[..., 1] - middle[1])
    image = np.tile(BACKGROUND, (height * width, 1))
    _colour_pixels(image, points, np.concatenate([shaded, flat]), width, height)
    blocks = image.reshape(HEIGHT, OVERSAMPLING, WIDTH, OVERSAMPLING, 3)
    return np.asarray(np.round(255.0 * blocks.mean((1, 3))), dtype=np.uint8)


def _camera(view: PictureView) -> tuple[Array, Array, Array]:
    """Directions in the base frame: right and up in the picture, and towards the camera."""
    azimuth, elevation = np.radians(VIEWS[view])
    flat = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    towards = np.cos(elevation) * flat + np.array([0.0, 0.0, np.sin(elevation)])
    right = np.array([-flat[1], flat[0], 0.0])
    return right, np.cross(towards, right), towards


def _colour_pixels(image: Array, points: Array, colors: Array, width: int, height: int) -> None:
    """Give each pixel the colour of the nearest point that is drawn there."""
    edges = np.abs(points[..., :2] - np.roll(points[..., :2], 1, axis=1)).max((1, 2))
    steps = STEPS[np.minimum(np.searchsorted(STEPS, edges), len(STEPS) - 1)]
    depth = np.full(width * height, -np.inf, np.float32)
    corners = points.astype(np.float32)
    for number in np.unique(steps):
        chosen = np.flatnonzero(steps == number)
        lattice = _lattice(int(number))
        for part in np.array_split(chosen, max(1, len(chosen) * len(lattice) // 1_000_000)):
            found = lattice @ corners[part]
            columns, rows = found[..., 0].astype(np.int32), found[..., 1].astype(np.int32)
            pixels = np.where(
                (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height), rows * width + columns, 0
            )
            nearer = found[..., 2] > depth[pixels]
            nearer &= pixels > 0
            pixels, depths = pixels[nearer], found[..., 2][nearer]
            triangles = np.broadcast_to(part[:, None], columns.shape)[nearer]
            order = np.argsort(depths)  # the nearest point is written last, so it stays visible
            pixels = pixels[order]
            depth[pixels] = depths[order]
            image[pixels] = colors[triangles[order]]


@lru_cache(16)
def _lattice(number: int) -> Array:
    """Barycentric coordinates of evenly spaced points in a triangle, with `number` steps along each edge,
    shape (n, 3).
    """
    first, second = np.meshgrid(np.arange(number + 1), np.arange(number + 1), indexing="ij")
    inside = first + second <= number
    a, b = first[inside] / number, second[inside] / number
    return np.stack([a, b, 1.0 - a - b], axis=1).astype(np.float32)


def _png(image: npt.NDArray[np.uint8]) -> bytes:
    """The image as a PNG, 8 bits per colour. Source: the PNG specification, third edition."""
    height, width, _ = image.shape
    rows = np.concatenate([np.zeros((height, 1), np.uint8), image.reshape(height, -1)], axis=1)
    chunks = (
        (b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)),
        (b"IDAT", zlib.compress(rows.tobytes(), 6)),
        (b"IEND", b""),
    )
    written = [
        struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))
        for kind, content in chunks
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(written)
