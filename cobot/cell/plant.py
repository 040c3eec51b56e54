"""The MuJoCo model that a simulation with a cell steps: the arm, its hand, parts, fixtures and belts.

The arm's joints come first, so the joint vectors of the arm are the first part of the plant's vectors.

The contacts are stiff. Three measures keep a held part from creeping between the fingers: elliptic friction
cones, friction that is stiffer than the contact's normal direction, and MuJoCo's no-slip iterations. In 5 s,
a can of 0.25 kg creeps by 1.5 mm without the last two measures, by 0.15 mm without the iterations, and by
less than 1 µm with all three. While the arm turns a part, `rtloop.backends.cell_devices` adds the forces that
are missing in MuJoCo's contacts.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from cobot.cell.cell import CUP, HAND, Belt, Cell, CellPart, CellSolid, Hand, cell_file
from cobot.cell.own_hand import AnyHand, AnyOwnHand, cell_of, hand_of
from cobot.cell.plant_hands import (
    CONTACT,
    FINGERS,
    LIPS,
    ROLLING_M,
    TORSION_M,
    add_cup,
    add_hand,
    add_own_hand,
    flange_of,
)
from cobot.cell.surroundings import first_tool, part_in_scene, pose_of
from cobot.config import Settings
from cobot.errors import CollisionError, ConfigError, exhausted
from cobot.robot.description import RobotDescription
from cobot.robot.load import homogeneous
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array, Pose

FLOOR = "floor of the cell"
OVERLAP_M = 0.001
"""Maximum overlap of bodies at the start, m."""
IMPEDANCE_RATIO = 10.0
NO_SLIP_ITERATIONS = 3
GRASP = {**CONTACT, "solref": [0.002, 1.0]}
"""Contact between fingers and parts. It is the stiffest contact that a period of 1 ms permits."""
ROUND = ("cylinder", "sphere")
"""Shapes that can roll. Their rolling is damped."""
_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


@dataclass(frozen=True, slots=True)
class Plant:
    """A compiled plant.

    Attributes:
        hand: the hand; None for an arm without a hand.
        start: joint positions of the plant at the start. For the joints of the arm it contains zeros.
        flange: the site that carries the tool.
        tcp_body: the body that carries the TCP.
        gripping: the bodies between which parts are held.
        parts: the bodies of the parts, in the cell's order.
        base: pose of the base frame in the world.
    """

    cell: Cell
    hand: AnyHand | None
    mj: mujoco.MjModel
    start: Array
    flange: int
    tcp_body: int
    gripping: tuple[int, ...]
    parts: tuple[int, ...]
    base: Pose

    @property
    def tool(self) -> Tool:
        """The tool that is a body of the plant: the hand or the cup of the cell file. BARE if the cell file
        contains neither.
        """
        return first_tool(self.hand, self.cell)


def plant_of(robot: RobotModel, settings: Settings) -> Plant:
    """The plant for settings that have a cell, or a hand in the arm's model. Raises the same errors as
    `build_plant`.
    """
    cell, hand, names = cell_of(settings), hand_of(settings), settings.robot
    assert cell is not None
    own = None if isinstance(hand, Hand) else hand
    return build_plant(robot, cell, names.base_frame, names.tcp, own)


def build_plant(robot: RobotModel, cell: Cell, base: str, tcp: str, own: AnyOwnHand | None = None) -> Plant:
    """Add the cell to the arm's model.

    Args:
        own: the hand that is part of the arm's model.

    Raises:
        ConfigError: a name is already used in the arm's model, or MuJoCo rejects the model. The message gives
            the reason.
    """
    hand = cell.hand if own is None else own
    if robot.spec is None:
        raise ConfigError("a cell can only be added to a model that was read from a file; this model was not")
    spec = robot.spec.copy()
    for key in list(spec.keys):
        spec.delete(key)
    _make_contacts_stiff(spec)
    base_pose = _base_pose(robot.mj, base)
    frames = robot.frame_names
    for name in (*_added_by(hand, cell), *cell.parts, *cell.fixtures, *cell.belts):
        if name in frames:
            raise ConfigError(
                f"the arm has a body or site named {name!r}: give the entry in the cell file a different name"
            )
    if cell.floor_m is not None:
        _replace_floor(spec, base_pose, cell.floor_m)
    fingers: list[mujoco.MjsGeom] = []
    if isinstance(hand, Hand):
        fingers = add_hand(spec, robot, hand, tcp)
    elif hand is not None:
        fingers = add_own_hand(spec, hand)
    gripping = {finger.parent.name for finger in fingers}
    if cell.cup is not None:
        fingers = add_cup(spec, robot, cell.cup, tcp)
    for name, solid in cell.solids():
        _add_solid(spec, spec.body(base), name, solid, pose_of(solid))
    for name, part in cell.parts.items():
        body = _add_solid(spec, spec.worldbody, name, part, base_pose @ pose_of(part))
        body.add_freejoint()
        for finger in fingers:
            for shape in body.geoms:
                _add_grasp(spec, finger, shape, part)
    mj = _compiled(spec)
    arm = robot.limits.names
    if tuple(mj.joint(index).name for index in range(len(arm))) != arm:
        raise ConfigError(
            "the arm's flange is not the last body of its model; it must be the last one, so that the "
            "arm's joints come before those of the hand"
        )
    start = np.array(mj.qpos0)
    start[: len(arm)] = 0.0
    if isinstance(hand, Hand):
        for finger_name in FINGERS:
            start[mj.joint(finger_name).qposadr[0]] = 0.5 * hand.stroke_m
    return Plant(
        cell=cell,
        hand=hand,
        mj=mj,
        start=start,
        flange=mj.site(flange_of(robot.mj, tcp)).id,
        tcp_body=int(mj.site_bodyid[mj.site(tcp).id]),
        gripping=tuple(mj.body(name).id for name in gripping),
        parts=tuple(mj.body(name).id for name in cell.parts),
        base=base_pose,
    )


def _added_by(hand: AnyHand | None, cell: Cell) -> tuple[str, ...]:
    """The names that a hand or a cup adds to the model; none if the arm's model already contains the hand."""
    if cell.cup is not None:
        return (CUP, *LIPS)
    return (HAND, *FINGERS) if isinstance(hand, Hand) else ()


