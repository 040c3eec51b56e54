"""`cobot run`: starts rtloop, the service and ros2, restarts what dies, and leaves nothing behind.

A dead process is ordinary: it is started again after a pause that doubles up to `MAX_BACKOFF_S`.
The supervisor owns the shared memory and the listening socket, so that both outlive their users: a
restarted rtloop finds where the arm was, and clients that connect while the service restarts wait
instead of being refused. Long, for starting, watching and ending them are one account of who is alive.
"""

from __future__ import annotations

import errno
import logging
import os
import secrets
import selectors
import signal
import socket
import subprocess
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from types import FrameType

from cobot.access.authentication import ROS_TOKEN_VARIABLE, authentication_required, is_loopback
from cobot.access.tls import check_certificate
from cobot.access.tokens import TokenFile
from cobot.addresses import address
from cobot.client.tls import CERTIFICATE_VARIABLE
from cobot.config import DEFAULT_SETTINGS, Settings, load_endpoints, resolve
from cobot.errors import TornReadError, UnavailableError, exhausted
from cobot.ipc.layout import text
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.shm import RobotMemory
from cobot.launch.heartbeat import HeartbeatWatch
from cobot.launch.process import RUN_MODULE, has_terminal
from cobot.launch.running_config import ProcessState, RunningConfig
from cobot.launch.systemd import Systemd
from cobot.logs.process import SUPERVISED
from cobot.logs.supervision import SupervisorLog, supervising
from cobot.robot.description import load_robot

FIRST_BACKOFF_S = 0.2
MAX_BACKOFF_S = 5.0
STEADY_S = 10.0
"""A process that has lived so long is trusted again: its next pause is the first one."""
READY_TIMEOUT_S = 20.0
STOP_TIMEOUT_S = 5.0
SERVICE = "service"
"""Fewer file descriptors leave a service that answers nobody."""

log = logging.getLogger("cobot")


@dataclass
class Child:
    """A process to keep alive."""

    name: str
    command: list[str]
    log: SupervisorLog
    descriptors: tuple[int, ...] = ()
    environment: dict[str, str] = field(default_factory=dict, repr=False)
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    backoff_s: float = FIRST_BACKOFF_S
    restart_at_s: float = 0.0
    restarts: int = 0
    line: str = ""
    reader: threading.Thread | None = field(default=None, repr=False)

    def start(self) -> None:
        read_end, write_end = os.pipe()
        # What a process writes past its log, as C libraries and the interpreter do, is lost when this one
        # does not read, and waits for nothing.
        os.set_blocking(write_end, False)
        output = os.fdopen(read_end, "rb")
        try:
            self.process = subprocess.Popen(
                self.command,
                stdin=subprocess.DEVNULL,
                stdout=write_end,
                stderr=write_end,
                pass_fds=self.descriptors,
                env={**os.environ, **self.environment, SUPERVISED: "1"},
                start_new_session=True,  # Ctrl-C reaches the supervisor alone, which stops the arm first
            )
        except BaseException:
            output.close()
            raise
        finally:
            os.close(write_end)
        self.started_s = time.monotonic()
        try:
            self.reader = self.log.follow(self.name, output, self._heard)
        except RuntimeError:  # no memory is left for a thread
            self.process.kill()
            self.process.wait()
            raise

    def _heard(self, line: str) -> None:
        self.line = line

    def last_words(self) -> str:
        """The last line of a process that has ended."""
        if self.reader is not None:
            self.reader.join(1.0)
        return self.line or "it said nothing"

    @property
    def state(self) -> ProcessState:
        return ProcessState(self.process.pid if self.process is not None else 0, self.restarts)

    def ask_to_end(self) -> None:
        if self.process is not None:
            self.process.terminate()

    def end(self, timeout_s: float) -> None:
        """Ask the process to end, and make it end."""
        if self.process is None:
            return
        self.ask_to_end()
        try:
            self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            log.error(
                "%s (pid %d) did not end within %.0f s and is killed", self.name, self.process.pid, timeout_s
            )
            self.process.kill()
            self.process.wait()
        if self.reader is not None:
            self.reader.join(1.0)


class _Flag:
    """An event that a signal's handler sets, which the next signal may interrupt in the middle of that.

    A `threading.Event` would then wait for itself, for ever.
    """

    def __init__(self) -> None:
        self._set = False

    def set(self) -> None:
        self._set = True

    def clear(self) -> None:
        self._set = False

    def is_set(self) -> bool:
        return self._set


