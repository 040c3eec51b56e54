"""A policy moves the arm: it sees, it thinks, its chunk of actions follows; rtloop blends chunk into chunk.

While the policy thinks, the arm follows what it has been given before. So a new chunk is asked for early
enough that it is there before the last one has run out, by what thinking has taken of late, and the actions
that it comes too late for are left out. Where it takes over, rtloop goes from the one to the other with
continuous velocity and acceleration, within the limits (docs/streaming.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from cobot.client import JointImpedanceControl, JointState, Robot
from cobot.clock import SYSTEM, Clock
from cobot.errors import ExecutionError, InputError, MotionStopped
from cobot.learning.chunks import Latency, Meaning, actions_of, timed
from cobot.types import Array

SPARE_S = 0.02
"""A chunk shall be there so long before the last one has run out: the way to rtloop and a quick blend."""
PATIENCE = 5
"""So many answers in a row that all came too late end the run: such a policy will never move this arm."""


class Policy(Protocol):
    """What is asked for actions, as `cobot.learning.openpi.PolicyConnection` is."""

    def infer(self, observation: Mapping[str, Any]) -> Mapping[str, Any]: ...


class Observer(Protocol):
    """Makes the observation that a policy was trained on."""

    def __call__(self, state: JointState) -> dict[str, Any]: ...


@dataclass(frozen=True, slots=True)
class Sent:
    """One chunk that was handed over.

    Attributes:
        observed_s: when the policy saw the arm, on the robot's clock.
        latency_s: from there until the chunk was handed over.
        dropped: so many of its first actions were too late.
        times_s, positions: what was sent, shape (m,) and (m, dof).
    """

    observed_s: float
    latency_s: float
    dropped: int
    times_s: Array
    positions: Array


def state_observer(
    prompt: str = "", pictures: Callable[[Array], Mapping[str, np.ndarray]] | None = None
) -> Observer:
    """The usual observation: `observation/state`, `observation/NAME` for each picture, `prompt`.

    Args:
        pictures: of the scene, for joint angles: `cobot.learning.cameras.Renderer.render`.
    """

    def observe(state: JointState) -> dict[str, Any]:
        joints = np.array(state.q)
        seen: dict[str, Any] = {"observation/state": joints.astype(np.float32), "prompt": prompt}
        for name, picture in (pictures(joints) if pictures else {}).items():
            seen[f"observation/{name}"] = picture
        return seen

    return observe


class PolicyRunner:
    """Has a policy move an arm.

    Attributes:
        latency: what its thinking has taken.
        sent: the chunks that were handed over, the newest last.

    Args:
        robot: whose session it is; for its clock.
        control: the session.
        policy: what is asked.
        period_s: between two actions of a chunk: that of the data the policy was trained with.
        observe: makes the observation; `state_observer()` without it.
        meaning: of an action: joint positions in rad, or offsets from the observed ones.
        every_s: ask again after so long, even if the chunk is longer; None: when it is about to run out.
        clock: to wait by.
    """

    def __init__(
        self,
        robot: Robot,
        control: JointImpedanceControl,
        policy: Policy,
        period_s: float,
        *,
        observe: Observer | None = None,
        meaning: Meaning = "positions",
        every_s: float | None = None,
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
        self._late = 0
        self.latency = Latency()
        self.sent: list[Sent] = []

    def run(self, seconds: float) -> None:
        """Go on for so long on the robot's clock; then the last chunk runs out, and the arm comes to rest.

        Raises:
            ExecutionError: the policy fails, its answer is no chunk for this arm, or always too late.
            UnavailableError: its server, or the robot, does not answer. The arm comes to rest.
            MotionStopped: the session has ended, with the reason.
        """
        until_s = self._robot.clock_s() + seconds
        while self._robot.clock_s() < until_s:
            next_s = self.once()
            self._wait(min(next_s, until_s))

    def once(self) -> float:
        """Ask once and send what comes of it; when to ask again, on the robot's clock, s."""
        observed_s = self._robot.clock_s()
        state = self._control.get_state()
        position = np.array(state.q)
        answer = self._policy.infer(self._observe(state))
        actions = actions_of(answer, len(position))
        now_s = self._robot.clock_s()
        self.latency.add(now_s - observed_s)
        times_s, points = timed(actions, observed_s, self._period_s, now_s, self._meaning, position)
        if not len(times_s):
            self._too_late(len(actions))
            return now_s
        self._late = 0
        self._control.set_chunk(times_s.tolist(), points.tolist())
        self.sent.append(Sent(observed_s, self.latency.last_s, len(actions) - len(times_s), times_s, points))
        return self._next_s(observed_s, float(times_s[-1]))

    def _next_s(self, observed_s: float, end_s: float) -> float:
        in_time_s = end_s - self.latency.expected_s - SPARE_S
        return in_time_s if self._every_s is None else min(in_time_s, observed_s + self._every_s)

    def _too_late(self, count: int) -> None:
        self._late += 1
        if self._late >= PATIENCE:
            raise ExecutionError(
                f"the policy takes {self.latency.last_s:.3f} s for {count} actions of {self._period_s:g} s: "
                f"{PATIENCE} answers in a row came when all of their actions were past"
            )

    def _wait(self, until_s: float) -> None:
        while (left_s := until_s - self._robot.clock_s()) > 0.0:
            if not self._control.is_running():
                raise MotionStopped("the session has ended while the policy's last chunk was under way")
            self._clock.sleep(min(max(left_s, 0.001), 0.05))
