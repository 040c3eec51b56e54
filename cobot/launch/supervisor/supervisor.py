"""Starts, watches and ends the processes of a `cobot run`."""

from __future__ import annotations

import logging
import signal
import time
from collections.abc import Iterable
from contextlib import ExitStack
from functools import partial
from pathlib import Path

from cobot.access.authentication import ros_access
from cobot.access.tls import check_certificate
from cobot.addresses import address
from cobot.cell.plant import check_cell
from cobot.config import DEFAULT_SETTINGS, Settings, resolve
from cobot.errors import UnavailableError
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.seqlock import Block
from cobot.ipc.shm import RobotMemory
from cobot.launch.endpoints import check_endpoints
from cobot.launch.fleet_extra import require_zenoh
from cobot.launch.forked import Forked
from cobot.launch.process import has_terminal
from cobot.launch.running_config import ProcessState, RunningConfig
from cobot.launch.supervisor.announcement import announce
from cobot.launch.supervisor.child import Child
from cobot.launch.supervisor.children import RECORDER, SERVICE, Children
from cobot.launch.supervisor.heartbeat import HeartbeatWatch
from cobot.launch.supervisor.kept_lock import locking_kept_files
from cobot.launch.supervisor.listening import access_to, listen, url_of
from cobot.launch.supervisor.signals import ProcessSignals
from cobot.launch.supervisor.systemd import Systemd
from cobot.logs.supervision import supervising
from cobot.recording.control import HANG_S
from cobot.robot.description import load_robot
from cobot.robot.holding import check_start

READY_TIMEOUT_S = 20.0
STOP_TIMEOUT_S = 5.0

log = logging.getLogger("cobot")


