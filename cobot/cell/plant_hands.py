"""The hands and cups of a plant: a hand or a cup from the cell file, or fingers in the arm's model.

`cobot.cell.plant` adds them to the arm.
"""

from __future__ import annotations

import mujoco
import numpy as np

from cobot.cell.cell import CUP, HAND, Cup, Hand
from cobot.cell.own_hand import AnyOwnHand, TurningHand
from cobot.cell.surroundings import FINGER_SHARE, LIP_M
from cobot.errors import ConfigError
from cobot.robot.model import RobotModel

FINGERS = ("hand finger 1", "hand finger 2")
"""Names of the joints that the hand's drives move. In a cell file, the bodies and shapes of the hand have
the same names. A turning hand has one drive.
"""
FOLLOWER = "hand follower"
"""Name prefix of joints that follow the drive of a turning hand."""
LIPS = tuple(f"{CUP} lip {number}" for number in range(1, 9))
"""Names of the balls that form the lip of a cup. The lip is closed if all these balls touch the same body."""
SOFT_M = 0.0005
"""Distance by which the soft lip extends beyond its balls, m."""
CONTACT = {"solref": [0.004, 1.0], "solimp": [0.95, 0.99, 0.001, 0.5, 2.0]}
DRIVE_KG = 0.5
"""Effective mass of a finger's drive at the finger, kg: it results from the rotor behind a gear."""
FOLLOWER_SHARE, DAMPING_PER_S = 0.1, 2.0
"""Inertia of a following joint, as a share of the drive's inertia, and damping of turning joints per unit of
inertia.
"""
TORSION_M = 0.005
ROLLING_M = 0.0002


def flange_of(mj: mujoco.MjModel, tcp: str) -> str:
    """The site that carries the tool: the arm's flange, or the arm's TCP if there is no flange."""
    flange = mujoco.mj_name2id(mj, mujoco.mjtObj.mjOBJ_SITE, "flange")
    if flange < 0 or mj.body_weldid[mj.site_bodyid[flange]] != mj.body_weldid[mj.site(tcp).bodyid[0]]:
        return tcp
    return "flange"


def _body_at_flange(spec: mujoco.MjSpec, robot: RobotModel, tcp: str, name: str) -> mujoco.MjsBody:
    flange = flange_of(robot.mj, tcp)
    place = robot.mj.site(flange)
    return spec.site(flange).parent.add_body(name=name, pos=place.pos, quat=place.quat)


def add_hand(spec: mujoco.MjSpec, robot: RobotModel, hand: Hand, tcp: str) -> list[mujoco.MjsGeom]:
    """Add the hand to the flange. Returns its finger shapes."""
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


def add_cup(spec: mujoco.MjSpec, robot: RobotModel, cup: Cup, tcp: str) -> list[mujoco.MjsGeom]:
    """Add the suction cup to the flange. Returns the shapes of its lip."""
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


def add_own_hand(spec: mujoco.MjSpec, hand: AnyOwnHand) -> list[mujoco.MjsGeom]:
    """Make the fingers in the arm's model movable. Returns the shapes that hold parts."""
    if isinstance(hand, TurningHand):
        return _add_turning_hand(spec, hand)
    bodies = []
    for name, finger in zip(FINGERS, hand.fingers, strict=True):
        body = _finger_of_model(spec, finger.body)
        joint = _add_slide(body, name, finger.axis, finger.travel_m)
        joint.ref = finger.travel_m  # in the model, the finger is open
        bodies.append(body)
    return _couple(spec, (bodies[0], bodies[1]), hand.fingers[0].travel_m / hand.fingers[1].travel_m)


def _add_turning_hand(spec: mujoco.MjSpec, hand: TurningHand) -> list[mujoco.MjsGeom]:
    """Add the joints for turning fingers in the arm's model. Returns the finger shapes. For a single jaw, it
    also returns the shapes of the link next to the jaw.
    """
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
        made.ref = joint.ratio * hand.travel_rad  # in the model, the finger is open
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
    """Effective inertia of the drive at the first joint, kg·m²."""
    return DRIVE_KG * ((hand.stroke_m - hand.closed_m) / hand.travel_rad) ** 2


def _finger_of_model(spec: mujoco.MjSpec, name: str) -> mujoco.MjsBody:
    body = spec.body(name)
    if body is None:
        raise ConfigError(
            f"robot.gripper.hand: the model has no body {name!r}; valid names: "
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
    """Couple the fingers, and let them pass through each other. Returns their shapes, which get the contact
    properties of fingers.

    Args:
        ratio: travel of the first finger per metre of the second one.
    """
    links = [_links(finger) for finger in fingers]
    _let_pass(spec, *links)
    _follow(spec, FINGERS[0], ratio, FINGERS[1])
    return _gripping_shapes([*links[0], *links[1]])


def _follow(spec: mujoco.MjSpec, name: str, ratio: float, leader: str = FINGERS[0]) -> None:
    """Couple a joint to a leader. The joint moves by `ratio` for each unit of the leader."""
    together = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=name,
        name2=leader,
        solref=[0.004, 1.0],
    )
    together.data[:5] = [0.0, ratio, 0.0, 0.0, 0.0]


def _let_pass(spec: mujoco.MjSpec, links: list[mujoco.MjsBody], others: list[mujoco.MjsBody]) -> None:
    """Let links pass through other links, without contacts."""
    pairs = {frozenset((one.name, other.name)) for one in links for other in others if one.name != other.name}
    for first, second in (sorted(pair) for pair in sorted(pairs, key=sorted)):
        spec.add_exclude(bodyname1=first, bodyname2=second)


def _gripping_shapes(links: list[mujoco.MjsBody]) -> list[mujoco.MjsGeom]:
    """Set the contact properties of fingers on the shapes of links. Returns these shapes."""
    shapes = [geom for link in links for geom in link.geoms if geom.contype]
    for number, geom in enumerate(shapes, start=1):
        geom.name = geom.name or f"{HAND} shape {number} of {geom.parent.name}"
        geom.condim, geom.friction = 4, [1.0, TORSION_M, ROLLING_M]
        geom.solref[:2], geom.solimp[:5] = CONTACT["solref"], CONTACT["solimp"]
    return shapes


def _rigid_with(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """The link and all links that are fixed to it."""
    while not body.joints and body.parent.name != "world":
        body = body.parent
    found, pending = [], [body]
    while pending:
        found.append(each := pending.pop())
        pending += [child for child in each.bodies if not child.joints]
    return found


def _links(body: mujoco.MjsBody) -> list[mujoco.MjsBody]:
    """A body and all bodies that it carries."""
    return [body, *(link for child in body.bodies for link in _links(child))]
