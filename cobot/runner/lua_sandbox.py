"""Runs a Lua program in a sandbox: plain Lua 5.3 without access to the system and with limits. It can be
ended on request.

The program sees only values, tables and Lua functions, which `sandbox.lua` defines. A program may catch
errors; `sandbox.lua` ensures that it does not catch the request to end. While a program is inside one long
function of Lua itself (for example for a hostile string pattern), it executes no instructions, so it does not
notice a request to end. Code that ends a program must therefore not wait for it indefinitely.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lupa.lua53 import LuaError, LuaRuntime

from cobot.errors import CobotError, InputError
from cobot.foreign import plain_error

PRELUDE = Path(__file__).with_name("sandbox.lua")
INTERVAL = 100_000
"""Number of instructions between two checks of the limits. This many instructions take about a millisecond.
"""
END_S = 0.3
"""Maximum time to wait for a program that must end, s. The program notices the request within milliseconds,
or never.
"""
MAX_ERROR_BYTES = 10_000
HOST_ERROR = "the runner has failed: {}; this is an error in cobot"

Function = Callable[..., Any]


@dataclass(frozen=True, slots=True)
class LuaLimits:
    """The limits of a program.

    Attributes:
        memory_bytes: maximum size of Lua's heap.
        instructions: maximum number of instructions between two calls that wait (sleep, motion, topic); 0
            means any number.
    """

    memory_bytes: int = 64 << 20
    instructions: int = 2_000_000_000


class Stopping(Exception):
    """Raised when the program must end. It passes through everything that the program calls."""


class ProgramWatch:
    """Tells a program when it must end, and then interrupts its waits.

    Attributes:
        reason: the reason why the program must end; "" while it may continue.
        told: whether it must end because of a request and not because of a limit.
    """

    def __init__(self, instructions: int) -> None:
        self.reason = ""
        self.told = False
        self._limit = instructions
        self._count = 0
        self._changed = threading.Condition()

    def end(self, reason: str) -> None:
        """Ask the program to stop."""
        self.told, self.reason = True, reason
        self.wake()

    def wake(self) -> None:
        """Let `wait` check its condition again."""
        with self._changed:
            self._changed.notify_all()

    def wait(self, ready: Callable[[], bool], timeout_s: float | None = None) -> bool:
        """Wait until `ready` returns true or the timeout has passed. Returns the last value of `ready`.

        Raises:
            Stopping: the program must end.
        """
        self._count = 0
        with self._changed:
            self._changed.wait_for(lambda: self.reason or ready(), timeout_s)
        if self.reason:
            raise Stopping(self.reason)
        return ready()

    def sleep(self, seconds: float) -> None:
        """Wait for a given time, s.

        Raises:
            Stopping: the program must end.
        """
        deadline_s = time.monotonic() + seconds
        self.wait(lambda: time.monotonic() >= deadline_s, min(seconds, threading.TIMEOUT_MAX))

    def poll(self, instructions: int) -> tuple[bytes, bool] | None:
        """Count instructions. If the program must end, returns the reason, and whether the message needs the
        line number; otherwise None.
        """
        if self.reason:
            return self.reason.encode(), False
        self._count += instructions
        if self._limit and self._count > self._limit:
            self.reason = f"more than {self._limit} instructions without waiting for anything; see sleep"
            return self.reason.encode(), True
        return None


class Sandbox:
    """A Lua runtime for one run of one program.

    Attributes:
        failure: the latest `CobotError` that was reported to the program; None before the first one.
    """

    def __init__(self, functions: Mapping[str, Function], watch: ProgramWatch, limits: LuaLimits) -> None:
        self.failure: CobotError | None = None
        self._watch = watch
        self._lua = LuaRuntime(
            encoding=None,  # strings are bytes, because messages are binary
            unpack_returned_tuples=True,
            register_eval=False,
            register_builtins=False,
            attribute_filter=_nothing,
            overflow_handler=float,
            max_memory=limits.memory_bytes,
        )
        host = {name.encode(): self._protect(function) for name, function in functions.items()}
        prelude = self._lua.compile(PRELUDE.read_bytes(), name=b"=cobot", mode=b"t")
        self._run = prelude(self._lua.table_from(host), watch.poll, INTERVAL)

    def run(self, source: bytes, name: str) -> None:
        """Run a program to its end.

        Args:
            name: file name, for messages.

        Raises:
            Stopping: the program was told to end.
            InputError: the text is not valid Lua, or the program has failed; the message names the line.
            CobotError: an error that the program did not catch.
        """
        try:
            ended = self._run(source, b"@" + name.encode())
        except LuaError as exc:  # there is no memory even for the end
            raise InputError(f"{name}: {exc}") from exc
        if ended is True:
            return
        if self._watch.told:
            raise Stopping(self._watch.reason)
        if self.failure is not None and ended[1].endswith(_bytes(self.failure)):
            raise self.failure.with_message(_message(ended[1])) from self.failure
        raise InputError(_message(ended[1]))

    def table(self, items: Mapping[Any, Any] | list[Any]) -> Any:
        """Convert items to a Lua table."""
        return self._lua.table_from(items)

    def _protect(self, function: Function) -> Function:
        """Wrap a function for `sandbox.lua`, so that no exception reaches the program, because exceptions are
        Python objects.
        """

        def call(*arguments: Any) -> tuple[Any, ...]:
            try:
                results = function(*arguments)
            except Stopping as exc:
                return False, _bytes(exc), True
            except CobotError as exc:
                self.failure = exc
                return False, _bytes(exc)
            except Exception as exc:  # noqa: BLE001 - reported, as all that goes wrong in here
                return False, HOST_ERROR.format(plain_error(exc)).encode()
            return (True, *results) if isinstance(results, tuple) else (True, results)

        return call


def _bytes(error: Exception) -> bytes:
    """Encode the text of an error for the program. A text from the service may contain characters that UTF-8
    cannot encode.
    """
    return str(error).encode("utf-8", "backslashreplace")


def _message(text: bytes) -> str:
    """The text of an error that ends the program. It is cut off, because it may be as large as the program's
    memory.
    """
    shown = text[:MAX_ERROR_BYTES].decode("utf-8", "replace")
    return shown if len(text) <= MAX_ERROR_BYTES else f"{shown}... ({len(text)} bytes)"


def _nothing(_object: object, name: object, _setting: bool) -> object:
    raise AttributeError(f"no access to {name!r}")


def require_lua(source: bytes, name: str) -> None:
    """Check the syntax of a Lua program without running it.

    Raises:
        InputError: the syntax is invalid; the message names the line.
    """
    try:
        LuaRuntime(encoding=None).compile(source, name=b"@" + name.encode(), mode=b"t")
    except LuaError as exc:
        raise InputError(str(exc)) from exc


def run_apart(work: Callable[[], None], watch: ProgramWatch) -> None:
    """Run a function in a separate thread, so that the main thread can always handle signals.

    An exception of a signal handler ends the program and is raised. A program that does not end is abandoned.

    Raises:
        CobotError: the error that `work` raises.
    """
    problems: list[Exception] = []
    done = threading.Event()

    def do() -> None:
        try:
            work()
        except Stopping:
            pass
        except Exception as exc:  # noqa: BLE001 - raised below
            problems.append(exc)
        finally:
            done.set()

    threading.Thread(target=do, name="lua", daemon=True).start()
    try:
        done.wait()
    except BaseException:
        watch.end("the program was told to end")
        done.wait(END_S)
        raise
    if problems:
        raise problems[0]
