"""`python -m cobot.fleet.cell`: the process of a cell in a fleet, as `cobot run` starts it."""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import logging
import os
import secrets
import signal
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from cobot.access.authentication import FLEET_TOKEN_VARIABLE
from cobot.access.roles import ANONYMOUS, Role
from cobot.audit import record_beside
from cobot.config import Settings, load_settings
from cobot.errors import CobotError, InputError, PermissionDenied, UnavailableError
from cobot.fleet.certificates import Verifier
from cobot.fleet.commands import CommandBook
from cobot.fleet.executing import ServiceCommands
from cobot.fleet.link import has_router, open_cell, payloads
from cobot.fleet.messages import (
    KEPT_EVENTS,
    CommandAnswer,
    FleetCommand,
    FleetState,
    HubTime,
    RobotEvent,
    StopArm,
    read,
    written,
)
from cobot.fleet.names import FleetKeys, own_cell_name, parts
from cobot.fleet.recordings import GivenRecordings
from cobot.fleet.watching import ArmWatch, EventWatch, ServiceWatch
from cobot.launch.process import Niceness, be, die_with_parent, in_words
from cobot.launch.stop import stop
from cobot.logs import start_logging

if TYPE_CHECKING:
    import zenoh

PERIOD_S = 0.1
"""Interval between two looks at a robot, in seconds: states are published at most at 10 Hz."""
UNCHANGED_S = 1.0
"""Interval at which a state is published again while nothing changes, in seconds."""
TIME_TIMEOUT_S = 1.0
FETCH_S = 10.0
SYNCHRONIZE_S = 10.0
WORKERS = 8
"""Number of commands that a robot works on at the same time: the first one, and retries that wait for it."""
MAX_WAITING = 100
"""Maximum number of commands in progress in a cell."""
FROM = "fleet"
NO_ROLE = "none"
SETTING_OF = {
    "stop": "stop",
    "start": "program",
    "pause": "program",
    "resume": "program",
    "speed": "speed",
    "take_control": "control",
    "release_control": "control",
    "stage": "roll_out",
    "activate": "roll_out",
    "roll_back": "roll_out",
}
"""The setting below `fleet.accept` for each kind of command."""

log = logging.getLogger("cobot.fleet")


class FleetRobot:
    """One robot of the cell, as the fleet sees it."""

    def __init__(self, cell: FleetCell, settings: Settings, url: str, token: str) -> None:
        self.name = settings.robot.name
        self.settings = settings
        self.events: deque[RobotEvent] = deque(maxlen=KEPT_EVENTS)
        self.book = CommandBook(cell.name, self.name, cell.ask_time)
        self._cell = cell
        self._arm = ArmWatch(self.name, settings.web.stale_after_s)
        self._service = ServiceWatch(url, self.name, token) if url else None
        self._commands = ServiceCommands(url, settings, token, cell.fetch_bundle) if url else None
        self._published_s = 0.0
        self.recordings = GivenRecordings(settings.recording_folder) if settings.fleet.recordings else None
        self.files = ThreadPoolExecutor(1)  # a large file is read while commands are executed
        self.workers = ThreadPoolExecutor(WORKERS)  # its own: an arm that does not rest delays no other
        self.state = self._look()

    def _look(self) -> FleetState:
        found: dict[str, Any] = self._arm.read()
        service = {} if self._service is None else self._service.found
        if found["state"] in ("ready", "moving") and self._service is not None and self._service.paused:
            found["state"] = "paused"
        if self._commands is not None:
            bundles = self._commands.bundles
            versions = {each["id"]: each["version"] for each in service.get("programs", ())}
            found |= {"bundle": bundles.title, "drift": bundles.drift(versions) if versions else []}
        return FleetState(robot=self.name, **self._cell.facts, **service, **found)

    def update(self) -> FleetState | None:
        """The new state, if it is time to publish it."""
        state, now_s = self._look(), time.monotonic()
        if state == self.state and now_s - self._published_s < UNCHANGED_S:
            return None
        self.state, self._published_s = state, now_s
        return state

    def stop(self, who: str, command: str) -> str:
        """Stop the arm by shared memory, as `cobot stop` does, and add the stop to the cell's audit.

        Raises:
            UnavailableError: the arm is not known to be at rest.
        """
        said = io.StringIO()
        at_rest = stop([self.name], latched=False, out=said)
        outcome = "ok" if at_rest else "not known to be at rest"
        record_beside(self.settings, who, FROM, f"stop {self.name}", outcome, command=command)
        log.warning("%s has stopped %s by the fleet: %s", who, self.name, outcome)
        if not at_rest:
            raise UnavailableError(said.getvalue().strip())
        return said.getvalue().strip()

    def execute(self, command: FleetCommand, who: str) -> str:
        """Execute a command, and add it to the cell's audit.

        Args:
            who: the name for the audit.

        Raises:
            CobotError: it was not executed, or the arm is not known to be at rest.
        """
        if isinstance(command.action, StopArm):
            return self.stop(who, command.id)
        outcome = "ok"
        try:
            if self._commands is None:
                raise UnavailableError("this cell runs without its web service")
            return self._commands.run(command.action)
        except CobotError as exc:
            outcome = exc.code
            raise
        finally:
            record_beside(self.settings, who, FROM, self.wish(command), outcome, command=command.id)

    def recover(self) -> None:
        """Roll back a bundle whose activation was interrupted, once the service answers."""
        if self._commands is not None:
            with contextlib.suppress(CobotError):
                self._commands.recover()

    def wish(self, command: FleetCommand) -> str:
        """What a command wants, for the audit."""
        action = command.action.model_dump(exclude_defaults=True)
        return " ".join(str(each) for each in (action.pop("kind"), self.name, *action.values()))

    def close(self) -> None:
        if self._service is not None:
            self._service.end()
        if self._commands is not None:
            self._commands.close()
        self.workers.shutdown(wait=False, cancel_futures=True)
        self.files.shutdown(wait=False, cancel_futures=True)
        self._arm.close()


