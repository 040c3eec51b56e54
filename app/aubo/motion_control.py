"""MotionControl: motions in a queue, see `app.services.motion.queue.motion_queue`, and servo modes.

Poses are those of the tool's tip, see RobotConfig/setTcpOffset, in the base frame. Long: each service is a
function that says what it takes and gives, and is the schema of it, so two that take the same both say it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from app.aubo.poses import place_of
from app.aubo.registry import CallOrigin, Json, service
from app.services.motion.queue.moves import queue_request
from cobot.errors import ConflictError, InputError, NotFoundError, NotSupportedError
from cobot.ipc.layout import ServoMode
from cobot.motions.requests import NO_START, MotionRequest, RatedMove
from cobot.types import Array, PlannerName, Pose, Scaling

if TYPE_CHECKING:
    from app.robot_services import Services


@dataclass(frozen=True, slots=True)
class Rate:
    """How fast a move of the queue is, and how far from its end the next one may begin; see `move_joint`.

    Attributes:
        acceleration, velocity: rad/s² and rad/s of the fastest joint, or m/s² and m/s of the tool's tip.
        duration_s: if above 0, how long the move takes; the two others do not count then.
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
    """Go to joint angles, in the shortest time in joint space. Answers when the move is planned; it follows
    those before.

    Args:
        q: rad, one for each joint.
        a: rad/s², of the fastest joint; a joint with a lower limit keeps that.
        v: rad/s, of the fastest joint; a joint with a lower limit keeps that.
        blend_radius: m, how far from q the TCP may be while the arm goes on into the next move, if that
            comes half a second before the arm would slow down for q; 0 stops at q.
        duration: s, up to a day; above 0 it takes exactly so long, and a and v do not count.
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
    """Go to a pose along a straight line, turning evenly. Answers when the move is planned.

    Args:
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.
        a: m/s², of the tool's tip; limits that are lower are kept.
        v: m/s, of the tool's tip; limits that are lower are kept.
        blend_radius: m, as of moveJoint.
        duration: s, up to a day; above 0 it takes exactly so long, and a and v do not count.
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
    """Go to a pose along an arc, turning evenly from start to end. Answers when the move is planned.

    Args:
        via_pose: a pose whose position the arc leads through; its orientation does not count.
        end_pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.
        a: m/s², of the tool's tip; limits that are lower are kept.
        v: m/s, of the tool's tip; limits that are lower are kept.
        blend_radius: m, as of moveJoint.
        duration: s, up to a day; above 0 it takes exactly so long, and a and v do not count.
    """
    via, goal = place_of(via_pose, "via_pose").position, place_of(end_pose, "end_pose")
    rate = Rate(a, v, blend_radius, duration)
    await _add(robot, origin, "moveCircle", PlannerName.CIRC, goal, rate, via)


@service("MotionControl")
def get_exec_id(robot: Services) -> int:
    """Which move of the queue is under way. It is shown for 0.2 s at least, even if there is nothing to move.

    Returns:
        The move's number, counted from 1; -1 when the queue is empty, also when a stop or a fault has
        emptied it.
    """
    return robot.queue.current


@service("MotionControl")
def get_queue_size(robot: Services) -> int:
    """How many moves have been accepted and have not ended.

    Returns:
        The one that is under way included.
    """
    return robot.queue.size


@service("MotionControl")
def get_duration(robot: Services, exec_id: int) -> float:
    """How long a move takes that has not ended, at full speed and without blends.

    Args:
        exec_id: the move's number, as getExecId gives it.

    Returns:
        s.
    """
    duration_s = robot.queue.duration_s(exec_id)
    if duration_s is None:
        raise NotFoundError(f"there is no move {exec_id} in the queue")
    return duration_s


