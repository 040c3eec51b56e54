"""Reloads the configuration while all robots are at rest, for POST /admin/reload and for SIGHUP.

A reload applies all changes or none. The files are copied and the copy is validated as a whole (see
`cobot.launch.running_config`). Then named positions, joint limits and the web settings in `LIVE_WEB` are
applied. Other changes need a restart; the answer lists them. New joint limits apply at once in the service.
The planning processes are replaced, and the supervisor restarts rtloop. Until rtloop has restarted, no motion
may begin.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from starlette.datastructures import State

from app.robot_services import Services
from app.routes import ENDPOINTS
from app.services.rights.claims import Caller
from cobot.cell import cell_of
from cobot.config import (
    DEFAULT_SETTINGS,
    Settings,
    load_endpoints,
    load_settings,
    load_with_rolled_out,
    resolve,
)
from cobot.errors import (
    CobotError,
    CollisionError,
    ConfigError,
    ConflictError,
    InputError,
    LimitError,
    UnavailableError,
)
from cobot.launch.running_config import ProcessState, RunningConfig
from cobot.robot.description import RobotDescription, load_robot
from cobot.robot.limits import check_positions
from cobot.types import RESTING, JointLimits

LIVE_WEB = ("allowed_hosts", "allowed_origins", "max_body_bytes", "max_json_bytes", "stop_on_disconnect")
"""Settings in the section `web` that a reload applies. Code that uses them reads `app.state.web` each time,
or is notified of changes.
"""
BY_CONTENT = {"web.endpoints", "web.joint_limits", "robot.srdf", "robot.cell"}
"""Settings that name a file. They have changed if the file's content has changed; its name does not
matter.
"""
STATE_TIMEOUT_S = 1.5
RTLOOP_TIMEOUT_S = 20.0
POLL_S = 0.02
NAME = "the reload of the configuration"
SIGNAL = "SIGHUP", "this computer", NAME
"""Client, address and action in the audit log's entry for a reload by signal."""

log = logging.getLogger("cobot.reload")


@dataclass(frozen=True, slots=True)
class Reloaded:
    """The result of a reload, in sentences: changes that apply now, and changes that need a restart."""

    taken_over: list[str]
    needs_restart: list[str]


@dataclass(frozen=True, slots=True)
class _Read:
    """The new configuration: its settings, each robot's description, and the answer to the reload request."""

    settings: Settings
    robots: dict[str, RobotDescription]
    new_limits: list[str]
    answer: Reloaded


