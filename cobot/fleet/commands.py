"""Decides which commands a cell executes: each one once, and none after its deadline.

The clock of a computer may be wrong by minutes, so deadlines are on the hub's clock. A cell asks the hub for
its time. That time is uncertain by the round trip. The cell uses the latest possible time, so a command that
may be late is rejected.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass

from cobot.clock import SYSTEM, Clock
from cobot.errors import BusyError, CobotError, ConflictError, InputError, UnavailableError
from cobot.fleet.messages import MAX_LIFETIME_S, CommandAnswer, FleetCommand, HubTime, StopArm

FRESH_S = 30.0
"""Maximum age of a known time of the hub, s. After it the cell asks again."""
MAX_COMMANDS = 1000
"""Maximum number of commands that are remembered until their deadline."""
ANSWER_S = 20.0
"""Longest wait of a retry for the answer to the first try."""
AHEAD_S = 1.0
"""Maximum time by which a command's issue may be ahead of the hub's time in this cell, s."""


@dataclass(frozen=True, slots=True)
class KnownTime:
    """The hub's time, with the times of this computer's clock before and after the question."""

    hub: HubTime
    asked_s: float
    answered_s: float

    def latest(self, now_s: float) -> float:
        """The latest time that the hub's clock can have."""
        return self.hub.time_s + (now_s - self.asked_s)

    def earliest(self, now_s: float) -> float:
        """The earliest time that the hub's clock can have."""
        return self.hub.time_s + (now_s - self.answered_s)


def _same(one: FleetCommand, other: FleetCommand) -> bool:
    """Whether one command is a retry of the other. A retry may have another deadline, or fewer robots."""
    return (one.action, one.who, one.role, one.epoch) == (other.action, other.who, other.role, other.epoch)


class CommandBook:
    """The commands of one robot. Thread safe.

    Args:
        ask_time: asks the hub for its time; returns None if it does not answer.
    """

    def __init__(
        self, cell: str, robot: str, ask_time: Callable[[], HubTime | None], clock: Clock = SYSTEM
    ) -> None:
        self._cell, self._robot = cell, robot
        self._ask_time = ask_time
        self._clock = clock
        self._known: KnownTime | None = None
        self._started: KnownTime | None = None
        self._answers: dict[str, tuple[Future[CommandAnswer], FleetCommand]] = {}
        self._lock = threading.Lock()

    def run(self, command: FleetCommand, execute: Callable[[], str]) -> CommandAnswer:
        """Execute a command once, or return the answer of its first try.

        Args:
            execute: executes the command, and returns a sentence about the result.
        """
        try:
            first = self._begin(command)
        except CobotError as exc:
            return self._answer(command, exc.code, str(exc))
        if first is not None:
            try:
                return first.result(ANSWER_S).model_copy(update={"repeated": True})
            except FutureTimeout:
                return self._answer(command, BusyError.code, "the first try of this command is still running")
        try:
            answer = self._answer(command, "ok", execute())
        except CobotError as exc:
            answer = self._answer(command, exc.code, str(exc))
        except BaseException as exc:
            self._answers[command.id][0].set_exception(exc)
            raise
        self._answers[command.id][0].set_result(answer)
        return answer

    def synchronize(self) -> None:
        """Ask the hub for its time. Call this at the start, because commands from before the first answer are
        rejected."""
        asked_s = self._clock.now_s()
        found = self._ask_time()
        with self._lock:
            if found is not None:
                self._known = KnownTime(found, asked_s, self._clock.now_s())
                self._started = self._started or self._known

    def _begin(self, command: FleetCommand) -> Future[CommandAnswer] | None:
        """None if the command must be executed now; otherwise the future of its first try.

        Raises:
            InputError: the times of the command are invalid.
            ConflictError: the command is late, or was issued before this process started.
            UnavailableError: the hub's time is unknown.
        """
        known = self._time_for(command)
        with self._lock:
            now_s = self._clock.now_s()
            entry = self._answers.get(command.id)
            if entry is not None and _same(entry[1], command):
                return entry[0]
            if entry is not None:
                raise ConflictError(f"id {command.id}: another command had this id already; use a new id")
            self._check(command, known, now_s)
            self._forget(known, now_s)
            if len(self._answers) >= MAX_COMMANDS:
                raise BusyError(
                    f"{len(self._answers)} commands wait for their deadlines, allowed are {MAX_COMMANDS}; "
                    "try again in a minute"
                )
            self._answers[command.id] = Future(), command
            return None

    def _time_for(self, command: FleetCommand) -> KnownTime:
        """The hub's time. The hub is asked again if the known time is old or from another epoch."""
        known = self._known
        if (
            known is None
            or known.hub.epoch != command.epoch
            or self._clock.now_s() - known.answered_s > FRESH_S
        ):
            self.synchronize()
            known = self._known
        if known is None:
            raise UnavailableError(
                "the hub does not send its time, so the deadline cannot be checked; send the command again"
            )
        return known

    def _check(self, command: FleetCommand, known: KnownTime, now_s: float) -> None:
        lifetime_s = command.expires_s - command.issued_s
        if not 0.0 < lifetime_s <= MAX_LIFETIME_S:
            raise InputError(
                f"expires_s: is {lifetime_s:g} s after issued_s, allowed is more than 0 and up to "
                f"{MAX_LIFETIME_S:g} s"
            )
        if command.epoch != known.hub.epoch:
            raise ConflictError(
                f"epoch: {command.epoch} is not the epoch of the present hub; ask the hub for its time and "
                "send a new command"
            )
        latest_s = known.latest(now_s)
        if latest_s > command.expires_s:
            raise ConflictError(
                f"the command is {latest_s - command.expires_s:.1f} s late and was not executed; send a new "
                "one"
            )
        if command.issued_s > latest_s + AHEAD_S:
            raise ConflictError(
                f"issued_s: is {command.issued_s - latest_s:.1f} s ahead of the hub's time, allowed is "
                f"{AHEAD_S:g} s; ask the hub for its time"
            )
        started = self._started
        if (
            not isinstance(command.action, StopArm)  # a second stop does no harm, a stop that is refused may
            and started is not None
            and started.hub.epoch == command.epoch
            and command.issued_s < started.hub.time_s
        ):
            raise ConflictError(
                "the command was issued before this cell joined the fleet, so this cell may have executed it "
                "before a restart; send a new one"
            )

    def _forget(self, known: KnownTime, now_s: float) -> None:
        """Drop the commands whose deadline has passed. A retry of one is rejected as late."""
        earliest_s = known.earliest(now_s)
        for name in [
            name for name, entry in self._answers.items() if self._is_over(entry, earliest_s, known)
        ]:
            del self._answers[name]

    def _is_over(
        self, entry: tuple[Future[CommandAnswer], FleetCommand], earliest_s: float, known: KnownTime
    ) -> bool:
        future, command = entry
        return future.done() and (command.epoch != known.hub.epoch or command.expires_s + 1.0 < earliest_s)

    def _answer(self, command: FleetCommand, code: str, text: str) -> CommandAnswer:
        return CommandAnswer(id=command.id, cell=self._cell, robot=self._robot, code=code, text=text[:2000])
