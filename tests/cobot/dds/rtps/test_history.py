"""What a writer keeps. Oracle: a plain list with the same rules, written down by hand."""

from __future__ import annotations

import random
from dataclasses import replace

from cobot.dds.rtps.history import Change, History
from cobot.dds.rtps.types import ParticipantLimits

SEED = 20261122
LIMITS = ParticipantLimits()


def change(sequence: int, size: int = 10, key: bytes | None = None) -> Change:
    return Change(sequence, bytes(size), b"", 0.0, key=key)


def numbers(history: History) -> list[int]:
    return [each.sequence for each in history]


def test_a_depth_keeps_the_newest() -> None:
    history = History(3, LIMITS)
    assert [history.add(change(n)) for n in range(1, 6)] == [0, 0, 0, 1, 1]
    assert numbers(history) == [3, 4, 5]
    assert history.first(9) == 3
    assert 2 not in history
    assert History(3, LIMITS).first(9) == 9


def test_too_many_bytes_push_out_the_oldest_but_never_the_newest() -> None:
    history = History(None, replace(LIMITS, history=25))
    assert [history.add(change(n)) for n in (1, 2, 3)] == [0, 0, 1]
    assert numbers(history) == [2, 3]
    assert history.add(change(4, 1000)) == 2
    assert numbers(history) == [4]


def test_a_later_change_of_a_key_replaces_the_one_before() -> None:
    history = History(None, LIMITS)
    for sequence, key in enumerate([b"a", b"b", b"a", b"a"], start=1):
        assert history.add(change(sequence, key=key)) == 0
    assert numbers(history) == [2, 4]
    history.remove([4])
    history.add(change(5, key=b"a"))
    assert numbers(history) == [2, 5]


def test_random_changes_are_kept_as_a_list_keeps_them() -> None:
    dice = random.Random(SEED)
    for _ in range(300):
        depth, most_bytes = dice.randrange(1, 6), dice.randrange(1, 60)
        history = History(depth, replace(LIMITS, history=most_bytes))
        kept: list[Change] = []
        for sequence in range(1, 40):
            made = change(sequence, dice.randrange(30), dice.choice([None, b"a", b"b"]))
            history.add(made)
            kept = [each for each in kept if made.key is None or each.key != made.key] + [made]
            while len(kept) > depth or (
                sum(len(each.payload) for each in kept) > most_bytes and len(kept) > 1
            ):
                del kept[0]
            assert list(history) == kept
            if dice.random() < 0.1:
                history.remove([kept.pop(0).sequence])
