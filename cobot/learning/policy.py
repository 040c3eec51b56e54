"""Lets a policy move the arm. The policy answers an observation with a chunk of actions, and the real-time
loop (`rtloop`) blends consecutive chunks.

The arm follows the last chunk while the policy computes the next one. The runner therefore requests the next
chunk so early that it arrives before the current one ends. It estimates the time that a response takes from
the latest ones. Actions whose time has passed when the chunk arrives are left out. rtloop changes to the new
chunk with continuous velocity and acceleration, within the limits (docs/streaming.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from threading import Thread
from typing import Any, Protocol

import numpy as np

from cobot.client import JointImpedanceControl, JointState, Robot
from cobot.client.fingers import WidthFollower
from cobot.clock import SYSTEM, Clock
from cobot.errors import ExecutionError, InputError, MotionStopped
from cobot.learning.chunks import Latency, Meaning, actions_of, timed
from cobot.types import Array

SPARE_S = 0.02
"""Time between the arrival of a chunk and the end of the previous one, in seconds. It covers the transfer to
rtloop and a short blend.
"""
FINGERS_S = 0.005
"""Interval at which the width of the current action is sent to the fingers, in seconds."""
PATIENCE = 5
"""Maximum number of consecutive late answers. After that the run ends, because the policy is too slow for
this arm.
"""


class Policy(Protocol):
    """A source of actions, for example `cobot.learning.openpi.PolicyConnection`."""

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]: ...


class ObservationMaker(Protocol):
    """Creates observations of the kind that a policy was trained on."""

    def __call__(self, state: JointState) -> dict[str, Any]: ...


@dataclass(frozen=True, slots=True)
class Sent:
    """One chunk that was sent to the arm.

    Attributes:
        observed_s: time of the observation, on the robot's clock.
        latency_s: time from the observation until the chunk was sent.
        dropped: number of actions at the beginning that were too late.
        times_s, positions: times, shape (m,), and positions, shape (m, dof), that were sent.
        widths: widths between the fingers at these times, m, shape (m,); empty if there are no fingers.
    """

    observed_s: float
    latency_s: float
    dropped: int
    times_s: Array
    positions: Array
    widths: Array


def state_observer(
    prompt: str = "", pictures: Callable[[Array], Mapping[str, np.ndarray]] | None = None
) -> ObservationMaker:
    """The usual observation: `observation/state`, `observation/NAME` for each picture, `prompt`.

    The state contains the joints, rad. If the robot has a gripper, the width between the fingers, m, follows.

    Args:
        pictures: renders the scene for given joint angles: `cobot.learning.cameras.Renderer.render`.
    """

    def observe(state: JointState) -> dict[str, Any]:
        joints = np.array(state.q)
        numbers = joints if state.gripper is None else np.append(joints, state.gripper.known_width)
        seen: dict[str, Any] = {"observation/state": numbers.astype(np.float32), "prompt": prompt}
        for name, picture in (pictures(joints) if pictures else {}).items():
            seen[f"observation/{name}"] = picture
        return seen

    return observe


class PolicyRunner:
    """Moves an arm according to the actions of a policy.

    Attributes:
        latency: response times of the policy.
        sent: chunks that were sent to the arm. The newest is the last.

    Args:
        robot: the robot that moves. Its clock is used.
        control: session in which the chunks are streamed.
        policy: source of the actions.
        period_s: time between two actions of a chunk, as in the policy's training data.
        observe: makes the observation; by default `state_observer()`.
        meaning: meaning of an action: joint positions in rad, or offsets from the observed positions.
        every_s: interval between requests, even if a chunk is longer; None means that a request is sent
            shortly before a chunk ends.
        fingers: fingers that follow the column after the joints, a width in m, at the times of the actions;
            None means that this column is ignored. `ServedFingers.of(robot.gripper)` returns the fingers of
            the robot.
        clock: clock for waiting.
    """

    def __init__(
        self,
        robot: Robot,
        control: JointImpedanceControl,
        policy: Policy,
        period_s: float,
        *,
        observe: ObservationMaker | None = None,
        meaning: Meaning = "positions",
        every_s: float | None = None,
        fingers: WidthFollower | None = None,
        clock: Clock = SYSTEM,
    ) -> None:
        if not 0.002 <= period_s <= 1.0:
            raise InputError(f"period_s must be from 0.002 to 1 s, got {period_s}")
        if meaning not in ("positions", "offsets"):
            raise InputError(f"meaning must be positions or offsets, got {meaning!r}")
        if every_s is not None and not every_s > 0.0:
            raise InputError(f"every_s must be above 0 s, got {every_s}")
        self._robot, self._control, self._policy, self._clock = robot, control, policy, clock
        self._period_s, self._meaning, self._every_s = period_s, meaning, every_s
        self._observe = observe or state_observer()
        self._fingers = fingers
        self._late = 0
        self.latency = Latency()
        self.sent: list[Sent] = []

    def run(self, seconds: float) -> None:
        """Move the arm for `seconds`, measured on the robot's clock. The last chunk then ends, and the arm
        stops.

        Raises:
            ExecutionError: the policy fails, is always too late, or its answer is not a valid chunk for this
                arm.
            UnavailableError: the policy's server or the robot does not answer. The arm stops.
            MotionStopped: the session has ended.
        """
        until_s = self._robot.clock_s() + seconds
        while self._robot.clock_s() < until_s:
            next_s = self.once()
            self._wait(min(next_s, until_s))

    def once(self) -> float:
        """Request one chunk and send it to the arm.

        Returns the time of the next request, on the robot's clock.
        """
        observed_s = self._robot.clock_s()
        state = self._control.get_state()
        position = np.array(state.q)
        dof = len(position)
        answer = self._infer(self._observe(state))
        actions = actions_of(answer, dof, fingers=self._fingers is not None)
        now_s = self._robot.clock_s()
        self.latency.add(now_s - observed_s)
        times_s, points = timed(actions, observed_s, self._period_s, now_s, self._meaning, position)
        if not len(times_s):
            self._too_late(len(actions))
            return now_s
        self._late = 0
        joints, widths = points[:, :dof], points[:, dof:].ravel()
        self._control.set_chunk(times_s.tolist(), joints.tolist())
        dropped = len(actions) - len(times_s)
        self.sent.append(Sent(observed_s, self.latency.last_s, dropped, times_s, joints, widths))
        return self._next_s(observed_s, float(times_s[-1]))

    def _infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]:
        """Get the policy's answer. While the policy computes it, both the arm and the fingers continue with
        the last chunk.
        """
        if self._fingers is None:
            return self._policy.infer(observation)
        answer: Future[Mapping[str, Any]] = Future()

        def ask() -> None:
            try:
                answer.set_result(self._policy.infer(observation))
            except BaseException as exc:  # noqa: BLE001 - raised again where the answer is used
                answer.set_exception(exc)

        Thread(target=ask, name="policy", daemon=True).start()
        while not answer.done():
            self._aim_fingers()
            self._clock.sleep(FINGERS_S)
        return answer.result()

    def _aim_fingers(self) -> None:
        """Command the width of the latest action whose time has passed."""
        if self._fingers is None or not self.sent:
            return
        due = int(np.searchsorted(self.sent[-1].times_s, self._robot.clock_s(), "right")) - 1
        if due >= 0:
            self._fingers.aim(float(self.sent[-1].widths[due]))

    def _next_s(self, observed_s: float, end_s: float) -> float:
        in_time_s = end_s - self.latency.expected_s - SPARE_S
        return in_time_s if self._every_s is None else min(in_time_s, observed_s + self._every_s)

    def _too_late(self, count: int) -> None:
        self._late += 1
        if self._late >= PATIENCE:
            raise ExecutionError(
                f"the policy takes {self.latency.last_s:.3f} s for {count} actions of "
                f"{self._period_s:g} s; {PATIENCE} consecutive answers arrived too late for all their "
                "actions"
            )

    def _wait(self, until_s: float) -> None:
        while (left_s := until_s - self._robot.clock_s()) > 0.0:
            if not self._control.is_running():
                raise MotionStopped("the session ended during the policy's last chunk")
            self._aim_fingers()
            self._clock.sleep(min(max(left_s, 0.001), 0.05 if self._fingers is None else FINGERS_S))
