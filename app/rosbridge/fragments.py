"""Messages in fragments, which use rosbridge's operation `fragment`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field

from app.rosbridge.operations import Fragment, Id
from cobot.errors import InputError

MAX_INCOMPLETE = 8
"""Maximum number of incomplete messages of one client. A further message replaces the oldest one."""
PIECE = 100
"""Number of characters added to the length of each fragment, because even an empty fragment takes memory."""


@dataclass(slots=True)
class _Incomplete:
    total: int
    pieces: dict[int, str] = field(default_factory=dict)
    held: int = 0
    """Number of characters that are held, including `PIECE` for each fragment."""


class MessageAssembly:
    """Assembles the fragments of one client's messages, in any order.

    Args:
        limit: maximum number of characters of all incomplete messages together.
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._incomplete: dict[Id, _Incomplete] = {}

    def add(self, fragment: Fragment) -> str | None:
        """Add a fragment. Returns the message if it is complete.

        Raises:
            InputError: the fragment contradicts earlier ones, or the limit is exceeded. The incomplete
                message is dropped.
        """
        known = self._incomplete.setdefault(fragment.id, _Incomplete(fragment.total))
        if known.total != fragment.total or fragment.num >= known.total:
            del self._incomplete[fragment.id]
            raise InputError(
                f"fragment {fragment.num} of {fragment.total} does not fit a message of {known.total}"
            )
        replaced = known.pieces.get(fragment.num)
        known.held += len(fragment.data) + (PIECE if replaced is None else -len(replaced))
        known.pieces[fragment.num] = fragment.data
        if len(known.pieces) == known.total:
            del self._incomplete[fragment.id]
            return "".join(known.pieces[number] for number in range(known.total))
        if sum(each.held for each in self._incomplete.values()) > self._limit:
            del self._incomplete[fragment.id]
            raise InputError(f"incomplete messages hold more than {self._limit} characters")
        if len(self._incomplete) > MAX_INCOMPLETE:
            del self._incomplete[next(iter(self._incomplete))]
            raise InputError(f"more than {MAX_INCOMPLETE} messages are incomplete: the oldest is dropped")
        return None


def in_pieces(text: str, size: int | None, name: str) -> Iterator[str]:
    """Yield a message as it is sent: whole, or in fragments of `size` characters."""
    if size is None or len(text) <= size:
        yield text
        return
    pieces = [text[start : start + size] for start in range(0, len(text), size)]
    for number, piece in enumerate(pieces):
        yield json.dumps({"op": "fragment", "id": name, "data": piece, "num": number, "total": len(pieces)})
