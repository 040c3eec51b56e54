"""The MuJoCo model that a simulation with a cell steps: the arm, its hand, parts, fixtures and belts.

The arm's joints come first, so its joint vectors are the first part of the plant's.

Contacts are those of stiff bodies. Elliptic friction cones, friction stiffer than the contact's normal
direction, and MuJoCo's no-slip iterations keep a held part from creeping between the fingers. In 5 s a can of
0.25 kg creeps by 1.5 mm without the last two, by 0.15 mm without the iterations, by less than 1 µm with all.
While the arm turns a part, `rtloop.backends.cell_devices` makes up for what MuJoCo's contacts leave out.
"""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from cobot.cell.cell import CUP, HAND, Belt, Cell, CellPart, CellSolid, Cup, Hand, cell_file
from cobot.cell.own_hand import AnyHand, AnyOwnHand, TurningHand, cell_of, hand_of
from cobot.cell.surroundings import FINGER_SHARE, LIP_M, first_tool, part_in_scene, pose_of
from cobot.config import Settings
from cobot.errors import CollisionError, ConfigError, exhausted
from cobot.robot.description import RobotDescription
from cobot.robot.load import homogeneous
from cobot.robot.model import RobotModel
from cobot.robot.tool import Tool
from cobot.types import Array, Pose

FLOOR = "floor of the cell"
FINGERS = ("hand finger 1", "hand finger 2")
"""Names of the joints that the hand's drives move, and of the bodies and shapes of a cell file's hand. A hand
that turns has one drive."""
FOLLOWER = "hand follower"
"""First part of the names of joints that follow the drive of a hand that turns."""
LIPS = tuple(f"{CUP} lip {number}" for number in range(1, 9))
"""Names of the balls that are a cup's lip: it is closed where all of them touch one body."""
SOFT_M = 0.0005
"""How far a lip reaches beyond its balls, as it is soft."""
OVERLAP_M = 0.001
"""How far bodies may overlap at the start."""
IMPEDANCE_RATIO = 10.0
NO_SLIP_ITERATIONS = 3
CONTACT = {"solref": [0.004, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0]}
GRASP = {**CONTACT, "solref": [0.002, 1.0]}
"""Between fingers and parts: the stiffest contact that a period of 1 ms permits."""
DRIVE_KG = 0.5
"""Mass of a finger's drive as the finger feels it: its rotor behind a gear."""
FOLLOWER_SHARE, DAMPING_PER_S = 0.1, 2.0
"""Inertia of a joint that follows, as a share of the drive's; and damping per inertia of joints that turn."""
TORSION_M = 0.005
ROLLING_M = 0.0002
ROUND = ("cylinder", "sphere")
"""Shapes that roll, so rolling is damped."""
_GEOMS = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
}


@dataclass(frozen=True, slots=True)
class Plant:
    """A compiled plant.

    Attributes:
        hand: None without one.
        start: its joint positions at the start; those of the arm are zeros.
        flange: the site that carries the tool.
        tcp_body: the body with the TCP.
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
        """The tool that is a body of the plant: the hand or the cup of the cell file; BARE without one."""
        return first_tool(self.hand, self.cell)


def plant_of(robot: RobotModel, settings: Settings) -> Plant:
    """The plant of the settings, which have a cell or a hand of the arm's model; raises as `build_plant`."""
    cell, hand, names = cell_of(settings), hand_of(settings), settings.robot
    assert cell is not None
    own = None if isinstance(hand, Hand) else hand
    return build_plant(robot, cell, names.base_frame, names.tcp, own)


def build_plant(robot: RobotModel, cell: Cell, base: str, tcp: str, own: AnyOwnHand | None = None) -> Plant:
    """Add the cell to the arm's model.

    Args:
        own: the hand that is part of the arm's model.

    Raises:
        ConfigError: a name is one of the arm's, or MuJoCo rejects the model, with the reason.
    """
    hand = cell.hand if own is None else own
    if robot.spec is None:
        raise ConfigError("this model was not read from a file, so no cell can be added to it")
    spec = robot.spec.copy()
    for key in list(spec.keys):
        spec.delete(key)
    _make_contacts_stiff(spec)
    base_pose = _base_pose(robot.mj, base)
    frames = robot.frame_names
    for name in (*_added_by(hand, cell), *cell.parts, *cell.fixtures, *cell.belts):
        if name in frames:
            raise ConfigError(f"the arm has a body or site named {name!r}: rename that of the cell")
    if cell.floor_m is not None:
        _replace_floor(spec, base_pose, cell.floor_m)
    fingers: list[mujoco.MjsGeom] = []
    if isinstance(hand, Hand):
        fingers = _add_hand(spec, robot, hand, tcp)
    elif hand is not None:
        fingers = _add_own_hand(spec, hand)
    gripping = {finger.parent.name for finger in fingers}
    if cell.cup is not None:
        fingers = _add_cup(spec, robot, cell.cup, tcp)
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
            "the arm's joints must come before those of the hand: its flange is not its last body"
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
        flange=mj.site(_flange(robot.mj, tcp)).id,
        tcp_body=int(mj.site_bodyid[mj.site(tcp).id]),
        gripping=tuple(mj.body(name).id for name in gripping),
        parts=tuple(mj.body(name).id for name in cell.parts),
        base=base_pose,
    )


