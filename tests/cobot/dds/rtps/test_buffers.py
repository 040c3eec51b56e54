"""What a participant keeps, and that nobody can make it keep more; the oracle is plain lists."""

from __future__ import annotations

import random

import pytest

from cobot.dds.rtps import MalformedError, ParticipantLimits, ParticipantStatistics
from cobot.dds.rtps.history import Change, History
from cobot.dds.rtps.inbound import Inbound
from cobot.dds.rtps.reassembly import SampleAssembly
from cobot.dds.rtps.submessages import DataFragment
from cobot.dds.rtps.writer_proxy import Arrival, WriterProxy

SMALL = ParticipantLimits(payload=1000, buffered_per_writer=2000, buffered=5000, window=50)


def proxy_with(inbound: Inbound, number: int = 0, *, reliable: bool = True) -> WriterProxy:
    guid = number.to_bytes(12, "big") + b"\0\0\1\3"
    made = WriterProxy(inbound, b"", b"\0\0\1\4", guid, ("127.0.0.1", 1), 0, reliable=reliable)
    made.heard = True
    return made


@pytest.fixture
def inbound() -> Inbound:
    return Inbound(SMALL, ParticipantStatistics())


def arrival(payload: bytes = b"") -> Arrival:
    return Arrival(payload, None, None, None, 0)


def accepted(proxy: WriterProxy, sequence: int, size: int = 0) -> list[int]:
    if not proxy.expects(sequence):
        return []
    return [number for number, _ in proxy.accept(sequence, arrival(bytes(size)))]


def test_samples_are_delivered_once_each_and_in_order_whatever_the_order_of_arrival(inbound: Inbound) -> None:
    for seed in range(50):
        proxy = proxy_with(inbound, seed)
        order = list(range(1, 41)) * 2
        random.Random(seed).shuffle(order)
        delivered = [number for sequence in order for number in accepted(proxy, sequence)]
        assert delivered == list(range(1, 41))
    assert inbound.used == 0


def test_gaps_and_samples_together_deliver_what_is_not_in_a_gap(inbound: Inbound) -> None:
    for seed in range(50):
        chance = random.Random(seed)
        gone = {number for number in range(1, 41) if chance.random() < 0.4}
        events = list(range(1, 41))
        chance.shuffle(events)
        proxy = proxy_with(inbound, seed)
        delivered = []
        for number in events:
            if number in gone:
                proxy.skip(number, number + 1, [])
                delivered += [ready for ready, _ in proxy.drain()]
            else:
                delivered += accepted(proxy, number)
        assert delivered == [number for number in range(1, 41) if number not in gone]


