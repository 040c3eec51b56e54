"""The robot's kinematics and dynamics, from an MJCF or URDF file as MuJoCo reads it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import mujoco
import numpy as np

from cobot.errors import ConfigError, InputError, exhausted
from cobot.robot.chain import Chain
from cobot.robot.dynamics import Dynamics
from cobot.robot.file_checks import check_names, require_inertials
from cobot.robot.inverse_kinematics.arm import Arm
from cobot.robot.inverse_kinematics.geometry import recognised
from cobot.robot.load import carrying
from cobot.robot.payload import Carrier
from cobot.robot.quaternion import from_matrix
from cobot.robot.scene import Scene, compiled
from cobot.robot.tool import BARE, Tool
from cobot.trajectory import Trajectory
from cobot.types import Array, FreeAxis, JointLimits, Numbers7, Pose


class RobotModel:
    """Forward kinematics, Jacobian, mass matrix and gravity of the arm.

    Not thread safe, because all calls use one scratch memory. Joint vectors have shape (dof,), rad, in the
    order of the limits. Poses and Jacobians describe the TCP in the base frame.

    Attributes:
        mj: MuJoCo's model.
        limits: the joint limits, in joint order; linear joints are marked.
        tcp_site: index of the TCP among the model's sites.
        chain: the kinematics, which compiled code calls without Python.
        dynamics: inertia and bias forces, also for compiled code.
        tool: the tool on the flange; `carry` changes it.
        attached: the scene whose attached objects are carried.
        carried: the tool together with the masses of these objects.
        last_efforts: see `effort_samples`.
        spec: the source of MuJoCo's model, for adding bodies; None if the model was made elsewhere.
    """

    def __init__(
        self,
        mj: mujoco.MjModel,
        limits: JointLimits,
        base: str,
        tcp: str,
        spec: mujoco.MjSpec | None = None,
    ) -> None:
        self.mj = mj
        self.spec = spec
        self.limits = limits
        self._base = _base_body(mj, base)
        joints = [mj.joint(index).name for index in range(mj.njnt)]
        if tuple(joints) != limits.names or mj.nv != limits.dof or mj.nq != limits.dof:
            raise ConfigError(
                "the model must have the joints of the limits, in the same order and of one degree of "
                f"freedom each; the model has {', '.join(joints)}, but the limits have "
                f"{', '.join(limits.names)}"
            )
        slides = tuple(bool(kind == mujoco.mjtJoint.mjJNT_SLIDE) for kind in mj.jnt_type)
        if any(slides):
            self.limits = limits = replace(limits, slides=slides)
        self.tcp_site = _tcp_site(mj, tcp)
        if mj.body_weldid[self._base] != 0:
            raise ConfigError(f"robot.base_frame: {base!r} must not move with the joints")
        try:
            self.chain = Chain(mj, self._base, self.tcp_site)
        except InputError as exc:
            raise ConfigError(str(exc)) from exc
        self.dynamics = Dynamics(mj)
        self.last_efforts: tuple[Trajectory, Array, Array] | None = None
        self.tool = self.carried = BARE
        self.attached = Scene()
        self._carrier = Carrier(mj, self._base, self.tcp_site)
        self._freed: dict[tuple[FreeAxis, ...], Arm] = {}
        moved = np.abs(self.jacobian(np.full(limits.dof, 0.5))).max(axis=0) > 0.0
        if not moved.all():
            still = ", ".join(name for name, moves in zip(limits.names, moved, strict=True) if not moves)
            raise ConfigError(f"robot.tcp: {tcp!r} is not moved by {still}")

    @classmethod
    def load(cls, path: Path, limits: JointLimits, base: str = "base_link", tcp: str = "tcp") -> RobotModel:
        """Read an MJCF or URDF file.

        Raises:
            ConfigError: the file is missing or cannot be loaded, a URDF lacks masses, the joints are not the
                same as in the limits, or the base or the TCP does not exist.
            UnavailableError: there is not enough memory.
        """
        if not path.is_file():
            raise ConfigError(f"{path}: {'is not a file' if path.exists() else 'no such file'}")
        try:
            spec = _read(path, tcp)
            mj = spec.compile()
            check_names(mj)
            require_inertials(path, spec, mj)
            return cls(mj, limits, base, tcp, spec)
        except ValueError as exc:
            if error := exhausted(exc):
                raise error from exc
            said = " ".join(str(exc).split())
            raise ConfigError(f"{path}: MuJoCo cannot load it: {said}{_advice(path, said)}") from exc
        except ConfigError as exc:
            raise ConfigError(f"{path}: {exc}") from exc

    @property
    def base(self) -> str:
        """The name of the body whose frame is used for all poses."""
        return str(self.mj.body(self._base).name)

    @property
    def name(self) -> str:
        """The name that the model's file gives to the model."""
        return bytes(self.mj.names).split(b"\0", 1)[0].decode("utf-8", "replace")

    def flange_in_tcp(self) -> Pose:
        """The pose of the site `flange` in the TCP's frame. In a model without this site, the flange is the
        TCP of the model file.
        """
        return Pose.from_numbers(self.tcp_in_flange()).inverse()

    def tcp_in_file_tcp(self, tool: Tool | None = None) -> Pose:
        """The pose of the TCP in the frame of the model file's TCP, with the given tool or the current
        one.
        """
        file_tcp = Pose.from_numbers(self.file_tcp_in_flange)
        return file_tcp.inverse() @ Pose.from_numbers(self.tcp_in_flange(tool))

    def tcp_in_flange(self, tool: Tool | None = None) -> Numbers7:
        """The pose of the TCP in the flange's frame, with the given tool or the current one."""
        tcp = (tool or self.tool).tcp
        return self._carrier.tcp_in_flange if tcp is None else tcp

    @property
    def file_tcp_in_flange(self) -> Numbers7:
        """The pose of the model file's TCP in the flange's frame."""
        return self._carrier.tcp_in_flange

    @property
    def file_gravity(self) -> Array:
        """The gravity of the model file in the base frame. Shape: (3,), in m/s²."""
        return np.asarray(self.chain.base_rotation.T @ self._carrier.gravity)

    def carry(self, tool: Tool, scene: Scene | None = None) -> None:
        """Replace the tool on the flange and the attached objects. This changes mass, TCP and gravity for all
        users of this model's `mj`, `chain` and `dynamics`. Without a scene, no objects are attached. The
        collision checker handles shapes. The call takes about 200 µs, during which nothing else may use the
        model.
        """
        self.attached = scene or Scene()
        self.carried = carrying(tool, self.attached, self.tcp_in_flange(tool))
        gravity = None if tool.gravity is None else self.chain.base_rotation @ tool.gravity
        self._carrier.load(self.carried, gravity)
        self.dynamics.settle()
        self.last_efforts = None
        self.chain.reach(self.mj, self.tcp_site)
        self.__dict__.pop("inverse_kinematics", None)
        self._freed.clear()
        self.tool = tool

    @cached_property
    def fixed_frames(self) -> dict[str, Pose]:
        """Poses, in the base frame, of the world and of all bodies and sites that no joint moves."""
        data = mujoco.MjData(self.mj)
        mujoco.mj_kinematics(self.mj, data)
        turn = data.xmat[self._base].reshape(3, 3).T
        frames = {}
        for name, body, place, matrix in self._frames(data):
            if self.mj.body_weldid[body] == 0:
                orientation = from_matrix((turn @ matrix.reshape(3, 3)).ravel().tolist())
                frames[name] = Pose(turn @ (place - data.xpos[self._base]), np.array(orientation))
        return frames

    @cached_property
    def frame_names(self) -> frozenset[str]:
        """The names of all bodies and sites."""
        return frozenset(name for name, *_ in self._frames(mujoco.MjData(self.mj)))

    def _frames(self, data: mujoco.MjData) -> Iterator[tuple[str, int, Array, Array]]:
        """Name, body, position and rotation matrix of each site and body that has a name."""
        for index in range(self.mj.nsite):
            if name := self.mj.site(index).name:
                yield name, self.mj.site_bodyid[index], data.site_xpos[index], data.site_xmat[index]
        for index in range(self.mj.nbody):
            if name := self.mj.body(index).name:
                yield name, index, data.xpos[index], data.xmat[index]

    def among(self, scene: Scene, tool: Tool | None = None, *, by_voxels: bool = False) -> mujoco.MjModel:
        """MuJoCo's model with the scene's objects and the tool's shapes. Use it only to compute distances.
        `tool` defaults to the current tool.

        Args:
            by_voxels: see `cobot.robot.scene.compiled`.

        Raises:
            InputError: MuJoCo rejects the scene or the tool.
        """
        tool = tool or self.tool
        if not scene.objects and not tool.shapes:
            return self.mj
        if self.spec is None:
            raise InputError(
                "objects can only be added to a model that was read from a file; this model was not"
            )
        # Attached bodies are placed relative to the model file's TCP, whose pose in the flange's frame is
        # known.
        flange = Pose.from_numbers(self.file_tcp_in_flange).inverse()
        tip = self.tcp_in_file_tcp(tool)
        objects = {
            name: replace(each, pose=(tip @ Pose.from_numbers(each.pose)).numbers) if each.attached else each
            for name, each in scene.objects.items()
        }
        shapes = {
            name: replace(each, pose=(flange @ Pose.from_numbers(each.pose)).numbers, attached=True)
            for name, each in tool.shapes.items()
        }
        whole = replace(scene, objects=objects | shapes)
        tcp = self.mj.site(self.tcp_site).name
        return compiled(self.spec, whole, self.base, tcp, by_voxels=by_voxels)

    @cached_property
    def inverse_kinematics(self) -> Arm:
        """The inverse kinematics, in closed form or numeric, depending on the arm's geometry; see
        `cobot.robot.inverse_kinematics`.
        """
        return recognised(self.chain, self.limits, self.mj.qpos0)

    def kinematics(self, free: tuple[FreeAxis, ...] = ()) -> Arm:
        """The inverse kinematics for poses in which the TCP rotations in `free` may have any value: none, one
        or all three.
        """
        if not free:
            return self.inverse_kinematics
        if free not in self._freed:
            self._freed[free] = recognised(self.chain, self.limits, self.mj.qpos0, free)
        return self._freed[free]

    @property
    def dof(self) -> int:
        return self.limits.dof

    def forward(self, joints: Array) -> Pose:
        """The pose of the TCP in the base frame."""
        out = np.empty(7)
        self.chain.forward_into(joints, out)
        return Pose(out[:3], out[3:])

    def forward_into(self, joints: Array, out: Array) -> None:
        """Calculate the result of `forward` and write it into `out`, shape (7,): x, y, z (m), then w, x, y,
        z.
        """
        self.chain.forward_into(joints, out)

    def jacobian(self, joints: Array) -> Array:
        """The Jacobian of the TCP in the base frame, shape (6, dof). Its rows are vx, vy, vz (m/s) and wx,
        wy, wz (rad/s), per rad/s of each joint.
        """
        return self.forward_and_jacobian(joints)[2].copy()

    def forward_and_jacobian(self, joints: Array) -> tuple[Array, Array, Array]:
        """The TCP's position, rotation matrix and Jacobian, for solvers. Shapes: (3,), (3, 3) and (6, dof).

        The Jacobian is overwritten by the next call.
        """
        position, rotation, jacobian = self.chain.solve(joints)
        return position.copy(), rotation.copy(), jacobian

    def poses(self, joints: Array) -> Array:
        """The TCP's poses in the base frame, shape (n, 7): x, y, z (m) and w, x, y, z. `joints` has shape (n,
        dof).
        """
        return self.chain.poses(joints)

    def mass_matrix(self, joints: Array) -> Array:
        """Joint-space inertia, shape (dof, dof), kg·m². It includes the inertia of the drives (armature)."""
        return self.dynamics.mass_matrix(joints)

    def gravity_torques(self, joints: Array) -> Array:
        """The torques that hold the arm against gravity, shape (dof,), N·m."""
        return self.bias_torques(joints, np.zeros(self.dof))

    def bias_torques(self, joints: Array, velocity: Array) -> Array:
        """The torques for a motion without acceleration, shape (dof,), N·m. They compensate gravity, Coriolis
        and centrifugal forces, but not friction.
        """
        return self.dynamics.bias_torques(joints, velocity)

    @property
    def gravity(self) -> Array:
        """The acceleration of free fall in the base frame. Shape: (3,), in m/s²."""
        return np.asarray(self.chain.base_rotation.T @ self.mj.opt.gravity)


