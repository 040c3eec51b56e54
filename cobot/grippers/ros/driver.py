"""The driver for a gripper that has a ROS 2 driver. It sends goals to the action of the ROS 2 driver, and
reads its joint states.
"""

from __future__ import annotations

import math
import time
from typing import Annotated, Any, Literal, NoReturn, Self

from pydantic import Field, model_validator

from cobot.clock import SYSTEM
from cobot.config import RosSection, Settings
from cobot.grippers.protocol import (
    Grasp,
    GripperCapabilities,
    GripperError,
    GripperOptions,
    GripperState,
    HeldObject,
    IoPort,
    Now,
    PowerLoss,
)
from cobot.grippers.ros.link import ActionLink, ActionProcess
from cobot.grippers.ros.rig import RosRig
from cobot.motions.fields import Finite

PARALLEL = "ParallelGripperCommand"
SUCCEEDED, CANCELED, ABORTED = 4, 5, 6
BEYOND_M = 0.003
"""A grasp aims this distance beyond the narrowest permitted object, m, because the fingers must press on
it.
"""
NEAR_M = 0.003
"""If the fingers are within this distance of the commanded width, m, they have reached it. A held object does
not move them further.
"""
LOOKS, LOOK_S = 50, 0.02
"""Maximum number of checks for the ROS 2 driver while connecting, and the interval between them."""
RosName = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$", max_length=200)]
Seconds = Annotated[float, Field(gt=0.0, le=60.0)]


class RosOptions(GripperOptions):
    """Options of `RosGripper`. The DDS domain and the networks are those of the section `ros`."""

    action: Annotated[RosName, Field(description="Name of the action, such as /hand/gripper_cmd.")]
    action_type: Annotated[
        Literal["GripperCommand", "ParallelGripperCommand"],
        Field(description="Type of the action in control_msgs."),
    ] = "GripperCommand"
    joint: Annotated[
        str, Field(min_length=1, max_length=200, description="Name of the finger joint in the joint states.")
    ]
    joint_states: Annotated[RosName, Field(description="Topic with the position of the joint.")] = (
        "/joint_states"
    )
    open_position: Annotated[Finite, Field(description="Position of the joint when open.")]
    closed_position: Annotated[Finite, Field(description="Position of the joint when closed.")] = 0.0
    open_width: Annotated[float, Field(gt=0.0, le=1.0, description="Width between open fingers, m.")]
    max_effort: Annotated[
        Finite, Field(ge=0.0, description="max_effort of a command without a force; 0: the driver's default.")
    ] = 0.0
    force: Annotated[
        tuple[Finite, Finite] | None,
        Field(strict=False, description="Smallest and largest force that a command may have, N."),
    ] = None
    answer_timeout_s: Annotated[Seconds, Field(description="Timeout for the answer to a goal, s.")] = 2.0
    result_timeout_s: Annotated[Seconds, Field(description="Timeout for the result of a goal, s.")] = 15.0
    state_timeout_s: Annotated[Seconds, Field(description="Maximum age of joint states, s.")] = 1.0
    on_power_loss: PowerLoss = PowerLoss.UNKNOWN

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.open_position == self.closed_position:
            raise ValueError(
                f"open_position and closed_position are both {self.open_position:g}; they must differ"
            )
        if self.force is not None and not 0.0 <= self.force[0] < self.force[1]:
            raise ValueError(
                f"force is {list(self.force)}; it must be a smallest and a largest value, both 0 or more"
            )
        return self


def link_settings(options: RosOptions, ros: RosSection) -> dict[str, Any]:
    """The settings with which `ActionProcess` starts its process."""
    network = ros.model_dump(mode="json", include={"domain_id", "interfaces", "localhost_only", "peers"})
    return {
        **network,
        "action": options.action,
        "type": f"control_msgs/action/{options.action_type}",
        "answer_timeout_s": options.answer_timeout_s,
        "joint_states": options.joint_states,
        "joint": options.joint,
    }