def test_a_gap_over_more_numbers_than_can_be_counted_is_one_step(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    proxy.skip(1, 1 << 62, [])
    assert list(proxy.drain()) == []
    assert proxy.next == 1 << 62


def test_a_heartbeat_of_more_samples_than_can_be_counted_asks_for_256(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    proxy.announce(1 << 62)
    assert len(proxy._missing()) == 256


def test_endless_scattered_gaps_take_no_memory(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    for start in range(10, 100_000, 2):
        proxy.skip(start, start + 1, [])
    assert len(proxy._gaps) <= 64


def test_samples_too_far_ahead_are_not_kept(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    for sequence in range(2, 10_000):
        accepted(proxy, sequence)
    assert max(proxy._pending) == SMALL.window


def test_one_writer_cannot_take_more_than_its_share(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    for sequence in range(2, 20):
        accepted(proxy, sequence, 300)
    assert inbound.used == proxy.held == 1800
    assert inbound.statistics.refused == 12


def test_when_all_is_taken_who_holds_most_loses_it(inbound: Inbound) -> None:
    greedy, modest = proxy_with(inbound, 1), [proxy_with(inbound, number) for number in range(2, 7)]
    for sequence in range(2, 8):
        accepted(greedy, sequence, 300)
    for proxy in modest:
        accepted(proxy, 2, 700)
    assert inbound.used <= SMALL.buffered
    assert (greedy.held, [proxy.held for proxy in modest]) == (0, [700] * 5)
    for sequence in range(1, 8):  # the writer sends it again
        accepted(greedy, sequence, 300)
    assert greedy.next == 8


def test_bytes_are_given_back_with_what_held_them(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    accepted(proxy, 5, 300)
    proxy.assemble(7, DataFragment(1, 1, 100, 300), None, memoryview(bytes(100)), 0.0)
    assert inbound.used > 600
    proxy.begin_at(8)
    assert (inbound.used, proxy.held) == (0, 0)


def test_a_sample_larger_than_the_limit_is_passed_over(inbound: Inbound) -> None:
    proxy = proxy_with(inbound)
    accepted(proxy, 2)
    assert proxy.assemble(1, DataFragment(1, 1, 1000, 1001), None, memoryview(bytes(1000)), 0.0) is None
    assert [number for number, _ in proxy.drain()] == [2]


def test_a_best_effort_writer_holds_one_incomplete_sample(inbound: Inbound) -> None:
    proxy = proxy_with(inbound, reliable=False)
    for sequence in range(1, 1000):
        proxy.assemble(sequence, DataFragment(1, 1, 100, 300), None, memoryview(bytes(100)), 0.0)
    assert inbound.used < 310


def test_fragments_in_any_order_make_the_sample() -> None:
    for seed in range(20):
        chance = random.Random(seed)
        size, payload = chance.randrange(1, 200), chance.randbytes(chance.randrange(1, 5000))
        count = -(-len(payload) // size)
        order = list(range(count))
        chance.shuffle(order)
        assembly = SampleAssembly(DataFragment(1, 1, size, len(payload)), None)
        for position, index in enumerate(order):
            assert assembly.missing(256)[:1] == [min(order[position:]) + 1]
            piece = memoryview(payload[index * size : (index + 1) * size])
            complete = assembly.add(DataFragment(index + 1, 1, size, len(payload)), piece)
            assert complete == (position == count - 1)
        assert assembly.payload() == payload


def test_several_fragments_may_come_in_one_submessage() -> None:
    assembly = SampleAssembly(DataFragment(1, 2, 4, 10), None)
    assert not assembly.add(DataFragment(2, 2, 4, 10), memoryview(b"efghij"))
    assert assembly.missing(256) == [1]
    assert assembly.add(DataFragment(1, 1, 4, 10), memoryview(b"abcd"))
    assert assembly.payload() == b"abcdefghij"


@pytest.mark.parametrize(
    "fragment",
    [
        DataFragment(0, 1, 4, 10),
        DataFragment(4, 1, 4, 10),
        DataFragment(3, 2, 4, 10),
        DataFragment(1, 0, 4, 10),
        DataFragment(1, 1, 5, 10),
        DataFragment(1, 1, 4, 11),
        DataFragment(1, 3, 4, 10),
    ],
)
def test_fragments_that_do_not_fit_are_malformed(fragment: DataFragment) -> None:
    with pytest.raises(MalformedError):
        SampleAssembly(DataFragment(1, 1, 4, 10), None).add(fragment, memoryview(b"abcd"))


@pytest.mark.parametrize(
    "fragment", [DataFragment(1, 1, 0, 10), DataFragment(1, 1, 4, 0), DataFragment(1, 1, 1, 1 << 20)]
)
def test_samples_that_cannot_be_cut_like_that_are_malformed(fragment: DataFragment) -> None:
    with pytest.raises(MalformedError):
        SampleAssembly(fragment, None)


def test_a_history_keeps_its_depth() -> None:
    history = History(3, ParticipantLimits())
    gone = [history.add(Change(number, b"x", b"", 0.0)) for number in range(1, 6)]
    assert ([change.sequence for change in history], sum(gone)) == ([3, 4, 5], 2)


def test_a_history_keeps_no_more_bytes_than_it_may_but_always_the_newest() -> None:
    history = History(None, ParticipantLimits(history=1000))
    for number in range(1, 10):
        history.add(Change(number, bytes(400), b"", 0.0))
    assert [change.sequence for change in history] == [8, 9]
    history.add(Change(10, bytes(2000), b"", 0.0))
    assert [change.sequence for change in history] == [10]


def test_a_change_replaces_the_one_of_the_same_key() -> None:
    history = History(None, ParticipantLimits())
    for number, key in enumerate((b"a", b"b", b"a"), 1):
        history.add(Change(number, b"", b"", 0.0, key=key))
    assert [change.sequence for change in history] == [2, 3]