class FleetCell:
    """The cell: its robots, its session, and its loop.

    Args:
        url: of the service; "" without one.
    """

    def __init__(self, settings: Settings, url: str, token: str) -> None:
        section = settings.fleet
        self._settings = settings
        self._fleet = section
        self._keys = FleetKeys(section.name)
        self.name = own_cell_name(section.cell)
        self.instance = secrets.token_hex(8)
        self.facts: dict[str, Any] = {
            "cell": self.name,
            "instance": self.instance,
            "version": version("cobot"),
            "configuration": sha256(settings.model_dump_json().encode()).hexdigest()[:16],
            "panel": section.panel or url,
            "zone": section.zone or "",
            "recordings": section.recordings,
        }
        self._verifier = Verifier(section.certificates) if section.certificates else None
        self._session: zenoh.Session | None = None
        self._declared: list[Any] = []
        self._waiting = threading.Semaphore(MAX_WAITING)
        self._workers = ThreadPoolExecutor(1, thread_name_prefix="time")
        self.robots = {each.robot.name: FleetRobot(self, each, url, token) for each in settings.each.values()}
        self._default = settings.robot.name
        self._token: Any = None
        self._problem = ""
        self._look_again_s = 0.0
        self._lost_s: float | None = None
        self._stopped_for_loss = False
        self._synchronize_s = 0.0
        if url:
            EventWatch(url, token, self._tell_event)

    def run(self, ended: threading.Event) -> None:
        """Publish states until the end is requested."""
        log.info(
            "fleet %s: this cell is %s, hub %s", self._fleet.name, self.name, ", ".join(self._fleet.connect)
        )
        while not ended.wait(PERIOD_S):
            connected = self._connect()
            self._watch_hub(connected)
            if connected:
                self._join()
            for robot in self.robots.values():
                state = robot.update()
                if state is not None:
                    self._publish(robot, "state", state)

    def close(self) -> None:
        """Leave the fleet. Without this, Zenoh may wait at the exit for a hub that is away."""
        if self._session is not None:
            self._session.close()
        self._workers.shutdown(wait=False, cancel_futures=True)
        for robot in self.robots.values():
            robot.close()

    def fetch_bundle(self, name: str) -> bytes | None:
        """The content of a bundle; None if the hub does not have it."""
        import zenoh

        if self._session is None:
            return None
        with contextlib.suppress(zenoh.ZError):
            for content in payloads(self._session.get(self._keys.bundle(name), timeout=FETCH_S)):
                return content
        return None

    def ask_time(self) -> HubTime | None:
        """The hub's time; None if it does not answer."""
        import zenoh

        if self._session is None:
            return None
        with contextlib.suppress(zenoh.ZError, InputError):
            for content in payloads(self._session.get(self._keys.time, timeout=TIME_TIMEOUT_S)):
                return read(HubTime, content)
        return None

    def _connect(self) -> bool:
        """Whether the hub is connected. The first connection is tried until it succeeds."""
        if self._session is None:
            try:
                self._session = open_cell(self._fleet.connect, self._fleet.certificates)
            except UnavailableError as exc:
                self._tell_problem(f"{exc}; this cell tries again")
                return False
        return has_router(self._session)

    def _publish(self, robot: FleetRobot, last: str, message: FleetState | RobotEvent) -> None:
        if self._token is not None and self._session is not None:
            self._session.put(self._key(robot, last), written(message))

    def _key(self, robot: FleetRobot, last: str) -> str:
        return self._keys.of(self.name, robot.name, last)

    def _watch_hub(self, connected: bool) -> None:
        """Report a loss and a return of the hub, and stop if the settings want it."""
        now_s = time.monotonic()
        if connected:
            if self._lost_s is not None and self._token is not None:
                log.info("the hub is back after %.1f s", now_s - self._lost_s)
            self._lost_s, self._stopped_for_loss = None, False
            return
        if self._lost_s is None:
            self._lost_s = now_s
            if self._token is not None:
                log.warning("the hub is lost; this cell goes on (fleet.on_loss: %s)", self._fleet.on_loss)
        stops = self._fleet.on_loss == "stop" and self._token is not None and not self._stopped_for_loss
        if stops and now_s - self._lost_s >= self._fleet.loss_s:
            self._stopped_for_loss = True
            why = f"fleet.on_loss: no hub for {self._fleet.loss_s:g} s"
            for robot in self.robots.values():
                robot.workers.submit(self._stop_for_loss, robot, why)

    def _stop_for_loss(self, robot: FleetRobot, why: str) -> None:
        with contextlib.suppress(CobotError):  # it is in the log and in the audit
            robot.stop("cobot", why)

    def _join(self) -> None:
        """Declare this cell, unless another one has its name."""
        now_s = time.monotonic()
        if self._token is not None:
            if now_s >= self._synchronize_s:
                self._synchronize_s = now_s + SYNCHRONIZE_S
                self._workers.submit(self._synchronize)
            return
        if now_s < self._look_again_s:
            return
        self._look_again_s = now_s + 1.0 + secrets.randbelow(1000) * 1e-3
        assert self._session is not None
        liveliness = self._session.liveliness()
        token = liveliness.declare_token(self._keys.alive(self.name, self.instance))
        alive = [
            parts(str(reply.ok.key_expr))[1]
            for reply in liveliness.get(self._keys.alive(self.name, "*"), timeout=TIME_TIMEOUT_S)
            if reply.ok is not None
        ]
        others = [each for each in alive if each != self.instance]
        if others:
            token.undeclare()
            self._tell_problem(
                f"the name {self.name!r} is used by another cell of the fleet {self._fleet.name!r}, so this "
                "cell has not joined; give each cell its own name: fleet.cell"
            )
            return
        self._tell_problem("")
        for robot in self.robots.values():
            self._declare(robot)
        self._synchronize()
        self._synchronize_s = now_s + SYNCHRONIZE_S
        self._token = token
        log.info("joined the fleet %s as %s", self._fleet.name, self.name)

    def _declare(self, robot: FleetRobot) -> None:
        """The queries that a robot answers. An answer never sleeps: that would block the session."""
        state, events, command = (self._key(robot, last) for last in ("state", "events", "command"))
        assert self._session is not None
        declare = self._session.declare_queryable
        self._declared += [
            declare(state, lambda query: query.reply(state, written(robot.state))),
            declare(events, lambda query: query.reply(events, _list_of(list(robot.events)))),
            declare(command, lambda query: self._receive(query, robot, command)),
        ]
        given = robot.recordings
        if given is not None:
            listed, piece = self._key(robot, "recordings"), self._key(robot, "recording")
            self._declared += [
                declare(
                    listed, lambda query: robot.files.submit(_give, query, listed, lambda _: given.listing())
                ),
                declare(piece, lambda query: robot.files.submit(_give, query, piece, given.answer)),
            ]

    def _receive(self, query: zenoh.Query, robot: FleetRobot, key: str) -> None:
        """Give a command to a thread: it takes as long as the arm needs."""
        if not self._waiting.acquire(blocking=False):
            busy = CommandAnswer(
                id="", cell=self.name, robot=robot.name, code="busy",
                text=f"{MAX_WAITING} commands are in progress; try again",
            )  # fmt: skip
            query.reply(key, written(busy))
            return
        robot.workers.submit(self._execute, query, robot, key)

    def _execute(self, query: zenoh.Query, robot: FleetRobot, key: str) -> None:
        try:
            with query:
                answer = self._answer(bytes(query.payload or b""), robot)
                if answer is not None:
                    query.reply(key, written(answer))
        except Exception:
            log.exception("a command was not answered")
        finally:
            self._waiting.release()

    def _answer(self, content: bytes, robot: FleetRobot) -> CommandAnswer | None:
        """None if the command is for another zone."""
        try:
            command = (
                read(FleetCommand, content) if self._verifier is None else self._verifier.command_of(content)
            )
        except CobotError as exc:
            log.warning("a command to %s is invalid: %s", robot.name, exc)
            return CommandAnswer(id="", cell=self.name, robot=robot.name, code=exc.code, text=str(exc)[:2000])
        if command.zone not in (None, self.facts["zone"]):
            return None
        who = command.who if self._verifier is not None else _claimed(command.who)
        tried: list[str] = []  # then it is in the audit

        def execute() -> str:
            tried.append(command.id)
            return robot.execute(command, who)

        try:
            self._require_accepted(command, robot)
            answer = robot.book.run(command, execute)
        except CobotError as exc:
            answer = CommandAnswer(
                id=command.id, cell=self.name, robot=robot.name, code=exc.code, text=str(exc)[:2000]
            )
        if answer.code != "ok" and not answer.repeated:
            log.warning("%s by %s: %s", robot.wish(command), who, answer.text)
            if not tried and answer.code in ("conflict", "input", "forbidden"):
                record_beside(robot.settings, who, FROM, robot.wish(command), answer.code, command=command.id)
        return answer

    def _require_accepted(self, command: FleetCommand, robot: FleetRobot) -> None:
        """
        Raises:
            InputError: the command is for another fleet, cell or robot.
            PermissionDenied: the settings do not accept it from this role.
        """
        own = self._fleet.name, self.name, robot.name
        given = command.fleet, command.cell, command.robot
        if any(name not in ("*", mine) for name, mine in zip(given, own, strict=True)):
            raise InputError(f"the command is for {'/'.join(given)}, and came to {'/'.join(own)}")
        setting = SETTING_OF[command.action.kind]
        if self._verifier is None and setting != "stop":
            raise PermissionDenied(
                "a cell without fleet.certificates accepts only stops: `cobot fleet certificate` makes them"
            )
        needed = str(getattr(self._fleet.accept, setting))
        if needed == NO_ROLE or Role[command.role.upper()] < Role[needed.upper()]:
            raise PermissionDenied(
                f"this cell accepts this from {needed} (fleet.accept.{setting}), and {command.who} has the "
                f"role {command.role}"
            )

    def _synchronize(self) -> None:
        for robot in self.robots.values():
            robot.book.synchronize()
            robot.recover()

    def _tell_problem(self, problem: str) -> None:
        if problem != self._problem:
            self._problem = problem
            if problem:
                log.error("%s", problem)

    def _tell_event(self, event: dict[str, Any]) -> None:
        try:
            robot = self.robots[event.get("robot") or self._default]
            made = RobotEvent(
                cell=self.name,
                robot=robot.name,
                id=f"{event['epoch']}-{event['id']}",
                time=event["time"],
                type=event["type"],
                data=event["data"],
            )
        except (ValidationError, KeyError) as exc:
            log.warning("an event of the service is not valid: %s", exc)
            return
        robot.events.append(made)
        self._publish(robot, "event", made)


