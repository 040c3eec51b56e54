"""Pages of a list: at most `limit` entries, beginning after the entry `after`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Annotated, Any, TypeVar

from fastapi import Query
from pydantic import BaseModel

from cobot.errors import InputError
from cobot.strict import shown

MAX_LIMIT = 1000
LIMIT = "Maximum number of entries in the response."
AFTER = "Id or name of an entry of an earlier response: the list continues after it."
Limit = Annotated[int | None, Query(ge=1, le=MAX_LIMIT, description=f"{LIMIT} Default: all.")]
After = Annotated[str | None, Query(max_length=200, description=AFTER)]
T = TypeVar("T")


def page_of(entries: Sequence[T], key: Callable[[T], str], limit: int | None, after: str | None) -> list[T]:
    """Return the entries of a page, in the order of the list.

    Args:
        key: id or name of an entry.

    Raises:
        InputError: no entry is called `after`.
    """
    begin = 0
    if after is not None:
        keys = [key(entry) for entry in entries]
        if after not in keys:
            raise InputError(
                f"after: the list has no entry {shown(after)}, which may have been removed; omit `after` to "
                "begin at the top"
            )
        begin = keys.index(after) + 1
    return list(entries[begin:] if limit is None else entries[begin : begin + limit])


def deprecated_value(query: BaseModel, name: str) -> Any:
    """Return the value of a deprecated parameter without pydantic's warning, which is meant for users of the
    class.
    """
    return query.__dict__[name]
