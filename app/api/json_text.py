"""Strict decoding of JSON from clients, with helpful errors."""

from __future__ import annotations

import json
import sys
from typing import Any

from cobot.errors import InputError
from cobot.strict import without_repetition

GZIP = b"\x1f\x8b"
"""The first bytes of gzip data."""


def decoded(text: bytes | str, name: str) -> Any:
    """Decode JSON. A key that occurs twice in one object is an error.

    Raises:
        InputError: the text is not valid JSON. The error states `name`, the problem and its position.
    """
    try:
        return json.loads(
            text, object_pairs_hook=without_repetition, parse_float=_as_float, parse_int=_as_int
        )
    except json.JSONDecodeError as exc:
        raise InputError(f"{name} is not valid JSON: {exc.msg} at character {exc.pos}{_hint(exc)}") from exc
    except UnicodeDecodeError as exc:
        if exc.object.startswith(GZIP):
            raise InputError(f"{name} is compressed with gzip: send it uncompressed") from exc
        byte = exc.object[exc.start]
        raise InputError(
            f"{name} is not {exc.encoding.upper()} text: byte 0x{byte:02x} at position {exc.start}; send it "
            "encoded as UTF-8"
        ) from exc
    except ValueError as exc:
        raise InputError(f"{name}: {exc}") from exc
    except RecursionError as exc:
        raise InputError(f"{name}: nested too deeply") from exc


def _as_float(digits: str) -> float:
    """Convert digits like `float`, but as a Python function, so that other threads can run between two
    numbers. Otherwise decoding a large text would block them for 15 ms per megabyte.
    """
    return float(digits)


def _as_int(digits: str) -> int:
    try:
        return int(digits)
    except ValueError as exc:
        limit = sys.get_int_max_str_digits()
        raise ValueError(f"a whole number has {len(digits)} characters, allowed: {limit}") from exc


def _hint(error: json.JSONDecodeError) -> str:
    """Suggest a correction, depending on the text at the position of the error; "" if there is none."""
    text, place = error.doc, error.doc[error.pos : error.pos + 5]
    if text[:1] == "'":
        return '; the single quotes around it are the shell\'s: in Windows write "{\\"joints\\": ...}"'
    if place[:1] == "'":
        return "; JSON uses double quotes"
    if place[:1] in ("]", "}") and text[: error.pos].rstrip()[-1:] == ",":
        return "; remove the comma before it"
    if place[:2] in ("/*", "//") or place[:1] == "#":
        return "; JSON does not allow comments"
    return "; JSON writes true, false and null" if place[:4] in ("True", "None", "Fals") else ""