def _claimed(who: str) -> str:
    """A name that proves nothing, in quotes, which names of tokens cannot have."""
    return who if who == ANONYMOUS else '"' + who.replace('"', "") + '"'


def _give(query: zenoh.Query, key: str, answer: Callable[[bytes], bytes]) -> None:
    """Answer a question about recordings."""
    with query:
        try:
            query.reply(key, answer(bytes(query.payload or b"")))
        except CobotError as exc:
            log.warning("%s: %s", key, exc)
        except Exception:
            log.exception("%s", key)


def _list_of(events: Iterable[RobotEvent]) -> bytes:
    return json.dumps([each.model_dump() for each in events]).encode()


def main() -> int:
    """Serve until SIGTERM. Returns the exit status: 0, or 2 if it could not start."""
    parser = argparse.ArgumentParser(prog="python -m cobot.fleet.cell", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file; default: the one shipped with cobot")
    parser.add_argument(
        "--url", default="", help="address of the web service; without it only modes are shown"
    )
    arguments = parser.parse_args()
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    start_logging("fleet")
    logging.getLogger("httpx").setLevel(logging.WARNING)
    try:
        settings = load_settings(arguments.config)
        start_logging("fleet", settings.logging)
        cell = FleetCell(settings, arguments.url, os.environ.pop(FLEET_TOKEN_VARIABLE, ""))
    except CobotError as exc:
        log.error("%s", exc)
        return 2
    try:
        cell.run(ended)
    finally:
        cell.close()
    return 0


if __name__ == "__main__":
    die_with_parent(signal.SIGTERM)
    be(Niceness.BACKGROUND)
    sys.exit(in_words(main))