class Supervisor:
    """Runs the robots until it is told to stop: a process for each, and one service for all."""

    def __init__(self, settings: Settings, config: Path | None, as_written: Settings | None = None) -> None:
        """as_written: the settings without what the command line says otherwise."""
        self._settings = settings
        self._as_written = as_written or settings
        self._source = config.resolve() if config else resolve(DEFAULT_SETTINGS, Path())
        self._running = RunningConfig.of(settings.robot.name)
        self._config = ["--config", str(self._running.file)]
        self._ros_token = secrets.token_urlsafe(32)
        self._systemd = Systemd()
        self._in_terminal = has_terminal()
        self._stopping = _Flag()
        self._hangup = _Flag()
        self._wake_read, self._wake_write = socket.socketpair()
        self._wake_write.setblocking(False)

    def run(self) -> int:
        """Start everything, watch over it, stop everything.

        Returns:
            The exit status: 0 after a stop by signal.

        Raises:
            CobotError: nothing could be started.
        """
        with (
            self._wake_read,
            self._wake_write,
            supervising(self._settings.logging, self._settings.log_file) as self._log,
        ):
            try:
                self._run()
            finally:
                signal.set_wakeup_fd(-1)
        return 0

    def _run(self) -> None:
        secure = check_certificate(self._settings.web)
        if self._settings.web.enabled:
            load_endpoints(self._settings.web.endpoints)  # what is wrong there is said here, not by a child
        listener = self._listen() if self._settings.web.enabled else None
        url = _url(listener, secure) if listener is not None else ""
        access = self._access(listener)
        rtloops: list[Child] = []
        service: list[Child] = []
        with ExitStack() as stack:
            if listener is not None:
                stack.callback(listener.close)
            memories = {name: self._memory(name, url, stack) for name in self._settings.each}
            stack.callback(self._running.remove)
            self._running.create(self._as_written)
            try:
                self._catch_signals()
                for name in memories:
                    rtloops.append(self._rtloop(name))
                    rtloops[-1].start()
                service.append(Child("recorder", [*RUN_MODULE, "recorder", *self._config], self._log))
                service[-1].start()
                if listener is not None:
                    service.append(self._service(listener))
                    service[-1].start()
                if self._settings.ros.enabled:
                    service.append(self._ros2(url))
                    service[-1].start()
                self._await_first(rtloops, list(memories.values()))  # the others take longer
                self._announce(url, access, memories)
                self._watch([*rtloops, *service], memories, url)
            finally:
                self._systemd.stopping()
                for child in rtloops:  # all arms come to rest at the same time, before anything is written
                    child.ask_to_end()
                log.info("stopping: the arm first")
                for child in (*rtloops, *service):
                    child.end(STOP_TIMEOUT_S)
        log.info("stopped")

    def _watch(self, children: list[Child], memories: dict[str, RobotMemory], url: str) -> None:
        """Until it is time to stop."""
        # For these robots the service has to begin before all is ready.
        served = list(memories.values()) if url else []
        known: dict[str, ProcessState] = {}
        service = next((child for child in children if child.name == SERVICE), None)
        heartbeat = HeartbeatWatch(
            SERVICE,
            lambda: sum(int(memory.heartbeat.sequence) for memory in memories.values()),
            self._settings.web.hang_to_restart_s,
        )
        while not self._stopping.is_set():
            if self._hangup.is_set():
                self._hangup.clear()
                self._reload(children)
            _mend(memories)
            for child in children:
                self._revive(child)
            if service is not None:
                heartbeat.look(service.process)
            states = {child.name: child.state for child in children}
            if states != known:
                known = states
                self._running.publish(states)
            if served and all(int(memory.heartbeat.sequence) for memory in served):
                served = []
            if not served:
                self._systemd.ready(url)
            self._systemd.alive()
            self._sleep(0.1)

    def _reload(self, children: list[Child]) -> None:
        """SIGHUP: the service reads the configuration again. Where it came because the terminal that this
        was started from has gone, it is the end: nobody watches the arm any more.
        """
        if self._in_terminal and not has_terminal():
            log.info("the terminal has gone")
            self._stopping.set()
            return
        service = next((child for child in children if child.name == SERVICE), None)
        if service is None or service.process is None:
            log.warning("web.enabled is false: no service can read the configuration again; restart cobot")
            return
        log.info("SIGHUP: the service reads the configuration again")
        service.process.send_signal(signal.SIGHUP)

    def _memory(self, name: str, url: str, stack: ExitStack) -> RobotMemory:
        """A robot's shared memory, which goes with the stack."""
        settings = self._settings.of(name)
        own_url = address(url, name) if url and self._settings.robots else url
        robot = load_robot(settings)
        robot.check_named_positions(settings.robot.srdf)
        dof = robot.limits.dof
        memory = RobotMemory.create(name, dof, settings.rt.period_s, settings.rt.trajectory_capacity, own_url)
        stack.callback(memory.close)
        stack.callback(memory.unlink)
        recording = RecordingMemory.create(
            name, dof, settings.rt.period_s, settings.recording.ring_s, robot.limits.names
        )
        stack.callback(recording.unlink)
        return memory

    def _rtloop(self, robot: str) -> Child:
        name = f"rtloop {robot}" if self._settings.robots else "rtloop"
        clock = self._settings.of(robot).rt.clock
        command = [*RUN_MODULE, "rtloop", *self._config, "--robot", robot, "--clock", clock]
        return Child(name, command, self._log)

    def _service(self, listener: socket.socket) -> Child:
        host, port = listener.getsockname()[:2]
        listening = ["--host", host, "--port", str(port), "--fd", str(listener.fileno())]
        losses = self._log.losses
        files = [*self._config, "--source", str(self._source), "--losses-fd", str(losses)]
        command = [*RUN_MODULE, "app", *files, *listening]
        token = {ROS_TOKEN_VARIABLE: self._ros_token}
        return Child(SERVICE, command, self._log, (listener.fileno(), losses), token)

    def _ros2(self, url: str) -> Child:
        # What one such process leaves to the next; it goes with the supervisor.
        last_words = os.memfd_create("cobot-ros2")
        arguments = ["--last-words", str(last_words), *(("--url", url) if url else ())]
        command = [*RUN_MODULE, "ros2", *self._config, *arguments]
        environment = {ROS_TOKEN_VARIABLE: self._ros_token}
        if self._settings.web.tls_certificate:
            environment[CERTIFICATE_VARIABLE] = str(self._settings.web.tls_certificate)
        return Child("ros2", command, self._log, (last_words,), environment)

    def _listen(self) -> socket.socket:
        web = self._settings.web
        try:
            family, _, _, _, address = socket.getaddrinfo(web.host, web.port, type=socket.SOCK_STREAM)[0]
            with ExitStack() as failed:
                listener = failed.enter_context(socket.socket(family, socket.SOCK_STREAM))
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.bind(address)
                listener.listen(512)
                failed.pop_all()
        except (OSError, ValueError) as exc:  # ValueError: no name of a host at all
            raise UnavailableError(_no_listener(web.host, web.port, exc)) from exc
        return listener

    def _access(self, listener: socket.socket | None) -> str:
        """Who may use the service, for people.

        Raises:
            ConfigError: the file of tokens cannot be read, or makes no sense.
        """
        if listener is None:
            return "none: there is no service"
        web, address = self._settings.web, listener.getsockname()[0]
        tokens = TokenFile(web.tokens).read()
        if authentication_required(web, address):
            if not tokens:
                log.warning("nobody can use the service yet: cobot token create NAME --role operator")
            open_stop = "; the stop needs none" if web.stop_without_token else ""
            return f"with a token, {len(tokens)} in {web.tokens}{open_stop}"
        if is_loopback(address):
            return "whoever uses this computer, without a token"
        log.warning(
            "web.authentication is none, and %s is reached from elsewhere: "
            "whoever reaches the port moves the robot",
            address,
        )
        return "WHOEVER REACHES THE PORT, without a token"

    def _catch_signals(self) -> None:
        def stop(number: int, frame: FrameType | None) -> None:
            self._stopping.set()

        signal.set_wakeup_fd(self._wake_write.fileno())
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        signal.signal(signal.SIGHUP, lambda number, frame: self._hangup.set())
        signal.signal(signal.SIGCHLD, lambda number, frame: None)  # only to wake the loop

    def _sleep(self, seconds: float) -> None:
        with selectors.PollSelector() as selector:  # it needs no descriptor, of which there may be none
            selector.register(self._wake_read, selectors.EVENT_READ)
            if selector.select(seconds):
                self._wake_read.recv(4096)

    def _await_first(self, rtloops: list[Child], memories: list[RobotMemory]) -> None:
        """Wait for the robots' cycles to begin. One that does not is tried again later, like one that dies.

        Raises:
            UnavailableError: not a single one has begun.
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
        while int(memory.state.sequence) == 0 and not self._stopping.is_set():
            assert rtloop.process is not None
            if rtloop.process.poll() is not None:
                status = rtloop.process.returncode
                raise UnavailableError(
                    f"{rtloop.name} ended with status {status} at its start: {rtloop.last_words()}"
                )
            if time.monotonic() > deadline_s:
                backend = self._settings.of(memory.robot).rt.backend
                raise UnavailableError(
                    f"{rtloop.name} did not begin its cycle in {READY_TIMEOUT_S:.0f} s: rt.backend "
                    f"{backend!r} has not opened its device"
                )
            self._sleep(0.02)

    def _revive(self, child: Child) -> None:
        assert child.process is not None
        status = child.process.poll()
        now_s = time.monotonic()
        if status is None:
            if now_s - child.started_s > STEADY_S:
                child.backoff_s = FIRST_BACKOFF_S
            return
        if child.restart_at_s <= child.started_s:  # its death is news
            child.restart_at_s = now_s + child.backoff_s
            if status == 0:
                log.info(
                    "%s (pid %d) has ended as it was asked to, and starts anew", child.name, child.process.pid
                )
                return
            cause = signal.Signals(-status).name if status < 0 else f"status {status}"
            log.error(
                "%s (pid %d) ended: %s; restart in %.1f s",
                child.name,
                child.process.pid,
                cause,
                child.backoff_s,
            )
            child.backoff_s = min(2.0 * child.backoff_s, MAX_BACKOFF_S)
        elif now_s >= child.restart_at_s:
            try:
                child.start()
                child.restarts += 1
            except (OSError, RuntimeError) as exc:  # RuntimeError: of a thread that cannot be started
                log.error(
                    "%s cannot be started: %s; next attempt in %.1f s",
                    child.name,
                    exhausted(exc) or exc,
                    child.backoff_s,
                )
                child.restart_at_s = now_s + child.backoff_s
                child.backoff_s = min(2.0 * child.backoff_s, MAX_BACKOFF_S)

    def _announce(self, url: str, access: str, memories: dict[str, RobotMemory]) -> None:
        log.info("cobot %s (pid %d)", version("cobot"), os.getpid())
        log.info("  address    %s", f"{url}/" if url else "none: web.enabled is false")
        log.info("  access     %s", access)
        for name, memory in memories.items():
            rt = self._settings.of(name).rt
            log.info("  robot      %s, %d joints", name, memory.dof)
            log.info("  backend    %s, clock %s", rt.backend, rt.clock)
            log.info("  real time  %s", _permissions(memory))
        log.info("  logs       %s", self._settings.log_file)
        log.info("  Ctrl-C stops: the arm first, then the service")


def _mend(memories: dict[str, RobotMemory]) -> None:
    """Nothing reads a header but who maps the memory, above all a process that is restarted."""
    for name, memory in memories.items():
        if memory.mend_header():
            log.error("the header of the shared memory of %s was spoilt, and is written anew", name)


def _no_listener(host: str, port: int, error: OSError | ValueError) -> str:
    """Why nobody can listen there, and which setting to change."""
    reason = getattr(error, "strerror", None) or str(error)
    message = f"cannot listen on {host} port {port}: {reason}"
    match getattr(error, "errno", None):
        case errno.EADDRINUSE:
            return f"web.port: {message}; set another one, or --port 0, which picks a free one"
        case errno.EACCES:
            return f"web.port: {message}; set one from 1024 on, which needs no privilege"
    return f"web.host: {message}; set an address of this computer, 127.0.0.1 or 0.0.0.0"


def _url(listener: socket.socket, secure: bool) -> str:
    """Where clients on this computer find the service."""
    host, port = listener.getsockname()[:2]
    local = host in ("127.0.0.1", "0.0.0.0", "::", "::1")
    scheme = "https" if secure else "http"
    return f"{scheme}://{'localhost' if local else f'[{host}]' if ':' in host else host}:{port}"


def _permissions(memory: RobotMemory) -> str:
    for _ in range(50):
        try:
            record = memory.statistics.read()
        except TornReadError as exc:
            return str(exc)
        if record["pid"]:
            granted = [("SCHED_FIFO", record["sched_fifo"]), ("locked memory", record["memory_locked"])]
            words = ", ".join(f"{name} {'granted' if yes else 'NOT granted'}" for name, yes in granted)
            refused = text(record["permissions"])
            return f"{words} ({refused})" if refused else words
        time.sleep(0.02)
    return "unknown: rtloop has published no statistics"
