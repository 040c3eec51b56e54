"""Names that clients claim without proof."""

from __future__ import annotations

from cobot.access.roles import ANONYMOUS
from cobot.logs.lines import printable

MAX_NAME = 40
"""Maximum length of a client's own name, in characters."""


def claimed(name: str) -> str:
    """The name that a client without a token gives itself. It is put in quotes, which no token's name
    contains.

    The text is untrusted, so the result is one line of bounded length, without invisible characters.
    """
    text = " ".join(name.split())
    if not text:
        return ANONYMOUS
    return '"{}"'.format(printable(text, MAX_NAME).replace('"', "'"))