class Reloading:
    """Reloads the configuration.

    Args:
        settings: the current settings.
        config: the file with the current settings.
        source: the file that the user edits, if `config` is the supervisor's copy of it. None without a
            supervisor: new joint limits then need a restart.
        state: state of the application. A reload replaces its `web` and updates its `origins`.
    """

    def __init__(self, settings: Settings, config: Path | None, source: Path | None, state: State) -> None:
        self._settings = settings
        self._source = source or config
        self._running = RunningConfig(config.parent) if config is not None and source is not None else None
        self._state = state
        self._task: asyncio.Task[None] | None = None

    @property
    def settings(self) -> Settings:
        """The current settings."""
        return self._settings

    @property
    def user_file(self) -> Path | None:
        """The settings file that the user edits; None if cobot started without one."""
        own = self._source is not None and self._source != resolve(DEFAULT_SETTINGS, Path())
        return self._source if own else None

    async def reload(self) -> Reloaded:
        """Reload the files and apply their changes.

        Raises:
            InputError: the files are not valid; the error states where. Nothing has changed.
            ConflictError: a client is moving a robot, or a robot is currently outside the new limits.
            UnavailableError: a robot does not answer, so it is unknown whether it is at rest; or rtloop has
                not restarted with the new limits.
        """
        robots: dict[str, Services] = self._state.robots
        with contextlib.ExitStack() as claims:
            for services in robots.values():
                owner = services.ownership
                caller = Caller(NAME, None, owner.stops, math.inf, asyncio.Event())
                claims.enter_context(owner.claim(caller))
                await _require_rest(services)
            read = await asyncio.to_thread(self._read)
            for services in robots.values():  # a local client may be streaming without a claim
                await _require_rest(services)
            for name in read.new_limits:
                _require_within(robots[name], read.robots[name].limits)
            self._take_over(robots, read)
            await asyncio.gather(*(self._enforce(robots[name]) for name in read.new_limits))
        return read.answer

    def processes(self) -> dict[str, ProcessState]:
        """Return the supervisor's processes by name; empty if there is no supervisor."""
        return {} if self._running is None else self._running.processes()

    def begin(self) -> None:
        """Reload in the background, for a signal. The result is written to the log."""
        self._task = asyncio.create_task(self._reload_and_log())

    async def _reload_and_log(self) -> None:
        try:
            answer = await self.reload()
        except CobotError as exc:
            log.error("reload rejected: %s", exc)
            self._state.audit.record(*SIGNAL, exc.code)
            return
        self._state.audit.record(*SIGNAL, "ok", taken_over=answer.taken_over)
        log.info("reload: applied: %s", "; ".join(answer.taken_over) or "nothing has changed")
        if answer.needs_restart:
            log.warning("reload: needs a restart: %s", "; ".join(answer.needs_restart))

    def _read(self) -> _Read:
        """Read the new configuration. Call it in a thread, because it may take a tenth of a second."""
        try:
            new = load_with_rolled_out(self._source)
            endpoints = load_endpoints(new.web.endpoints, ENDPOINTS)
            for each in new.each.values():
                load_robot(each).check_named_positions(each.robot.srdf)
                cell_of(each)
            settings = self._merge(new)
            if self._running is not None:
                settings = load_settings(self._running.prepare(settings))
            robots = {name: load_robot(each) for name, each in settings.each.items()}
        except (ConfigError, LimitError, CollisionError) as exc:
            raise InputError(str(exc)) from exc
        needs_restart = list(_differences(self._settings, new))
        if endpoints != load_endpoints(self._settings.web.endpoints):
            needs_restart.append("web.endpoints: the content of the file")
        needs_restart += [
            f"robot.cell of {name}: the content of the file"
            for name in self._settings.each.keys() & new.each.keys()
            if cell_of(self._settings.each[name]) != cell_of(new.each[name])
        ]
        return self._compare(settings, robots, needs_restart)

    def _compare(
        self, settings: Settings, robots: dict[str, RobotDescription], needs_restart: list[str]
    ) -> _Read:
        """Compare the new configuration with the current one."""
        taken_over: list[str] = []
        new_limits = []
        for name, robot in robots.items():
            label = f"{name}: " if len(robots) > 1 else ""
            mine = self._state.robots[name].robot
            taken_over += [f"{label}{change}" for change in _position_changes(mine, robot)]
            changes = [f"{label}{change}" for change in _limit_changes(mine.limits, robot.limits)]
            if self._running is None:
                needs_restart += changes
            elif changes:
                new_limits.append(name)
                taken_over += changes
        for key in LIVE_WEB:
            before, after = getattr(self._settings.web, key), getattr(settings.web, key)
            if before != after:
                taken_over.append(f"web.{key}: {before} → {after}")
        return _Read(settings, robots, new_limits, Reloaded(taken_over, needs_restart))

    def _merge(self, new: Settings) -> Settings:
        """Return the current settings, updated with the new values that need no restart."""
        web = {key: getattr(new.web, key) for key in LIVE_WEB}
        merged = []
        for name, each in self._settings.each.items():
            other = new.each.get(name, each)
            robot = each.robot.model_copy(update={"srdf": other.robot.srdf})
            limits = {"joint_limits": other.web.joint_limits}
            own_web = each.web.model_copy(update=web | limits)
            merged.append(each.model_copy(update={"robot": robot, "web": own_web}))
        several = tuple(merged) if self._settings.robots else ()
        return merged[0].model_copy(update={"robots": several})

    def _take_over(self, robots: dict[str, Services], read: _Read) -> None:
        """Apply the new configuration, without letting other tasks run in between."""
        if self._running is not None:
            self._running.commit()
        self._settings = read.settings
        self._state.web = read.settings.web
        self._state.origins.take_over(read.settings.web)
        for name, services in robots.items():
            if services.robot.positions != read.robots[name].positions:
                services.robot.rename(read.robots[name].positions)
                services.link.events.publish("positions", what="read again", name="")
        for name in read.new_limits:
            robots[name].robot.limits.take_over(read.robots[name].limits)
            robots[name].settings.restore_limits()
            robots[name].servo.restore_limits()

    async def _enforce(self, services: Services) -> None:
        """Replace the planning processes and restart rtloop, so that they use the new limits."""
        await asyncio.gather(services.planning.renew(), self._restart_rtloop(services))

    async def _restart_rtloop(self, services: Services) -> None:
        link, name = services.link, services.robot.name
        process = self.processes().get(f"rtloop {name}" if self._settings.robots else "rtloop")
        if process is None:
            raise UnavailableError("the supervisor has not reported the process id of rtloop; restart cobot")
        # rtloop has died, and its successor reads the new limits anyway
        with contextlib.suppress(ProcessLookupError):
            os.kill(process.pid, signal.SIGTERM)
        deadline_s = link.clock.now_s() + RTLOOP_TIMEOUT_S
        while True:
            with contextlib.suppress(UnavailableError):
                if int(link.statistics()["pid"]) != process.pid:
                    await link.await_fresh_state(0.0)
                    return
            if link.clock.now_s() > deadline_s:
                raise UnavailableError(
                    "the new joint limits apply, but rtloop has not restarted within "
                    f"{RTLOOP_TIMEOUT_S:.0f} s: see the log"
                )
            await asyncio.sleep(POLL_S)


