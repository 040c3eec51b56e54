"""Follows the actions and conditions of one motion, and carries out those actions that rtloop leaves to the
service.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from app.services.rights.signal_results import ActionOutcome, ContactOutcome, SignalResults
from app.services.state.link import RobotLink
from cobot.errors import CobotError
from cobot.ipc.layout import Firing, Waiting
from cobot.ipc.signal_record import Fired, Met, SignalReport
from cobot.motions.signals import NO_PLACED, Placed, PlacedAction
from cobot.types import Array, Scaling

log = logging.getLogger("cobot.signals")

CommandGripper = Callable[[Mapping[str, Any]], None]
"""Type of a function that starts a gripper command and returns at once. It raises `CobotError` if the command
is rejected.
"""


class FollowsSignals(Protocol):
    """The interface of a follower of a motion's signals; see `SignalFollower`."""

    @property
    def results(self) -> SignalResults: ...
    @property
    def is_missed(self) -> bool: ...
    @property
    def until(self) -> str: ...
    def look(self) -> None: ...
    def rest(self, tcp: Array) -> None: ...


class SignalFollower:
    """Follows the signals of one motion, or of one part of it."""

    def __init__(
        self, link: RobotLink, placed: Placed, motion_id: int, command_gripper: CommandGripper, job: str = ""
    ) -> None:
        """
        Args:
            job: id of the motion's job, for events; "" if there is no job.
        """
        self._link = link
        self._placed = placed
        self._motion_id = motion_id
        self._begin_s = 0.0
        self._job = job
        self._command_gripper = command_gripper
        self._results = {each.number: _pending(each) for each in placed.actions}
        self._waiting = Waiting.NO
        self._contact: ContactOutcome | None = None

    @property
    def results(self) -> SignalResults:
        """Results of the actions and conditions so far."""
        waits_for = {Waiting.START: self._placed.start_when, Waiting.PAUSE: self._placed.pause_while}
        condition, until = waits_for.get(self._waiting), self._placed.until
        name = "start_when" if self._waiting is Waiting.START else "pause_while"
        return SignalResults(
            tuple(self._results[number] for number in sorted(self._results)),
            "" if condition is None else f"{name}: {condition.words}",
            "" if until is None or self._contact is None else until.condition.words,
            self._contact,
        )

    @property
    def contact(self) -> ContactOutcome | None:
        """The state of the arm when `until` was met; None if it was not met."""
        return self._contact

    @property
    def is_missed(self) -> bool:
        """Whether `until` was required and is not met."""
        until = self._placed.until
        return until is not None and until.is_required and self._contact is None

    @property
    def until(self) -> str:
        """The `until` condition as text; "" if there is none."""
        return "" if self._placed.until is None else self._placed.until.condition.words

    @property
    def retract_m(self) -> float:
        """Distance that the TCP must move back after the motion, m."""
        until = self._placed.until
        return 0.0 if until is None or self._contact is None else until.retract_m

    @property
    def retract_scaling(self) -> Scaling:
        """Speed scaling of the move back."""
        assert self._placed.until is not None
        return self._placed.until.scaling

    @property
    def settled(self) -> frozenset[int]:
        """Numbers of the actions that are known to have fired or to have been rejected."""
        return frozenset(number for number, result in self._results.items() if result.path_time_s is not None)

    def continue_with(self, placed: Placed, motion_id: int, begin_s: float) -> None:
        """Follow the signals on another path. Results of actions are kept.

        Args:
            placed: the signals, at path times since the start of the motion.
            begin_s: path time at which this follower's part of the motion begins.
        """
        self._placed, self._motion_id, self._begin_s = placed, motion_id, begin_s
        for each in placed.actions:
            before = self._results[each.number]
            if before.path_time_s is None:
                self._results[each.number] = replace(before, planned_s=each.path_time_s - begin_s)

    def look(self, *, is_current: bool = True) -> None:
        """Read rtloop's report. For each action that has fired since the last call, publish an event and
        command the gripper.

        Args:
            is_current: whether the arm is on this follower's part of the motion.
        """
        report = None if self._placed is NO_PLACED else self._link.signals()
        if report is None or report.motion_id != self._motion_id:
            return
        self._waiting = report.waiting if is_current else Waiting.NO
        self._look_at_actions(report)
        if report.met is not None and self._placed.until is not None and self._contact is None:
            self._contact = _contact(report.met, self._begin_s)

    def rest(self, tcp: Array) -> None:
        """Stop following the signals. Called when the motion has ended and the TCP is at rest at `tcp`, shape
        (7,).
        """
        self.look()
        self.note_rest(tcp)
        self.end()

    def note_rest(self, tcp: Array) -> None:
        """Record the TCP pose at rest, shape (7,)."""
        self._waiting = Waiting.NO
        if self._contact is not None:
            overshoot_m = float(np.linalg.norm(np.array(self._contact.position) - tcp[:3]))
            self._contact = replace(self._contact, overshoot_m=overshoot_m)

    def end(self) -> None:
        """End, because no further action can fire, and publish an event for each action that has not
        fired.
        """
        for result in self._results.values():
            if not result.fired and not result.problem:
                self._tell("not fired", result)

    def note_retraction(self, by_m: float) -> None:
        """Record how far the TCP has moved back, m."""
        if self._contact is not None:
            self._contact = replace(self._contact, retracted_m=by_m)

    def _look_at_actions(self, report: SignalReport) -> None:
        for each in self._placed.actions:
            fired, before = report.fired.get(each.number), self._results[each.number]
            if fired is None or before.path_time_s is not None:
                continue
            result = _fired(before, fired, self._begin_s)
            if each.action.gripper is not None:
                result = self._grip(each.action.gripper, result)
            self._results[each.number] = result
            self._tell("rejected" if result.problem else "fired", result, each.action.event)

    def _grip(self, command: Mapping[str, Any], result: ActionOutcome) -> ActionOutcome:
        try:
            self._command_gripper(command)
        except CobotError as exc:
            return replace(result, fired=False, problem=str(exc))
        return result

    def _tell(self, what: str, result: ActionOutcome, text: str = "") -> None:
        if result.problem:
            where = f"{self._link.label}motion {self._motion_id}"
            log.warning("%s: %s (%s): %s", where, result.action, result.does, result.problem)
        self._link.events.publish(
            "action",
            what=what,
            motion=self._motion_id,
            job=self._job or None,
            action=result.action,
            does=result.does,
            text=text,
            path_time_s=result.path_time_s,
            problem=result.problem,
        )


def planned_results(placed: Placed) -> SignalResults:
    """Return the results of a motion that has not begun."""
    actions = sorted(placed.actions, key=lambda each: each.number)
    return SignalResults(tuple(_pending(each) for each in actions))


def _pending(placed: PlacedAction) -> ActionOutcome:
    action = placed.action
    return ActionOutcome(action.field, action.words, str(action.place), placed.path_time_s)


def _fired(before: ActionOutcome, fired: Fired, begin_s: float) -> ActionOutcome:
    return replace(
        before,
        fired=fired.firing is Firing.FIRED,
        path_time_s=fired.path_time_s - begin_s,
        robot_time_s=fired.robot_time_s,
        position=tuple(fired.pose[:3].tolist()),
        problem=fired.reason,
    )


def _contact(met: Met, begin_s: float) -> ContactOutcome:
    x, y, z, qw, qx, qy, qz = met.pose.tolist()
    return ContactOutcome(
        (x, y, z),
        (qx, qy, qz, qw),
        tuple(met.wrench[:3].tolist()),
        tuple(met.wrench[3:].tolist()),
        met.value,
        met.path_time_s - begin_s,
        met.robot_time_s,
    )
