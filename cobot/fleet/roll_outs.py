"""Rolls a bundle out to many cells: first to one cell, then in waves to the others. If one of them fails, all
are rolled back.
"""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from cobot.access.roles import Role, RoleName
from cobot.errors import (
    BusyError,
    ConflictError,
    InputError,
    NotFoundError,
    PermissionDenied,
    UnavailableError,
)
from cobot.fleet.bundle import Bundle, hash_of, read_bundle
from cobot.fleet.messages import ActivateBundle, FleetAction, RollBackBundle, StageBundle

MAX_BUNDLES = 20
MAX_ROLL_OUTS = 100
WATCH_S = 0.5
WRONG = ("fault", "estop", "gone")
"""States of a robot that end a roll-out."""
SILENT_S = 5.0
"""Maximum time that a robot may be silent, s. New limits restart its real-time process, which takes about 1
s.
"""
UNKNOWN = UnavailableError.code
Send = Callable[[FleetAction, str, str], dict[str, Any]]
"""A function that sends an action to a cell and a robot. It returns the answer with `code` and `text`."""
log = logging.getLogger("cobot.fleet")


@dataclass(slots=True)
class RollOut:
    """One roll-out.

    Attributes:
        waves: pairs of cell and robot, for each wave. The first wave is a single robot.
        state: for example `refused`, which means that nothing has changed anywhere, or `failed`, when `done`
            lists the robots in which the bundle is still active.
        done: the robots in which the bundle is active.
        lines: progress as human-readable text.
    """

    id: str
    bundle: str
    title: str
    who: str
    role: RoleName
    waves: list[list[tuple[str, str]]]
    state: Literal["running", "done", "refused", "rolled_back", "failed"] = "running"
    done: list[tuple[str, str]] = field(default_factory=list)
    lines: list[str] = field(default_factory=list)
    cancelled: bool = False

    def tell(self, line: str) -> None:
        log.info("roll-out %s: %s", self.title, line)
        self.lines.append(line)


class RollOuts:
    """The bundles and roll-outs of a hub. One roll-out runs at a time."""

    def __init__(self) -> None:
        self._bundles: dict[str, bytes] = {}
        self._roll_outs: dict[str, RollOut] = {}
        self._lock = threading.Lock()

    def add(self, content: bytes) -> tuple[str, Bundle]:
        """Store a bundle. Returns its name.

        Raises:
            InputError: the content is not a bundle.
        """
        bundle, name = read_bundle(content), hash_of(content)
        with self._lock:
            self._bundles.pop(name, None)
            self._bundles[name] = content
            while len(self._bundles) > MAX_BUNDLES:
                del self._bundles[next(iter(self._bundles))]
        return name, bundle

    def content(self, name: str) -> bytes | None:
        return self._bundles.get(name)

    def get(self, name: str) -> dict[str, Any]:
        """A roll-out as JSON.

        Raises:
            NotFoundError: there is no roll-out with this id.
        """
        found = self._roll_outs.get(name)
        if found is None:
            raise NotFoundError(
                f"there is no roll-out {name!r}; valid names: {', '.join(self._roll_outs) or 'none'}"
            )
        return asdict(found)

    def all(self) -> list[dict[str, Any]]:
        return [asdict(each) for each in self._roll_outs.values()]

    def cancel(self, name: str, role: RoleName) -> dict[str, Any]:
        """Roll back the activated bundles.

        Args:
            role: role of the person who sends the request.

        Raises:
            NotFoundError: there is no roll-out with this id.
            PermissionDenied: the role is lower than that of the person who started the roll-out.
            ConflictError: the roll-out has ended.
        """
        self.get(name)
        found = self._roll_outs[name]
        if Role[role.upper()] < Role[found.role.upper()]:
            raise PermissionDenied(
                f"{found.who} has started the roll-out with the role {found.role}; your role {role} is lower"
            )
        if found.state != "running":
            raise ConflictError(f"the roll-out {name} has ended: {found.state}")
        found.cancelled = True
        return asdict(found)

    def begin(
        self,
        bundle: str,
        who: str,
        role: RoleName,
        robots: Sequence[tuple[str, str]],
        wave: int,
        watch_s: float,
        send: Send,
        states: Callable[[], dict[tuple[str, str], str]],
    ) -> dict[str, Any]:
        """Start a roll-out in a thread.

        Args:
            robots: pairs of cell and robot, in the order of the roll-out.
            wave: number of robots in each wave after the first one.
            watch_s: how long the robots of a wave are watched before the next wave begins.
            states: returns the current state of each robot.

        Raises:
            NotFoundError: the hub does not have the bundle.
            BusyError: a roll-out is already running.
            InputError: no robots are named.
        """
        content = self._bundles.get(bundle)
        if content is None:
            raise NotFoundError("the hub does not have this bundle; POST it to /bundles first")
        if not robots:
            raise InputError("there are no robots for the roll-out")
        rest = list(robots[1:])
        waves = [[robots[0]], *(rest[index : index + wave] for index in range(0, len(rest), wave))]
        made = RollOut(secrets.token_hex(6), bundle, read_bundle(content).title, who, role, waves)
        with self._lock:
            running = [each for each in self._roll_outs.values() if each.state == "running"]
            if running:
                raise BusyError(
                    f"the roll-out {running[0].id} of {running[0].title} is running; wait for it, or "
                    "cancel it"
                )
            self._roll_outs[made.id] = made
            while len(self._roll_outs) > MAX_ROLL_OUTS:
                del self._roll_outs[next(iter(self._roll_outs))]
        threading.Thread(target=_run, args=(made, watch_s, send, states), daemon=True).start()
        return asdict(made)