class Supervisor:
    """Runs the robots until it receives a signal. There is one process for each robot, and one service for
    all robots.
    """

    def __init__(
        self,
        settings: Settings,
        config: Path | None,
        as_written: Settings | None = None,
        blanks: Iterable[Forked] = (),
    ) -> None:
        """Create a supervisor that has started nothing yet.

        Args:
            as_written: the settings without the overrides of the command line.
            blanks: forked processes that wait for a command. The first processes to start use them.
        """
        self._blanks = list(blanks)
        self._settings = settings
        self._as_written = as_written or settings
        self._source = config.resolve() if config else resolve(DEFAULT_SETTINGS, Path())
        self._running = RunningConfig.of(settings.robot.name)
        self._systemd = Systemd()
        self._signals = ProcessSignals()
        self._in_terminal = has_terminal()
        self._recordings: list[RecordingMemory] = []

    def run(self) -> int:
        """Start everything, watch it, stop everything.

        Returns:
            The exit status: 0 after a stop by signal.

        Raises:
            CobotError: nothing could be started.
        """
        with supervising(self._settings.logging, self._settings.log_file) as self._log:
            self._run()
        return 0

    def _run(self) -> None:
        secure = check_certificate(self._settings.web)
        if self._settings.fleet.connect:
            require_zenoh("fleet.connect")
        if self._settings.web.enabled:
            check_endpoints(self._settings.web.endpoints)  # errors are reported here and not by a child
        listener = listen(self._settings.web) if self._settings.web.enabled else None
        url = url_of(listener, secure) if listener is not None else ""
        access = access_to(self._settings.web, listener)
        access += f"; {ros_access(self._settings.ros, self._settings.web)}"
        made = Children(self._settings, self._running.file, self._source, self._log)
        rtloops: list[Child] = []
        service: list[Child] = []
        with ExitStack() as stack:
            if listener is not None:
                stack.callback(listener.close)
            memories = {name: self._memory(name, url, stack) for name in self._settings.each}
            stack.enter_context(locking_kept_files(self._settings))
            stack.callback(self._running.remove)
            self._running.create(self._as_written)
            try:
                stack.enter_context(self._signals.catch())
                rtloops.extend(self._start(made.rtloop(name)) for name in memories)
                service.append(self._start(made.recorder()))
                if listener is not None:
                    service.append(self._start(made.service(listener)))
                if self._settings.ros.enabled:
                    service.append(self._start(made.ros2(url)))
                if self._settings.fleet.connect:
                    service.append(self._start(made.fleet(url)))
                self._await_first(rtloops, list(memories.values()))  # the other processes take longer
                announce(self._settings, url, access, memories)
                self._watch([*rtloops, *service], memories, url)
            finally:
                self._systemd.report_stopping()
                for child in rtloops:  # all arms stop at the same time, before anything is written
                    child.ask_to_end()
                log.info("stopping: the arm first")
                for child in (*rtloops, *service):
                    child.end(STOP_TIMEOUT_S)
        log.info("stopped")

    def _start(self, child: Child) -> Child:
        child.blank = self._blanks.pop() if self._blanks else None
        child.start()
        return child

    def _watch(self, children: list[Child], memories: dict[str, RobotMemory], url: str) -> None:
        """Watch the processes until it is time to stop."""
        # Everything is ready only after the service has begun to serve these robots.
        served = list(memories.values()) if url else []
        known: dict[str, ProcessState] = {}
        watches = self._watches(memories)
        while not self._signals.stopping:
            if self._signals.hangup:
                self._signals.hangup = False
                self._reload(children)
            _repair_headers(memories)
            for child in children:
                child.ensure_running()
                for watch in watches.get(child.name, ()):
                    watch.look(child.process)
            states = {child.name: child.state for child in children}
            if states != known:
                known = states
                self._running.publish(states)
            if served and all(int(memory.heartbeat.sequence) for memory in served):
                served = []
            if not served:
                self._systemd.report_ready(url)
            self._systemd.send_heartbeat()
            self._signals.sleep(0.1)

    def _watches(self, memories: dict[str, RobotMemory]) -> dict[str, list[HeartbeatWatch]]:
        """The heartbeats that must be watched, by process. The recorder sends one heartbeat per robot, from
        the thread that follows the robot.
        """
        beats = partial(_beats, [memory.heartbeat for memory in memories.values()])
        return {
            SERVICE: [HeartbeatWatch(SERVICE, beats, self._settings.web.hang_to_restart_s)],
            RECORDER: [
                HeartbeatWatch(RECORDER, partial(_beats, [each.status]), HANG_S) for each in self._recordings
            ],
        }

    def _reload(self, children: list[Child]) -> None:
        """Handle SIGHUP: the service reads the configuration again. If the terminal of this process is gone,
        the supervisor ends instead, because the operator no longer watches the arm.
        """
        if self._in_terminal and not has_terminal():
            log.info("the terminal has been closed")
            self._signals.stopping = True
            return
        service = next((child for child in children if child.name == SERVICE), None)
        if service is None or service.process is None:
            log.warning("web.enabled is false: no service can read the configuration again; restart cobot")
            return
        log.info("SIGHUP: the service reads the configuration again")
        service.process.send_signal(signal.SIGHUP)

    def _memory(self, name: str, url: str, stack: ExitStack) -> RobotMemory:
        """Create a robot's shared memory. When the stack is closed, the memory is removed."""
        settings = self._settings.of(name)
        own_url = address(url, name) if url and self._settings.robots else url
        robot = load_robot(settings)
        robot.check_named_positions(settings.robot.srdf)
        check_start(robot, settings)
        check_cell(robot, settings)
        dof = robot.limits.dof
        memory = RobotMemory.create(name, dof, settings.rt.period_s, settings.rt.trajectory_capacity, own_url)
        stack.callback(memory.close)
        stack.callback(memory.unlink)
        recording = RecordingMemory.create(
            name, dof, settings.rt.period_s, settings.recording.ring_s, robot.limits.names
        )
        stack.callback(recording.unlink)
        self._recordings.append(recording)
        return memory

    def _await_first(self, rtloops: list[Child], memories: list[RobotMemory]) -> None:
        """Wait for the robots' cycles to begin. If the cycle of a process does not begin, the process is
        restarted later, like one that has ended.

        Raises:
            UnavailableError: no cycle has begun.
        """
        failed: list[UnavailableError] = []
        deadline_s = time.monotonic() + READY_TIMEOUT_S
        for rtloop, memory in zip(rtloops, memories, strict=True):
            try:
                self._await_rtloop(rtloop, memory, deadline_s)
            except UnavailableError as exc:
                failed.append(exc)
        if len(failed) == len(rtloops):
            raise failed[0]
        for error in failed:
            log.error("%s", error)

    def _await_rtloop(self, rtloop: Child, memory: RobotMemory, deadline_s: float) -> None:
        while int(memory.state.sequence) == 0 and not self._signals.stopping:
            assert rtloop.process is not None
            if rtloop.process.poll() is not None:
                status = rtloop.process.returncode
                raise UnavailableError(
                    f"{rtloop.name} ended with status {status} at its start: {rtloop.last_line()}"
                )
            if time.monotonic() > deadline_s:
                backend = self._settings.of(memory.robot).robot.backend.type
                raise UnavailableError(
                    f"{rtloop.name} did not begin its cycle in {READY_TIMEOUT_S:.0f} s: robot.backend "
                    f"{backend!r} has not opened its device"
                )
            self._signals.sleep(0.02)


def _beats(blocks: Iterable[Block]) -> int:
    """A number that changes with each heartbeat in any of the blocks."""
    return sum(int(each.sequence) for each in blocks)


def _repair_headers(memories: dict[str, RobotMemory]) -> None:
    """Repair headers that were overwritten. A process reads the header only when it maps the memory, for
    example after a restart.
    """
    for name, memory in memories.items():
        if memory.mend_header():
            log.error("the header of the shared memory of %s was overwritten and has been restored", name)
