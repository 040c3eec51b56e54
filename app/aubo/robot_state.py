"""RobotState: the current state of the arm.

Poses refer to the tool's tip, see RobotConfig/setTcpOffset, in the base frame.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from app.aubo.poses import as_list, numbers_of
from app.aubo.registry import service
from cobot.ipc.layout import Intervention
from cobot.types import RESTING, LoopMode, Pose

if TYPE_CHECKING:
    from app.robot_services import Services

STATE_TIMEOUT_S = 1.5
"""Timeout for reading a state, s. It is the same as for GET /robot/joint_states."""
PUSHED = (Intervention.TRACKING, Intervention.CONTACT)


async def record(robot: Services) -> np.ndarray:
    """The complete state that rtloop publishes. Raises UnavailableError if it is old or not measured."""
    return await robot.link.await_measured_record(STATE_TIMEOUT_S)


@service("RobotState")
async def get_joint_positions(robot: Services) -> list[float]:
    """The measured joint angles.

    Returns:
        the angles, rad, one for each joint.
    """
    return as_list((await record(robot))["position"])


@service("RobotState")
async def get_joint_speeds(robot: Services) -> list[float]:
    """The velocities of the joints, as measured.

    Returns:
        the velocities, rad/s, one for each joint.
    """
    return as_list((await record(robot))["velocity"])


@service("RobotState")
async def get_joint_torque_sensors(robot: Services) -> list[float]:
    """The measured joint torques, including gravity.

    Returns:
        the torques, N·m, one for each joint.
    """
    return as_list((await record(robot))["effort"])


@service("RobotState")
async def get_joint_external_torques(robot: Services) -> list[float]:
    """The estimated torques that the surroundings exert on the joints.

    Returns:
        the torques, N·m, one for each joint.
    """
    return as_list((await record(robot))["external_effort"])


@service("RobotState")
async def get_target_joint_positions(robot: Services) -> list[float]:
    """The commanded joint angles.

    Returns:
        the angles, rad, one for each joint.
    """
    return as_list((await record(robot))["commanded_position"])


@service("RobotState")
async def get_target_joint_speeds(robot: Services) -> list[float]:
    """The commanded velocities of the joints.

    Returns:
        the velocities, rad/s, one for each joint.
    """
    return as_list((await record(robot))["commanded_velocity"])


@service("RobotState")
async def get_target_joint_accelerations(robot: Services) -> list[float]:
    """The commanded accelerations of the joints.

    Returns:
        the accelerations, rad/s², one for each joint.
    """
    return as_list((await record(robot))["commanded_acceleration"])


@service("RobotState")
async def get_target_joint_torques(robot: Services) -> list[float]:
    """The commanded torques of the drives.

    Returns:
        the torques, N·m, one for each joint.
    """
    return as_list((await record(robot))["desired_effort"])


@service("RobotState")
async def get_tcp_pose(robot: Services) -> list[float]:
    """The pose of the tool's tip, from the measured joints.

    Returns:
        [x, y, z, rx, ry, rz] in the base frame, m and rad.
    """
    return numbers_of(Pose.from_numbers((await record(robot))["tcp"]))


@service("RobotState")
async def get_target_tcp_pose(robot: Services) -> list[float]:
    """The commanded pose of the tool's tip.

    Returns:
        [x, y, z, rx, ry, rz] in the base frame, m and rad.
    """
    joints = (await record(robot))["commanded_position"]
    return numbers_of(robot.robot.model.forward(joints))


@service("RobotState")
async def get_tool_pose(robot: Services) -> list[float]:
    """The pose of the flange, calculated from the measured joint positions. Tool and TCP are ignored.

    Returns:
        [x, y, z, rx, ry, rz] in the base frame, m and rad.
    """
    return numbers_of(robot.settings.flange(Pose.from_numbers((await record(robot))["tcp"])))


@service("RobotState")
async def get_tcp_speed(robot: Services) -> list[float]:
    """The linear and angular velocity of the tool's tip, from the measured joints.

    Returns:
        [vx, vy, vz, wx, wy, wz] in the base frame, m/s and rad/s.
    """
    return as_list((await record(robot))["tcp_velocity"])


@service("RobotState")
async def get_tcp_force(robot: Services) -> list[float]:
    """The force and torque that the surroundings exert on the tool's tip, estimated from the joint torques.

    Returns:
        [fx, fy, fz, tx, ty, tz] in the base frame, N and N·m.
    """
    return as_list((await record(robot))["wrench"])


@service("RobotState")
async def get_tcp_force_sensors(robot: Services) -> list[float]:
    """The values of the force sensor at the model's TCP, in the frame of that TCP.

    Returns:
        [fx, fy, fz, tx, ty, tz], N and N·m.
    """
    return as_list((await record(robot))["sensor"])


@service("RobotState")
async def get_robot_mode_type(robot: Services) -> str:
    """The mode of the arm.

    Returns:
        Idle (holds its position), Running (follows a motion or a streaming session, or is stopping), Error (a
            fault), or EmergencyStop.
    """
    mode = LoopMode(int((await robot.link.await_fresh_state(STATE_TIMEOUT_S)).mode))
    return {LoopMode.HOLD: "Idle", LoopMode.FAULT: "Error", LoopMode.ESTOP: "EmergencyStop"}.get(
        mode, "Running"
    )


@service("RobotState")
async def get_safety_mode_type(robot: Services) -> str:
    """Whether a fault or an e-stop is latched. This is not a safety system.

    Returns:
        Normal, Fault or RobotEmergencyStop.
    """
    mode = (await robot.link.await_fresh_state(STATE_TIMEOUT_S)).mode
    return {LoopMode.FAULT: "Fault", LoopMode.ESTOP: "RobotEmergencyStop"}.get(mode, "Normal")


@service("RobotState")
async def get_mode_reason(robot: Services) -> str:
    """The reason for a fault or an emergency stop, or for the early end of the last motion.

    Returns:
        The reason as a sentence; empty without a fault, an emergency stop or an early end.
    """
    return (await robot.link.await_fresh_state(STATE_TIMEOUT_S)).reason


@service("RobotState")
async def is_steady(robot: Services) -> bool:
    """Whether the arm is at rest and no motion is pending.

    Returns:
        True when the arm has settled, no motion or streaming session runs, and the motion queue is empty.
    """
    state = await robot.link.await_fresh_state(STATE_TIMEOUT_S)
    return state.mode in RESTING and state.settled and state.session == 0 and robot.queue.idle


@service("RobotState")
async def is_power_on(robot: Services) -> bool:
    """Whether the drives are on. They are always on, except in a fault.

    Returns:
        False in a fault.
    """
    return (await robot.link.await_fresh_state(STATE_TIMEOUT_S)).mode is not LoopMode.FAULT


@service("RobotState")
async def is_collision_occurred(robot: Services) -> bool:
    """Whether the arm is in a fault because it was pushed off its path or hit an obstacle.

    Returns:
        True until the fault is reset.
    """
    state = await robot.link.await_fresh_state(STATE_TIMEOUT_S)
    newest = int(np.argmax(state.intervened_ns))
    return (
        state.mode in (LoopMode.FAULT, LoopMode.ESTOP)
        and newest in PUSHED
        and state.intervened_ns[newest] > 0
    )


@service("RobotState")
async def is_within_safety_limits(robot: Services) -> bool:
    """Whether all joints are within their position limits, and neither a fault nor an e-stop is latched.

    Returns:
        True if they are, as measured.
    """
    state = await robot.link.await_measured_state(STATE_TIMEOUT_S)
    limits = robot.robot.limits
    inside = (state.position >= limits.min_position) & (state.position <= limits.max_position)
    return bool(inside.all()) and state.mode not in (LoopMode.FAULT, LoopMode.ESTOP)
