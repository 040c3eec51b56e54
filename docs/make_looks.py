"""What the shipped arms look like: config/NAME.visuals.yaml, with a GLB for each link in config/visuals/NAME.

Run it after a change of the shapes below: `python docs/make_looks.py`. The housings are modelled after the
collision shapes of the models, from distance functions: solids that are joined, cut and rounded. No file of a
manufacturer is used.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import mujoco
import numpy as np
import numpy.typing as npt
import trimesh
import yaml

CONFIG = Path(__file__).parents[1] / "config"
Points = npt.NDArray[np.float64]
Vector = Sequence[float]
Distance = Callable[[Points], Points]
"""Of points, shape (n, 3), m, the distance to a surface, shape (n,), negative inside."""

WHITE, SILVER, DARK = (0.90, 0.91, 0.92, 1.0), (0.62, 0.65, 0.68, 1.0), (0.16, 0.17, 0.19, 1.0)
ORANGE, BLUE = (0.98, 0.42, 0.05, 1.0), (0.25, 0.30, 0.36, 1.0)
Colour = tuple[float, float, float, float]
COARSE_M, FINE_M = 0.0095, 0.0065
"""Edge lengths of the triangles of housings and of what is small."""


@dataclass(frozen=True)
class Solid:
    """A part of one colour, inside a box in the link's frame, m."""

    distance: Distance
    low: Vector
    high: Vector
    colour: Colour
    edge_m: float = COARSE_M


def capsule(begin: Vector, end: Vector, radius: float) -> Distance:
    """A cylinder with a half sphere at each end."""
    first, along = np.array(begin), np.subtract(end, begin)

    def distance(points: Points) -> Points:
        share = np.clip((points - first) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        return np.linalg.norm(points - first - share[:, None] * along, axis=1) - radius

    return distance


def cylinder(begin: Vector, end: Vector, radius: float, rounding: float = 0.012) -> Distance:
    """A cylinder with rounded edges."""
    first, along = np.array(begin), np.subtract(end, begin)
    length = float(np.linalg.norm(along))
    axis = along / length

    def distance(points: Points) -> Points:
        from_middle = points - first - 0.5 * along
        height = from_middle @ axis
        across = np.linalg.norm(from_middle - height[:, None] * axis, axis=1)
        beyond = np.stack([across - radius + rounding, np.abs(height) - 0.5 * length + rounding], axis=1)
        outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
        return outside + np.minimum(beyond.max(axis=1), 0.0) - rounding

    return distance


def joined(*parts: Distance, blend: float = 0.04) -> Distance:
    """The parts as one, with fillets of about this radius, m."""

    def union(one: Distance, other: Distance) -> Distance:
        def distance(points: Points) -> Points:
            first, second = one(points), other(points)
            share = np.maximum(blend - np.abs(first - second), 0.0) / blend
            return np.minimum(first, second) - 0.25 * blend * share**2

        return distance

    return reduce(union, parts)


def cut(whole: Distance, away: Distance, blend: float = 0.008) -> Distance:
    """The whole without what is cut away, with rounded edges."""
    rest = joined(lambda points: -whole(points), away, blend=blend)
    return lambda points: -rest(points)


def surface(solid: Solid) -> trimesh.Trimesh:
    """The surface of a solid in triangles: each cell of a grid that it crosses has a vertex, moved onto it.

    The method is known as surface nets.
    """
    step = solid.edge_m
    axes = [
        np.arange(low - 2 * step, high + 2 * step, step)
        for low, high in zip(solid.low, solid.high, strict=True)
    ]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    inside = solid.distance(grid.reshape(-1, 3)).reshape(grid.shape[:3]) < 0.0
    corners = [
        inside[x : x - 1 or None, y : y - 1 or None, z : z - 1 or None]
        for x in (0, 1)
        for y in (0, 1)
        for z in (0, 1)
    ]
    count = sum(corner.astype(int) for corner in corners)
    crossed = (count > 0) & (count < 8)
    number = np.full(crossed.shape, -1)
    number[crossed] = np.arange(crossed.sum())
    vertices = grid[:-1, :-1, :-1][crossed] + 0.5 * step
    for _ in range(6):
        vertices = vertices - solid.distance(vertices)[:, None] * gradients(solid.distance, vertices)
    faces = [face for axis in range(3) for face in quads(inside, number, axis)]
    mesh = trimesh.Trimesh(vertices, np.concatenate(faces), process=False)
    mesh.visual = trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(baseColorFactor=solid.colour)
    )
    return mesh


