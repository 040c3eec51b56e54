"""The shipped robot as other programs see it: pinocchio from a URDF, MuJoCo without cobot's model class.

The URDF is written here from the numbers that `config/iiwa14.xml` publishes, read as XML.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pinocchio
from folders import ROOT
from scipy.spatial.transform import Rotation

from cobot.robot.collision import CollisionChecker
from cobot.robot.description import RobotDescription
from cobot.robot.model import RobotModel
from cobot.trajectory import Trajectory
from cobot.types import Array, JointLimits

MJCF = ROOT / "config" / "iiwa14.xml"
LIMITS = MJCF.with_name("joint_limits.yaml")
SRDF = MJCF.with_name("iiwa14.srdf")


def mjcf_root() -> ET.Element:
    return ET.parse(MJCF).getroot()


def numbers(element: ET.Element, name: str, default: str) -> list[float]:
    return [float(word) for word in element.get(name, default).split()]


def origin(element: ET.Element) -> str:
    """`<origin>` for an element with pos and a (w, x, y, z) quat."""
    x, y, z = numbers(element, "pos", "0 0 0")
    turn = Rotation.from_quat(numbers(element, "quat", "1 0 0 0"), scalar_first=True)
    roll, pitch, yaw = turn.as_euler("xyz")
    return f'<origin xyz="{x!r} {y!r} {z!r}" rpy="{float(roll)!r} {float(pitch)!r} {float(yaw)!r}"/>'


def urdf() -> str:
    """The chain from base_link to a link `tcp` at the site of this name."""
    parts = ['<robot name="iiwa14">']
    parent, body = "", mjcf_root().find("worldbody/body")
    while body is not None:
        name, inertial, joint = body.get("name"), body.find("inertial"), body.find("joint")
        assert inertial is not None
        ix, iy, iz = numbers(inertial, "diaginertia", "")
        parts.append(
            f'<link name="{name}"><inertial>{origin(inertial)}<mass value="{inertial.get("mass")}"/>'
            f'<inertia ixx="{ix}" iyy="{iy}" izz="{iz}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )
        if joint is not None:
            low, high = numbers(joint, "range", "")
            parts.append(
                f'<joint name="{joint.get("name")}" type="revolute">{origin(body)}<axis xyz="0 0 1"/>'
                f'<parent link="{parent}"/><child link="{name}"/>'
                f'<limit lower="{low}" upper="{high}" effort="400" velocity="10"/></joint>'
            )
        site = body.find("site")
        if site is not None:
            parts.append(
                f'<link name="{site.get("name")}"/><joint name="to_tcp" type="fixed">{origin(site)}'
                f'<parent link="{name}"/><child link="{site.get("name")}"/></joint>'
            )
        parent, body = str(name), body.find("body")
    return "\n".join([*parts, "</robot>"])


class Pinocchio:
    """Forward kinematics and dynamics of the arm by pinocchio; all in the base frame."""

    def __init__(self) -> None:
        self.model = pinocchio.buildModelFromXML(urdf())
        joints = [joint for joint in mjcf_root().iter("joint") if joint.get("name")]
        assert list(self.model.names)[1:] == [joint.get("name") for joint in joints]
        self.model.armature[:] = [float(joint.get("armature", "0")) for joint in joints]
        self.data = self.model.createData()
        self.tcp = self.model.getFrameId("tcp")

    def forward(self, joints: Array) -> tuple[Array, Array]:
        """Position (3,) and rotation matrix (3, 3) of the TCP."""
        pinocchio.framesForwardKinematics(self.model, self.data, np.asarray(joints, dtype=float))
        placement = self.data.oMf[self.tcp]
        return placement.translation.copy(), placement.rotation.copy()

    def path(self, samples: Array) -> tuple[Array, Rotation]:
        """Positions (n, 3) and orientations of the TCP at joint samples (n, dof)."""
        places = [self.forward(joints) for joints in samples]
        return np.array([place[0] for place in places]), Rotation.from_matrix([place[1] for place in places])

    def jacobian(self, joints: Array) -> Array:
        return np.array(
            pinocchio.computeFrameJacobian(
                self.model, self.data, joints, self.tcp, pinocchio.ReferenceFrame.LOCAL_WORLD_ALIGNED
            )
        )

    def gravity(self, joints: Array) -> Array:
        return np.array(pinocchio.computeGeneralizedGravity(self.model, self.data, joints))

    def mass_matrix(self, joints: Array) -> Array:
        upper = np.triu(pinocchio.crba(self.model, self.data, joints))
        return np.asarray(upper + np.triu(upper, 1).T)


class Contacts:
    """MuJoCo's own contact list for an MJCF file, without cobot's checker; all margins as given."""

    def __init__(self, margin_m: float = 0.0, file: Path = MJCF) -> None:
        self.model = mujoco.MjModel.from_xml_path(str(file))
        self.model.geom_margin[:] = margin_m
        self.data = mujoco.MjData(self.model)

    def bodies(self, joints: Array) -> set[frozenset[str]]:
        """The pairs of bodies in contact."""
        self.data.qpos[:] = joints
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        body = self.model.geom_bodyid
        return {
            frozenset(self.model.body(body[geom]).name for geom in contact.geom)
            for contact in self.data.contact[: self.data.ncon]
        }


def changed_world(folder: Path, *, floor: bool = True, post: Sequence[float] = ()) -> Path:
    """The shipped MJCF without its floor, or with a box `post` (x, y, z and half sizes, m)."""
    root = mjcf_root()
    world = root.find("worldbody")
    assert world is not None
    if not floor:
        world.remove(next(geom for geom in world.findall("geom") if geom.get("name") == "floor"))
    if post:
        words = [str(value) for value in post]
        ET.SubElement(
            world, "geom", name="post", type="box", pos=" ".join(words[:3]), size=" ".join(words[3:])
        )
    file = folder / "changed.xml"
    file.write_bytes(ET.tostring(root))
    return file


def robot_in(world: Path, robot: RobotDescription) -> RobotDescription:
    """The robot in another world."""
    model = RobotModel.load(world, robot.limits)
    return replace(robot, model=model, collision=CollisionChecker(model, robot.collision.margin_m))


@cache
def second_robot() -> Pinocchio:
    return Pinocchio()


def largest_rates(trajectory: Trajectory, samples: int = 2000) -> Array:
    """The largest mean velocity, acceleration and jerk over short times, by differences, shape (3, dof).

    A mean never exceeds the true maximum, so these may be held against limits.
    """
    step_s = trajectory.duration_s / samples
    positions = trajectory.sample(np.linspace(0.0, trajectory.duration_s, samples + 1))
    return np.array([np.abs(np.diff(positions, k, axis=0)).max(axis=0) / step_s**k for k in (1, 2, 3)])


def rate_limits(limits: JointLimits) -> Array:
    """Shape (3, dof), to compare with `largest_rates`."""
    return np.array([limits.max_velocity, limits.max_acceleration, limits.max_jerk])
