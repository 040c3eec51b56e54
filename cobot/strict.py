"""Reading what others have written: YAML and JSON documents, strictly, with errors that help."""

from __future__ import annotations

import difflib
import reprlib
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from pydantic import BaseModel, ConfigDict, model_validator

SHOWN_CHARACTERS = 80
SHOWN_ERRORS = 10
_BRIEF = reprlib.Repr()  # of a list of a million, only what is shown is written
_BRIEF.maxlist = _BRIEF.maxdict = SHOWN_CHARACTERS
_BRIEF.maxstring = _BRIEF.maxother = 2 * SHOWN_CHARACTERS


class StrictModel(BaseModel):
    """Numbers are numbers, and nothing is unknown."""

    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown(cls, content: Any) -> Any:
        """Pydantic refuses an extra key too, but does not say which ones are valid."""
        if isinstance(content, dict):
            for key in content:
                if key not in cls.model_fields:
                    raise ValueError(unknown_key(str(key), list(cls.model_fields)))
        return content


def unknown_key(name: str, valid: list[str]) -> str:
    """The sentence for a key that nobody knows: what may have been meant, and the valid ones."""
    guess = difflib.get_close_matches(name, valid, 1) if len(name) <= SHOWN_CHARACTERS else []
    hint = f" (did you mean {guess[0]!r}?)" if guess else ""
    return f"unknown key {shown(name)}{hint}; valid are: {', '.join(valid)}"


def sentence(error: Mapping[str, Any], *, ignored: tuple[str, ...] = ()) -> str:
    """One of pydantic's errors as `place: what is wrong, got value`.

    Args:
        ignored: parts of the place that mean nothing to the document's author.
    """
    place = ""
    for part in error["loc"]:
        if part not in ignored:
            place += f"[{part}]" if isinstance(part, int) else f".{_key(part)}" if place else _key(part)
    match error["type"]:
        case "missing":
            return f"{place}: is missing"
        case "value_error":
            text = str(error["ctx"]["error"])
        case _:
            text = f"{error['msg'][:1].lower()}{error['msg'][1:]}, got {shown(error['input'])}"
    return f"{place}: {text}" if place else text


def _key(name: str) -> str:
    """As it stands, unless it is long or acts on a terminal: it may be the client's own."""
    return name if len(name) <= SHOWN_CHARACTERS and name.isprintable() else shown(name)


def sentences(errors: Sequence[Mapping[str, Any]], *, ignored: tuple[str, ...] = ()) -> str:
    """The first of pydantic's errors, and how many more there are."""
    each = dict.fromkeys(sentence(error, ignored=ignored) for error in errors[:SHOWN_ERRORS])
    more = [f"and {len(errors) - SHOWN_ERRORS} more"] if len(errors) > SHOWN_ERRORS else []
    return "; ".join([*each, *more])


def without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """For `json.loads(object_pairs_hook=...)`, which by itself lets a second key win silently.

    Raises:
        ValueError: a key stands twice; where an arm goes must not depend on which one counts.
    """
    content = dict(pairs)
    if len(content) < len(pairs):
        counts = Counter(name for name, _ in pairs)
        twice = next(name for name, count in counts.items() if count > 1)
        raise ValueError(f"the key {shown(twice)} stands twice in one object")
    return content


def shown(value: object) -> str:
    """A value in an error message, cut to a readable length."""
    text = repr(value) if isinstance(value, str) else _BRIEF.repr(value)
    return text if len(text) <= SHOWN_CHARACTERS else text[:SHOWN_CHARACTERS] + "..."
