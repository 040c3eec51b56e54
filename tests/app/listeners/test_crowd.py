"""Who is let in, and who has to go. Oracle: the rules as they stand in the settings' comments, and a simple
list of everybody."""

from __future__ import annotations

import random
from collections.abc import Callable
from functools import partial

import pytest

from app.listeners.crowd import CLOSABLE, EXPIRING, SETTLED_S, TURN_S, Crowd, Doing, Visit

GRACE_S = 0.02


class Guests:
    """Visits of a crowd, and the names of those that it has closed."""

    def __init__(self, places: int, per_address: int, reserve: int) -> None:
        self.crowd = Crowd(places, per_address, reserve)
        self.closed: list[str] = []

    def come(
        self, name: str, address: str = "a", doing: Doing = Doing.ASKING, now_s: float = 0.0
    ) -> Visit | None:
        visit = self.crowd.enter(address, self._closing(name), now_s)
        if visit is not None and doing is not Doing.ASKING:
            self.crowd.note_progress(visit, doing)
        return visit

    def _closing(self, name: str) -> Callable[[], object]:
        return lambda: self.closed.append(name)


def test_a_newcomer_takes_the_place_of_the_oldest_that_has_not_asked_for_anything() -> None:
    guests = Guests(places=3, per_address=3, reserve=1)
    for name in ("first", "second", "third"):
        guests.come(name)
    newcomer = guests.come("fourth")
    assert newcomer is not None
    assert not newcomer.reserved
    assert guests.closed == ["first"]


def test_who_is_served_stays_before_who_sends_before_who_is_idle_before_who_says_nothing() -> None:
    guests = Guests(places=5, per_address=5, reserve=1)
    for doing in (Doing.STREAMING, Doing.SERVED, Doing.SENDING, Doing.IDLE, Doing.ASKING):
        guests.come(doing.name, doing=doing)
    for number in range(3):
        assert guests.come(f"new {number}", doing=Doing.SERVED)
    assert guests.closed == ["ASKING", "IDLE", "SENDING"]


def test_when_all_are_served_the_newcomer_gets_a_place_of_the_reserve_and_then_none() -> None:
    guests = Guests(places=2, per_address=2, reserve=1)
    for name in "ab":
        guests.come(name, doing=Doing.SERVED)
    reserved = guests.come("c", doing=Doing.SERVED)
    assert reserved is not None
    assert reserved.reserved
    assert guests.come("d") is None
    assert guests.closed == []
    guests.crowd.leave(reserved)
    assert guests.come("e") is not None


def test_the_reserve_takes_newcomers_for_its_own_silent_ones() -> None:
    guests = Guests(places=1, per_address=1, reserve=2)
    guests.come("served", doing=Doing.SERVED)
    for name in ("silent", "silent too", "stop"):
        visit = guests.come(name)
        assert visit is not None
        assert visit.reserved
    assert guests.closed == ["silent"]


def test_one_address_cannot_take_the_places_of_the_others() -> None:
    guests = Guests(places=4, per_address=2, reserve=1)
    for name in ("a1", "a2"):
        guests.come(name, "a", Doing.SERVED)
    greedy, other = guests.come("a3", "a"), guests.come("b1", "b")
    assert greedy is not None
    assert other is not None
    assert (greedy.reserved, other.reserved) == (True, False)


def test_the_address_with_most_connections_loses_one() -> None:
    guests = Guests(places=4, per_address=4, reserve=1)
    guests.come("b1", "b")
    for name in ("a1", "a2", "a3"):
        guests.come(name, "a")
    guests.come("c1", "c")
    assert guests.closed == ["a1"]


def test_who_does_not_go_on_in_time_is_told() -> None:
    guests = Guests(places=4, per_address=4, reserve=1)
    slow, quick = guests.come("slow"), guests.come("quick")
    assert slow is not None
    assert quick is not None
    guests.crowd.note_progress(slow, Doing.SENDING, 10.0)
    guests.crowd.note_progress(quick, Doing.SENDING, 20.0)
    assert not guests.crowd.expire(15.0)
    assert guests.closed == ["slow"]


def test_of_many_that_are_late_some_are_told_at_once_and_each_once_the_slowest_to_go_too() -> None:
    guests = Guests(places=50, per_address=50, reserve=1)
    names = [f"late {number}" for number in range(2 * EXPIRING + 1)]
    for name in names:
        visit = guests.come(name)
        assert visit is not None
        guests.crowd.note_progress(visit, Doing.SENDING, 10.0)
    more = [guests.crowd.expire(15.0) for _ in range(4)]
    assert more == [True, True, False, False]
    assert guests.closed == names