def gradients(distance: Distance, points: Points) -> Points:
    """Unit normals, by central differences."""
    tiny = 1e-4 * np.eye(3)
    found = np.stack([distance(points + each) - distance(points - each) for each in tiny], axis=1)
    return found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)


def quads(
    inside: npt.NDArray[np.bool_], number: npt.NDArray[np.int64], axis: int
) -> list[npt.NDArray[np.int64]]:
    """Two triangles for each edge along an axis with one end inside, between the four cells around it."""
    ahead = np.moveaxis(inside, axis, 0)
    cells = np.moveaxis(number, axis, 0)
    leaves = ahead[:-1] & ~ahead[1:]
    enters = ~ahead[:-1] & ahead[1:]
    if axis == 1:  # moveaxis has turned the other two axes about
        leaves, enters = enters, leaves
    made = []
    for edges, order in ((leaves, (0, 1, 2, 3)), (enters, (3, 2, 1, 0))):
        along, one, other = np.nonzero(edges[:, 1:-1, 1:-1])
        around = [cells[along, one + i, other + j] for i, j in ((0, 0), (1, 0), (1, 1), (0, 1))]
        a, b, c, d = (around[each] for each in order)
        made += [np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)]
    return made


def ring(height: float, radius: float, axis: int = 2, width: float = 0.012) -> Solid:
    """A thin dark disc about an axis of the frame, where one housing turns against the next."""
    begin, end = np.zeros(3), np.zeros(3)
    begin[axis], end[axis] = height - 0.5 * width, height + 0.5 * width
    distance = cylinder(begin.tolist(), end.tolist(), radius, 0.004)
    low, high = np.full(3, -radius), np.full(3, radius)
    low[axis], high[axis] = begin[axis], end[axis]
    return Solid(distance, low.tolist(), high.tolist(), DARK, FINE_M)


def cap(center: Vector, axis: int, side: float, radius: float, colour: Colour) -> Solid:
    """A round cover on the side of an elbow, in the direction `side` of an axis."""
    middle = np.array(center, dtype=float)
    end = middle.copy()
    end[axis] += side * 0.014
    low, high = np.minimum(middle, end) - radius, np.maximum(middle, end) + radius
    return Solid(
        cylinder(middle.tolist(), end.tolist(), radius, 0.006), low.tolist(), high.tolist(), colour, FINE_M
    )


def upright(begin: float, elbow: float, radius: float, knee: float) -> list[Solid]:
    """A link of the iiwa that rises along z to an elbow, of which it has the half at -y."""
    tube = cylinder((0, 0, begin), (0, 0, elbow - 0.02), radius, 0.02)
    half = cylinder((0, -knee - 0.008, elbow), (0, -0.001, elbow), knee, 0.022)
    other = cylinder((0, 0.001, elbow), (0, 0.3, elbow), knee + 0.006, 0.004)
    side = knee + 0.02
    housing = Solid(cut(joined(tube, half), other), (-side, -side, begin), (side, side, elbow + side), WHITE)
    return [housing, cap((0, -knee - 0.006, elbow), 1, -1.0, 0.62 * knee, ORANGE), ring(begin, 0.94 * radius)]


def hanging(end: float, radius: float, knee: float) -> list[Solid]:
    """A link of the iiwa that leaves an elbow along y, of which it has the half at +z."""
    tube = cylinder((0, 0.02, 0), (0, end, 0), radius, 0.02)
    half = cylinder((0, 0, 0.001), (0, 0, knee + 0.008), knee, 0.022)
    other = cylinder((0, 0, -0.3), (0, 0, -0.001), knee + 0.006, 0.004)
    side = knee + 0.02
    housing = Solid(cut(joined(tube, half), other), (-side, -side, -side), (side, end, side), WHITE)
    return [housing, cap((0, 0, knee + 0.006), 2, 1.0, 0.62 * knee, ORANGE)]


