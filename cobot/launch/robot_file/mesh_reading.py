"""Mesh files: STL (binary and text), OBJ, PLY, DAE, GLB, glTF and MuJoCo's MSH. Results are in metres, with z
up as in ROS.

This code runs in the process of `worker_main`, whose memory and time are bounded.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import trimesh

from cobot.errors import InputError
from cobot.robot.geometry.mesh import Indices
from cobot.types import Array

MAX_BYTES = 300_000_000
MAX_TRIANGLES = 2_000_000
MAX_LOOK_TRIANGLES = 500_000
MIN_TRIANGLES = 12
"""Minimum number of triangles in a simplified mesh part: the number of triangles in a box."""
EDGE_RAD = 0.5
"""Angle between two triangles above which a simplified mesh is drawn with an edge."""


def read_mesh(file: Path) -> tuple[Array, Indices]:
    """Read a mesh. Returns its vertices (m), shape (n, 3), and its triangles, shape (m, 3).

    Raises:
        InputError: the mesh has no triangles or too many, or a number is not finite.
    """
    if file.suffix.lower() == ".msh":
        vertices, triangles = _msh(_content(file))
    else:
        whole = _scene(file, MAX_TRIANGLES).to_mesh()
        vertices, triangles = np.asarray(whole.vertices, float), np.asarray(whole.faces, np.int64)
    if not np.isfinite(vertices).all():
        raise InputError("has a vertex that is not finite")
    return vertices, triangles


def as_glb(file: Path, triangles: int) -> tuple[bytes, int]:
    """Convert a mesh to GLB, with its colours but without textures, simplified to about this number of
    triangles.

    Returns:
        The content, and its number of triangles. This number is higher than requested if parts have several
        colours or cannot be simplified that far.
    """
    if file.suffix.lower() == ".msh":
        scene = trimesh.Scene(trimesh.Trimesh(*_msh(_content(file))))
    else:
        scene = _scene(file, MAX_LOOK_TRIANGLES)
    meshes = {name: each for name, each in scene.geometry.items() if isinstance(each, trimesh.Trimesh)}
    share = triangles / max(sum(len(each.faces) for each in meshes.values()), 1)
    if share < 1.0:
        for name, mesh in meshes.items():
            scene.geometry[name] = _simplify(mesh, max(int(share * len(mesh.faces)), MIN_TRIANGLES))
    count = sum(len(each.faces) for each in scene.geometry.values() if isinstance(each, trimesh.Trimesh))
    return bytes(trimesh.exchange.gltf.export_glb(scene)), count


def _simplify(mesh: trimesh.Trimesh, triangles: int) -> trimesh.Trimesh:
    """Return the mesh with fewer triangles and the same colour. A mesh with several colours is not
    changed.
    """
    visual = mesh.visual
    colours = np.asarray(visual.face_colors if visual.kind in ("face", "vertex") else [])
    if len(mesh.faces) <= triangles or (colours != colours[:1]).any():
        return mesh
    whole = mesh.copy()
    whole.merge_vertices(merge_tex=True, merge_norm=True)  # otherwise the seams between normals would remain
    simple = whole.simplify_quadric_decimation(face_count=triangles)
    simple.update_faces(simple.nondegenerate_faces())
    if not len(simple.faces):
        return mesh  # it has an area of 0
    made = trimesh.graph.smooth_shade(simple, angle=EDGE_RAD)
    if visual.kind == "texture":
        made.visual = trimesh.visual.TextureVisuals(material=visual.material)
    elif len(colours):
        made.visual = trimesh.visual.ColorVisuals(made, face_colors=colours[0])
    return made


def _scene(file: Path, max_triangles: int) -> trimesh.Scene:
    content, kind = _content(file), file.suffix.lower().removeprefix(".")
    if kind == "dae" and not content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        raise InputError("is not COLLADA: its first character is not <")
    if kind == "dae" and b"<!DOCTYPE" in content:
        raise InputError("has a DOCTYPE; remove it")
    beside = trimesh.resolvers.FilePathResolver(str(file))  # Nothing is read from outside the mesh's folder.
    scene = trimesh.load_scene(io.BytesIO(content), file_type=kind, resolver=beside)
    if kind == "dae":
        metres = trimesh.units.unit_conversion(scene.units or "meters", "meters")
        scene.apply_transform(np.diag([metres, metres, metres, 1.0]))
    count = sum(
        len(scene.geometry[scene.graph[node][1]].faces)
        for node in scene.graph.nodes_geometry
        if hasattr(scene.geometry[scene.graph[node][1]], "faces")
    )
    if not 0 < count <= max_triangles:
        raise InputError(
            f"has {count} triangles; at most {max_triangles} are allowed, so simplify it"
            if count
            else "has no triangles: it is empty or damaged"
        )
    return scene


def _content(file: Path) -> bytes:
    if (size := file.stat().st_size) > MAX_BYTES:
        raise InputError(f"has {size} bytes; at most {MAX_BYTES} are allowed")
    return file.read_bytes()


def _msh(content: bytes) -> tuple[Array, Indices]:
    """Read MuJoCo's format, which contains the numbers of vertices, normals, texture coordinates and faces,
    and then the data in this order.
    """
    counts = np.frombuffer(content, "<i4", 4).tolist()
    vertices, normals, coordinates, faces = counts
    if min(counts) < 0 or 16 + 4 * (3 * (vertices + normals + faces) + 2 * coordinates) != len(content):
        raise InputError("is not a MuJoCo mesh: its size does not match its counts")
    places = np.frombuffer(content, "<f4", 3 * vertices, 16).astype(float).reshape(-1, 3)
    triangles = np.frombuffer(content, "<i4", 3 * faces, len(content) - 12 * faces).reshape(-1, 3)
    if not faces or triangles.min() < 0 or triangles.max() >= vertices:
        raise InputError("has no triangles, or a triangle with vertices that do not exist")
    return places, triangles.astype(np.int64)
