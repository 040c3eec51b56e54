"""Decides which commands a cell executes: each command once, and none after its deadline.

The clock of a computer may be wrong by minutes, so deadlines use the hub's clock. A cell asks the hub for its
time. The answer is uncertain by the duration of the round trip. The cell uses the latest possible time, so it
rejects a command that may be late.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future
from concurrent.futures import TimeoutError as FutureTimeout
from dataclasses import dataclass
from typing import Protocol

from cobot.clock import SYSTEM, Clock
from cobot.errors import BusyError, CobotError, ConflictError, InputError, UnavailableError
from cobot.fleet.messages import MAX_LIFETIME_S, CommandAnswer, FleetCommand, HubTime, StopArm

FRESH_S = 30.0
"""Maximum age of the time that the hub has sent, s. After this, the cell asks again."""
MAX_COMMANDS = 1000
"""Maximum number of commands that are remembered until their deadline."""
MAX_MESSAGES = 20_000
"""Maximum number of other messages that are remembered until their deadline."""
ANSWER_S = 20.0
"""Maximum time that a retry waits for the answer to the first try, s."""
AHEAD_S = 1.0
"""Maximum time, s, by which a command may have been issued after the hub's time as this cell knows it."""


@dataclass(frozen=True, slots=True)
class KnownTime:
    """A time that the hub has sent, and the times on this computer's clock just before the request and just
    after the answer.
    """

    hub: HubTime
    asked_s: float
    answered_s: float

    def latest(self, now_s: float) -> float:
        """The latest time that the hub's clock can show."""
        return self.hub.time_s + (now_s - self.asked_s)

    def earliest(self, now_s: float) -> float:
        """The earliest time that the hub's clock can have."""
        return self.hub.time_s + (now_s - self.answered_s)


class HubMessage(Protocol):
    """A message with an id and a deadline. The deadline is on the clock of the hub that has this epoch."""

    @property
    def id(self) -> str: ...
    @property
    def epoch(self) -> str: ...
    @property
    def issued_s(self) -> float: ...
    @property
    def expires_s(self) -> float: ...


class Deadlines:
    """Decides whether a hub message is in time. Thread safe.

    Args:
        ask_time: asks the hub for its time; returns None if it does not answer.
    """

    def __init__(self, ask_time: Callable[[], HubTime | None], clock: Clock = SYSTEM) -> None:
        self._ask_time = ask_time
        self._clock = clock
        self._known: KnownTime | None = None
        self._started: KnownTime | None = None

    def synchronize(self) -> None:
        """Ask the hub for its time. Call this at the start, because messages issued before the first answer
        are rejected.
        """
        asked_s = self._clock.now_s()
        found = self._ask_time()
        if found is not None:
            self._known = KnownTime(found, asked_s, self._clock.now_s())
            self._started = self._started or self._known

    def time_for(self, message: HubMessage) -> KnownTime:
        """The hub's time. If the known time is old or has a different epoch, the hub is asked again.

        Raises:
            UnavailableError: the hub's time is unknown.
        """
        known = self._known
        if (
            known is None
            or known.hub.epoch != message.epoch
            or self._clock.now_s() - known.answered_s > FRESH_S
        ):
            self.synchronize()
            known = self._known
        if known is None:
            raise UnavailableError(
                "the hub does not send its time, so the deadline cannot be checked; send the command again"
            )
        return known

    def check(self, message: HubMessage, known: KnownTime, *, harmless_twice: bool = False) -> None:
        """Check that a message is in time.

        Args:
            harmless_twice: whether a message from before the start of this process may be executed.

        Raises:
            InputError: the times of the message are invalid.
            ConflictError: the message is late, or was issued before this process started.
        """
        now_s = self._clock.now_s()
        lifetime_s = message.expires_s - message.issued_s
        if not 0.0 < lifetime_s <= MAX_LIFETIME_S:
            raise InputError(
                f"expires_s: is {lifetime_s:g} s after issued_s, allowed: more than 0 and up to "
                f"{MAX_LIFETIME_S:g} s"
            )
        if message.epoch != known.hub.epoch:
            raise ConflictError(
                f"epoch: {message.epoch} is not the epoch of the current hub; ask the hub for its time and "
                "send a new command"
            )
        latest_s = known.latest(now_s)
        if latest_s > message.expires_s:
            raise ConflictError(
                f"the command is {latest_s - message.expires_s:.1f} s late and was not executed; send a new "
                "one"
            )
        if message.issued_s > latest_s + AHEAD_S:
            raise ConflictError(
                f"issued_s: is {message.issued_s - latest_s:.1f} s later than the hub's time, allowed: "
                f"{AHEAD_S:g} s; ask the hub for its time"
            )
        started = self._started
        if (
            not harmless_twice
            and started is not None
            and started.hub.epoch == message.epoch
            and message.issued_s < started.hub.time_s
        ):
            raise ConflictError(
                "the command was issued before this cell joined the fleet, so this cell may have executed it "
                "before a restart; send a new one"
            )

    def is_over(self, message: HubMessage, known: KnownTime) -> bool:
        """Whether the deadline of a message has certainly passed, so that a copy of it would be rejected."""
        earliest_s = known.earliest(self._clock.now_s())
        return message.epoch != known.hub.epoch or message.expires_s + 1.0 < earliest_s


