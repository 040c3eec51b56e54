"""`cobot run`: starts rtloop, the service and ros2, restarts what dies, and leaves nothing behind.

A dead process is ordinary: it is started again after a pause that doubles up to `MAX_BACKOFF_S`.
The supervisor owns the shared memory and the listening socket, so that both outlive their users: a
restarted rtloop finds where the arm was, and clients that connect while the service restarts wait
instead of being refused. Long, for starting, watching and ending them are one account of who is alive.
"""

from __future__ import annotations

import logging
import os
import selectors
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from logging.handlers import RotatingFileHandler
from pathlib import Path
from types import FrameType

from cobot.addresses import address
from cobot.config import Settings
from cobot.errors import ConfigError, TornReadError, UnavailableError
from cobot.ipc.shm import RobotMemory, text
from cobot.launch.process import RUN_MODULE
from cobot.robot.description import load_robot

FIRST_BACKOFF_S = 0.2
MAX_BACKOFF_S = 5.0
STEADY_S = 10.0
"""A process that has lived so long is trusted again: its next pause is the first one."""
READY_TIMEOUT_S = 20.0
STOP_TIMEOUT_S = 5.0
LOG_BYTES = 10_000_000

log = logging.getLogger("cobot")


@dataclass
class Child:
    """A process to keep alive."""

    name: str
    command: list[str]
    descriptors: tuple[int, ...] = ()
    process: subprocess.Popen[bytes] | None = None
    started_s: float = 0.0
    backoff_s: float = FIRST_BACKOFF_S
    restart_at_s: float = 0.0
    reader: threading.Thread | None = field(default=None, repr=False)

    def start(self) -> None:
        self.process = subprocess.Popen(
            self.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            pass_fds=self.descriptors,
            start_new_session=True,  # Ctrl-C reaches the supervisor alone, which stops the arm first
        )
        self.started_s = time.monotonic()
        self.reader = threading.Thread(target=self._forward, args=(self.process,), daemon=True)
        self.reader.start()

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

    def _forward(self, process: subprocess.Popen[bytes]) -> None:
        assert process.stdout is not None
        with process.stdout as lines:
            for line in lines:
                log.info("%s: %s", self.name, line.decode("utf-8", "replace").rstrip())


