"""What repeats itself is counted."""

from __future__ import annotations

from cobot.logs.repeats import MAX_KINDS, Repeats


class Clock:
    now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def test_so_many_pass_and_the_others_are_counted() -> None:
    clock = Clock()
    repeats = Repeats[str](3, 10.0, clock)
    assert [repeats.passes("a", f"line {n}") for n in range(10)] == [True] * 3 + [False] * 7
    assert repeats.passes("b", "another"), "kinds do not count together"
    assert repeats.summary() == []
    clock.now_s = 10.0
    assert repeats.summary() == [("line 9", 7)]
    assert repeats.summary() == []


def test_what_never_ends_is_summarised_in_each_interval() -> None:
    clock = Clock()
    repeats = Repeats[int](5, 1.0, clock)
    passed = counted = 0
    for n in range(1000):
        clock.now_s = n * 0.01
        passed += repeats.passes("a", n)
        counted += sum(count for _, count in repeats.summary())
    counted += sum(count for _, count in repeats.summary(all_of_them=True))
    assert passed + counted == 1000
    assert passed == 5
    clock.now_s += 3.0
    repeats.summary()
    assert repeats.passes("a", 0), "after a pause it is news again"


def test_nobody_fills_the_memory_with_kinds() -> None:
    clock = Clock()
    repeats = Repeats[int](1, 1.0, clock)
    passed = sum(repeats.passes(n, n) for n in range(10 * MAX_KINDS))
    assert MAX_KINDS <= passed <= MAX_KINDS + 1
    assert repeats.held_back
    (_, count) = repeats.summary(all_of_them=True)[0]
    assert passed + count == 10 * MAX_KINDS
    clock.now_s = 5.0
    assert repeats.passes("new", 0)
