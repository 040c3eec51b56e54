"""`python -m cobot.fleet.cell`: the process of a cell in a fleet, as `cobot run` starts it."""

from __future__ import annotations

import argparse
import contextlib
import json
import logging
import os
import secrets
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from cobot.access.authentication import FLEET_TOKEN_VARIABLE
from cobot.access.claimed import claimed
from cobot.access.roles import ANONYMOUS, Role
from cobot.audit import record_beside
from cobot.config import DEFAULT_SETTINGS, Settings, load_settings, resolve
from cobot.errors import CobotError, InputError, PermissionDenied, UnavailableError
from cobot.fleet.cell_settings import configuration_of
from cobot.fleet.certificates import Verifier, check_cell_folder
from cobot.fleet.link import has_router, open_cell, payloads
from cobot.fleet.messages import (
    CommandAnswer,
    FleetCommand,
    FleetState,
    HubTime,
    RobotEvent,
    read,
    written,
)
from cobot.fleet.names import FleetKeys, own_cell_name, parts
from cobot.fleet.panel_cell import CellPanel
from cobot.fleet.robot import FROM, FleetRobot
from cobot.fleet.watching import EventWatch
from cobot.launch.process import Niceness, die_with_parent, in_words, set_niceness
from cobot.logs import start_logging

if TYPE_CHECKING:
    import zenoh

PERIOD_S = 0.1
"""Interval at which robots are read, in seconds. States are published at most at 10 Hz."""
TIME_TIMEOUT_S, TIME_TRIES = 1.0, 5
FETCH_S = 10.0
SYNCHRONIZE_S = 10.0
MAX_WAITING = 100
"""Maximum number of commands in progress in a cell."""
NO_ROLE = "none"

log = logging.getLogger("cobot.fleet")


