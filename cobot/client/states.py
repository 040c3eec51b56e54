"""Facts about a robot and its measured state: plain data, SI units, lists of floats."""

from __future__ import annotations

from dataclasses import dataclass
from math import isnan

import numpy as np

from cobot.ipc.layout import GripperObject, text
from cobot.orientations import inverse, rotated
from cobot.pose import Pose

Values = list[float]


@dataclass(frozen=True, slots=True)
class RobotInfo:
    """Constant facts about a robot.

    Attributes:
        serial_num: the robot's name.
        model_name: model name, from its file.
        DoF: number of joints.
        K_q_nom: largest joint stiffness, N·m/rad.
        K_x_nom: largest stiffness of the TCP: N/m three times, N·m/rad three times.
        q_min, q_max: joint limits, rad.
        dq_max: velocity limits, rad/s.
        tau_max: torque limits, N·m.
    """

    serial_num: str
    model_name: str
    DoF: int
    K_q_nom: Values
    K_x_nom: Values
    q_min: Values
    q_max: Values
    dq_max: Values
    tau_max: Values


@dataclass(frozen=True, slots=True)
class GripperReading:
    """The last gripper reading. A value that the gripper does not know is NaN.

    Attributes:
        width, commanded_width: distance between the fingers, m.
        force: force at the fingers, N.
        moving: whether a command is running.
        object: whether the gripper holds an object, and how.
    """

    width: float
    commanded_width: float
    force: float
    moving: bool
    object: GripperObject

    @property
    def known_width(self) -> float:
        """The width, m; 0 if the gripper does not know it."""
        return 0.0 if isnan(self.width) else self.width

    @property
    def known_force(self) -> float:
        """The force, N; 0 if the gripper does not know it."""
        return 0.0 if isnan(self.force) else self.force

    @property
    def target_width(self) -> float:
        """The commanded width, m. Before the first command, it is the current width."""
        return self.known_width if isnan(self.commanded_width) else self.commanded_width


@dataclass(frozen=True, slots=True)
class JointState:
    """Joint positions (rad), velocities (rad/s), torques and external torques (N·m); see `RobotStates`."""

    q: Values
    dq: Values
    tau: Values
    tau_ext: Values
    tcp_pose: Values
    gripper: GripperReading | None = None


@dataclass(frozen=True, slots=True)
class CartesianState:
    """The motion of the TCP and the forces on it; see `RobotStates`."""

    tcp_pose: Values
    tcp_vel: Values
    ext_wrench_in_tcp: Values
    ext_wrench_in_world: Values
    ft_sensor_raw: Values
    q: Values
    tau_ext: Values


@dataclass(frozen=True, slots=True)
class RobotStates:
    """All measured values of one cycle.

    External torques and forces are those that the surroundings exert on the arm. The world frame is the base
    frame.

    Attributes:
        q, dq: positions, rad, and velocities, rad/s, of the joints.
        theta, dtheta: the same for the motors. They equal q and dq, because the drives are assumed to be
            rigid.
        tau, tau_des, tau_ext: measured, commanded and external joint torques, N·m.
        tau_dot: change of tau, smoothed over 10 ms, N·m/s.
        tcp_pose, flange_pose: position x, y, z, m, and quaternion w, x, y, z.
        tcp_vel: linear velocity, m/s, and angular velocity, rad/s, of the TCP in the base frame.
        ft_sensor_raw: reading of the sensor at the flange, in the TCP's frame, including the tool's weight
            and inertia; zeros without a sensor.
        ext_wrench_in_tcp, ext_wrench_in_world: force and torque at the TCP, N and N·m, estimated.
        gripper: gripper reading; None if there is no gripper, or before its first reading.
    """

    q: Values
    theta: Values
    dq: Values
    dtheta: Values
    tau: Values
    tau_des: Values
    tau_dot: Values
    tau_ext: Values
    tcp_pose: Values
    tcp_vel: Values
    flange_pose: Values
    ft_sensor_raw: Values
    ext_wrench_in_tcp: Values
    ext_wrench_in_world: Values
    gripper: GripperReading | None = None


def robot_info(robot: str, info: np.ndarray) -> RobotInfo:
    """Read the facts about a robot from a record of `cobot.ipc.layout.info_dtype`."""
    return RobotInfo(
        serial_num=robot,
        model_name=text(info["model"]),
        DoF=len(info["max_velocity"]),
        K_q_nom=info["stiffness"].tolist(),
        K_x_nom=info["cartesian_stiffness"].tolist(),
        q_min=info["min_position"].tolist(),
        q_max=info["max_position"].tolist(),
        dq_max=info["max_velocity"].tolist(),
        tau_max=info["max_effort"].tolist(),
    )


def joint_state(state: np.ndarray) -> JointState:
    """Read the state of the joints from a record of `cobot.ipc.state_fields.state_dtype`."""
    return JointState(
        state["position"].tolist(),
        state["velocity"].tolist(),
        state["effort"].tolist(),
        state["external_effort"].tolist(),
        state["tcp"].tolist(),
        gripper_reading(state),
    )


def gripper_reading(state: np.ndarray) -> GripperReading | None:
    """Read the state of the gripper from a record of `cobot.ipc.state_fields.state_dtype`; None if there is
    no reading.
    """
    found = GripperObject(int(state["gripper_object"]))
    if found is GripperObject.ABSENT:
        return None
    width, commanded, force = (
        float(state[f"gripper_{name}"]) for name in ("width", "commanded_width", "force")
    )
    return GripperReading(width, commanded, force, bool(state["gripper_moving"]), found)


def cartesian_state(state: np.ndarray) -> CartesianState:
    """Read the state of the TCP from a record of `cobot.ipc.state_fields.state_dtype`."""
    pose, wrench = state["tcp"].tolist(), state["wrench"].tolist()
    return CartesianState(
        tcp_pose=pose,
        tcp_vel=state["tcp_velocity"].tolist(),
        ext_wrench_in_tcp=_in_tcp(pose, wrench),
        ext_wrench_in_world=wrench,
        ft_sensor_raw=state["sensor"].tolist(),
        q=state["position"].tolist(),
        tau_ext=state["external_effort"].tolist(),
    )


def robot_states(state: np.ndarray, flange_in_tcp: Pose) -> RobotStates:
    """Read all measured values from a record of `cobot.ipc.state_fields.state_dtype`."""
    joints, tcp = joint_state(state), cartesian_state(state)
    return RobotStates(
        q=joints.q,
        theta=joints.q,
        dq=joints.dq,
        dtheta=joints.dq,
        tau=joints.tau,
        tau_des=state["desired_effort"].tolist(),
        tau_dot=state["effort_rate"].tolist(),
        tau_ext=joints.tau_ext,
        tcp_pose=tcp.tcp_pose,
        tcp_vel=tcp.tcp_vel,
        flange_pose=list((Pose.from_numbers(tcp.tcp_pose) @ flange_in_tcp).numbers),
        ft_sensor_raw=tcp.ft_sensor_raw,
        ext_wrench_in_tcp=tcp.ext_wrench_in_tcp,
        ext_wrench_in_world=tcp.ext_wrench_in_world,
        gripper=joints.gripper,
    )


def _in_tcp(pose: Values, wrench: Values) -> Values:
    back = inverse(pose[3:])
    return [*rotated(back, wrench[:3]), *rotated(back, wrench[3:])]