async def _require_rest(services: Services) -> None:
    state = await services.link.await_fresh_state(STATE_TIMEOUT_S)
    if state.mode not in RESTING or state.session or not state.settled:
        raise ConflictError(
            f"robot {services.robot.name} is not at rest (mode {state.mode.name}); the configuration "
            "can be reloaded only while nothing moves"
        )


def _require_within(services: Services, limits: JointLimits) -> None:
    """Check that the new limits include the arm's current position."""
    position = services.link.state().commanded_position
    try:
        check_positions(limits, position, f"robot {services.robot.name} is outside the new limits: the angle")
    except LimitError as exc:
        raise ConflictError(f"{exc}; first move the arm inside the new limits") from exc


def _differences(old: Settings, new: Settings) -> Iterator[str]:
    """Yield a description of each difference that needs a restart."""
    if list(old.each) != list(new.each):
        yield f"robots: {', '.join(old.each)} → {', '.join(new.each)}"
    said = set()
    for name in old.each.keys() & new.each.keys():
        before, after = dict(_flat(old.each[name])), dict(_flat(new.each[name]))
        for key in before:
            if key in BY_CONTENT or key.removeprefix("web.") in LIVE_WEB or before[key] == after[key]:
                continue
            change = f"{key}: {before[key]} → {after[key]}"
            if change not in said:
                said.add(change)
                yield change


def _flat(settings: Settings) -> Iterator[tuple[str, Any]]:
    for section, content in settings.model_dump(mode="json", exclude={"robots"}).items():
        if isinstance(content, dict):
            yield from ((f"{section}.{key}", value) for key, value in content.items())
        else:
            yield section, content


def _position_changes(old: RobotDescription, new: RobotDescription) -> Iterator[str]:
    changes = [f"{name} added" for name in new.positions if name not in old.positions]
    changes += [f"{name} removed" for name in old.positions if name not in new.positions]
    both = old.positions.keys() & new.positions.keys()
    changes += sorted(f"{name} changed" for name in both if old.positions[name] != new.positions[name])
    if changes:
        yield f"named positions: {', '.join(changes)}"


def _limit_changes(old: JointLimits, new: JointLimits) -> Iterator[str]:
    for quantity in JointLimits.QUANTITIES:
        for joint, before, after in zip(
            old.names, getattr(old, quantity).tolist(), getattr(new, quantity).tolist(), strict=True
        ):
            if before != after:
                yield f"{joint}.{quantity}: {before:g} → {after:g}"
