"""`cobot stop`: stops the arm through shared memory, regardless of the state of the service.

It increments a counter that rtloop reads in every cycle. No queue, lock or other process is involved, so this
works while the service has crashed, is paused or is overloaded.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TextIO
from urllib.parse import urlsplit

import numpy as np

from cobot.access.authentication import is_loopback
from cobot.commands.options import URL_VARIABLE
from cobot.errors import CobotError, TornReadError
from cobot.ipc.layout import MotionResult, text
from cobot.ipc.memory_file import robots_running
from cobot.ipc.shm import MemoryRole, RobotMemory
from cobot.launch.process import is_gone
from cobot.types import RESTING, LoopMode

REST_S = 5.0
"""Timeout for the arm to stop, in seconds. A stop takes up to about 2.5 s."""
STALE_S = 0.25
"""Age above which a state no longer shows the arm's current position, s."""
POLL_S = 0.005
FOLLOWED_S = 0.25
"""Maximum time to wait until the service follows a stop, in seconds. The service sends a heartbeat every 0.05
s.
"""


@dataclass(frozen=True, slots=True)
class StopRequest:
    """A request to rtloop to stop the arm.

    Attributes:
        count: the counter that rtloop reports once it has noticed the stop.
        moving: the motion that the stop ends, as human-readable text; "" if no motion was running.
        followed: number of the service's heartbeat after which the service has handled the stop.
        followed_s: time until which to wait for that heartbeat. The wait is limited because the service may
            not be running.
    """

    memory: RobotMemory
    count: int
    moving: str
    followed: int
    followed_s: float


def stop(robots: Sequence[str], *, latched: bool, out: TextIO) -> bool:
    """Stop these robots, or all robots on this computer if the list is empty, and report the result.

    Args:
        latched: whether this is an e-stop, after which nothing moves until a reset.

    Returns:
        Whether all of them are known to be at rest.
    """
    names = list(robots) or robots_running()
    if not names:
        out.write(
            "no robot is running on this computer; for a robot on another computer: "
            f"{_by_service('http://ROBOT:8007')}\n"
        )
        return False
    stops: dict[str, StopRequest] = {}
    for name in names:  # stop all of them first, because waiting for one must not delay the others
        try:
            stops[name] = _ask(RobotMemory.attach(name, MemoryRole.READER), latched=latched)
        except CobotError as exc:
            out.write(f"{name}: NOT stopped: {exc}\n")
    deadline_s = time.monotonic() + REST_S
    at_rest = [_report(name, each, deadline_s, latched=latched, out=out) for name, each in stops.items()]
    return len(stops) == len(names) and all(at_rest)


def not_asked(url: str | None) -> str:
    """A hint with the command to stop the arm, if the service in the environment variable is on a different
    computer; otherwise "".

    Args:
        url: value of the environment variable.
    """
    if not url or _here(url):
        return ""
    return (
        f"the service of {URL_VARIABLE} was NOT asked, because it is on another computer: {_by_service(url)}"
    )


def _here(url: str) -> bool:
    try:
        host = urlsplit(url).hostname or ""
    except ValueError:
        return False
    return host == "localhost" or is_loopback(host)


def _by_service(url: str) -> str:
    return f"cobot stop --url {url}"


def _ask(memory: RobotMemory, *, latched: bool) -> StopRequest:
    state = _state(memory)
    counter = memory.outside_estops if latched else memory.outside_stops
    counter.add()
    # Each heartbeat adds 2 to its sequence. The service notices the stop before one heartbeat, and has ended
    # everything that it had begun before the next one.
    followed = memory.heartbeat.sequence + 4, time.monotonic() + FOLLOWED_S
    if state is None:
        return StopRequest(memory, 0, "", *followed)
    seen = int(state["estops_seen" if latched else "stops_seen"])
    return StopRequest(memory, seen + 1, _moving(state), *followed)


def _report(name: str, stop: StopRequest, deadline_s: float, *, latched: bool, out: TextIO) -> bool:
    problem = _until_rest(stop, deadline_s, latched=latched)
    _await_service(stop)
    done = stop.moving or "nothing was running"
    if problem:
        out.write(f"{name}: stop requested; {done}; the arm is NOT known to be at rest: {problem}\n")
    else:
        after = "; latched until POST /robot/reset" if latched else ""
        out.write(f"{name}: {f'stopped {done}' if stop.moving else done}; the arm is at rest{after}\n")
    stop.memory.close()
    return not problem


def _until_rest(stop: StopRequest, deadline_s: float, *, latched: bool) -> str:
    """Wait until the arm is at rest. Returns "", or the reason why the arm is not known to be at rest."""
    problem = "rtloop has not started yet"
    while time.monotonic() < deadline_s:
        state = _state(stop.memory)
        if state is not None:
            age_s = (time.monotonic_ns() - int(state["monotonic_ns"])) * 1e-9
            measured_s = (time.monotonic_ns() - int(state["measured_monotonic_ns"])) * 1e-9
            seen = int(state["estops_seen" if latched else "stops_seen"]) >= stop.count
            if age_s > STALE_S:
                problem = f"rtloop has published nothing for {age_s:.1f} s"
                if _has_ended(stop.memory):
                    return f"{problem}: rtloop is not running"
            elif measured_s > STALE_S:
                problem = f"rtloop has measured nothing for {measured_s:.1f} s: {text(state['reason'])}"
            elif seen and not _moving(state) and state["settled"]:
                return ""
            else:
                problem = f"the arm still moves after {REST_S:g} s"
        time.sleep(POLL_S)
    return problem


def _await_service(stop: StopRequest) -> None:
    """Wait until the service has handled the stop. Until then, the service would end any newly requested
    motion.
    """
    while stop.memory.heartbeat.sequence < stop.followed and time.monotonic() < stop.followed_s:
        time.sleep(POLL_S)


def _has_ended(memory: RobotMemory) -> bool:
    """Whether the rtloop process has ended, so that waiting is pointless."""
    try:
        return is_gone(int(memory.statistics.read()["pid"]))
    except TornReadError:
        return False


def _state(memory: RobotMemory) -> np.ndarray | None:
    """A copy of the latest state; None before the first one, or while it cannot be read."""
    try:
        return memory.state.read().copy() if memory.state.sequence else None
    except TornReadError:
        return None


def _moving(state: np.ndarray) -> str:
    """The current motion of the arm as human-readable text; "" if the arm is at rest."""
    if int(state["session"]):
        return f"session {int(state['session'])}"
    if LoopMode(int(state["mode"])) not in RESTING or int(state["motion_result"]) == MotionResult.RUNNING:
        return f"motion {int(state['motion_id'])}"
    return ""
