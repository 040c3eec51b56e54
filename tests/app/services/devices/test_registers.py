"""Variables that clients share. Oracle: a count of characters by hand."""

from __future__ import annotations

import pytest

from app.services.devices.registers import MAX_CHARACTERS, MAX_STRING, Variables
from cobot.errors import LimitError


async def nobody(name: str, action: int) -> None: ...


def test_all_texts_together_are_bounded_and_give_their_room_back() -> None:
    variables = Variables(nobody)
    text = "x" * MAX_STRING
    room = MAX_CHARACTERS // MAX_STRING
    for number in range(room):
        variables.set(f"text {number}", "string", text)
    with pytest.raises(
        LimitError, match=f"would have {MAX_CHARACTERS + 1} characters, allowed: {MAX_CHARACTERS}"
    ):
        variables.set("one more", "string", "x")
    assert variables.kind("one more") == ""
    variables.set("text 0", "string", text)  # in place of itself
    variables.set("a number", "int32", 7)
    variables.set("text 0", "int32", 7)
    variables.remove("text 1")
    for number in range(2):
        variables.set(f"text {number}", "string", text)
    with pytest.raises(LimitError):
        variables.set("one more", "string", "x")