def _added_by(hand: AnyHand | None, cell: Cell) -> tuple[str, ...]:
    """The names that a hand or a cup adds to the model; the arm's own hand adds none."""
    if cell.cup is not None:
        return (CUP, *LIPS)
    return (HAND, *FINGERS) if isinstance(hand, Hand) else ()


def check_start(plant: Plant, joints: Array) -> None:
    """See that nothing overlaps at the start.

    Args:
        joints: of the arm.

    Raises:
        CollisionError: two bodies do, with how far.
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
                f"{names[0]} and {names[1]} overlap by {-1e3 * contact.dist:.1f} mm at the start, allowed is "
                f"{1e3 * OVERLAP_M:g} mm: move one of them"
            )


def check_cell(robot: RobotDescription, settings: Settings) -> str:
    """See that the cell of the settings can be simulated; its contents in words.

    Raises:
        ConfigError, CollisionError: it cannot, with the file and the reason.
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
    """The name of a shape; of one of these bodies, the body's."""
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
    """Add the floor of the cell, and let nothing touch that of the arm's file."""
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


def _flange(mj: mujoco.MjModel, tcp: str) -> str:
    """The site that carries the tool: the arm's flange, or without one its TCP."""
    flange = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_SITE, "flange")
    if flange < 0 or mj.body_weldid[mj.site_bodyid[flange]] != mj.body_weldid[mj.site(tcp).bodyid[0]]:
        return tcp
    return "flange"


def _body_at_flange(spec: mujoco.MjSpec, robot: RobotModel, tcp: str, name: str) -> mujoco.MjsBody:
    flange = _flange(robot.mj, tcp)
    place = robot.mj.site(flange)
    return spec.site(flange).parent.add_body(name=name, pos=place.pos, quat=place.quat)


def _add_hand(spec: mujoco.MjSpec, robot: RobotModel, hand: Hand, tcp: str) -> list[mujoco.MjsGeom]:
    """Add the hand at the flange; the shapes of its fingers."""
    palm = _body_at_flange(spec, robot, tcp, HAND)
    height, (thickness, width, length) = hand.palm_m[2], hand.finger_m
    palm.add_geom(
        name=HAND,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[0.5 * edge for edge in hand.palm_m],
        pos=[0.0, 0.0, 0.5 * height],
        mass=(1.0 - 2.0 * FINGER_SHARE) * hand.mass_kg,
        **CONTACT,
    )
    for finger, side in zip(FINGERS, (1.0, -1.0), strict=True):
        body = palm.add_body(name=finger, pos=[0.0, 0.0, height])
        _add_slide(body, finger, (side, 0.0, 0.0), 0.5 * hand.stroke_m)
        body.add_geom(
            name=finger,
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=[0.5 * thickness, 0.5 * width, 0.5 * length],
            pos=[0.5 * side * thickness, 0.0, 0.5 * length],
            mass=FINGER_SHARE * hand.mass_kg,
        )
    return _couple(spec, (spec.body(FINGERS[0]), spec.body(FINGERS[1])), 1.0)


def _add_cup(spec: mujoco.MjSpec, robot: RobotModel, cup: Cup, tcp: str) -> list[mujoco.MjsGeom]:
    """Add the suction cup at the flange, and return its lip."""
    holder, radius_m = _body_at_flange(spec, robot, tcp, CUP), 0.5 * LIP_M
    length_m = cup.length_m - LIP_M
    holder.add_geom(
        name=CUP,
        type=mujoco.mjtGeom.mjGEOM_CYLINDER,
        size=[cup.radius_m, 0.5 * length_m, 0.0],
        pos=[0.0, 0.0, 0.5 * length_m],
        mass=cup.mass_kg,
        **CONTACT,
    )
    around_m = cup.radius_m - radius_m
    return [
        holder.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius_m, 0.0, 0.0],
            pos=[around_m * np.cos(angle), around_m * np.sin(angle), cup.length_m - radius_m],
            mass=0.0,
            condim=4,
            friction=[1.0, TORSION_M, ROLLING_M],
            gap=SOFT_M,
            **CONTACT,
        )
        for name, angle in zip(LIPS, np.linspace(0.0, 2.0 * np.pi, len(LIPS), endpoint=False), strict=True)
    ]


def _add_own_hand(spec: mujoco.MjSpec, hand: AnyOwnHand) -> list[mujoco.MjsGeom]:
    """Make the fingers of the arm's model movable, and return the shapes that hold parts."""
    if isinstance(hand, TurningHand):
        return _add_turning_hand(spec, hand)
    bodies = []
    for name, finger in zip(FINGERS, hand.fingers, strict=True):
        body = _finger_of_model(spec, finger.body)
        joint = _add_slide(body, name, finger.axis, finger.travel_m)
        joint.ref = finger.travel_m  # the model has it open
        bodies.append(body)
    return _couple(spec, (bodies[0], bodies[1]), hand.fingers[0].travel_m / hand.fingers[1].travel_m)