class Supervisor:
    """Runs the robots until it is told to stop: a process for each, and one service for all."""

    def __init__(self, settings: Settings, config: Path | None) -> None:
        self._settings = settings
        self._config = ["--config", str(config.resolve())] if config else []
        self._stopping = threading.Event()
        self._wake_read, self._wake_write = socket.socketpair()
        self._wake_write.setblocking(False)

    def run(self) -> int:
        """Start everything, watch over it, stop everything.

        Returns:
            The exit status: 0 after a stop by signal.

        Raises:
            CobotError: nothing could be started.
        """
        log_file = self._open_log()
        listener = self._listen() if self._settings.web.enabled else None
        url = _url(listener) if listener is not None else ""
        rtloops: list[Child] = []
        service: list[Child] = []
        with ExitStack() as stack:
            if listener is not None:
                stack.callback(listener.close)
            memories = {name: self._memory(name, url, stack) for name in self._settings.each}
            try:
                self._catch_signals()
                for name in memories:
                    rtloops.append(self._rtloop(name))
                    rtloops[-1].start()
                if listener is not None:
                    service.append(self._service(listener))
                    service[-1].start()
                if self._settings.ros.enabled:
                    service.append(self._ros2(url))
                    service[-1].start()
                self._await_first(rtloops, list(memories.values()))  # the others take longer
                self._announce(url, memories, log_file)
                while not self._stopping.is_set():
                    for child in (*rtloops, *service):
                        self._revive(child)
                    self._sleep(0.1)
            finally:
                log.info("stopping: the arm first")
                for child in rtloops:  # all arms come to rest at the same time
                    child.ask_to_end()
                for child in (*rtloops, *service):
                    child.end(STOP_TIMEOUT_S)
        log.info("stopped")
        return 0

    def _memory(self, name: str, url: str, stack: ExitStack) -> RobotMemory:
        """A robot's shared memory, which goes with the stack."""
        settings = self._settings.of(name)
        own_url = address(url, name) if url and self._settings.robots else url
        dof = load_robot(settings).limits.dof
        memory = RobotMemory.create(name, dof, settings.rt.period_s, settings.rt.trajectory_capacity, own_url)
        stack.callback(memory.close)
        stack.callback(memory.unlink)
        return memory

    def _rtloop(self, robot: str) -> Child:
        name = f"rtloop {robot}" if self._settings.robots else "rtloop"
        clock = self._settings.of(robot).rt.clock
        return Child(name, [*RUN_MODULE, "rtloop", *self._config, "--robot", robot, "--clock", clock])

    def _service(self, listener: socket.socket) -> Child:
        host, port = listener.getsockname()[:2]
        listening = ["--host", host, "--port", str(port), "--fd", str(listener.fileno())]
        return Child("service", [*RUN_MODULE, "app", *self._config, *listening], (listener.fileno(),))

    def _ros2(self, url: str) -> Child:
        # What one such process leaves to the next; it goes with the supervisor.
        last_words = os.memfd_create("cobot-ros2")
        arguments = ["--last-words", str(last_words), *(("--url", url) if url else ())]
        return Child("ros2", [*RUN_MODULE, "ros2", *self._config, *arguments], (last_words,))

    def _open_log(self) -> Path:
        folder = self._settings.logs
        try:
            folder.mkdir(parents=True, exist_ok=True)
            path = self._settings.log_file
            to_file = RotatingFileHandler(path, maxBytes=LOG_BYTES, backupCount=3, encoding="utf-8")
        except OSError as exc:
            raise ConfigError(f"logs: cannot write to {folder}: {exc.strerror}") from exc
        to_file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(message)s"))
        to_console = logging.StreamHandler(sys.stdout)
        to_console.setFormatter(logging.Formatter("%(message)s"))
        log.setLevel(logging.INFO)
        log.handlers[:] = [to_file, to_console]
        return path

    def _listen(self) -> socket.socket:
        web = self._settings.web
        try:
            family, _, _, _, address = socket.getaddrinfo(web.host, web.port, type=socket.SOCK_STREAM)[0]
            listener = socket.socket(family, socket.SOCK_STREAM)
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen(512)
        except (OSError, ValueError) as exc:  # ValueError: no name of a host at all
            reason = getattr(exc, "strerror", None) or str(exc)
            raise UnavailableError(
                f"cannot listen on {web.host} port {web.port}: {reason}; --port 0 picks a free one"
            ) from exc
        if listener.getsockname()[0] in ("0.0.0.0", "::"):
            log.warning(
                "listening on all interfaces without authentication: whoever reaches the port moves the robot"
            )
        return listener

    def _catch_signals(self) -> None:
        def stop(number: int, frame: FrameType | None) -> None:
            self._stopping.set()

        signal.set_wakeup_fd(self._wake_write.fileno())
        for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            signal.signal(number, stop)
        signal.signal(signal.SIGCHLD, lambda number, frame: None)  # only to wake the loop

    def _sleep(self, seconds: float) -> None:
        with selectors.DefaultSelector() as selector:
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
                raise UnavailableError(
                    f"{rtloop.name} ended with status {rtloop.process.returncode} at its start, see above"
                )
            if time.monotonic() > deadline_s:
                raise UnavailableError(f"{rtloop.name} did not begin its cycle in {READY_TIMEOUT_S:.0f} s")
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
            child.start()

    def _announce(self, url: str, memories: dict[str, RobotMemory], log_file: Path) -> None:
        log.info("cobot %s (pid %d)", version("cobot"), os.getpid())
        log.info("  address    %s", f"{url}/docs" if url else "none: web.enabled is false")
        for name, memory in memories.items():
            rt = self._settings.of(name).rt
            log.info("  robot      %s, %d joints", name, memory.dof)
            log.info("  backend    %s, clock %s", rt.backend, rt.clock)
            log.info("  real time  %s", _permissions(memory))
        log.info("  logs       %s", log_file)
        log.info("  Ctrl-C stops: the arm first, then the service")


def _url(listener: socket.socket) -> str:
    """Where clients on this computer find the service."""
    host, port = listener.getsockname()[:2]
    local = host in ("127.0.0.1", "0.0.0.0", "::", "::1")
    return f"http://{'localhost' if local else f'[{host}]' if ':' in host else host}:{port}"


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
