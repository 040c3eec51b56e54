"""SyncMove: frames, and synchronous motions of several robots. Frames and groups are shared by all robots."""

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
    """Begin synchronous motion: from now on, the robots move together, segment by segment. A call on one of
    the robots is enough.

    Args:
        syncident: a number of your choice.
        taskset: robot names.
    """
    robot.sync.begin(syncident, taskset)


@service(CLASS)
async def sync_move_segment(
    robot: Services, segment: int, q: list[float], a: float = ACCELERATION, v: float = VELOCITY
) -> bool:
    """Add this robot's part of a segment. The last robot's part starts the segment.

    All robots begin together and take as long as the slowest. If one stops, all stop. The call that starts a
    segment waits until the previous segment has ended.

    Args:
        segment: number of the segment, the same for all robots.
        q: target of this robot, rad.
        a: the maximum acceleration of the fastest joint, rad/s²; 0 for 0.5.
        v: the maximum velocity of the fastest joint, rad/s; 0 for 0.5.

    Returns:
        true if the segment has started; false if it is waiting for another robot.
    """
    return await robot.sync.segment(robot.robot.name, segment, q, a, v)


@service(CLASS)
def sync_move_off(robot: Services, syncident: int) -> None:
    """End synchronous motion. Fails while a segment is waiting for a robot.

    Args:
        syncident: the same number as for syncMoveOn.
    """
    robot.sync.end(syncident)


@service(CLASS)
def sync_move_undo(robot: Services, syncident: int) -> None:
    """End synchronous motion, and delete the segments that are waiting for a robot.

    Args:
        syncident: the same number as for syncMoveOn.
    """
    robot.sync.end(syncident, undo=True)


@service(CLASS)
def is_sync_move_on(robot: Services) -> bool:
    """Whether synchronous motion is on for this robot.

    Returns:
        true if it is on.
    """
    return robot.sync.is_on(robot.robot.name)


@service(CLASS)
async def sync_move_wait(robot: Services) -> None:
    """Wait until no synchronous motion is moving this robot."""
    await robot.sync.wait((robot.robot.name,))


@service(CLASS)
def axis_group_add(robot: Services, name: str, robots: list[str]) -> None:
    """Define a named group of robots.

    Args:
        name: group name.
        robots: robot names, in the order of their joints in axisGroupMoveJoint.
    """
    robot.sync.add_group(name, robots)


@service(CLASS)
def axis_group_delete(robot: Services, name: str) -> None:
    """Delete a group.

    Args:
        name: name of the group.
    """
    robot.sync.group(name)
    del robot.sync.groups[name]


@service(CLASS)
def axis_group_get_names(robot: Services) -> list[str]:
    """The names of all groups.

    Returns:
        the names, in the order they were added.
    """
    return list(robot.sync.groups)


@service(CLASS)
def axis_group_get_axis_num(robot: Services, name: str) -> int:
    """The number of joints of all robots in a group.

    Args:
        name: group name.

    Returns:
        the total number.
    """
    return sum(robot.sync.robots[each].robot.limits.dof for each in robot.sync.group(name))


@service(CLASS)
async def axis_group_move_joint(
    robot: Services, name: str, q: list[float], a: float = ACCELERATION, v: float = VELOCITY
) -> None:
    """Move the robots of a group to joint angles. Returns when all have begun. If one stops, all stop.

    Args:
        name: group name.
        q: the targets of all robots, concatenated, rad.
        a: the maximum acceleration of the fastest joint, rad/s²; 0 for 0.5.
        v: the maximum velocity of the fastest joint, rad/s; 0 for 0.5.
    """
    await robot.sync.move(robot.sync.targets(robot.sync.group(name), q, a, v))


@service(CLASS)
def frame_add(robot: Services, name: str, pose: list[float], ref_frame: str = WORLD) -> None:
    """Add a frame.

    Args:
        name: frame name.
        pose: [x, y, z, rx, ry, rz] in the reference frame, m and rad, about fixed axes.
        ref_frame: parent frame; empty for world.
    """
    robot.sync.frames.add(name, place_of(pose), ref_frame)


@service(CLASS)
def frame_attach(robot: Services, frame: str, ref_frame: str = WORLD) -> None:
    """Attach a frame and its children to a different parent. The frame's pose in the world stays the same.

    Args:
        frame: frame name.
        ref_frame: new parent frame; empty for world.
    """
    robot.sync.frames.attach(frame, ref_frame)


@service(CLASS)
def frame_move(robot: Services, name: str, pose: list[float], ref_frame: str = "") -> None:
    """Move a frame and its children. The parent frame stays the same.

    Args:
        name: frame name.
        pose: [x, y, z, rx, ry, rz], m and rad.
        ref_frame: the frame of the pose; empty for the parent frame.
    """
    robot.sync.frames.move(name, place_of(pose), ref_frame)


@service(CLASS)
def frame_delete(robot: Services, name: str) -> None:
    """Delete a frame that has no children.

    Args:
        name: frame name.
    """
    robot.sync.frames.remove(name)


@service(CLASS)
def frame_delete_all(robot: Services) -> None:
    """Delete all frames except world."""
    robot.sync.frames.remove_all()


@service(CLASS)
def frame_get_pose(robot: Services, name: str, ref_frame: str = WORLD) -> list[float]:
    """The pose of a frame in another frame.

    Args:
        name: frame name.
        ref_frame: the other frame; empty for world.

    Returns:
        the pose [x, y, z, rx, ry, rz], m and rad.
    """
    return numbers_of(robot.sync.frames.between(name, ref_frame))


@service(CLASS)
def frame_convert_pose(robot: Services, from_frame: str, to_frame: str, pose: list[float]) -> list[float]:
    """Convert a pose from one frame to another.

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
    """The parent of a frame.

    Args:
        name: frame name.

    Returns:
        the parent's name; empty for world.
    """
    return robot.sync.frames.parent(name)


@service(CLASS)
def frame_get_children(robot: Services, name: str = WORLD) -> list[str]:
    """The children of a frame.

    Args:
        name: frame name; empty for world.

    Returns:
        their names.
    """
    return robot.sync.frames.children(name)


@service(CLASS)
def frame_get_names(robot: Services) -> list[str]:
    """The names of all frames.

    Returns:
        the names, world first.
    """
    return robot.sync.frames.names()