@service("MotionControl")
def get_last_error(robot: Services) -> str:
    """Why the queue was emptied last.

    Returns:
        A sentence; empty once another move is accepted.
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
    """Go faster or slower along the paths, from now on: the motion that runs and all that follow.

    Refused while another client moves the arm or has control of it, and while it follows a stream. A value
    that a program or the holder of a control lease has set ends with the program or the lease.

    Args:
        fraction: of the planned speed: 0, where the arm waits, or from 0.01 to 1.
    """
    await robot.ownership.set_speed_fraction(fraction)


@service("MotionControl")
async def stop_move(robot: Services) -> None:
    """Come to rest on the path and wait there, moves that are queued included, until startMove or clearPath.

    With an empty queue it does nothing, and is refused while something else moves the arm.
    """
    _require_no_other_motion(robot)
    if not robot.queue.idle:
        await robot.ownership.speed_override.pause()


@service("MotionControl")
async def start_move(robot: Services) -> None:
    """Continue after stopMove. Refused while another client has control of the arm."""
    robot.ownership.require_control()
    await robot.ownership.speed_override.resume()


@service("MotionControl")
async def clear_path(robot: Services) -> None:
    """Come to rest on the path and forget all moves of the queue. Answers when the arm rests.

    With an empty queue it does nothing, and is refused while something else moves the arm.
    """
    _require_no_other_motion(robot)
    await robot.queue.clear("the path was cleared by MotionControl/clearPath")


@service("MotionControl")
async def stop_joint(robot: Services, acc: float = 0.0) -> None:
    """Come to rest on the path as fast as the limits permit, and forget all moves. Answers at rest.

    This ends every motion, another client's too, because a stop needs no ownership.

    Args:
        acc: rad/s²; 0, or no less than the joints' limits: a gentler stop is not supported.
    """
    _require_fastest(acc, float(robot.robot.limits.max_acceleration.max()), "rad/s²")
    await robot.stopping.stop_motion("stopped by MotionControl/stopJoint")


@service("MotionControl")
async def stop_line(robot: Services, acc: float = 0.0, acc_rot: float = 0.0) -> None:
    """Come to rest on the path as fast as the limits permit, and forget all moves. Answers at rest.

    This ends every motion, another client's too, because a stop needs no ownership.

    Args:
        acc: m/s²; 0, or no less than the limit of the tool's tip: a gentler stop is not supported.
        acc_rot: rad/s²; the same.
    """
    limits = robot.robot.cartesian_limits
    _require_fastest(acc, limits.max_linear_acceleration, "m/s²")
    _require_fastest(acc_rot, limits.max_angular_acceleration, "rad/s²")
    await robot.stopping.stop_motion("stopped by MotionControl/stopLine")


@service("MotionControl")
async def set_servo_mode(robot: Services, enable: bool) -> None:
    """Begin a servo session in mode 1, or end the one that is under way. Answers when it has, at rest.

    Args:
        enable: whether to begin one; see setServoModeSelect for the other modes.
    """
    await (robot.servo.begin(ServoMode.REPLANNED) if enable else robot.servo.end())


@service("MotionControl")
async def set_servo_mode_select(
    robot: Services, qmode: int, watchdog_timeout: float = 0.0, send_period: float = 0.0
) -> None:
    """Begin a servo session in a mode; one that is under way is ended before. Points come by servoJoint,
    servoCartesian or the topic joint_cmd.

    Args:
        qmode: 0 leaves; 1 re-planned to the newest point, 2 passed through, 3 and 4 passed through from a
            buffer, 5 planned through all points, 6 and 7 as 1 and 5 with force control.
        watchdog_timeout: s, without a point for so long the session ends; 0 for 0.5 s.
        send_period: s, how often points come; 0 for the control period.
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
    """Whether a servo session is under way.

    Returns:
        Whether points are taken.
    """
    return robot.servo.active


@service("MotionControl")
def get_servo_feedback(robot: Services) -> Json:
    """What the servo session does, and what was refused since it began; without one of the last one.

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
    """A point of the servo session. Answers when it is taken, not when the arm is there.

    Args:
        q: rad, one for each joint.
        a: not used, as the manual says.
        v: not used, as the manual says.
        t: s, the point's time parameter; 0 for the send period.
        lookahead_time: s, of the servo law; 0 for none.
        gain: of the servo law; 0 for none.
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
    """A point of the servo session as a pose, by inverse kinematics near the last one. Answers when taken.

    Args:
        pose: [x, y, z, rx, ry, rz] in the base frame, m and rad.
        a: not used, as the manual says.
        v: not used, as the manual says.
        t: s, the point's time parameter; 0 for the send period.
        lookahead_time: s, of the servo law; 0 for none.
        gain: of the servo law; 0 for none.
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
    """See that the queue is what moves the arm, if anything does: else its stop would be none."""
    owner = robot.ownership.owner if robot.queue.idle and robot.ownership.in_motion else None
    if owner is not None:
        raise ConflictError(f"the queue is empty, but {owner} moves the arm; stopJoint stops it")


def _require_fastest(acceleration: float, limit: float, unit: str) -> None:
    if acceleration != 0.0 and acceleration < limit:
        raise NotSupportedError(
            f"a stop is as fast as the limits permit: give 0, or from {limit:g} {unit}, not {acceleration:g}"
        )