class RosGripper:
    """The driver for a gripper that has a ROS 2 driver, see the module. If a goal has ended with `stalled`,
    the fingers hold an object.
    """

    Options = RosOptions

    def __init__(self, options: RosOptions, port: IoPort, link: ActionLink, clock: Now = SYSTEM) -> None:
        self._options, self._link, self._clock = options, link, clock
        self._target_m: float | None = None
        self._closes = True
        self._held_m: float | None = None
        self._noted = False
        self.capabilities = GripperCapabilities(
            width_m=(0.0, options.open_width),
            force_n=options.force,
            object_detection=True,
            on_power_loss=options.on_power_loss,
        )

    @classmethod
    def of_robot(cls, settings: Settings, port: IoPort) -> RosGripper:
        """See `Gripper`."""
        from cobot.grippers.registry import gripper_options

        options = gripper_options(settings)
        assert isinstance(options, RosOptions)
        return cls(options, port, ActionProcess(link_settings(options, settings.ros)))

    @staticmethod
    def contract_rig(options: RosOptions) -> RosRig:
        """A simulated ROS 2 driver with this action."""
        return RosRig(options)

    def connect(self) -> None:
        """Listen to the ROS 2 driver, and wait for it briefly. What is known about a held object is kept."""
        self._link.open()
        for _ in range(LOOKS):
            if self._link.heard.problem or (self._link.heard.ready and self._link.heard.joint):
                break
            time.sleep(LOOK_S)
        self._width_m()

    def disconnect(self) -> None:
        """Continue to listen, so that a ROS 2 driver that starts later is found. The process that listens
        ends with this process.
        """
        if self._link.heard.problem:
            self._link.close()

    def open(self) -> None:
        self.move(self._options.open_width, None, None)

    def close(self) -> None:
        self.move(0.0, None, None)

    def move(self, width: float, speed: float | None, force: float | None) -> None:
        options, present_m = self._options, self._width_m()
        effort = options.max_effort if force is None else force
        position = options.closed_position + width / options.open_width * (
            options.open_position - options.closed_position
        )
        if options.action_type == PARALLEL:
            command: dict[str, Any] = {"name": [options.joint], "position": [position]}
            command |= {"effort": [effort]} if effort else {}
        else:
            command = {"position": position, "max_effort": effort}
        self._closes, self._noted = width <= present_m, False
        self._target_m, self._held_m = width, None
        self._link.send({"command": command})

    def grasp(self, grasp: Grasp) -> None:
        present_m, most_m = self._width_m(), self._options.open_width
        if grasp.width is not None and grasp.width > present_m:
            target_m = grasp.width + grasp.tolerance_outer + BEYOND_M
        else:
            target_m = 0.0 if grasp.width is None else grasp.width - grasp.tolerance_inner - BEYOND_M
        self.move(min(max(target_m, 0.0), most_m), grasp.speed, grasp.force)

    def release(self, width: float | None) -> None:
        self.move(self._options.open_width if width is None else width, None, None)

    def stop(self) -> None:
        """Cancel the running goal. A held object stays held, because its goal has ended."""
        if self._target_m is not None and self._link.heard.goal.status is None:
            self._link.cancel()

    def home(self) -> None:
        self.open()

    def state(self) -> GripperState:
        width, heard = self._width_m(), self._link.heard
        moving = self._is_under_way()
        if self._target_m is None and heard.earlier is not None:
            self._hold(heard.earlier, width)
            heard.earlier = None
        if self._held_m is not None and abs(width - self._held_m) > NEAR_M:
            self._held_m = None
        held = HeldObject.NONE
        if self._held_m is not None:
            held = HeldObject.HELD_INSIDE if self._closes else HeldObject.HELD_OUTSIDE
        return GripperState(width, self._target_m, moving, force=self._effort(), object=held)

    def _is_under_way(self) -> bool:
        """Whether a goal is running. If it has ended, its result is stored.

        Raises:
            GripperError: the ROS 2 driver has rejected or aborted the goal, or does not answer.
        """
        heard, options = self._link.heard, self._options
        goal = heard.goal
        if self._target_m is None or self._noted:
            return False
        waited_s = self._clock.now_s() - goal.sent_s
        if goal.status is not None:
            if heard.joint_s < goal.ended_s:
                return True  # the position of the joint is from before the end
            self._noted = True
            self._end(goal.status, goal.values)
            return False
        if goal.accepted is False:
            self._fail("has rejected the goal; see the log of its driver")
        if goal.accepted is None and waited_s > options.answer_timeout_s:
            self._fail(
                f"has not answered the goal within {options.answer_timeout_s:g} s; check that its driver "
                "is running"
            )
        if waited_s > options.result_timeout_s:
            self._fail(
                f"has not reported a result within {options.result_timeout_s:g} s: the result is lost, and "
                "the motion of the fingers is unknown"
            )
        return True

    def _end(self, status: int, values: dict[str, Any]) -> None:
        """Store the goal result."""
        if status not in (SUCCEEDED, CANCELED, ABORTED):
            self._fail(f"has reported the status {status} for a result: the driver does not know the goal")
        if status == ABORTED and not values["stalled"]:
            self._fail(
                "has aborted the goal; see the log of its driver, or another client may have commanded the "
                "gripper"
            )
        if status != CANCELED:
            self._hold(values, self._width_m())

    def _fail(self, words: str) -> NoReturn:
        self._target_m = None
        raise GripperError(f"{self._options.action} {words}")

    def _hold(self, values: dict[str, Any], width: float) -> None:
        if values["stalled"]:
            self._held_m = width

    def _width_m(self) -> float:
        """The width that follows from the joint's position.

        Raises:
            GripperError: the ROS 2 driver is not available, or its joint states are missing, old or not
                numbers.
        """
        heard, options, now_s = self._link.heard, self._options, self._clock.now_s()
        if heard.problem:
            raise GripperError(heard.problem)
        if not heard.ready:
            raise GripperError(
                f"there is no action {options.action} of type {options.action_type}: start its driver, and "
                "compare ROS_DOMAIN_ID with ros.domain_id"
            )
        if heard.joint is None:
            raise GripperError(
                f"{options.joint_states} has had no joint {options.joint} yet; check that its driver is "
                "running, and compare the name with `ros2 topic echo`"
            )
        if now_s - heard.joint_s > options.state_timeout_s:
            raise GripperError(
                f"{options.joint_states} has had no joint {options.joint} for more than "
                f"{options.state_timeout_s:g} s; check that its driver is running"
            )
        position = heard.joint[0]
        if not isinstance(position, float | int) or not math.isfinite(position):
            raise GripperError(f"{options.joint_states}: the position of {options.joint} is not a number")
        way = options.open_position - options.closed_position
        return min(max((position - options.closed_position) / way, 0.0), 1.0) * options.open_width

    def _effort(self) -> float | None:
        effort = None if self._link.heard.joint is None else self._link.heard.joint[1]
        return abs(effort) if isinstance(effort, float | int) and math.isfinite(effort) else None