def _add_turning_hand(spec: mujoco.MjSpec, hand: TurningHand) -> list[mujoco.MjsGeom]:
    """Have the fingers of the arm's model turn; their shapes, and those of the link next to a single jaw."""
    inertia = drive_inertia(hand)
    bodies = [_finger_of_model(spec, joint.body) for joint in hand.joints]
    carriers = [body.parent for body in bodies if body.parent not in bodies]
    for index, (joint, body) in enumerate(zip(hand.joints, bodies, strict=True)):
        name = FINGERS[0] if index == 0 else f"{FOLLOWER} {index}"
        made = body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=joint.axis,
            pos=joint.anchor_m,
            armature=inertia if index == 0 else FOLLOWER_SHARE * inertia,
            damping=DAMPING_PER_S * inertia,
        )
        made.ref = joint.ratio * hand.travel_rad  # the model has it open
        made.limited = mujoco.mjtLimited.mjLIMITED_FALSE
        if index == 0:
            made.limited, made.range = mujoco.mjtLimited.mjLIMITED_TRUE, [0.0, hand.travel_rad]
        else:
            _follow(spec, name, joint.ratio)
    links = list({link.name: link for body in bodies for link in _links(body)}.values())
    carrier = _rigid_with(carriers[0])
    _let_pass(spec, links, [*links, *carrier])
    # A single jaw presses parts against the link that carries it.
    return _gripping_shapes(links if len(carriers) > 1 else [*links, *carrier])


def drive_inertia(hand: TurningHand) -> float:
    """Inertia of the drive as the first joint feels it, kg m²."""
    return DRIVE_KG * ((hand.stroke_m - hand.closed_m) / hand.travel_rad) ** 2


def _finger_of_model(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    body = spec.body(name)
    if body is None:
        raise ConfigError(
            f"robot.gripper.hand: the model has no body {name!r}; valid are: "
            f"{', '.join(each.name for each in spec.bodies if each.name)}"
        )
    if body.joints:
        raise ConfigError(f"robot.gripper.hand: {name!r} is a link of the arm, not a finger")
    return body


def _add_slide(
    body: mujoco.MjsBody, name: str, axis: tuple[float, float, float], travel_m: float
) -> mujoco.MjsJoint:
    return body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=axis,
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        range=[0.0, travel_m],
        armature=DRIVE_KG,
        damping=1.0,
    )


def _couple(
    spec: mujoco.MjSpec, fingers: tuple[mujoco.MjsBody, mujoco.MjsBody], ratio: float
) -> list[mujoco.MjsGeom]:
    """Have the fingers move together, and pass each other; their shapes, which touch as fingers do.

    Args:
        ratio: how far the first one slides for each metre of the second one.
    """
    links = [_links(finger) for finger in fingers]
    _let_pass(spec, *links)
    _follow(spec, FINGERS[0], ratio, FINGERS[1])
    return _gripping_shapes([*links[0], *links[1]])


def _follow(spec: mujoco.MjSpec, name: str, ratio: float, leader: str = FINGERS[0]) -> None:
    """Have a joint move by `ratio` for each unit of the leader."""
    together = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=name,
        name2=leader,
        solref=[0.004, 1.0],
    )
    together.data[:5] = [0.0, ratio, 0.0, 0.0, 0.0]


def _let_pass(spec: mujoco.MjSpec, links: list[mujoco.MjsBody], others: list[mujoco.MjsBody]) -> None:
    """Let links pass through other ones."""
    pairs = {frozenset((one.name, other.name)) for one in links for other in others if one.name != other.name}
    for first, second in (sorted(pair) for pair in sorted(pairs, key=sorted)):
        spec.add_exclude(bodyname1=first, bodyname2=second)


def _gripping_shapes(links: list[mujoco.MjsBody]) -> list[mujoco.MjsGeom]:
    """The shapes of links, which touch as fingers do."""
    shapes = [geom for link in links for geom in link.geoms if geom.contype]
    for number, geom in enumerate(shapes, start=1):
        geom.name = geom.name or f"{HAND} shape {number} of {geom.parent.name}"
        geom.condim, geom.friction = 4, [1.0, TORSION_M, ROLLING_M]
        geom.solref[:2], geom.solimp[:5] = CONTACT["solref"], CONTACT["solimp"]
    return shapes


def _rigid_with(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """The link, and those fixed to it in both directions."""
    while not body.joints and body.parent.name != "world":
        body = body.parent
    found, pending = [], [body]
    while pending:
        found.append(each := pending.pop())
        pending += [child for child in each.bodies if not child.joints]
    return found


def _links(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """A body and all that it carries."""
    return [body, *(link for child in body.bodies for link in _links(child))]


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
        # Any speed but zero has MuJoCo compile belts in; the simulation sets the speed in each cycle.
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
    """Add the convex solids of a mesh, and the mass of one with uniform density."""
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
    """Add the contact between a shape of a finger or a cup and one of a part."""
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