def _same(one: FleetCommand, other: FleetCommand) -> bool:
    """Whether one command is a retry of the other. A retry may have a different deadline and name fewer
    robots.
    """
    return (one.action, one.who, one.role, one.epoch) == (other.action, other.who, other.role, other.epoch)


class SeenMessages:
    """The hub messages that a cell has executed. Each is executed only once. Thread safe."""

    def __init__(self, deadlines: Deadlines) -> None:
        self._deadlines = deadlines
        self._seen: dict[str, HubMessage] = {}
        self._lock = threading.Lock()

    def require_new(self, message: HubMessage) -> None:
        """Check that a message has not been executed before, and store it.

        Raises:
            CobotError: the message is late, invalid, or was executed before.
        """
        known = self._deadlines.time_for(message)
        with self._lock:
            self._deadlines.check(message, known)
            if message.id in self._seen:
                raise ConflictError(f"id {message.id}: this message was executed before; send a new one")
            if len(self._seen) >= MAX_MESSAGES:
                self._seen = {
                    name: each
                    for name, each in self._seen.items()
                    if not self._deadlines.is_over(each, known)
                }
            if len(self._seen) >= MAX_MESSAGES:
                raise BusyError(f"{MAX_MESSAGES} messages came within their deadlines; try again in a minute")
            self._seen[message.id] = message


class CommandBook:
    """The commands of one robot. Thread safe.

    Args:
        ask_time: asks the hub for its time; returns None if it does not answer.
    """

    def __init__(
        self, cell: str, robot: str, ask_time: Callable[[], HubTime | None], clock: Clock = SYSTEM
    ) -> None:
        self._cell, self._robot = cell, robot
        self._deadlines = Deadlines(ask_time, clock)
        self.synchronize = self._deadlines.synchronize
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

    def _begin(self, command: FleetCommand) -> Future[CommandAnswer] | None:
        """Begin a command. Returns None if it must be executed now; otherwise the future of its first try.

        Raises:
            InputError: the times of the command are invalid.
            ConflictError: the command is late, or was issued before this process started.
            UnavailableError: the hub's time is unknown.
        """
        known = self._deadlines.time_for(command)
        with self._lock:
            entry = self._answers.get(command.id)
            if entry is not None and _same(entry[1], command):
                return entry[0]
            if entry is not None:
                raise ConflictError(f"id {command.id}: another command already used this id; use a new id")
            # A second stop does no harm, but a stop that is rejected may.
            self._deadlines.check(command, known, harmless_twice=isinstance(command.action, StopArm))
            self._forget(known)
            if len(self._answers) >= MAX_COMMANDS:
                raise BusyError(
                    f"{len(self._answers)} commands wait for their deadlines, allowed: {MAX_COMMANDS}; "
                    "try again in a minute"
                )
            self._answers[command.id] = Future(), command
            return None

    def _forget(self, known: KnownTime) -> None:
        """Forget the commands whose deadline has passed. A retry of such a command is rejected because it is
        late.
        """
        over = [
            name
            for name, (future, command) in self._answers.items()
            if future.done() and self._deadlines.is_over(command, known)
        ]
        for name in over:
            del self._answers[name]

    def _answer(self, command: FleetCommand, code: str, text: str) -> CommandAnswer:
        return CommandAnswer(id=command.id, cell=self._cell, robot=self._robot, code=code, text=text[:2000])