class FleetCell:
    """The cell in its fleet: its robots, its session on Zenoh, and its loop.

    Args:
        config: the settings file that is in force. A reload replaces it.
        source: the user's settings file.
        url: service URL; "" for a cell without a service.
    """

    def __init__(self, settings: Settings, config: Path, source: Path, url: str, token: str) -> None:
        section = settings.fleet
        self._settings = settings
        self._fleet = section
        self._keys = FleetKeys(section.name)
        self.name = own_cell_name(section.cell)
        self.instance = secrets.token_hex(8)
        self.config, self.source = config, source
        self._config_ns = 0
        self.facts: dict[str, Any] = {
            "cell": self.name,
            "instance": self.instance,
            "version": version("cobot"),
            "configuration": "",
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
        self._panel = CellPanel(
            section.name, self.name, section.accept, self._verifier, self.ask_time, url, token, self._record
        )
        self._token: Any = None
        self._problem = ""
        self._look_again_s = 0.0
        self._lost_s: float | None = None
        self._stopped_for_loss = False
        self._synchronize_s = 0.0
        if url:
            EventWatch(url, token, self._tell_event)

    def run(self, ended: threading.Event) -> None:
        """Publish states until the process is asked to end."""
        log.info(
            "fleet %s: this cell is %s, hub %s", self._fleet.name, self.name, ", ".join(self._fleet.connect)
        )
        while not ended.wait(PERIOD_S):
            self._look_at_settings()
            connected = self._connect()
            self._watch_hub(connected)
            if connected:
                self._join()
            for robot in self.robots.values():
                state = robot.update()
                if state is not None:
                    self._publish(robot, "state", state)

    def close(self) -> None:
        """Leave the fleet. Otherwise, when the process exits, Zenoh may wait for a hub that does not
        answer.
        """
        if self._session is not None:
            self._session.close()
        self._panel.close()
        self._workers.shutdown(wait=False, cancel_futures=True)
        for robot in self.robots.values():
            robot.close()

    def _look_at_settings(self) -> None:
        """Publish the hash of the settings in force. A reload replaces their file."""
        with contextlib.suppress(OSError, CobotError):
            changed_ns = self.config.stat().st_mtime_ns
            if changed_ns != self._config_ns:
                self.facts["configuration"] = configuration_of(load_settings(self.config))
                self._config_ns = changed_ns

    def fetch_bundle(self, name: str) -> bytes | None:
        """The bundle content; None if the hub does not have it."""
        import zenoh

        if self._session is None:
            return None
        with contextlib.suppress(zenoh.ZError):
            for content in payloads(self._session.get(self._keys.bundle(name), timeout=FETCH_S)):
                return content
        return None

    def ask_time(self) -> HubTime | None:
        """The time of the hub; None if the hub does not answer."""
        import zenoh

        if self._session is None:
            return None
        with contextlib.suppress(zenoh.ZError, InputError):
            for content in payloads(self._session.get(self._keys.time, timeout=TIME_TIMEOUT_S)):
                return read(HubTime, content)
        return None

    def _connect(self) -> bool:
        """Return whether the hub is connected. If no connection has been made yet, try to make one."""
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
        """Report the loss and the return of the hub, and stop the arm if the settings require it."""
        now_s = time.monotonic()
        if connected:
            if self._lost_s is not None and self._token is not None:
                log.info("the hub is back after %.1f s", now_s - self._lost_s)
            self._lost_s, self._stopped_for_loss = None, False
            return
        if self._lost_s is None:
            self._lost_s = now_s
            self._panel.close_streams()
            if self._token is not None:
                log.warning("the hub is lost; this cell continues (fleet.on_loss: %s)", self._fleet.on_loss)
        stops = self._fleet.on_loss == "stop" and self._token is not None and not self._stopped_for_loss
        if stops and now_s - self._lost_s >= self._fleet.loss_s:
            self._stopped_for_loss = True
            why = f"fleet.on_loss: no hub for {self._fleet.loss_s:g} s"
            for robot in self.robots.values():
                robot.workers.submit(self._stop_for_loss, robot, why)

    def _stop_for_loss(self, robot: FleetRobot, why: str) -> None:
        with contextlib.suppress(CobotError):  # the error is in the log and in the audit
            robot.stop("cobot", why)

    def _join(self) -> None:
        """Declare this cell, unless another cell already uses its name."""
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
        self._wait_for_time()
        for robot in self.robots.values():
            self._declare(robot)
        panel = self._keys.panel(self.name)
        receive = partial(self._panel.receive, key=panel)
        self._declared.append(self._session.declare_queryable(panel, receive))
        self._synchronize()
        self._synchronize_s = now_s + SYNCHRONIZE_S
        self._token = token
        for robot in self.robots.values():  # the hub may have requested these states before
            for event in list(robot.events):
                self._publish(robot, "event", event)
        log.info("joined the fleet %s as %s", self._fleet.name, self.name)

    def _wait_for_time(self) -> None:
        """Wait until the hub answers.

        On a slow line, this session needs time to find the hub. Without this wait, the first commands would
        be rejected because they are older than the first time that the cell has received from the hub.
        """
        for _ in range(TIME_TRIES):
            if self.ask_time() is not None:
                return
            time.sleep(PERIOD_S)

    def _declare(self, robot: FleetRobot) -> None:
        """Declare the queries that a robot answers.

        A function that answers must not wait, because that would block the session.
        """
        keys = (self._key(robot, last) for last in ("state", "events", "programs", "command"))
        state, events, programs, command = keys
        assert self._session is not None
        declare = self._session.declare_queryable
        self._declared += [
            declare(state, lambda query: query.reply(state, written(robot.state))),
            declare(events, lambda query: query.reply(events, _list_of(list(robot.events)))),
            declare(programs, lambda query: query.reply(programs, json.dumps(robot.programs).encode())),
            declare(command, lambda query: self._receive(query, robot, command)),
        ]
        self._answer_to(robot, "picture", robot.picture)
        if robot.recordings is not None:
            self._answer_to(robot, "recordings", robot.recordings.listing)
            self._answer_to(robot, "recording", robot.recordings.answer)

    def _answer_to(self, robot: FleetRobot, last: str, answer: Callable[[bytes], bytes]) -> None:
        """Answer the queries for one of the robot's keys, in the thread that reads files."""
        assert self._session is not None
        key = self._key(robot, last)
        give = partial(robot.files.submit, partial(_give, key=key, answer=answer))
        self._declared.append(self._session.declare_queryable(key, give))

    def _receive(self, query: zenoh.Query, robot: FleetRobot, key: str) -> None:
        """Pass a command to a thread, because a command may take as long as a motion."""
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
        """The answer to a command; None if the command is for a different zone."""
        try:
            command = (
                read(FleetCommand, content) if self._verifier is None else self._verifier.command_of(content)
            )
        except CobotError as exc:
            log.warning("a command to %s is invalid: %s", robot.name, exc)
            return CommandAnswer(id="", cell=self.name, robot=robot.name, code=exc.code, text=str(exc)[:2000])
        if command.zone not in (None, self.facts["zone"]):
            return None
        who = command.who if self._verifier is not None else _unproven(command.who)
        tried: list[str] = []  # not empty if the command was added to the audit

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
        """Check that this cell accepts a command.

        Raises:
            InputError: the command is for another fleet, cell or robot.
            PermissionDenied: the settings do not accept the command from this role.
        """
        own = self._fleet.name, self.name, robot.name
        given = command.fleet, command.cell, command.robot
        if any(name not in ("*", mine) for name, mine in zip(given, own, strict=True)):
            raise InputError(f"the command is for {'/'.join(given)}, but {'/'.join(own)} received it")
        setting = command.action.accepted_by
        if self._verifier is None and setting != "stop":
            raise PermissionDenied(
                "a cell without fleet.certificates accepts only stops; create certificates with `cobot "
                "fleet certificate`"
            )
        needed = str(getattr(self._fleet.accept, setting))
        if needed == NO_ROLE or Role[command.role.upper()] < Role[needed.upper()]:
            raise PermissionDenied(
                f"this cell accepts this command from {needed} (fleet.accept.{setting}), but "
                f"{command.who} has the role {command.role}"
            )

    def _record(self, who: str, what: str, outcome: str, request: str) -> None:
        record_beside(self._settings, who, FROM, what, outcome, command=request)

    def _synchronize(self) -> None:
        self._panel.synchronize()
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


def _unproven(who: str) -> str:
    """The name that the audit records for the client if no hub has signed the command."""
    return who if who == ANONYMOUS else claimed(who.strip('"'))


def _give(query: zenoh.Query, *, key: str, answer: Callable[[bytes], bytes]) -> None:
    """Answer a query. If no answer can be made or sent, the querier gets none."""
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
    """Serve until SIGTERM. Returns the exit status: 0, or 2 if the process could not start."""
    parser = argparse.ArgumentParser(prog="python -m cobot.fleet.cell", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file; by default the one that is part of cobot")
    parser.add_argument("--source", type=Path, help="settings file of the user, if --config is a copy of it")
    parser.add_argument(
        "--url", default="", help="URL of the web service; without a URL, only modes are shown"
    )
    parser.add_argument("--check", action="store_true", help="only check the certificate of this cell")
    arguments = parser.parse_args()
    if arguments.check:
        return _check(arguments.config)
    ended = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: ended.set())
    start_logging("fleet")
    logging.getLogger("httpx2").setLevel(logging.WARNING)
    try:
        settings = load_settings(arguments.config)
        start_logging("fleet", settings.logging)
        config = arguments.config or resolve(DEFAULT_SETTINGS, Path())
        source = arguments.source or config
        cell = FleetCell(settings, config, source, arguments.url, os.environ.pop(FLEET_TOKEN_VARIABLE, ""))
    except CobotError as exc:
        log.error("%s", exc)
        return 2
    try:
        cell.run(ended)
    finally:
        cell.close()
    return 0


def _check(config: Path | None) -> int:
    """Print whether the cell's certificate is usable."""
    try:
        section = load_settings(config).fleet
        if section.certificates is not None:
            check_cell_folder(section.certificates)
    except CobotError as exc:
        print(exc, file=sys.stderr)
        return 2
    print(f"{section.name}, hub {', '.join(section.connect)}")
    return 0


if __name__ == "__main__":
    die_with_parent(signal.SIGTERM)
    set_niceness(Niceness.BACKGROUND)
    sys.exit(in_words(main))