def check_start(plant: Plant, joints: Array) -> None:
    """Check that nothing overlaps at the start.

    Args:
        joints: the arm's joint positions.

    Raises:
        CollisionError: two bodies overlap; the message gives the depth.
    """
    mj = plant.mj
    data = mujoco.MjData(mj)
    data.qpos[:] = plant.start
    data.qpos[: len(joints)] = joints
    mujoco.mj_fwdPosition(mj, data)
    new = {
        *plant.cell.parts,
        *plant.cell.fixtures,
        *plant.cell.belts,
        *_added_by(plant.hand, plant.cell),
        FLOOR,
    }
    for contact in data.contact:
        names = [_name_of_geom(mj, geom, new) for geom in (contact.geom1, contact.geom2)]
        if contact.dist < -OVERLAP_M and not new.isdisjoint(names):
            raise CollisionError(
                f"{names[0]} and {names[1]} overlap by {-1e3 * contact.dist:.1f} mm at the start, allowed: "
                f"{1e3 * OVERLAP_M:g} mm: move one of them"
            )


def check_cell(robot: RobotDescription, settings: Settings) -> str:
    """Check that the cell in the settings can be simulated. Returns a description of the cell.

    Raises:
        ConfigError, CollisionError: the cell cannot be simulated; the message gives the file and the reason.
    """
    cell = cell_of(settings)
    if cell is None:
        return "none"
    joints = robot.positions[settings.robot.start_position].joints
    file = "no file" if settings.robot.cell is None else cell_file(settings.robot.cell)
    try:
        plant = plant_of(robot.model, settings)
        check_start(plant, np.array(joints))
    except (ConfigError, CollisionError) as exc:
        place = "robot.gripper.hand" if settings.robot.cell is None else file
        raise type(exc)(f"{place}: {exc}") from exc
    counts = (
        (cell.parts, "parts"),
        (cell.fixtures, "fixtures"),
        (cell.belts, "belts"),
        (cell.switches, "switches"),
    )
    own = "a hand" if isinstance(plant.hand, Hand) else "the hand of the arm's model"
    hand = "a suction cup" if cell.cup is not None else "no hand" if plant.hand is None else own
    return f"{file}: {hand}, " + ", ".join(f"{len(entries)} {what}" for entries, what in counts)


def _name_of_geom(mj: mujoco.MjModel, geom: int, bodies: Container[str]) -> str:
    """The name of a shape for messages. A shape of one of the given bodies gets the name of its body."""
    body = str(mj.body(mj.geom_bodyid[geom]).name)
    return body if body in bodies else str(mj.geom(geom).name or body)


