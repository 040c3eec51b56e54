"""Messages in pieces. Oracle: the whole text; the pieces in random order, as rosbridge v2 describes them."""

from __future__ import annotations

import json
import random

import pytest

from app.rosbridge.fragments import MAX_INCOMPLETE, PIECE, MessageAssembly, in_pieces
from app.rosbridge.operations import Fragment
from cobot.errors import InputError

SEED = 20261122


def fragment(num: int, total: int, data: str = "x", name: str = "a") -> Fragment:
    return Fragment(op="fragment", id=name, data=data, num=num, total=total)


def test_any_text_comes_back_from_its_pieces_in_any_order() -> None:
    dice = random.Random(SEED)
    for _ in range(300):
        text = "".join(dice.choice('aé{"\\\n😀') for _ in range(dice.randrange(80)))
        size = dice.randrange(1, 30)
        sent = list(in_pieces(text, size, "name"))
        if len(text) <= size:
            assert sent == [text]
            continue
        pieces = [Fragment.model_validate(json.loads(piece)) for piece in sent]
        assert all(len(piece.data) <= size for piece in pieces)
        dice.shuffle(pieces)
        assembly = MessageAssembly(10**6)
        found = [assembly.add(piece) for piece in [*pieces[:-1], pieces[0], pieces[-1]]]
        assert found == [None] * (len(found) - 1) + [text]
    assert list(in_pieces("x" * 1000, None, "name")) == ["x" * 1000]


def test_a_piece_that_contradicts_those_before_it_ends_the_message() -> None:
    assembly = MessageAssembly(10**6)
    for wrong in (fragment(1, 3), fragment(2, 2)):
        assembly.add(fragment(0, 2))
        with pytest.raises(InputError, match="does not fit a message of 2"):
            assembly.add(wrong)
    assert assembly.add(fragment(1, 2)) is None  # nothing is left of the first ones


def test_what_is_held_is_bounded() -> None:
    assembly = MessageAssembly(3 * PIECE)
    assembly.add(fragment(0, 9, ""))
    assembly.add(fragment(1, 9, ""))
    with pytest.raises(InputError, match=f"incomplete messages hold more than {3 * PIECE} characters"):
        assembly.add(fragment(2, 9, "x" * PIECE))
    crowded = MessageAssembly(10**6)
    for number in range(MAX_INCOMPLETE):
        crowded.add(fragment(0, 2, name=str(number)))
    with pytest.raises(InputError, match=f"more than {MAX_INCOMPLETE} messages are incomplete"):
        crowded.add(fragment(0, 2, name="one more"))
    assert crowded.add(fragment(1, 2, "y", name="1")) == "xy"  # only the oldest is forgotten
