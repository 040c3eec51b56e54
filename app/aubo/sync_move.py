"""SyncMove: frames, and robots that move together. Frames and groups are the same for all robots."""

from __future__ import annotations

from typing import TYPE_CHECKING

from app.aubo.poses import numbers_of, place_of
from app.aubo.registry import service
from app.services.motion.frames import WORLD

if TYPE_CHECKING:
    from app.robot_services import Services

CLASS = "SyncMove"
VELOCITY = 0.5
ACCELERATION = 0.5


@service(CLASS)
def sync_move_on(robot: Services, syncident: int, taskset: list[str]) -> None:
    """Have robots move segment by segment, together, from now on. Any of them may say so, or each.

    Args:
        syncident: a number of your choice.
        taskset: the robots' names.
    """
    robot.sync.begin(syncident, taskset)


@service(CLASS)
async def sync_move_segment(
    robot: Services, segment: int, q: list[float], a: float = ACCELERATION, v: float = VELOCITY
) -> bool:
    """This robot's part of a segment. The last robot's part starts the segment.

    All robots begin together, and each takes as long as the slowest; when one stops, all do. The call that
    starts a segment waits for the end of the segment before it.

    Args:
        segment: its number, the same for all robots.
        q: the target of this robot, rad.
        a: the maximum acceleration of the fastest joint, rad/s²; 0 for 0.5.
        v: the maximum velocity of the fastest joint, rad/s; 0 for 0.5.

    Returns:
        whether the segment has been started; false when it waits for another robot.
    """
    return await robot.sync.segment(robot.robot.name, segment, q, a, v)


@service(CLASS)
def sync_move_off(robot: Services, syncident: int) -> None:
    """Let the robots move by themselves again. Fails while a segment waits for a robot.

    Args:
        syncident: as syncMoveOn got it.
    """
    robot.sync.end(syncident)


@service(CLASS)
def sync_move_undo(robot: Services, syncident: int) -> None:
    """Let the robots move by themselves again, and forget segments that wait.

    Args:
        syncident: as syncMoveOn got it.
    """
    robot.sync.end(syncident, undo=True)


@service(CLASS)
def is_sync_move_on(robot: Services) -> bool:
    """Whether this robot moves together with others.

    Returns:
        whether it does.
    """
    return robot.sync.is_on(robot.robot.name)


@service(CLASS)
async def sync_move_wait(robot: Services) -> None:
    """Wait until no synchronous motion moves this robot."""
    await robot.sync.wait((robot.robot.name,))


@service(CLASS)
def axis_group_add(robot: Services, name: str, robots: list[str]) -> None:
    """Give some robots a name.

    Args:
        name: of your choice.
        robots: their names; the order is that of their joints in axisGroupMoveJoint.
    """
    robot.sync.add_group(name, robots)


@service(CLASS)
def axis_group_delete(robot: Services, name: str) -> None:
    """Forget a group.

    Args:
        name: its name.
    """
    robot.sync.group(name)
    del robot.sync.groups[name]


@service(CLASS)
def axis_group_get_names(robot: Services) -> list[str]:
    """The names of all groups.

    Returns:
        in the order in which they were added.
    """
    return list(robot.sync.groups)


@service(CLASS)
def axis_group_get_axis_num(robot: Services, name: str) -> int:
    """How many joints the robots of a group have.

    Args:
        name: the group's.

    Returns:
        all together.
    """
    return sum(robot.sync.robots[each].robot.limits.dof for each in robot.sync.group(name))


@service(CLASS)
async def axis_group_move_joint(
    robot: Services, name: str, q: list[float], a: float = ACCELERATION, v: float = VELOCITY
) -> None:
    """Move the robots of a group to joint angles; answers when all have begun. When one stops, all do.

    Args:
        name: the group's.
        q: the targets of all robots one after the other, rad.
        a: the maximum acceleration of the fastest joint, rad/s²; 0 for 0.5.
        v: the maximum velocity of the fastest joint, rad/s; 0 for 0.5.
    """
    await robot.sync.move(robot.sync.targets(robot.sync.group(name), q, a, v))


@service(CLASS)
def frame_add(robot: Services, name: str, pose: list[float], ref_frame: str = WORLD) -> None:
    """Add a frame.

    Args:
        name: of your choice.
        pose: [x, y, z, rx, ry, rz] in the reference frame, m and rad, about fixed axes.
        ref_frame: on which it hangs; empty for world.
    """
    robot.sync.frames.add(name, place_of(pose), ref_frame)


@service(CLASS)
def frame_attach(robot: Services, frame: str, ref_frame: str = WORLD) -> None:
    """Hang a frame, with all that hangs on it, on another one; it stays where it is in the world.

    Args:
        frame: its name.
        ref_frame: on which it hangs from now on; empty for world.
    """
    robot.sync.frames.attach(frame, ref_frame)


@service(CLASS)
def frame_move(robot: Services, name: str, pose: list[float], ref_frame: str = "") -> None:
    """Put a frame, with all that hangs on it, somewhere else; it goes on hanging where it does.

    Args:
        name: its name.
        pose: [x, y, z, rx, ry, rz], m and rad.
        ref_frame: the frame of the pose; empty for the one on which it hangs.
    """
    robot.sync.frames.move(name, place_of(pose), ref_frame)


@service(CLASS)
def frame_delete(robot: Services, name: str) -> None:
    """Take a frame away on which none hangs.

    Args:
        name: its name.
    """
    robot.sync.frames.remove(name)


@service(CLASS)
def frame_delete_all(robot: Services) -> None:
    """Take all frames away; world stays."""
    robot.sync.frames.remove_all()


@service(CLASS)
def frame_get_pose(robot: Services, name: str, ref_frame: str = WORLD) -> list[float]:
    """Where a frame is in another one.

    Args:
        name: the frame's.
        ref_frame: the other one; empty for world.

    Returns:
        [x, y, z, rx, ry, rz], m and rad.
    """
    return numbers_of(robot.sync.frames.between(name, ref_frame))


@service(CLASS)
def frame_convert_pose(robot: Services, from_frame: str, to_frame: str, pose: list[float]) -> list[float]:
    """Convert a pose to another frame.

    Args:
        from_frame: the frame that the pose is given in; empty for world.
        to_frame: the frame of the result; empty for world.
        pose: [x, y, z, rx, ry, rz], m and rad.

    Returns:
        the pose in `to_frame`.
    """
    there = robot.sync.frames.between(from_frame or WORLD, to_frame or WORLD)
    return numbers_of(there @ place_of(pose))


@service(CLASS)
def frame_get_parent(robot: Services, name: str) -> str:
    """On which frame a frame hangs.

    Args:
        name: its name.

    Returns:
        the other one's name; empty for world.
    """
    return robot.sync.frames.parent(name)


@service(CLASS)
def frame_get_children(robot: Services, name: str = WORLD) -> list[str]:
    """Which frames hang on a frame.

    Args:
        name: its name; empty for world.

    Returns:
        their names.
    """
    return robot.sync.frames.children(name)


@service(CLASS)
def frame_get_names(robot: Services) -> list[str]:
    """The names of all frames.

    Returns:
        world first.
    """
    return robot.sync.frames.names()