def _base_pose(mj: mujoco.MjModel, base: str) -> Pose:
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    body = data.body(base)
    return Pose(body.xpos.copy(), body.xquat.copy())


def _make_contacts_stiff(spec: mujoco.MjSpec) -> None:
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    spec.option.impratio = IMPEDANCE_RATIO
    spec.option.noslip_iterations = NO_SLIP_ITERATIONS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST


def _replace_floor(spec: mujoco.MjSpec, base: Pose, height_m: float) -> None:
    """Add the floor of the cell, and switch off contacts with the floor in the arm's file."""
    for geom in spec.worldbody.geoms:
        if geom.type == mujoco.mjtGeom.mjGEOM_PLANE:
            geom.contype = geom.conaffinity = 0
    place = base @ Pose(np.array([0.0, 0.0, height_m]), np.array([1.0, 0.0, 0.0, 0.0]))
    spec.worldbody.add_geom(
        name=FLOOR,
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[5.0, 5.0, 0.1],
        pos=place.position,
        quat=place.quaternion,
        **CONTACT,
    )


def _add_solid(
    spec: mujoco.MjSpec, parent: mujoco.MjsBody, name: str, solid: CellSolid | Belt, pose: Pose
) -> mujoco.MjsBody:
    body = parent.add_body(name=name, pos=pose.position, quat=pose.quaternion)
    is_part = isinstance(solid, CellPart)
    shape = "box" if isinstance(solid, Belt) else solid.shape
    rule = {
        "mass": solid.mass_kg if isinstance(solid, CellPart) and shape != "mesh" else 0.0,
        "friction": [solid.friction, TORSION_M, ROLLING_M],
        "condim": 6 if is_part and shape in ROUND else 4,
        "priority": int(is_part),
        # With any speed but zero, MuJoCo compiles support for belts. The simulation sets the speed in each
        # cycle.
        "surfacevel": [1.0 if isinstance(solid, Belt) else 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        **CONTACT,
    }
    if not isinstance(solid, Belt) and shape == "mesh":
        _add_mesh(spec, body, name, solid, rule)
        return body
    size = solid.size_m
    half = {
        "box": [0.5 * edge for edge in size],
        "cylinder": [size[0], 0.5 * size[-1], 0.0],
        "sphere": [size[0], 0.0, 0.0],
    }[shape]
    body.add_geom(name=name, type=_GEOMS[shape], size=half, **rule)
    return body


def _add_mesh(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, solid: CellSolid, rule: dict[str, Any]
) -> None:
    """Add the convex solids of a mesh, with the inertia that follows from a uniform density."""
    mesh, number = solid.mesh, 0
    for box in mesh.boxes:
        geom = body.add_geom(type=_GEOMS["box"], pos=box[:3], size=[0.5 * edge for edge in box[3:]], **rule)
        number += 1
        geom.name = f"{name} {number}"
    for corners in mesh.hulls:
        number += 1
        made = spec.add_mesh(name=f"{name} {number}", uservert=np.ravel(corners).tolist())
        made.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body.add_geom(name=made.name, type=mujoco.mjtGeom.mjGEOM_MESH, meshname=made.name, **rule)
    if isinstance(solid, CellPart):
        centre, inertia = homogeneous(part_in_scene(solid, pose_of(solid).numbers))
        body.mass, body.ipos = solid.mass_kg, centre
        body.fullinertia = [*np.diag(inertia), *inertia[np.triu_indices(3, 1)]]
        body.explicitinertial = True


def _add_grasp(spec: mujoco.MjSpec, finger: mujoco.MjsGeom, shape: mujoco.MjsGeom, part: CellPart) -> None:
    """Add a contact between one shape of a finger or a cup and one shape of a part."""
    pair = spec.add_pair(
        geomname1=finger.name,
        geomname2=shape.name,
        gap=finger.gap,
        condim=6 if part.shape in ROUND else 4,
        friction=[part.friction, part.friction, TORSION_M, ROLLING_M, ROLLING_M],
    )
    pair.solref[:2], pair.solimp[:5] = GRASP["solref"], GRASP["solimp"]


def _compiled(spec: mujoco.MjSpec) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as exc:
        if error := exhausted(exc):
            raise error from exc
        raise ConfigError(f"MuJoCo rejects the cell: {' '.join(str(exc).split())}") from exc