def _advice(path: Path, said: str) -> str:
    """Advice for users whose files come from ROS."""
    if path.suffix == ".xacro":
        return f"; it is xacro: convert it with `cobot new-robot {path.name}`"
    if "package:" in said:
        return f"; convert it and its meshes with `cobot new-robot {path.name} --package FOLDER`"
    return ""


def _read(path: Path, tcp: str) -> mujoco.MjSpec:
    """Read a model file, and complete a URDF.

    A URDF contains no sites, and MuJoCo would fuse its fixed links. Here these links are kept, and the TCP
    may be a link. A URDF contains no actuators either, so each joint gets a motor.
    """
    spec = mujoco.MjSpec.from_file(str(path))
    spec.compiler.fusestatic = False
    spec.compiler.usethread = False  # starting MuJoCo's threads takes longer than the work that they share
    if spec.site(tcp) is None and spec.body(tcp) is not None:
        spec.body(tcp).add_site(name=tcp)
    if path.suffix == ".urdf" and not spec.actuators:
        for joint in spec.joints:
            motor = spec.add_actuator(name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
            motor.set_to_motor()
    return spec


def _base_body(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)
    if index < 0:
        still = [model.body(body).name for body in range(model.nbody) if model.body_weldid[body] == 0]
        raise ConfigError(f"robot.base_frame: the model has no {name!r}; valid names: {', '.join(still)}")
    return int(index)


def _tcp_site(model: mujoco.MjModel, name: str) -> int:
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    if index < 0:
        sites = [model.site(i).name for i in range(model.nsite)]
        raise ConfigError(
            f"robot.tcp: the model has no site or body {name!r}; its sites: {', '.join(sites) or 'none'}"
        )
    return int(index)
