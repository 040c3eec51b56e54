"""The REST client's commands for the gripper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from cobot.client.connection import Json
from cobot.client.jobs import JobHandle

if TYPE_CHECKING:
    from cobot.client.moves import Moves


class GripperCommands:
    """The commands for the gripper of one robot, which a client provides as `gripper`.

    Commands return when the fingers have finished, with the gripper's state and `held`; with `wait=False`
    they return a `JobHandle` immediately. A new command replaces a running one. Widths are in m, speeds in
    m/s, forces in N. The gripper defines the defaults of optional values.
    """

    def __init__(self, client: Moves) -> None:
        self._client = client

    def state(self) -> Json:
        """The state of the gripper: `type`, `connected`, `problem`, `state`, `command`, `held`,
        `capabilities`.
        """
        return self._client._json("GET", "/robot/gripper")

    def move(
        self,
        width: float,
        speed: float | None = None,
        force: float | None = None,
        *,
        if_blocked: str | None = None,
        wait: bool = True,
    ) -> Json | JobHandle:
        """Move to a width.

        Args:
            if_blocked: with "success", the motion succeeds if an object stops the fingers, and the object is
                then held.
        """
        return self._run("move", wait, width=width, speed=speed, force=force, if_blocked=if_blocked)

    def grasp(self, width: float | None = None, *, wait: bool = True, **how: Any) -> Json | JobHandle:
        """Close on an object and hold it.

        Args:
            width: width of the object; None for any width.
            how: `tolerance_inner`, `tolerance_outer`, `speed`, `force`, `if_missed`.
        """
        return self._run("grasp", wait, width=width, **how)

    def release(self, width: float | None = None, *, wait: bool = True) -> Json | JobHandle:
        """Release the object: open to a width, or as far as possible."""
        return self._run("release", wait, width=width)

    def home(self, *, wait: bool = True) -> Json | JobHandle:
        """Activate the gripper, or have it find its reference."""
        return self._run("home", wait)

    def stop(self) -> Json:
        """Stop the fingers at their current position. An object in the gripper stays held."""
        return self._client._json("POST", "/robot/gripper/stop")

    def _run(self, kind: str, wait: bool, **body: Any) -> Json | JobHandle:
        given = {name: value for name, value in body.items() if value is not None}
        return self._client._motion(f"/robot/gripper/{kind}", given, wait)
