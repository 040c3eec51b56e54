"""The motions of the REST client. Each method returns when the goal is reached. With `wait=False`, it returns
the handle of its job immediately.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, overload

from cobot.client.connection import Json
from cobot.client.jobs import JobHandle, Jobs

KINDS = {
    "plan_id": "execute",
    "motions": "move/sequence",
    "name": "move/named",
    "joints": "move/joints",
    "angle": "move/arc",
}
"""The endpoint of a motion. The first of these keys in the body of the motion determines it. Without any of
them, the motion goes to a pose.
"""


class Moves(Jobs):
    """Motions. With `wait=False` they return a `JobHandle` as soon as the service has accepted them."""

    @overload
    def move_named(
        self,
        name: str,
        *,
        speed: float = ...,
        accel_scale: float = ...,
        wait: Literal[True] = ...,
        **how: Any,
    ) -> Json: ...
    @overload
    def move_named(self, name: str, *, wait: Literal[False], **how: Any) -> JobHandle: ...
    def move_named(
        self, name: str, *, speed: float = 0.1, accel_scale: float = 0.0, wait: bool = True, **how: Any
    ) -> Json | JobHandle:
        """Move to a named position. Returns when the position is reached, and raises an error if it is not
        reached.

        Args:
            how: `planner`, `budget_s`, `algorithm`, `synchronization`, `constraints`, `actions`,
                `start_when`, `pause_while` and `until`, as in POST /robot/move/named.
        """
        return self._move("named", {"name": name, "speed": speed, "accel_scale": accel_scale, **how}, wait)

    @overload
    def move_joints(
        self,
        joints: Sequence[float],
        *,
        speed: float = ...,
        accel_scale: float = ...,
        wait: Literal[True] = ...,
        **how: Any,
    ) -> Json: ...
    @overload
    def move_joints(self, joints: Sequence[float], *, wait: Literal[False], **how: Any) -> JobHandle: ...
    def move_joints(
        self,
        joints: Sequence[float],
        *,
        speed: float = 0.1,
        accel_scale: float = 0.0,
        wait: bool = True,
        **how: Any,
    ) -> Json | JobHandle:
        """Move to joint angles, rad. Returns when they are reached, and raises an error if they are not
        reached.

        Args:
            how: `planner`, `budget_s`, `algorithm`, `synchronization`, `constraints`, `actions`,
                `start_when`, `pause_while` and `until`, as in POST /robot/move/joints.
        """
        body = {"joints": list(joints), "speed": speed, "accel_scale": accel_scale, **how}
        return self._move("joints", body, wait)

    @overload
    def execute(self, plan_id: str, *, wait: Literal[True] = ...) -> Json: ...
    @overload
    def execute(self, plan_id: str, *, wait: Literal[False]) -> JobHandle: ...
    def execute(self, plan_id: str, *, wait: bool = True) -> Json | JobHandle:
        """Execute a plan. Returns when its goal is reached. Raises an error if the plan has expired or its
        goal is not reached.
        """
        return self._motion("/robot/execute", {"plan_id": plan_id}, wait)

    # The parameters are the fields of POST /robot/move/pose, with the same names.
    @overload
    def move_pose(
        self,
        *,
        x: float,
        y: float,
        z: float,
        a: float = ...,
        b: float = ...,
        c: float = ...,
        speed: float | None = ...,
        accel_scale: float = ...,
        planner: str = ...,
        frame_id: str = ...,
        via: Mapping[str, float] | None = ...,
        wait: Literal[True] = ...,
        **more: Any,
    ) -> Json: ...
    @overload
    def move_pose(self, *, x: float, y: float, z: float, wait: Literal[False], **how: Any) -> JobHandle: ...
    def move_pose(
        self,
        *,
        x: float,
        y: float,
        z: float,
        a: float = 0.0,
        b: float = 0.0,
        c: float = 0.0,
        speed: float | None = None,
        accel_scale: float = 0.0,
        planner: str = "ptp",
        frame_id: str = "",
        via: Mapping[str, float] | None = None,
        wait: bool = True,
        **more: Any,
    ) -> Json | JobHandle:
        """Move the TCP to a pose (m, KUKA angles in rad). Returns when the pose is reached, and raises an
        error if it is not reached.

        Args:
            speed: share of the maximum speed. The default is 0.1, or 1 if `speed_m_s` or `speed_rad_s` is
                given.
            more: `centre`, `axis`, `through`, `radius`, `speed_m_s`, `speed_rad_s`, `budget_s`,
                `algorithm`, `synchronization`, `constraints`, `free_axes`, `cyclic`, `end_joints`, as in POST
                /robot/move/pose.
        """
        body: Json = {"x": x, "y": y, "z": z, "a": a, "b": b, "c": c}
        body |= {"accel_scale": accel_scale, "planner": planner, "frame_id": frame_id}
        if speed is not None or not more.keys() & {"speed_m_s", "speed_rad_s"}:
            body["speed"] = 0.1 if speed is None else speed
        body["via"] = dict(via) if via else None
        return self._move("pose", body | more, wait)

    @overload
    def move_arc(
        self,
        *,
        centre: Mapping[str, float],
        axis: Mapping[str, float],
        angle: float,
        wait: Literal[True] = ...,
        **more: Any,
    ) -> Json: ...
    @overload
    def move_arc(
        self,
        *,
        centre: Mapping[str, float],
        axis: Mapping[str, float],
        angle: float,
        wait: Literal[False],
        **more: Any,
    ) -> JobHandle: ...
    def move_arc(
        self,
        *,
        centre: Mapping[str, float],
        axis: Mapping[str, float],
        angle: float,
        wait: bool = True,
        **more: Any,
    ) -> Json | JobHandle:
        """Turn the TCP by `angle` (rad) about the axis through `centre` (m). Returns when the motion is
        complete.

        Args:
            more: `rise`, `turn_tool`, `frame_id`, `speed`, `accel_scale`, `speed_m_s`, `speed_rad_s`,
                `constraints`, `free_axes`, `cyclic`, as in POST /robot/move/arc.
        """
        return self._move("arc", {"centre": dict(centre), "axis": dict(axis), "angle": angle, **more}, wait)

    @overload
    def move_sequence(
        self, motions: Sequence[Mapping[str, Any]], radii: Sequence[float] = ..., *, wait: Literal[True] = ...
    ) -> Json: ...
    @overload
    def move_sequence(
        self, motions: Sequence[Mapping[str, Any]], radii: Sequence[float] = ..., *, wait: Literal[False]
    ) -> JobHandle: ...
    def move_sequence(
        self, motions: Sequence[Mapping[str, Any]], radii: Sequence[float] = (), *, wait: bool = True
    ) -> Json | JobHandle:
        """Run several motions as one. Returns when the last goal is reached.

        Args:
            motions: bodies of POST /robot/move/named, joints, pose and arc.
            radii: blend radius at the end of each motion except the last, m. Without radii, the arm stops at
                the end of each motion.
        """
        return self._move(
            "sequence", {"motions": [dict(each) for each in motions], "radii": list(radii)}, wait
        )

    def queue(self, motion: Mapping[str, Any], *, blend_radius: float = 0.0) -> JobHandle:
        """Append a motion to the queue. Returns as soon as the motion is planned.

        Args:
            motion: a body of POST /robot/move/named, joints, pose, arc or sequence, or of /robot/execute.
            blend_radius: distance from the end of the motion, m, within which the TCP may leave its path to
                continue into the next one.
        """
        what = next((path for key, path in KINDS.items() if key in motion), "move/pose")
        query = {"queue": True, "blend_radius": blend_radius}
        time_s = self._motion_timeout_s
        job = self._json("POST", f"/robot/{what}", params=query, json=dict(motion), timeout=time_s)
        return JobHandle(self, str(job["id"]))

    def _move(self, what: str, body: Json, wait: bool) -> Json | JobHandle:
        return self._motion(f"/robot/move/{what}", body, wait)
