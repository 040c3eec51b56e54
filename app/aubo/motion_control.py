"""MotionControl: motions in a queue, see `app.services.motion.queue.motion_queue`, and servo modes.

Poses refer to the tool's tip, see RobotConfig/setTcpOffset, in the base frame. This module is long because
the docstring of each service is also its schema, so similar services repeat the same descriptions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from app.aubo.poses import place_of
from app.aubo.registry import CallOrigin, Json, service
from app.services.motion.queue.moves import queue_request
from app.services.rights.stop_reason import StopReason
from cobot.errors import ConflictError, InputError, NotFoundError, NotSupportedError
from cobot.ipc.layout import ServoMode
from cobot.motions.requests import NO_START, MotionRequest, RatedMove
from cobot.types import Array, PlannerName, Pose, Scaling

if TYPE_CHECKING:
    from app.robot_services import Services


@dataclass(frozen=True, slots=True)
class Rate:
    """The speed of a move in the queue, and its blend radius; see `move_joint`.

    Attributes:
        acceleration, velocity: rad/s² and rad/s of the fastest joint, or m/s² and m/s of the tool's tip.
        duration_s: if above 0, the move duration; the two others are then ignored.
    """

    acceleration: float
    velocity: float
    blend_radius_m: float
    duration_s: float


@service("MotionControl")
async def move_joint(
    robot: Services,
    origin: CallOrigin,
    q: list[float],
    a: float = 0.5,
    v: float = 0.5,
    blend_radius: float = 0.0,
    duration: float = 0.0,
) -> None:
    """Move to joint angles, in the shortest time in joint space. Returns when the move is planned. The move
    runs after the queued ones.

    Args:
        q: joint angles, rad, one for each joint.
        a: maximum acceleration of the fastest joint, rad/s². Joints with lower limits keep those.
        v: maximum velocity of the fastest joint, rad/s. Joints with lower limits keep those.
        blend_radius: maximum distance of the TCP from q, m, while the arm blends into the next move. The next
            move must arrive half a second before the arm would slow down for q. 0: stop at q.
        duration: exact move duration, s, up to a day; a and v are then ignored. 0: use a and v.
    """
    target = np.array(q)
    robot.goals.require_joints(target, name="q", limits=robot.settings.envelope.limits)
    await _add(robot, origin, "moveJoint", PlannerName.PTP, target, Rate(a, v, blend_radius, duration))


@service("MotionControl")
async def move_line(
    robot: Services,
    origin: CallOrigin,
    pose: list[float],
    a: float = 1.2,
    v: float = 0.25,
    blend_radius: float = 0.0,
    duration: float = 0.0,
) -> None:
    """Move to a pose along a straight line, with evenly interpolated orientation. Returns when the move
    is planned.

    Args:
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.
        a: maximum acceleration of the tool's tip, m/s². Lower limits are kept.
        v: maximum velocity of the tool's tip, m/s. Lower limits are kept.
        blend_radius: as in moveJoint, m.
        duration: exact move duration, s, up to a day; a and v are then ignored. 0: use a and v.
    """
    rate = Rate(a, v, blend_radius, duration)
    await _add(robot, origin, "moveLine", PlannerName.LIN, place_of(pose), rate)


@service("MotionControl")
async def move_circle(
    robot: Services,
    origin: CallOrigin,
    via_pose: list[float],
    end_pose: list[float],
    a: float = 1.2,
    v: float = 0.25,
    blend_radius: float = 0.0,
    duration: float = 0.0,
) -> None:
    """Move to a pose along an arc, with evenly interpolated orientation. Returns when the move is planned.

    Args:
        via_pose: a pose on the arc. Only its position is used.
        end_pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.
        a: maximum acceleration of the tool's tip, m/s². Lower limits are kept.
        v: maximum velocity of the tool's tip, m/s. Lower limits are kept.
        blend_radius: as in moveJoint, m.
        duration: exact move duration, s, up to a day; a and v are then ignored. 0: use a and v.
    """
    via, goal = place_of(via_pose, "via_pose").position, place_of(end_pose, "end_pose")
    rate = Rate(a, v, blend_radius, duration)
    await _add(robot, origin, "moveCircle", PlannerName.CIRC, goal, rate, via)


@service("MotionControl")
def get_exec_id(robot: Services) -> int:
    """The number of the current move in the queue. Each number is reported for at least 0.2 s, even if the
    arm does not have to move.

    Returns:
        The number of the move, counted from 1. -1 if the queue is empty, also after a stop or a fault has
            emptied it.
    """
    return robot.queue.current


@service("MotionControl")
def get_queue_size(robot: Services) -> int:
    """The number of accepted moves that have not ended.

    Returns:
        The number, including the current move.
    """
    return robot.queue.size


@service("MotionControl")
def get_duration(robot: Services, exec_id: int) -> float:
    """The duration of a move that has not ended, at full speed and without blends.

    Args:
        exec_id: number of the move, as in getExecId.

    Returns:
        the duration, s.
    """
    duration_s = robot.queue.duration_s(exec_id)
    if duration_s is None:
        raise NotFoundError(f"there is no move {exec_id} in the queue")
    return duration_s


@service("MotionControl")
def get_last_error(robot: Services) -> str:
    """The reason why the queue was last cleared.

    Returns:
        The reason as a sentence; empty once another move is accepted.
    """
    return robot.queue.last_error


@service("MotionControl")
def get_speed_fraction(robot: Services) -> float:
    """The speed override: how fast motions run along their paths.

    Returns:
        A share of their planned speed: 0, or from 0.01 to 1.
    """
    return robot.ownership.speed_fraction


@service("MotionControl")
async def set_speed_fraction(robot: Services, fraction: float) -> None:
    """Set the speed override, for the current motion and all later ones.

    Rejected while another client is moving the arm or has control of it, and during a streaming session. A
    value that a program or the holder of a control lease has set ends with the program or the lease.

    Args:
        fraction: share of the planned speed: 0 (the arm waits), or from 0.01 to 1.
    """
    await robot.ownership.set_speed_fraction(fraction)


@service("MotionControl")
async def stop_move(robot: Services) -> None:
    """Stop on the path. The current and the queued moves wait until startMove or clearPath.

    With an empty queue this does nothing. It is rejected while another request is moving the arm.
    """
    _require_no_other_motion(robot)
    if not robot.queue.idle:
        await robot.ownership.speed_override.pause()


@service("MotionControl")
async def start_move(robot: Services) -> None:
    """Continue after stopMove. Rejected while another client has control of the arm."""
    robot.ownership.require_control()
    await robot.ownership.speed_override.resume()


@service("MotionControl")
async def clear_path(robot: Services) -> None:
    """Stop on the path and remove all moves from the queue. Returns when the arm is at rest.

    With an empty queue this does nothing. It is rejected while another request is moving the arm.
    """
    _require_no_other_motion(robot)
    await robot.queue.clear("the path was cleared by MotionControl/clearPath")


@service("MotionControl")
async def stop_joint(robot: Services, acc: float = 0.0) -> None:
    """Stop on the path as fast as the limits permit, and remove all moves. Returns when the arm is at rest.

    This also ends motions of other clients, because a stop needs no control.

    Args:
        acc: deceleration, rad/s²: 0, or at least the joints' limits. A gentler stop is not supported.
    """
    _require_fastest(acc, float(robot.robot.limits.max_acceleration.max()), "rad/s²")
    await robot.stopping.stop_motion(StopReason("stopped by MotionControl/stopJoint"))


@service("MotionControl")
async def stop_line(robot: Services, acc: float = 0.0, acc_rot: float = 0.0) -> None:
    """Stop on the path as fast as the limits permit, and remove all moves. Returns when the arm is at rest.

    This also ends motions of other clients, because a stop needs no control.

    Args:
        acc: deceleration, m/s²: 0, or at least the limit of the tool's tip. A gentler stop is not supported.
        acc_rot: angular deceleration, rad/s²; as acc.
    """
    limits = robot.robot.cartesian_limits
    _require_fastest(acc, limits.max_linear_acceleration, "m/s²")
    _require_fastest(acc_rot, limits.max_angular_acceleration, "rad/s²")
    await robot.stopping.stop_motion(StopReason("stopped by MotionControl/stopLine"))


@service("MotionControl")
async def set_servo_mode(robot: Services, enable: bool) -> None:
    """Begin a servo session in mode 1, or end the current one. Returns when the session has begun, or has
    ended with the arm at rest.

    Args:
        enable: true: begin a session; false: end it. For other modes see setServoModeSelect.
    """
    await (robot.servo.begin(ServoMode.REPLANNED) if enable else robot.servo.end())


@service("MotionControl")
async def set_servo_mode_select(
    robot: Services, qmode: int, watchdog_timeout: float = 0.0, send_period: float = 0.0
) -> None:
    """Begin a servo session in a mode. A running session is ended first. Send points with servoJoint,
    servoCartesian or the topic joint_cmd.

    Args:
        qmode: 0: end the session. 1: always move to the newest point. 2: pass through the points. 3, 4: pass
            through the points of a buffer. 5: a planned motion through all points. 6, 7: like 1 and 5, with
            force control.
        watchdog_timeout: time without a point after which the session ends, s; 0 for 0.5 s.
        send_period: interval between points, s; 0 for the control period.
    """
    await robot.servo.begin(qmode, watchdog_timeout, send_period)


@service("MotionControl")
def get_servo_mode(robot: Services) -> int:
    """The mode of the servo session.

    Returns:
        1 to 7, see setServoModeSelect; 0 without a session.
    """
    return int(robot.servo.feedback()["mode"])


service("MotionControl", name="getServoModeSelect")(get_servo_mode)


@service("MotionControl")
def is_servo_mode_enabled(robot: Services) -> bool:
    """Whether a servo session is open.

    Returns:
        true if points are accepted.
    """
    return robot.servo.active


@service("MotionControl")
def get_servo_feedback(robot: Services) -> Json:
    """State of the servo session, and the points that have been rejected since the session began. If there is
    no session, the values of the last session are returned.

    Returns:
        JSON: an object, see docs/servo.md.
    """
    return robot.servo.feedback()


@service("MotionControl")
async def servo_joint(
    robot: Services,
    q: list[float],
    a: float = 0.0,
    v: float = 0.0,
    t: float = 0.0,
    lookahead_time: float = 0.0,
    gain: float = 0.0,
) -> None:
    """Send a point to the servo session. Returns when the point is accepted, before the arm reaches it.

    Args:
        q: joint angles, rad, one for each joint.
        a: not used, as the manual says.
        v: not used, as the manual says.
        t: time parameter of the point, s; 0 for the send period.
        lookahead_time: look-ahead time of the servo law, s; 0 for none.
        gain: gain of the servo law; 0 for none.
    """
    await robot.servo.point(q, time_s=t, lookahead_s=lookahead_time, gain=gain)


@service("MotionControl")
async def servo_cartesian(
    robot: Services,
    pose: list[float],
    a: float = 0.0,
    v: float = 0.0,
    t: float = 0.0,
    lookahead_time: float = 0.0,
    gain: float = 0.0,
) -> None:
    """Send a point to the servo session as a pose. Of the solutions of the inverse kinematics, the one
    nearest to the last point is used. Returns when the point is accepted.

    Args:
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.
        a: not used, as the manual says.
        v: not used, as the manual says.
        t: time parameter of the point, s; 0 for the send period.
        lookahead_time: look-ahead time of the servo law, s; 0 for none.
        gain: gain of the servo law; 0 for none.
    """
    await robot.servo.point(pose, cartesian=True, time_s=t, lookahead_s=lookahead_time, gain=gain)


async def _add(
    robot: Services,
    origin: CallOrigin,
    name: str,
    planner: PlannerName,
    target: Array | Pose,
    rate: Rate,
    via: Array | None = None,
) -> None:
    if rate.duration_s < 0.0:
        raise InputError(f"duration must not be negative, got {rate.duration_s:g} s")
    envelope = robot.settings.envelope

    def plan(goal: MotionRequest, start: Array) -> RatedMove:
        request = robot.goals.request(goal, start)
        return RatedMove(request, rate.velocity, rate.acceleration, envelope, rate.duration_s)

    goals = [MotionRequest(NO_START, target, planner, Scaling(1.0), via)]
    request = queue_request(name, goals, plan, rate.blend_radius_m)
    await robot.queue.add(request, origin.stops, origin.token)


def _require_no_other_motion(robot: Services) -> None:
    """Check that no other client is moving the arm, because stopping the queue does not stop other
    motions.
    """
    owner = robot.ownership.owner if robot.queue.idle and robot.ownership.in_motion else None
    if owner is not None:
        raise ConflictError(f"the queue is empty, but {owner} is moving the arm; stopJoint stops it")


def _require_fastest(acceleration: float, limit: float, unit: str) -> None:
    if acceleration != 0.0 and acceleration < limit:
        raise NotSupportedError(
            f"a stop is always as fast as the limits permit; give 0, or at least {limit:g} {unit}, got "
            f"{acceleration:g}"
        )
