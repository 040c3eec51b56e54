"""Memory that clients, programs and field devices share: numbered registers, named variables and
watchdogs.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

from cobot.errors import InputError, LimitError, NotFoundError
from cobot.strict import shown

COUNT = 128
"""Number of registers of each kind in a bank. They are numbered from 0."""
BANKS = ("input", "output", "register")
KINDS: dict[str, Any] = {"bool": False, "int16": 0, "int32": 0, "float": 0.0, "double": 0.0}
"""The kinds of registers, with the initial value of each."""
MAX_VARIABLES = 10_000
MAX_NAME = 200
MAX_STRING = 65_536
MAX_CHARACTERS = 4 * 2**20
"""Maximum number of characters in all string variables together."""
MAX_WATCHDOGS = 100
WATCHDOG_S = (0.01, 3600.0)
INT16 = 2**15 - 1
FLOAT = struct.Struct("<f")

Value = bool | int | float | str


class Registers:
    """Typed banks of `COUNT` registers. Any client may write them.

    By convention, devices write input registers and read output registers.
    """

    def __init__(self) -> None:
        self._banks = {(kind, bank): [zero] * COUNT for kind, zero in KINDS.items() for bank in BANKS}

    def get(self, kind: str, bank: str, index: int) -> Any:
        """Return the value of a register.

        Raises:
            InputError: there is no such index.
        """
        return self._banks[kind, bank][_checked(index)]

    def set(self, kind: str, bank: str, index: int, value: Any) -> None:
        """Write a register. A float is rounded to four bytes.

        Raises:
            InputError: there is no such index.
            LimitError: the value does not fit.
        """
        _checked(index)
        if kind == "int16" and not -INT16 - 1 <= value <= INT16:
            raise LimitError(f"an int16 register accepts numbers from {-INT16 - 1} to {INT16}, got {value}")
        if kind == "float":
            try:
                (value,) = FLOAT.unpack(FLOAT.pack(value))
            except OverflowError as exc:
                raise LimitError(f"a float register accepts numbers up to ±3.4e38, got {value:g}") from exc
        self._banks[kind, bank][index] = value


def _checked(index: int) -> int:
    if not 0 <= index < COUNT:
        raise InputError(f"index must be from 0 to {COUNT - 1}, got {index}")
    return index


def _require_name(name: str) -> None:
    if not 1 <= len(name) <= MAX_NAME:
        raise InputError(f"a name must be 1 to {MAX_NAME} characters long, got {shown(name)}")


def _length(value: Value) -> int:
    return len(value) if isinstance(value, str) else 0


@dataclass(slots=True)
class Watchdog:
    """A timer that expires unless a client writes the variable of the same name in time.

    Attributes:
        action: number of the action on expiry.
        expired: whether the watchdog has expired. The next write starts it again.
    """

    timeout_s: float
    action: int
    expired: bool = False
    timer: asyncio.TimerHandle | None = field(default=None, repr=False)


class Variables:
    """The named variables and their watchdogs.

    Args:
        on_expiry: function that is called with the name and the action of a watchdog that has expired.
    """

    def __init__(self, on_expiry: Callable[[str, int], Awaitable[None]]) -> None:
        self._on_expiry = on_expiry
        self._values: dict[str, tuple[str, Value]] = {}
        self._characters = 0
        self._watchdogs: dict[str, Watchdog] = {}
        self._tasks: set[asyncio.Task[None]] = set()

    def set(self, name: str, kind: str, value: Value) -> None:
        """Write a variable, regardless of its previous type.

        Raises:
            InputError: the name or the value is too long, or there are too many variables.
        """
        _require_name(name)
        if isinstance(value, str) and len(value) > MAX_STRING:
            raise LimitError(f"a variable accepts up to {MAX_STRING} characters, got {len(value)}")
        if name not in self._values and len(self._values) >= MAX_VARIABLES:
            raise LimitError(f"there are already {MAX_VARIABLES} variables, which is the maximum")
        characters = self._characters + _length(value) - _length(self._values.get(name, ("", 0))[1])
        if isinstance(value, str) and characters > MAX_CHARACTERS:
            raise LimitError(
                f"all variables together would have {characters} characters, allowed: {MAX_CHARACTERS}"
            )
        self._characters = characters
        self._values[name] = kind, value
        self._restart_timer(name)

    def get(self, name: str, kind: str, default: Any) -> Any:
        """Return the value of a variable, or the default if there is no such variable.

        Raises:
            InputError: the variable is of a different type.
        """
        if name not in self._values:
            return default
        found, value = self._values[name]
        if found != kind:
            raise InputError(f"the variable {shown(name)} is a {found}, not a {kind}")
        return value

    def kind(self, name: str) -> str:
        """Return the type of a variable; "" if there is no such variable."""
        return self._values[name][0] if name in self._values else ""

    def names(self) -> list[str]:
        return sorted(self._values)

    def remove(self, name: str) -> None:
        """Delete a variable.

        Raises:
            NotFoundError: there is no variable with this name.
        """
        found = self._values.pop(name, None)
        if found is None:
            raise NotFoundError(f"there is no variable {shown(name)}")
        self._characters -= _length(found[1])

    def watchdog(self, name: str) -> Watchdog | None:
        return self._watchdogs.get(name)

    def watch(self, name: str, timeout_s: float, action: int) -> None:
        """Start a watchdog, which executes an action if the variable is not written for `timeout_s`. A
        timeout of 0 s deletes the watchdog.

        Raises:
            InputError: the name is too long.
            LimitError: the time is out of bounds, or there are too many watchdogs.
        """
        _require_name(name)
        shortest, longest = WATCHDOG_S
        if timeout_s and not shortest <= timeout_s <= longest:
            raise LimitError(
                f"a watchdog's timeout must be from {shortest} to {longest:g} s, got {timeout_s:g}"
            )
        if name not in self._watchdogs and len(self._watchdogs) >= MAX_WATCHDOGS:
            raise LimitError(f"there are already {MAX_WATCHDOGS} watchdogs, which is the maximum")
        old = self._watchdogs.pop(name, None)
        if old is not None and old.timer is not None:
            old.timer.cancel()
        if timeout_s:
            self._watchdogs[name] = Watchdog(timeout_s, action)
            self._restart_timer(name)

    def close(self) -> None:
        for dog in self._watchdogs.values():
            if dog.timer is not None:
                dog.timer.cancel()

    def _restart_timer(self, name: str) -> None:
        dog = self._watchdogs.get(name)
        if dog is None:
            return
        if dog.timer is not None:
            dog.timer.cancel()
        dog.expired = False
        dog.timer = asyncio.get_running_loop().call_later(dog.timeout_s, self._expire, name)

    def _expire(self, name: str) -> None:
        dog = self._watchdogs[name]
        dog.expired = True
        task = asyncio.ensure_future(self._on_expiry(name, dog.action))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