def iiwa14() -> dict[str, list[Solid]]:
    """Each link's solids. The distances between the axes are those of config/iiwa14.xml."""
    foot = joined(
        cylinder((0, 0, 0), (0, 0, 0.045), 0.105), cylinder((0, 0, 0.02), (0, 0, 0.15), 0.082), blend=0.05
    )
    flange = cylinder((0, 0, 0.004), (0, 0, 0.045), 0.042, 0.006)
    wrist = joined(
        cylinder((0, 0, -0.062), (0, 0, 0.062), 0.062, 0.02), cylinder((0, 0.02, 0), (0, 0.079, 0), 0.05)
    )
    return {
        "base_link": [Solid(foot, (-0.11, -0.11, 0), (0.11, 0.11, 0.15), SILVER)],
        "link1": upright(0.0, 0.2025, 0.074, 0.078),
        "link2": hanging(0.2005, 0.072, 0.078),
        "link3": upright(0.004, 0.2155, 0.07, 0.074),
        "link4": hanging(0.1805, 0.067, 0.074),
        "link5": upright(0.004, 0.2155, 0.062, 0.05),
        "link6": [
            Solid(wrist, (-0.07, -0.07, -0.07), (0.07, 0.08, 0.07), WHITE),
            cap((0, 0, 0.06), 2, 1.0, 0.04, ORANGE),
        ],
        "link7": [Solid(flange, (-0.05, -0.05, 0), (0.05, 0.05, 0.05), SILVER, FINE_M)],
    }


def fr3() -> dict[str, list[Solid]]:
    """The collision capsules of each link, joined with fillets, with dark covers on their joints."""
    model = mujoco.MjModel.from_xml_path(str(CONFIG / "fr3.xml"))
    made: dict[str, list[Solid]] = {}
    for body in range(1, model.nbody):
        first = int(model.body_geomadr[body])
        ends, parts = [], []
        for geom in range(first, first + int(model.body_geomnum[body])):
            radius, half = model.geom_size[geom][:2]
            turn = np.zeros(9)
            mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
            along = half * turn.reshape(3, 3)[:, 2]
            begin, end = model.geom_pos[geom] - along, model.geom_pos[geom] + along
            is_flange = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER
            shape = cylinder if is_flange else capsule
            parts.append(shape(begin.tolist(), end.tolist(), 0.96 * float(radius)))
            ends += [begin - radius, begin + radius, end - radius, end + radius]
        low, high = np.min(ends, axis=0), np.max(ends, axis=0)
        name = model.body(body).name
        colour = {"base_link": DARK, "link7": SILVER}.get(name, WHITE)
        made[name] = [Solid(joined(*parts, blend=0.07), low.tolist(), high.tolist(), colour)]
    for name, radius in (("link2", 0.05), ("link4", 0.045), ("link6", 0.036)):
        reach = {"link2": 0.112, "link4": 0.097, "link6": 0.078}[name]
        made[name].append(cap((0, 0, reach - 0.01), 2, 1.0, radius, BLUE))
        if name != "link6":
            made[name].append(cap((0, 0, 0.01 - reach), 2, -1.0, radius, BLUE))
    return made


def write(name: str, links: dict[str, list[Solid]]) -> int:
    """Write the meshes and the manifest of an arm. The number of bytes of the meshes."""
    folder = CONFIG / "visuals" / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    entries, size = [], 0
    for link, solids in links.items():
        scene = trimesh.Scene([surface(each) for each in solids])
        content = scene.export(file_type="glb")
        (folder / f"{link}.glb").write_bytes(content)
        size += len(content)
        entries.append(
            {
                "link": link,
                "shape": "mesh",
                "position": [0.0, 0.0, 0.0],
                "quaternion": [1.0, 0.0, 0.0, 0.0],
                "file": f"visuals/{name}/{link}.glb",
            }
        )
    text = yaml.safe_dump({"visuals": entries}, sort_keys=False, default_flow_style=None)
    (CONFIG / f"{name}.visuals.yaml").write_text(
        f"# Written by docs/make_looks.py.\n{text}", encoding="utf-8"
    )
    return size


if __name__ == "__main__":
    for arm in (iiwa14, fr3):
        print(f"{arm.__name__}: {write(arm.__name__, arm()) / 1000:.0f} kB")
