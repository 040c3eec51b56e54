"""Names in requests: ids, which are used in URLs and programs, and labels for people."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from cobot.strict import shown


def _require_printable(text: str) -> str:
    if not text.isprintable() or not text.strip():
        raise ValueError(f"{shown(text)} has invisible characters, or no visible characters")
    return text.strip()


Name = Annotated[
    str,
    Field(pattern=r"^[A-Za-z0-9_.-]{1,64}$", description="Letters, digits, and _ . -; at most 64."),
]
Label = Annotated[
    str,
    Field(min_length=1, max_length=100, description="Displayed name."),
    AfterValidator(_require_printable),
]
