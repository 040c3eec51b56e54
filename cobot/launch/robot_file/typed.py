"""Options as a person types them. Error messages use them in the commands that they suggest."""

from __future__ import annotations

import shlex


def typed(option: str, *values: str) -> str:
    """The option with its values, quoted for a shell.

    A value that begins with a hyphen would be read as an option, so `=` connects it to its option.
    """
    if any(value.startswith("-") for value in values):
        return shlex.join(f"{option}={value}" for value in values)
    return shlex.join([option, *values])
