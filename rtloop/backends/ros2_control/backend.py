"""An arm behind ros2_control that accepts whole motions.

Motions are sent as FollowJointTrajectory goals, and positions are received from joint_states.

The clock of the driver's computer is not used: goals have the time stamp 0, which means now, and ages are
measured with the clock of this computer.
"""

from __future__ import annotations

import contextlib
from types import MappingProxyType

import numpy as np

from cobot.config import Settings
from cobot.robot.device import Capabilities
from cobot.types import Array, JointLimits
from rtloop.backends.compiled import Measured
from rtloop.backends.protocols import BackendError
from rtloop.backends.ros2_control import words
from rtloop.backends.ros2_control.common import LOOK_S, ControllerClient, options_of
from rtloop.backends.ros2_control.link import ClientProcess, ControllerLink, Facts
from rtloop.backends.ros2_control.options import Ros2ControlOptions, client_settings, ros_names
from rtloop.backends.ros2_control.path import PathProgress, resampled
from rtloop.backends.ros2_control.rig import Ros2ControlRig

START_RAD = 0.02
"""Maximum distance of a joint from the first point of a motion, rad."""
FEEDBACK_S = 0.25
"""Maximum age of the controller's feedback, s. If the feedback is older, the measured position is used
instead.
"""


class Ros2ControlArm(ControllerClient):
    """A `TrajectoryDevice` that also reports its status; see the module."""

    Options = Ros2ControlOptions
    capabilities = Capabilities(
        measured=frozenset({"position"}), stops=MappingProxyType({2: False}), hardware=True
    )
    state_period_s = LOOK_S

    def __init__(self, settings: Settings, limits: JointLimits, link: ControllerLink | None = None) -> None:
        """Create the device. `link` replaces the connection in tests.

        Raises:
            ConfigError: the joints or the namespace are wrong.
        """
        options = options_of(settings, Ros2ControlOptions)
        made = link or ClientProcess(client_settings(options, settings, ros_names(options, limits)))
        super().__init__(options, limits, made)
        self._progress: PathProgress | None = None
        self._loaded: tuple[Array, Array] | None = None

    @staticmethod
    def contract_rig(settings: Settings, limits: JointLimits) -> Ros2ControlRig:
        """Create a rig with the backend and a simulated controller in the same process."""
        return Ros2ControlRig(Ros2ControlArm, settings, limits)

    def open(self, initial_position: Array) -> None:
        self._link.open()
        self._await()

    def enable(self) -> None:
        """Cancel any remaining goal, and check again for faults.

        The drives are not switched on here, because the driver does that.
        """
        self._link.open()
        self._link.forget()
        self._progress = None
        self._await()
        if failed := self._link.cancel():
            raise BackendError(failed)

    def state(self, measured: Measured) -> None:
        facts = self._look_at_facts()
        if problem := self._problem(facts):
            raise BackendError(problem)
        measured.position[:] = facts.position
        for row in self._options.measured:
            getattr(measured, row)[:] = getattr(facts, row)

    def load(self, times_s: Array, rows: Array) -> None:
        facts, options = self._facts, self._options
        if facts.position is not None:
            off = np.abs(np.array(facts.position) - rows[0][0])
            joint = int(off.argmax())
            if not off[joint] <= START_RAD:
                raise BackendError(
                    f"{self._names[joint]} is {off[joint]:.3f} rad from the start of the motion, allowed: "
                    f"{START_RAD} rad"
                )
        self._loaded = None
        self._link.load(*resampled(times_s, rows, options.max_points, options.resampling_rad))
        self._loaded = times_s, rows[0]

    def start(self) -> None:
        if self._loaded is None:
            raise BackendError("no motion has been loaded")
        times_s, positions = self._loaded
        self._progress = PathProgress(times_s, positions)
        self._link.start()
        goal = self._link.facts().goal
        if goal is None or goal.accepted is None:
            raise BackendError(
                f"{self._facts.action} has not answered the goal within "
                f"{self._options.answer_timeout_s:g} s; cobot cancels it if it is accepted later"
            )
        if failed := words.of_goal(goal, self._facts.action):
            raise BackendError(failed)

    def progress(self) -> float:
        goal, progress = self._facts.goal, self._progress
        if goal is None or progress is None:
            return 0.0
        if goal.status == words.SUCCEEDED:
            return progress.duration_s
        if goal.desired is not None and goal.feedback_age_s < FEEDBACK_S:
            since_s = self.status().speed_scaling * goal.feedback_age_s
            return progress.look(goal.running_s, np.array(goal.desired), since_s)
        place = self._facts.position
        return progress.look(goal.running_s, None if place is None else np.array(place), 0.0)

    def stop(self) -> None:
        """Cancel all goals. If the DDS process has ended, it is restarted first."""
        self._link.open()
        if failed := self._link.cancel():
            raise BackendError(f"{failed}: the arm may still move; press the emergency stop of the robot")

    def disable(self) -> None:
        """Cancel the goal. The driver controls the drives, so they are not switched off here."""
        with contextlib.suppress(BackendError):
            self._link.cancel()

    def close(self) -> None:
        self._link.close()

    def _problem(self, facts: Facts) -> str:
        """Return the reason why the arm cannot be moved now; "" if it can be moved."""
        goal = facts.goal
        failed = "" if goal is None else words.of_goal(goal, facts.action)
        problem = failed or self._of_driver(facts)
        if problem or goal is None:
            return problem or self._of_others(facts)
        if goal.accepted and goal.status is None and not goal.stopping:
            return self._overdue(facts)
        return self._of_others(facts)

    def _of_others(self, facts: Facts) -> str:
        if not facts.others:
            return ""
        return (
            f"another client is moving the arm with a goal of {facts.action}: stop that client, then reset; "
            "only one may command the controller"
        )

    def _overdue(self, facts: Facts) -> str:
        """Describe an overdue result; "" if it is not overdue.

        If the speed slider is below full speed, no result is reported as overdue.
        """
        goal, progress = facts.goal, self._progress
        if goal is None or progress is None or self.status().speed_scaling < 1.0:
            return ""
        allowed_s = progress.duration_s + self._options.goal_time_s + self._options.result_timeout_s
        if goal.running_s <= allowed_s:
            return ""
        return (
            f"{facts.action} has not reported a result {goal.running_s:.1f} s after the start of a motion of "
            f"{progress.duration_s:.1f} s: the controller waits for the arm to arrive within its tolerances, "
            "or it slows the motion down without a topic for it (robot.backend.speed_scaling)"
        )
