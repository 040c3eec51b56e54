"""The backend with a simulated controller in the same process, for the contract checks.

The simulated controller uses no clock; its time advances with each poll.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cobot.config import Settings
from cobot.ros.failures import FjtError
from cobot.ros.trajectory_controller import ABORTED, CANCELED, TrajectoryController
from cobot.types import Array, JointLimits
from rtloop.backends.protocols import BackendError, TrajectoryDevice
from rtloop.backends.ros2_control.link import Facts, GoalFacts

ACTION, CONTROLLER = "/arm_controller/follow_joint_trajectory", "arm_controller"
STEP_S = 0.05
SILENCE_S = 5.0
STOPS = {"e_stop": "the emergency stop is pressed", "protective_stop": "the force was too great"}


class Ros2ControlRig:
    """A `ContractRig` for whole motions. A stop of the robot aborts the goal and deactivates the controller,
    as drivers do. The rig has no operation-mode faults, because ROS reports no operation mode, and no
    single-packet faults, because lost packets do not affect a controller that already has a motion.
    """

    faults = frozenset({"disconnect", "frozen", "nan", *STOPS})

    def __init__(
        self, kind: Callable[..., TrajectoryDevice], settings: Settings, limits: JointLimits
    ) -> None:
        self._kind, self._settings, self._limits = kind, settings, limits
        start = 0.4 * limits.min_position + 0.6 * limits.max_position
        rows = np.zeros((3, limits.dof))
        rows[0] = np.where(np.isfinite(start), start, 0.0)
        self.controller = TrajectoryController(limits.names, rows, self._end)
        self.active: set[str] = set()
        self.gpio: dict[str, float] = {}
        self.link = RigLink(self)

    def backend(self) -> TrajectoryDevice:
        self.link = RigLink(self)
        return self._kind(self._settings, self._limits, self.link)

    def inject(self, fault: str) -> None:
        self.active.add(fault)
        if fault in STOPS:
            self.controller.end(ABORTED, FjtError.INVALID_GOAL, STOPS[fault])
            self.controller.active = False

    def clear(self, fault: str) -> None:
        self.active.discard(fault)
        if fault in STOPS:
            self.controller.active = True

    def _end(self, key: str, status: int, result: dict[str, Any]) -> None:
        self.link.end(key, status, result)


class RigLink:
    """A `ControllerLink` to the rig's controller. Each poll advances its time by `STEP_S`."""

    def __init__(self, rig: Ros2ControlRig) -> None:
        self._rig = rig
        self._motion: dict[str, Any] | None = None
        self._goal: dict[str, Any] | None = None
        self._number = 0
        self._seen: tuple[list[float], list[float]] | None = None

    def open(self) -> None: ...

    def close(self) -> None: ...

    def pause(self, duration_s: float) -> None: ...

    def set_output(self, interface: str, value: float) -> None:
        self._rig.gpio[interface] = value

    def facts(self) -> Facts:
        rig, controller = self._rig, self._rig.controller
        controller.step(STEP_S)
        goal = self._goal
        if goal is not None and goal.get("status") is None:
            goal["running_s"] += STEP_S
        away = "disconnect" in rig.active
        if self._seen is None or not (away or "frozen" in rig.active):
            self._seen = controller.rows[0].tolist(), controller.rows[1].tolist()
        position, velocity = (list(each) for each in self._seen)
        if "nan" in rig.active:
            position[0] = float("nan")
        if goal is not None and not away and controller.goal is not None:
            goal |= {"desired": controller.rows[0].tolist(), "feedback_age_s": 0.0}
        state = "active" if controller.active else "inactive"
        named = {"name": CONTROLLER, "state": state, "joints": list(controller.joints)}
        return Facts(
            action=ACTION,
            ready=not away,
            controllers=[named],
            controller=CONTROLLER,
            age_s=SILENCE_S if away else 0.0,
            rate_hz=250.0,
            position=position,
            velocity=velocity,
            gpio=dict(rig.gpio),
            gpio_age_s=0.0,
            effort=[0.0] * len(position),
            goal=None if goal is None else GoalFacts(**goal),
        )

    def load(self, times_s: Array, rows: Array) -> None:
        self._require()
        names = ("positions", "velocities", "accelerations")
        points = [
            {name: rows[order][place].tolist() for order, name in enumerate(names)}
            | {"time_from_start": {"sec": 0, "nanosec": 1e9 * float(time_s)}}
            for place, time_s in enumerate(times_s)
        ]
        self._motion = {"trajectory": {"joint_names": list(self._rig.controller.joints), "points": points}}

    def start(self) -> None:
        self._require()
        assert self._motion is not None
        self._number += 1
        refusal = self._rig.controller.refusal(self._motion)
        self._goal = {"accepted": not refusal, "running_s": 0.0}
        if not refusal:
            self._rig.controller.begin(str(self._number), self._motion)

    def cancel(self) -> str:
        if "disconnect" in self._rig.active:
            return f"there is no server for the action {ACTION}, so nothing can be cancelled"
        if self._goal is not None:
            self._goal["stopping"] = True
        self._rig.controller.end(CANCELED, FjtError.SUCCESSFUL, "")
        return ""

    def forget(self) -> None:
        self._goal = None

    def end(self, key: str, status: int, result: dict[str, Any]) -> None:
        """Store the result of a goal."""
        if self._goal is not None and key == str(self._number):
            self._goal |= {"status": status, **result}

    def _require(self) -> None:
        if "disconnect" in self._rig.active:
            raise BackendError(f"there is no server for the action {ACTION}")
