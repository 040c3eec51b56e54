"""Writes a URDF for a MuJoCo model, with kinematics, limits, masses and simple shapes. It is for display and
planning.

Source: http://wiki.ros.org/urdf/XML
"""

from __future__ import annotations

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np

from cobot.robot.rotations import matrix_of
from cobot.types import Array, JointLimits

WORLD = "world"
GIMBAL_LOCK = 1e-9
"""If the cosine of the pitch is below this, only the sum or difference of roll and yaw is defined."""
_MIN_INERTIA = 1e-9
_Geom = mujoco.mjtGeom


def urdf(model: mujoco.MjModel, limits: JointLimits, tcp_site: int) -> str:
    """The text of the URDF.

    A joint whose axis does not pass through its link's origin is followed by an empty link and a fixed joint.
    Meshes and ellipsoids are replaced by the boxes around them; planes are left out.

    Args:
        tcp_site: index of the site that becomes the link of the TCP.
    """
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    root = Element("robot", name=bytes(model.names).split(b"\0", 1)[0].decode("utf-8", "replace"))
    SubElement(root, "link", name=WORLD)
    for body in range(1, model.nbody):
        _link(root, model, body)
        parent = int(model.body_parentid[body])
        back = data.xmat[parent].reshape(3, 3).T
        place = back @ (data.xpos[body] - data.xpos[parent])
        turn = back @ data.xmat[body].reshape(3, 3)
        _join(root, model, limits, body, place, turn)
    tcp = model.site(tcp_site)
    holder = link_name(model, int(model.site_bodyid[tcp_site]))
    if tcp.name != holder:
        SubElement(root, "link", name=tcp.name)
        _joint(root, f"{holder}_to_{tcp.name}", "fixed", holder, tcp.name, tcp.pos, matrix_of(tcp.quat))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode", xml_declaration=True)


def link_name(model: mujoco.MjModel, body: int) -> str:
    """The name of the link for a body."""
    return model.body(body).name or f"body{body}" if body else WORLD


def _join(
    root: Element, model: mujoco.MjModel, limits: JointLimits, body: int, place: Array, turn: Array
) -> None:
    parent, child = link_name(model, int(model.body_parentid[body])), link_name(model, body)
    if not model.body_jntnum[body]:
        _joint(root, f"{parent}_to_{child}", "fixed", parent, child, place, turn)
        return
    index = int(model.body_jntadr[body])
    joint = model.joint(index)
    pivot = joint.pos
    holder = f"{child}_pivot" if pivot.any() else child
    made = _joint(root, joint.name, "revolute", parent, holder, place + turn @ pivot, turn)
    SubElement(made, "axis", xyz=_numbers(joint.axis))
    number = limits.names.index(joint.name)
    SubElement(
        made,
        "limit",
        lower=_number(limits.min_position[number]),
        upper=_number(limits.max_position[number]),
        velocity=_number(limits.max_velocity[number]),
        effort=_number(limits.max_effort[number]),
    )
    if holder != child:
        SubElement(root, "link", name=holder)
        _joint(root, f"{holder}_to_{child}", "fixed", holder, child, -pivot, np.eye(3))


def _joint(
    root: Element, name: str, kind: str, parent: str, child: str, place: Array, turn: Array
) -> Element:
    made = SubElement(root, "joint", name=name, type=kind)
    SubElement(made, "parent", link=parent)
    SubElement(made, "child", link=child)
    _origin(made, place, turn)
    return made


def _link(root: Element, model: mujoco.MjModel, body: int) -> None:
    made = SubElement(root, "link", name=link_name(model, body))
    if model.body_mass[body] > 0.0:
        inertial = SubElement(made, "inertial")
        _origin(inertial, model.body_ipos[body], matrix_of(model.body_iquat[body]))
        SubElement(inertial, "mass", value=_number(model.body_mass[body]))
        x, y, z = (_number(max(value, _MIN_INERTIA)) for value in model.body_inertia[body])
        SubElement(inertial, "inertia", ixx=x, iyy=y, izz=z, ixy="0", ixz="0", iyz="0")
    first = int(model.body_geomadr[body])
    for geom in range(first, first + int(model.body_geomnum[body])):
        kinds = ["visual"]
        if model.geom_contype[geom] or model.geom_conaffinity[geom]:
            kinds.append("collision")
        for kind in kinds:
            _shapes(made, kind, model, geom)


def _shapes(link: Element, kind: str, model: mujoco.MjModel, geom: int) -> None:
    """Add a shape to a link. A capsule becomes a cylinder and two spheres, because URDF does not define
    capsules.
    """
    place, turn = model.geom_pos[geom], matrix_of(model.geom_quat[geom])
    radius, half, _ = model.geom_size[geom]
    match int(model.geom_type[geom]):
        case _Geom.mjGEOM_SPHERE:
            _shape(link, kind, place, turn, "sphere", radius=_number(radius))
        case _Geom.mjGEOM_BOX:
            _shape(link, kind, place, turn, "box", size=_numbers(2.0 * model.geom_size[geom]))
        case _Geom.mjGEOM_CYLINDER:
            _shape(link, kind, place, turn, "cylinder", radius=_number(radius), length=_number(2.0 * half))
        case _Geom.mjGEOM_CAPSULE:
            _shape(link, kind, place, turn, "cylinder", radius=_number(radius), length=_number(2.0 * half))
            for end in (half, -half):
                _shape(link, kind, place + turn[:, 2] * end, turn, "sphere", radius=_number(radius))
        case _Geom.mjGEOM_MESH | _Geom.mjGEOM_ELLIPSOID:
            centre, size = model.geom_aabb[geom][:3], 2.0 * model.geom_aabb[geom][3:]
            _shape(link, kind, place + turn @ centre, turn, "box", size=_numbers(size))


def _shape(link: Element, kind: str, place: Array, turn: Array, shape: str, **values: str) -> None:
    made = SubElement(link, kind)
    _origin(made, place, turn)
    SubElement(SubElement(made, "geometry"), shape, values)


def _origin(element: Element, place: Array, turn: Array) -> None:
    SubElement(element, "origin", xyz=_numbers(place), rpy=_numbers(_fixed_angles(turn)))


def _fixed_angles(turn: Array) -> Array:
    """Roll, pitch and yaw of a rotation matrix, about fixed axes. At gimbal lock the roll is 0."""
    level = math.hypot(turn[0, 0], turn[1, 0])
    pitch = math.atan2(-turn[2, 0], level)
    if level < GIMBAL_LOCK:
        return np.array([0.0, pitch, math.atan2(-turn[0, 1], turn[1, 1])])
    return np.array([math.atan2(turn[2, 1], turn[2, 2]), pitch, math.atan2(turn[1, 0], turn[0, 0])])


def _number(value: float) -> str:
    return f"{float(value):.15g}"


def _numbers(values: Array) -> str:
    return " ".join(_number(value + 0.0) for value in values)
