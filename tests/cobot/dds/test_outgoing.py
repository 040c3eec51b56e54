"""What waits for the connection. Oracle: the order and the sizes of what the test has put in."""

from __future__ import annotations

import pytest

from cobot.dds import outgoing
from cobot.dds.outgoing import Outgoing


def taken(waiting: Outgoing) -> list[str]:
    texts = []
    while (text := waiting.next()) is not None:
        texts.append(text)
    return texts


def test_senders_take_turns_and_each_keeps_its_order() -> None:
    waiting = Outgoing()
    for number in range(100):
        assert waiting.put("/flood", f"flood {number}")
    assert waiting.put("/quiet", "quiet 0")
    assert waiting.put("/quiet", "quiet 1")
    texts = taken(waiting)
    assert texts.index("quiet 0") <= 1
    assert texts.index("quiet 1") <= 3
    assert [text for text in texts if text.startswith("flood")] == [f"flood {n}" for n in range(100)]
    assert waiting.next() is None


def test_however_many_senders_flood_there_is_room_for_another(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outgoing, "MAX_CHARACTERS", 100_000)
    waiting = Outgoing()
    for sender in range(20):
        count = 0
        while waiting.put(f"/flood{sender}", "x" * 10):
            count += 1
        assert count > 0
        assert waiting.put("/quiet", "a")
    assert sum(map(len, taken(waiting))) <= 100_000
    assert waiting.put("/flood0", "x" * 10)  # there is room again


def test_one_sender_may_hold_a_fifth_of_the_room_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outgoing, "MAX_CHARACTERS", 1000)
    waiting = Outgoing()
    assert not waiting.put("/a", "x" * 251)
    assert waiting.put("/a", "x" * 200)
    assert not waiting.put("/a", "x")
    waiting.clear()
    assert waiting.put("/a", "x" * 250)


def test_messages_of_one_sender_are_counted_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(outgoing, "MAX_MESSAGES", 5)
    waiting = Outgoing()
    assert [waiting.put("/a", "") for _ in range(6)] == [True] * 5 + [False]
    assert waiting.put("/b", "")