def test_who_has_just_come_stays_before_who_has_sent_a_body_for_longer() -> None:
    """Where a flood of slow bodies has all places, and comes again when it is closed, a stop is heard."""
    crowd = Crowd(places=3, per_address=3, reserve=1)
    closed: list[str] = []
    for name in ("sends", "sends too", "sends as well"):
        sending = crowd.enter("a", partial(closed.append, name), 1.0)
        assert sending is not None
        crowd.note_progress(sending, Doing.SENDING)
    crowd.enter("a", partial(closed.append, "stop"), 2.0)
    crowd.enter("a", partial(closed.append, "of the flood"), 2.0 + SETTLED_S / 2)
    assert closed == ["sends", "sends too"]
    crowd.enter("a", partial(closed.append, "of the flood too"), 2.0 + SETTLED_S)
    assert closed == ["sends", "sends too", "stop"], "it has said nothing"


def test_a_health_that_waits_for_its_turn_stays_before_a_flood_of_newcomers_for_some_time() -> None:
    """200 WebSockets came and came again, and each of the five tries of a /health was the oldest of all."""
    guests = Guests(places=3, per_address=3, reserve=1)
    guests.come("health", doing=Doing.WAITING)
    for number in range(100):
        assert guests.come(f"new {number}", now_s=number * TURN_S / 100)
    assert guests.closed == [f"new {number}" for number in range(98)]
    assert guests.come("late", now_s=TURN_S)
    assert guests.closed[98:] == ["health"]


def test_a_flood_of_those_does_not_take_a_stop_its_place() -> None:
    guests = Guests(places=4, per_address=4, reserve=1)
    for number in range(4):
        guests.come(f"health {number}", doing=Doing.WAITING, now_s=0.001 * number)
    guests.come("stop", now_s=0.004)
    for number in range(3):
        guests.come(f"new {number}", doing=Doing.WAITING, now_s=0.005 + 0.001 * number)
    assert guests.closed == [f"health {number}" for number in range(4)]


@pytest.mark.parametrize("seed", range(20))
def test_the_numbers_are_kept_whatever_happens(seed: int) -> None:
    chance = random.Random(seed)
    places, per_address, reserve = chance.randint(1, 9), chance.randint(1, 9), chance.randint(1, 3)
    crowd = Crowd(places, per_address, reserve)
    there: dict[int, tuple[Visit, str]] = {}
    for number in range(2000):
        if there and chance.random() < 0.5:
            key = chance.choice(list(there))
            visit, _ = there[key]
            if chance.random() < 0.3:
                crowd.leave(visit)
                del there[key]
            else:
                crowd.note_progress(visit, chance.choice(list(Doing)))
            continue
        address = chance.choice("abc")
        visit_ = crowd.enter(address, lambda key=number: there.pop(key))
        if visit_ is None:
            assert sum(visit.reserved for visit, _ in there.values()) == reserve
            assert not any(visit.doing in CLOSABLE for visit, _ in there.values() if visit.reserved)
        else:
            there[number] = visit_, address
        assert set(crowd) == {visit for visit, _ in there.values()}, seed
        ordinary = [where for visit, where in there.values() if not visit.reserved]
        assert len(ordinary) <= places
        assert all(ordinary.count(where) <= per_address for where in "abc")
        assert len(there) - len(ordinary) <= reserve


def test_who_has_just_got_the_last_place_of_the_reserve_may_say_what_it_wants() -> None:
    """Else each newcomer of a flood would cost the one before its place, a stop among them."""
    crowd = Crowd(places=1, per_address=1, reserve=1)
    served = crowd.enter("a", lambda: None, 0.0)
    assert served is not None
    crowd.note_progress(served, Doing.SERVED)
    assert not crowd.would_evict_recent(1.0, GRACE_S), "a place of the reserve is free"
    stop = crowd.enter("a", lambda: None, 1.0)
    assert stop is not None
    assert stop.reserved
    assert crowd.would_evict_recent(1.0 + GRACE_S / 2, GRACE_S)
    assert not crowd.would_evict_recent(1.0 + GRACE_S, GRACE_S)
    crowd.note_progress(stop, Doing.SERVED)
    assert not crowd.would_evict_recent(1.0 + GRACE_S / 2, GRACE_S), (
        "it has said it: nobody can take its place"
    )
    crowd.leave(served)
    assert not crowd.would_evict_recent(1.0 + GRACE_S / 2, GRACE_S), "there is room"
