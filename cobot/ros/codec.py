"""Converts ROS message fields between three forms: JSON as in rosbridge v2, checked values, and the native
values of `rosbags`.

In JSON, a message is an object, a list is a list, uint8[] and char[] are base64 (lists are also accepted),
and NaN and infinity are null. As in REST bodies (`cobot.loose_lists`), the brackets of a list with one item
may be missing, and `[]` in place of a single value or an object is treated as a missing field. Checked values
are
complete: every field exists, is in range, and has the right type.
"""

from __future__ import annotations

import base64
import binascii
import contextlib
import math
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from cobot.errors import InputError
from cobot.strict import shown, unknown_key

HIDDEN = "structure_needs_at_least_one_member"
"""The only field of an empty message on the wire. ROS 2's generators add it."""
OCTETS = frozenset({"uint8", "char"})
INTEGERS = {
    "byte": (0, 255),
    "octet": (0, 255),
    "char": (0, 255),
    **{f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
ROS1_TIMES = {"secs": "sec", "nsecs": "nanosec"}
"""Names of the fields of a time in ROS 1, which roslibpy uses, and their names in ROS 2."""
_DTYPES = {"bool": "bool", "byte": "uint8", "octet": "uint8", "char": "uint8"}
BARE: dict[str, tuple[type, ...]] = {"bool": (bool,), "string": (str,), "wstring": (str,)}
"""Python types of a single item that may replace a list with one item. Items of all other types are
numbers.
"""
_MAX_FLOAT32 = float(np.finfo(np.float32).max)


class FieldCodec(Protocol):
    """Interface for one kind of field."""

    def default(self) -> Any:
        """ROS's default for this field."""
        ...

    def check(self, value: Any, path: str) -> Any:
        """Check a value and complete it with defaults.

        Args:
            path: location of the value, for errors.

        Raises:
            InputError: the value is invalid.
        """
        ...

    def to_native(self, value: Any) -> Any:
        """Convert a checked value to a native value."""
        ...

    def from_native(self, value: Any) -> Any:
        """Convert a native value to a checked value."""
        ...


class Scalar:
    """A field with a number, a string or a boolean. `bound` is the maximum length of a string in bytes; 0
    means any length.
    """

    def __init__(self, name: str, bound: int = 0, default: Any = None) -> None:
        self.name = name
        self._bound = bound
        self.check: Callable[[Any, str], Any]
        match name:
            case "bool":
                self.check = _truth
            case "string" | "wstring":
                self.check = self._text
            case "float32":
                self.check = _single
            case "float64":
                self.check = _double
            case _:
                self.check = self._integer
                self._low, self._high = INTEGERS[name]
        self._default = _zero(name) if default is None else self.check(default, "default")

    def default(self) -> Any:
        return self._default

    def to_native(self, value: Any) -> Any:
        return value

    def from_native(self, value: Any) -> Any:
        return value

    def _integer(self, value: Any, path: str) -> int:
        if isinstance(value, float) and value.is_integer():
            value = int(value)  # some languages have only floating-point numbers
        if isinstance(value, bool) or not isinstance(value, int):
            raise InputError(f"{path}: must be an integer, got {shown(value)}")
        if not self._low <= value <= self._high:
            raise InputError(
                f"{path}: {self.name} must be from {self._low} to {self._high}, got {shown(value)}"
            )
        return int(value)  # it may be an enumeration

    def _text(self, value: Any, path: str) -> str:
        if not isinstance(value, str):
            raise InputError(f"{path}: must be a string, got {shown(value)}")
        if self._bound or not value.isascii():
            try:
                length = len(value.encode())
            except UnicodeEncodeError as exc:
                raise InputError(f"{path}: is not valid Unicode: {exc.reason}") from exc
            if self._bound and length > self._bound:
                raise InputError(f"{path}: has {length} bytes, allowed: {self._bound}")
        return value


class ListField:
    """A field with a list of `size` items. If `size` is None, it is a list of up to `bound` items; 0 means
    any number.
    """

    def __init__(self, item: FieldCodec, size: int | None, bound: int, default: Any = None) -> None:
        self._item = item
        self._size = size
        self._bound = bound
        self._floats = isinstance(item, Scalar) and item.name == "float64"
        name = item.name if isinstance(item, Scalar) else "string"
        self._dtype = None if name.endswith("string") else np.dtype(_DTYPES.get(name, name))
        self._bare: tuple[type, ...] = (
            (dict,) if not isinstance(item, Scalar) else BARE.get(name, (int, float))
        )
        self._default = None if default is None else self.check(default, "default")

    def default(self) -> list[Any]:
        if self._default is not None:
            return list(self._default)
        return [self._item.default() for _ in range(self._size or 0)]

    def check(self, value: Any, path: str) -> list[Any]:
        if not isinstance(value, list):
            if type(value) not in self._bare:
                raise InputError(f"{path}: must be a list, got {shown(value)}")
            value = [value]
        _check_length(len(value), self._size, self._bound, path)
        if self._floats and (kinds := set(map(type, value))) <= {float, int}:  # usual, and much faster
            with contextlib.suppress(OverflowError):
                return value if int not in kinds else list(map(float, value))
        check = self._item.check
        return [check(item, f"{path}[{index}]") for index, item in enumerate(value)]

    def to_native(self, value: list[Any]) -> Any:
        if self._dtype is not None:
            return np.array(value, self._dtype)
        return [self._item.to_native(item) for item in value]

    def from_native(self, value: Any) -> list[Any]:
        if self._dtype is not None:
            return list(value.tolist())
        return [self._item.from_native(item) for item in value]


class Octets:
    """A field of type uint8[] or char[], which is base64 in JSON."""

    def __init__(self, size: int | None, bound: int) -> None:
        self._size = size
        self._bound = bound

    def default(self) -> str:
        return _base64(bytes(self._size or 0))

    def check(self, value: Any, path: str) -> str:
        if isinstance(value, list):
            octet = Scalar("uint8")
            content = bytes(octet.check(item, f"{path}[{index}]") for index, item in enumerate(value))
        else:
            try:
                content = base64.b64decode(value, validate=True)
            except (TypeError, ValueError, binascii.Error) as exc:
                raise InputError(
                    f"{path}: must be base64, or a list of integers from 0 to 255, got {shown(value)}"
                ) from exc
        _check_length(len(content), self._size, self._bound, path)
        return _base64(content)

    def to_native(self, value: str) -> Any:
        return np.frombuffer(base64.b64decode(value), np.uint8)

    def from_native(self, value: Any) -> str:
        return _base64(value.tobytes())


class CheckedMessage(dict[str, Any]):
    """A message that another thread has already checked. It is the result of `Record.check`, or the error."""

    __slots__ = ("name", "problem")

    def __init__(self, record: Record, value: Any) -> None:
        self.name = record.name
        self.problem: InputError | None = None
        try:
            super().__init__(record.check(value, ""))
        except InputError as exc:
            self.problem = exc


class Record:
    """A message.

    Args:
        make: creates the native message.
        fields: for each name, the name of the native attribute and the field.
    """

    def __init__(
        self, name: str, make: Callable[..., Any], fields: dict[str, tuple[str, FieldCodec]]
    ) -> None:
        self.name = name
        self._make = make
        self.fields = fields

    def default(self) -> dict[str, Any]:
        return {name: item.default() for name, (_, item) in self.fields.items()}

    def check(self, value: Any, path: str) -> dict[str, Any]:
        if isinstance(value, CheckedMessage) and value.name == self.name:
            if value.problem is not None:
                raise value.problem
            return value
        if not isinstance(value, dict):
            if value != []:
                raise InputError(f"{path}{': ' if path else ''}must be an object, got {shown(value)}")
            value = {}
        fields = self.fields
        if self.name in TIMES and not value.keys().isdisjoint(ROS1_TIMES):
            value = {ROS1_TIMES.get(name, name): item for name, item in value.items()}
        if not value.keys() <= fields.keys():
            name = next(str(key) for key in value if key not in fields)
            raise InputError(f"{path}{': ' if path else ''}{unknown_key(name, list(fields))}")
        below = f"{path}." if path else ""
        return {
            name: item.check(value[name], below + name) if _is_given(value, name, item) else item.default()
            for name, (_, item) in fields.items()
        }

    def to_native(self, value: dict[str, Any]) -> Any:
        fields = self.fields.items()
        return self._make(**{native: item.to_native(value[name]) for name, (native, item) in fields})

    def from_native(self, value: Any) -> dict[str, Any]:
        fields = self.fields.items()
        return {name: item.from_native(getattr(value, native)) for name, (native, item) in fields}


def without_nan(value: Any) -> Any:
    """A copy of a value for JSON. Numbers that are not finite become null."""
    if isinstance(value, dict):
        return {name: without_nan(item) for name, item in value.items()}
    if isinstance(value, list):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _is_given(message: dict[str, Any], name: str, field: FieldCodec) -> bool:
    """Whether a message gives this field a value. For a single value, `[]` is treated as a missing field."""
    return name in message and not (isinstance(field, Scalar) and message[name] == [])


def _zero(name: str) -> Any:
    if name.endswith("string"):
        return ""
    return False if name == "bool" else 0.0 if name.startswith("float") else 0


def _truth(value: Any, path: str) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{path}: must be true or false, got {shown(value)}")
    return value


def _double(value: Any, path: str) -> float:
    if value is None:
        return math.nan
    if type(value) is int and abs(value) < 2**1023:
        return float(value)
    if type(value) is not float:
        raise InputError(f"{path}: must be a number, got {shown(value)}")
    return value


def _single(value: Any, path: str) -> float:
    number = _double(value, path)
    if math.isfinite(number) and abs(number) > _MAX_FLOAT32:
        raise InputError(f"{path}: float32 must be up to {_MAX_FLOAT32:.7g}, got {shown(value)}")
    return number


def _check_length(length: int, size: int | None, bound: int, path: str) -> None:
    if size is not None and length != size:
        raise InputError(f"{path}: must have {size} items, got {length}")
    if bound and length > bound:
        raise InputError(f"{path}: must have no more than {bound} items, got {length}")


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode()
