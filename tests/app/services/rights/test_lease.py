"""The control lease by itself, on a clock of the test's.

Oracle: the design of it, written out by hand: who may, until when, and what others are told.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from app.services.clients import RequestClient
from app.services.rights.lease import KEPT_ENDS, ControlLease
from cobot.errors import ConflictError


class Bench:
    """A lease, and the time."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.moving = False
        self.ends = 0
        clock: Any = SimpleNamespace(now_s=lambda: self.now_s)
        self.lease = ControlLease(clock, lambda: self.moving, self._end)

    def _end(self) -> None:
        self.ends += 1


@pytest.fixture
def bench() -> Bench:
    return Bench()


def showing(name: str, token: str) -> RequestClient:
    """Another request of somebody who shows a token."""
    return RequestClient(name, "10.0.0.9", frozenset({token}))


def test_who_has_taken_it_or_shows_its_token_may_move_and_nobody_else(bench: Bench) -> None:
    anna = RequestClient("anna", "10.0.0.1")
    bench.lease.require(RequestClient("ben"))
    token = bench.lease.take(anna, 30.0).token
    bench.lease.require(anna)
    bench.lease.require(showing("anna", token))
    for other in (RequestClient("ben"), RequestClient("anna", "10.0.0.1"), showing("anna", "another")):
        with pytest.raises(ConflictError, match=r"anna from 10\.0\.0\.1 has control .*, for another 30 s"):
            bench.lease.require(other)


def test_it_expires_unless_something_moves(bench: Bench) -> None:
    token = bench.lease.take(RequestClient("anna"), 30.0).token
    bench.now_s += 29.0
    bench.lease.renew()
    bench.now_s += 29.0
    assert bench.lease.holds(showing("anna", token))
    bench.moving = True
    bench.now_s += 1000.0
    assert bench.lease.holds(showing("anna", token))
    bench.moving = False
    assert bench.lease.current is None
    assert bench.ends == 1
    bench.lease.require(RequestClient("ben"))
    with pytest.raises(ConflictError, match="control of anna has expired: nothing has moved for 30 s"):
        bench.lease.require(showing("anna", token))


def test_taking_it_again_renews_it_and_keeps_the_token(bench: Bench) -> None:
    token = bench.lease.take(RequestClient("anna"), 30.0).token
    bench.now_s += 20.0
    again = bench.lease.take(showing("anna", token), 5.0)
    assert (again.token, again.until_s) == (token, bench.now_s + 5.0)
    assert bench.ends == 0


def test_who_has_lost_it_is_told_to_whom_for_as_long_as_it_shows_its_token(bench: Bench) -> None:
    first = bench.lease.take(RequestClient("anna"), 30.0).token
    ben = RequestClient("ben", "10.0.0.2")
    bench.lease.take(ben, 30.0)
    for _ in range(2):
        with pytest.raises(ConflictError, match=r"of anna was taken over by ben from 10\.0\.0\.2"):
            bench.lease.require(showing("anna", first))
    bench.lease.release(ben)
    with pytest.raises(ConflictError, match="taken over by ben"):
        bench.lease.require(showing("anna", first))
    assert bench.ends == 2


def test_only_its_holder_gives_it_back(bench: Bench) -> None:
    token = bench.lease.take(RequestClient("anna"), 30.0).token
    with pytest.raises(ConflictError, match="has control of the robot"):
        bench.lease.release(RequestClient("ben"))
    bench.lease.release(showing("anna", token))
    bench.lease.release(RequestClient("ben"))
    with pytest.raises(ConflictError, match="of anna was released"):
        bench.lease.release(showing("anna", token))


def test_it_ends_with_the_connection_that_has_taken_it(bench: Bench) -> None:
    anna, ben = RequestClient("anna"), RequestClient("ben")
    bench.lease.take(anna, 30.0)
    bench.lease.drop_client(ben)
    assert bench.lease.holds(anna)
    bench.lease.drop_client(anna)
    assert bench.lease.current is None


def test_not_more_than_so_many_ends_are_remembered(bench: Bench) -> None:
    tokens = [bench.lease.take(RequestClient(f"client {n}"), 30.0).token for n in range(KEPT_ENDS + 20)]
    assert len(bench.lease._ends) == KEPT_ENDS
    bench.lease.require_not_lost(showing("client 0", tokens[0]))
    with pytest.raises(ConflictError):
        bench.lease.require_not_lost(showing("client 100", tokens[100]))