def _run(
    roll_out: RollOut, watch_s: float, send: Send, states: Callable[[], dict[tuple[str, str], str]]
) -> None:
    try:
        problem = _go(roll_out, watch_s, send, states)
        if problem:
            roll_out.tell(problem)
            roll_out.state = _go_back(roll_out, send)
        else:
            roll_out.state = "done"
    except Exception as exc:  # after any error, the state must report that the roll-out has ended
        log.exception("the roll-out %s ended", roll_out.id)
        roll_out.tell(f"ended because of an error in the hub: {exc}")
        roll_out.state = "failed"


def _go(
    roll_out: RollOut, watch_s: float, send: Send, states: Callable[[], dict[tuple[str, str], str]]
) -> str:
    """Stage the bundle everywhere, then activate it wave by wave. Returns the problem that ended the
    roll-out; "" if it was completed.
    """
    everywhere = [robot for wave in roll_out.waves for robot in wave]
    problem = _all(roll_out, everywhere, StageBundle(kind="stage", bundle=roll_out.bundle), send, [])
    if problem:
        return problem
    activate = ActivateBundle(kind="activate", bundle=roll_out.bundle)
    for number, wave in enumerate(roll_out.waves, 1):
        if roll_out.cancelled:
            return "cancelled"
        roll_out.tell(f"wave {number} of {len(roll_out.waves)}: {', '.join('/'.join(each) for each in wave)}")
        problem = _all(roll_out, wave, activate, send, roll_out.done, UNKNOWN)
        problem = problem or _watch(roll_out, watch_s, states)
        if problem:
            return problem
    return ""


def _all(
    roll_out: RollOut,
    robots: Sequence[tuple[str, str]],
    action: FleetAction,
    send: Send,
    done: list[tuple[str, str]],
    counted: str = "",
) -> str:
    """Send an action to several robots at the same time.

    Args:
        done: receives the robots that have executed the action, and those that answer with the code
            `counted`.

    Returns:
        The first problem; "" if all robots have succeeded.
    """
    problem = ""
    with ThreadPoolExecutor(min(32, len(robots))) as pool:
        answers = list(pool.map(lambda robot: send(action, *robot), robots))
    for robot, answer in zip(robots, answers, strict=True):
        roll_out.tell(f"{'/'.join(robot)}: {answer['text']}")
        if answer["code"] in ("ok", counted):
            done.append(robot)
        if answer["code"] != "ok":
            problem = problem or f"{'/'.join(robot)} has not executed the action"
    return problem


def _watch(roll_out: RollOut, watch_s: float, states: Callable[[], dict[tuple[str, str], str]]) -> str:
    begun_s = time.monotonic()
    while True:
        found = {robot: states().get(robot, "gone") for robot in roll_out.done}
        for_s = time.monotonic() - begun_s
        silent = "silent" in found.values()
        for robot, state in found.items():
            if state in WRONG or (state == "silent" and for_s > SILENT_S):
                return f"{'/'.join(robot)} is in the state {state}"
        if roll_out.cancelled:
            return "cancelled"
        if for_s >= watch_s and not silent:
            return ""
        time.sleep(min(WATCH_S, max(0.01, watch_s - for_s)))


def _go_back(roll_out: RollOut, send: Send) -> Literal["refused", "rolled_back", "failed"]:
    if not roll_out.done:
        return "refused"
    back: list[tuple[str, str]] = []
    action = RollBackBundle(kind="roll_back", bundle=roll_out.bundle)
    # A robot that did not answer may have activated the bundle anyway. If not, its rollback changes nothing.
    _all(roll_out, roll_out.done, action, send, back, NotFoundError.code)
    roll_out.done = [robot for robot in roll_out.done if robot not in back]
    if not roll_out.done:
        return "rolled_back"
    roll_out.tell(f"NOT rolled back: {', '.join('/'.join(each) for each in roll_out.done)}")
    return "failed"
