"""The total load of the arm: the tool and the attached objects."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from cobot.errors import InputError, LimitError
from cobot.robot.rotations import matrix_of
from cobot.robot.scene import COMPOUND, Scene, SceneObject, symmetric
from cobot.robot.tool import BARE, Tool, check_tool
from cobot.types import Array, JointLimits, Numbers7, Pose

if TYPE_CHECKING:
    from cobot.robot.model import RobotModel

FARTHEST_M = 1.0
"""Maximum distance from the flange of a mass that is added to a tool."""


def carrying(tool: Tool, scene: Scene, tcp_in_flange: Numbers7) -> Tool:
    """The tool together with the masses of the attached objects. This is the load that the drives carry.

    Its version is the sum of the tool's version and `Scene.loads`. Both only increase, so successive loads
    never have the same version.
    """
    tcp = Pose.from_numbers(tcp_in_flange)
    parts = [(tool.mass, np.array(tool.centre), tool.inertia_matrix)]
    parts += [_in_flange(each, tcp @ Pose.from_numbers(each.pose)) for each in scene.load.values()]
    version = tool.version + scene.loads
    if len(parts) == 1:
        return replace(tool, version=version)
    mass = math.fsum(part[0] for part in parts)
    centre = sum((part[0] * part[1] for part in parts), np.zeros(3)) / mass
    inertia = sum((part[2] + moved(part[0], part[1] - centre) for part in parts), np.zeros((3, 3)))
    xx, xy, xz, yy, yz, zz = inertia[np.triu_indices(3)].tolist()
    x, y, z = centre.tolist()
    whole = (xx, xy, xz, yy, yz, zz) if np.linalg.eigvalsh(inertia)[0] > 0.0 else None
    return replace(tool, version=version, mass=mass, centre=(x, y, z), inertia=whole)


def beyond(tool: Tool, mounted: Tool) -> Tool:
    """The difference between a tool and the mounted tool, expressed as a tool; BARE if the tool is not
    heavier than the mounted one.

    The TCP does not change. The mass is left out if it would be farther than `FARTHEST_M` from the flange,
    because the two tools then have nothing in common.
    """
    mass = tool.mass - mounted.mass
    if not mass > 0.0:
        return BARE
    centre = (tool.mass * np.array(tool.centre) - mounted.mass * np.array(mounted.centre)) / mass
    if float(np.linalg.norm(centre)) > FARTHEST_M:
        return BARE
    inertia = tool.inertia_matrix + moved(tool.mass, np.array(tool.centre))
    inertia -= mounted.inertia_matrix + moved(mounted.mass, np.array(mounted.centre))
    moments, axes = np.linalg.eigh(inertia - moved(mass, centre))
    inertia = axes @ np.diag(np.maximum(moments, 0.0)) @ axes.T
    xx, xy, xz, yy, yz, zz = inertia[np.triu_indices(3)].tolist()
    x, y, z = centre.tolist()
    return Tool(version=tool.version, mass=mass, centre=(x, y, z), inertia=(xx, xy, xz, yy, yz, zz))


def check_load(
    model: RobotModel, limits: JointLimits, tool: Tool, scene: Scene, joints: Array, max_payload_kg: float
) -> None:
    """Check that the arm may carry a load, and that its drives can hold it in the current posture.

    Raises:
        InputError, LimitError: see `check_tool`. If the drives cannot hold the load, the error names the
            joint, the needed effort and its limit.
    """
    whole = carrying(tool, scene, model.tcp_in_flange(tool))
    held = "".join(f", with {name} of {each.mass:g} kg" for name, each in scene.load.items())
    if held and not whole.mass <= max_payload_kg:
        raise LimitError(
            f"mass: must be at most {max_payload_kg:g} kg (robot.max_payload_kg), got {whole.mass:g} kg: "
            f"the tool of {tool.mass:g} kg{held}"
        )
    check_tool(whole, max_payload_kg, model.file_gravity)
    before, around = model.tool, model.attached
    model.carry(tool, scene)
    try:
        efforts = np.abs(model.gravity_torques(joints))
    finally:
        model.carry(before, around)
    worst = int((efforts / limits.max_effort).argmax())
    if efforts[worst] > limits.max_effort[worst]:
        unit = limits.effort_unit(worst)
        raise LimitError(
            f"mass: {limits.names[worst]} would need {efforts[worst]:.4g} {unit} to hold {whole.mass:g} "
            f"kg{held} in the current position, but its limit is {limits.max_effort[worst]:.4g} {unit}; "
            "move the arm first"
        )


def moved(mass: float, arm: Array) -> Array:
    """The inertia of a point mass at the offset `arm` from the centre. Shape (3, 3), in kg·m²."""
    return mass * (float(arm @ arm) * np.eye(3) - np.outer(arm, arm))


def _in_flange(each: SceneObject, pose: Pose) -> tuple[float, Array, Array]:
    """Mass, centre and inertia of an object at a pose. The inertia is about the centre, along the flange's
    axes.
    """
    turn = pose.rotation
    middle, inertia = homogeneous(each)
    if each.centre is not None:
        middle = np.array(each.centre)
    if each.inertia is not None:
        inertia = symmetric(each.inertia)
    return each.mass, pose.apply(middle), turn @ inertia @ turn.T


def homogeneous(each: SceneObject) -> tuple[Array, Array]:
    """The centre of a solid with uniform density, and its inertia about the centre, both in the solid's own
    frame. Shapes: (3,) and (3, 3).

    These are the standard formulas; the round ends of a capsule are two half spheres, whose centre is 3/8 of
    the radius from their flat side.
    """
    if each.shape not in COMPOUND:
        return np.zeros(3), each.mass * np.diag(_squares(each))
    parts = [_of_box(np.array(box)) for box in each.boxes] + [_of_hull(np.array(hull)) for hull in each.hulls]
    volume = math.fsum(part[0] for part in parts)
    centre = sum((part[0] * part[1] for part in parts), np.zeros(3)) / volume
    inertia = sum((part[2] + moved(part[0], part[1] - centre) for part in parts), np.zeros((3, 3)))
    return centre, each.mass / volume * inertia


def _of_box(box: Array) -> tuple[float, Array, Array]:
    """Volume, centre, and inertia about the centre for density 1."""
    volume = float(np.prod(box[3:]))
    squares = np.square(box[3:])
    return volume, box[:3], volume / 12.0 * np.diag(squares.sum() - squares)


def _of_hull(corners: Array) -> tuple[float, Array, Array]:
    """Volume, centre and inertia of a convex solid. MuJoCo computes them."""
    spec = mujoco.MjSpec()
    mesh = spec.add_mesh(name="hull", uservert=corners.ravel().tolist())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    kind = mujoco.mjtGeom.mjGEOM_MESH
    spec.worldbody.add_body().add_geom(type=kind, meshname=mesh.name, density=1.0)
    try:
        mj = spec.compile()
    except ValueError as exc:
        raise InputError(f"mesh: its inertia cannot be computed: {' '.join(str(exc).split())}") from exc
    turn = matrix_of(mj.body_iquat[1])
    return float(mj.body_mass[1]), np.array(mj.body_ipos[1]), turn @ np.diag(mj.body_inertia[1]) @ turn.T


def _squares(each: SceneObject) -> Array:
    """The principal moments per mass, m²."""
    if each.shape == "box":
        x, y, z = np.square(each.size)
        return np.array([y + z, x + z, x + y]) / 12.0
    radius = each.size[0]
    if each.shape == "sphere":
        return np.full(3, 0.4 * radius**2)
    length = each.size[1]
    across, along = radius**2 / 4.0 + length**2 / 12.0, radius**2 / 2.0
    if each.shape == "capsule":
        ends = 4.0 * radius / (4.0 * radius + 3.0 * length)  # share of the ends in the volume
        offset = 0.5 * length * (0.5 * length + 0.75 * radius)
        across = (1.0 - ends) * across + ends * (0.4 * radius**2 + offset)
        along = (1.0 - ends) * along + ends * 0.4 * radius**2
    return np.array([across, across, along])
