"""ROS messages as dicts and as CDR. The types are defined by ROS 2 Humble and by this project."""

from __future__ import annotations

import base64
import re
from collections.abc import Iterator, Mapping
from typing import Any, cast

from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.base import TypesysError, normalize_fieldname

from cobot.errors import InputError
from cobot.ros.codec import HIDDEN, OCTETS, CheckedMessage, FieldCodec, ListField, Octets, Record, Scalar
from cobot.ros.interfaces import DEFAULTS, STANDARD, message_names, parsed
from cobot.strict import shown

Message = dict[str, Any]
_LATEST_NS = (2**31 - 1) * 1_000_000_000
_SHORT = re.compile(r"([a-z][a-z0-9_]*)/([A-Za-z][A-Za-z0-9_]*)")


def ros_time(wall_ns: int) -> Message:
    """A time as builtin_interfaces/Time. This type ends in 2038, so later times are clipped."""
    sec, nanosec = divmod(min(wall_ns, _LATEST_NS), 1_000_000_000)
    return {"sec": sec, "nanosec": nanosec}


class Messages:
    """The message types and operations on their messages. Not thread safe while types are added.

    Args:
        definitions: texts by the names of the types, such as `aubo_interfaces/srv/GetDof`.

    Attributes:
        definitions: the given texts, without the standard types.

    Raises:
        InputError: a text is invalid.
    """

    def __init__(self, definitions: Mapping[str, str] | None = None) -> None:
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        self._defaults = dict(DEFAULTS)
        self._records: dict[str, Record] = {}
        self._promised: dict[str, str] = {}  # for each message, the definition to which it belongs
        self._texts: dict[str, str] = {}  # texts of these definitions
        self.definitions: dict[str, str] = {}
        self._add_lazily(STANDARD)
        self.add(definitions or {})

    def add(self, definitions: Mapping[str, str]) -> None:
        """Add types.

        Raises:
            InputError: a text is invalid, uses an unknown type, or differs from the known type with the same
                name.
        """
        self._register({n: text for n, text in definitions.items() if self.definitions.get(n) != text})
        self.definitions |= definitions

    def add_lazily(self, definitions: Mapping[str, str]) -> None:
        """Add types whose definitions are valid. Each definition is parsed when it is first needed.

        The vendor's 300 services take half a second to parse, and few are ever called.
        """
        self._add_lazily(definitions)
        self.definitions |= definitions

    def has_service(self, name: str) -> bool:
        return f"{name}_Request" in self

    def __contains__(self, name: str) -> bool:
        return name in self._store.fielddefs or name in self._promised

    def __iter__(self) -> Iterator[str]:
        return iter([*self._store.fielddefs, *self._promised])

    def resolved(self, name: str, kind: str) -> str:
        """The full name of an existing type; `std_msgs/String` means `std_msgs/msg/String`.

        Args:
            kind: msg, srv or action.

        Raises:
            InputError: the type is unknown.
        """
        short = _SHORT.fullmatch(name)
        if short:
            name = f"{short[1]}/{kind}/{short[2]}"
        known = (
            name in self if kind == "msg" else f"{name}_{'Goal' if kind == 'action' else 'Request'}" in self
        )
        if not known:
            raise InputError(f"there is no type {shown(name)} here")
        return name

    def default(self, name: str) -> Message:
        """A message whose fields all have ROS's default values."""
        return self.record(name).default()

    def checked(self, name: str, message: Any) -> Message:
        """The message after checking. Missing fields have ROS's defaults.

        Raises:
            InputError: the message is invalid; the message names the location and the problem.
        """
        try:
            return self.record(name).check(message, "")
        except InputError as exc:
            raise InputError(f"{name}: {exc}") from exc

    def examine(self, name: str, message: Any) -> CheckedMessage:
        """Check a message without blocking the event loop. Checking a large message takes seconds, so another
        thread does it.

        Raises:
            InputError: the type is unknown. `checked` raises errors about the message.
        """
        return CheckedMessage(self.record(name), message)

    def to_cdr(self, name: str, message: Message) -> bytes:
        """Convert a message to little-endian CDR with its header of 4 bytes.

        Raises:
            InputError: see `checked`.
        """
        native = self.record(name).to_native(self.checked(name, message))
        return bytes(self._store.serialize_cdr(native, name, little_endian=True))

    def from_cdr(self, name: str, content: bytes) -> Message:
        """Read and check a message in CDR of either byte order.

        Raises:
            InputError: the content cannot be read.
        """
        record = self.record(name)
        try:
            native = self._store.deserialize_cdr(content, name)
        except (SerdeError, IndexError, ValueError, OverflowError) as exc:
            raise InputError(f"{name}: is not readable as CDR: {exc}") from exc
        return record.from_native(native)

    def octets(self, value: str) -> bytes:
        """The bytes of a checked uint8[] value."""
        return base64.b64decode(value)

    def type_hash(self, name: str) -> str:
        """The RIHS01 hash of a message type, as in ROS 2 since Iron (REP 2016)."""
        self.record(name)
        return str(self._store.hash_rihs01(name))

    def constants(self, name: str) -> list[tuple[str, str, Any]]:
        """Name, type and value of each of a message's constants."""
        self.record(name)
        return list(cast(Any, self._store.fielddefs[name][0]))

    def fields(self, name: str) -> list[tuple[str, str, int]]:
        """Name, type and length of each field. The length is -1 for a single value, and 0 for any number of
        values.
        """
        self.record(name)
        made = []
        for field, (kind, rest) in cast(Any, self._store.fielddefs[name][1]):
            if field != HIDDEN:
                item, size = rest if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else ((kind, rest), -1)
                made.append((field, item[1] if item[0] == Nodetype.NAME else item[1][0], size))
        return made

    def record(self, name: str) -> Record:
        """The converter of a message type.

        Raises:
            InputError: the type is unknown.
        """
        made = self._records.get(name)
        if made is None:
            self._parse_once(name)
            definition = self._store.fielddefs.get(name)
            if definition is None:
                raise InputError(f"there is no type {shown(name)} here")
            defaults = self._defaults.get(name, {})
            fields = {
                field: (normalize_fieldname(field), self._field(description, defaults.get(field)))
                for field, description in definition[1]
                if field != HIDDEN
            }
            made = self._records[name] = Record(name, self._store.types[name], fields)
        return made

    def _field(self, description: Any, default: Any) -> FieldCodec:
        kind, rest = description
        if kind == Nodetype.BASE:
            return cast(FieldCodec, Scalar(rest[0], rest[1], default))
        if kind == Nodetype.NAME:
            return self.record(rest)
        item, length = rest
        size, bound = (length, 0) if kind == Nodetype.ARRAY else (None, length)
        if item[0] == Nodetype.BASE and item[1][0] in OCTETS and default is None:
            return Octets(size, bound)
        return ListField(self._field(item, None), size, bound, default)

    def _add_lazily(self, definitions: Mapping[str, str]) -> None:
        for name, text in definitions.items():
            self._texts[name] = text
            self._promised |= dict.fromkeys(message_names(name), name)

    def _parse_once(self, message: str) -> None:
        """Parse the definition of a message if that has not been done yet."""
        if (name := self._promised.get(message)) is not None:
            for each in message_names(name):
                self._promised.pop(each, None)
            self._register({name: self._texts.pop(name)})

    def _register(self, definitions: Mapping[str, str]) -> None:
        messages = [message for name, text in definitions.items() for message in parsed(name, text)]
        for message in messages:
            self._parse_once(message.name)
        new = {message.name: message for message in messages}
        for message in messages:
            for _, description in message.fields:
                self._require_known(message.name, description, new)
        types = {message.name: (message.constants, message.fields) for message in messages}
        try:
            if types:
                self._store.register(cast(Any, types))
        except TypesysError as exc:
            raise InputError(str(exc)) from exc
        self._defaults |= {message.name: message.defaults for message in messages if message.defaults}

    def _require_known(self, name: str, description: Any, new: Mapping[str, Any]) -> None:
        kind, rest = description
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            self._require_known(name, rest[0], new)
        elif kind == Nodetype.NAME and rest not in new and rest not in self:
            raise InputError(f"{name}: there is no type {shown(rest)} here")
