"""Topics and services with Fast DDS 2.9, the library under rmw_fastrtps, which is the oracle.

`peer.cpp` checks every byte that it gets and drops a reply that does not carry its request's identity.
"""

from __future__ import annotations

import random
from collections.abc import Callable

import pytest
from cobot_run import until
from rtps_peer import Peer, number_of, numbered
from thorough import few

from cobot.dds.rtps import Participant, Qos, Sample, SampleIdentity, Writer

Start = Callable[[], Peer]
Join = Callable[..., Participant]
KEEP_ALL = Qos(depth=None)


def losing(share: float, seed: int) -> Callable[[], bool]:
    chance = random.Random(seed)
    return lambda: chance.random() < share


def writer_for(ours: Participant, peer: Peer, topic: str, qos: Qos = KEEP_ALL) -> Writer:
    """A writer of ours that a keep-all reader of the peer is matched with."""
    writer = ours.create_writer(topic, "Type", qos)
    peer.reader(topic)
    peer.wait(topic)
    until(lambda: writer.matched)
    return writer


def reader_for(ours: Participant, peer: Peer, topic: str) -> list[int]:
    """What a reader of ours gets from a writer of the peer that it is matched with."""
    numbers: list[int] = []
    reader = ours.create_reader(
        topic, "Type", KEEP_ALL, lambda sample: numbers.append(number_of(sample.payload))
    )
    peer.writer(topic)
    peer.wait(topic)
    until(lambda: reader.matched)
    return numbers


def serve(ours: Participant, service: str) -> list[Sample]:
    """A service of ours that answers with what it is asked; returns its requests."""
    requests: list[Sample] = []
    replies = ours.create_writer(f"rr{service}Reply", "Service_Response_", KEEP_ALL)

    def answer(request: Sample) -> None:
        requests.append(request)
        asker = request.related.writer if request.related else request.writer
        identity = SampleIdentity(asker, request.sequence)
        replies.write(request.payload, identity, only=asker if asker.is_reader else None)

    ours.create_reader(f"rq{service}Request", "Service_Request_", KEEP_ALL, answer)
    return requests


def call(peer: Peer, count: int) -> str:
    peer.tell("call", "client", count)
    return peer.expect("called", "client")


@pytest.mark.parametrize(("share", "count"), few([(0.0, 300), (0.1, 100), (0.3, 60)]))
def test_reliable_topics_carry_everything_in_order_both_ways(
    start_peer: Start, join: Join, share: float, count: int
) -> None:
    ours, peer = join(loss=losing(share, 4) if share else None), start_peer()
    writer, numbers = writer_for(ours, peer, "out"), reader_for(ours, peer, "in")
    for number in range(1, count + 1):
        writer.write(numbered(number, 200))
    peer.write("in", count, 200)
    until(lambda: peer.report("out")["count"] == count and len(numbers) == count)
    report = peer.report("out")
    assert (report["wrong"], report["unordered"], report["last"]) == (0, 0, count)
    assert numbers == list(range(1, count + 1))


@pytest.mark.parametrize("share", few([0.0, 0.1, 0.3]))
def test_large_samples_arrive_whole_both_ways(start_peer: Start, join: Join, share: float) -> None:
    sizes = [65_000, 70_000, 1 << 20, 5 << 20]
    ours, peer = join(loss=losing(share, 5) if share else None), start_peer()
    writer, numbers = writer_for(ours, peer, "out"), reader_for(ours, peer, "in")
    for number, size in enumerate(sizes, 1):
        writer.write(numbered(number, size))
        peer.write("in", 1, size)
    until(lambda: peer.report("out")["count"] == len(sizes) and len(numbers) == len(sizes))
    report = peer.report("out")
    assert (report["wrong"], report["unordered"], report["largest"]) == (0, 0, sizes[-1])
    assert numbers == [1, 2, 3, 4]


def test_best_effort_readers_get_samples_in_order(start_peer: Start, join: Join) -> None:
    ours, peer = join(), start_peer()
    writer = ours.create_writer("out", "Type", Qos(reliable=True))
    peer.reader("out", reliable=False)
    peer.wait("out")
    until(lambda: writer.matched)
    numbers: list[int] = []
    reader = ours.create_reader(
        "in", "Type", Qos(reliable=False), lambda sample: numbers.append(number_of(sample.payload))
    )
    peer.writer("in")
    peer.wait("in")
    until(lambda: reader.matched)
    sent = iter(range(1, 10_000))

    def something_arrived() -> bool:
        writer.write(numbered(next(sent)))
        peer.write("in", 1)
        return bool(peer.report("out")["count"] >= 20 and len(numbers) >= 20)

    until(something_arrived)
    assert peer.report("out")["unordered"] == 0
    assert numbers == sorted(set(numbers))


def test_a_reader_that_asks_for_more_than_is_offered_is_not_matched(start_peer: Start, join: Join) -> None:
    ours, peer = join(), start_peer()
    volatile = ours.create_writer("volatile", "Type", Qos())
    best_effort = ours.create_writer("best_effort", "Type", Qos(reliable=False))
    fitting = ours.create_writer("fitting", "Type", Qos(transient_local=True))
    peer.reader("volatile", latched=True)
    peer.reader("best_effort")
    peer.reader("fitting", latched=True)
    until(lambda: fitting.matched and len(ours.discovered()) == 3)
    assert (volatile.matched, best_effort.matched) == ((), ())


def test_latched_samples_reach_those_who_come_later(start_peer: Start, join: Join) -> None:
    ours, peer = join(), start_peer()
    writer = ours.create_writer("out", "Type", Qos(transient_local=True, depth=3))
    for number in range(1, 11):
        writer.write(numbered(number))
    peer.reader("out", latched=True)
    peer.writer("in", latched=True, depth=1)
    peer.write("in", 5)
    numbers: list[int] = []
    ours.create_reader(
        "in",
        "Type",
        Qos(transient_local=True, depth=1),
        lambda sample: numbers.append(number_of(sample.payload)),
    )
    until(lambda: peer.report("out")["count"] == 3 and numbers)
    report = peer.report("out")
    assert (report["first"], report["last"]) == (8, 10)
    assert numbers == [5]


def test_a_volatile_reader_gets_only_what_is_written_after_it_came(start_peer: Start, join: Join) -> None:
    ours, peer = join(), start_peer()
    writer = ours.create_writer("out", "Type", Qos(depth=100))
    for number in range(1, 51):
        writer.write(numbered(number))
    peer.reader("out")
    peer.wait("out")
    until(lambda: writer.matched)
    writer.write(numbered(51))
    until(lambda: peer.report("out")["count"])
    assert peer.report("out")["first"] == 51


def test_every_call_of_a_service_client_gets_its_own_reply(start_peer: Start, join: Join) -> None:
    ours, peer = join(), start_peer()
    requests = serve(ours, "/service")
    peer.tell("client", "client", "/service", "Service")
    peer.wait("client")
    assert call(peer, 200) == "200 0"
    assert [request.sequence for request in requests] == list(range(1, 201))
    assert all(request.related and request.related.writer.is_reader for request in requests)


def test_the_first_call_of_each_new_client_is_answered(start_peer: Start, join: Join) -> None:
    # The client knows both of our endpoints; we may not know its reply reader yet.
    ours, peer = join(), start_peer()
    serve(ours, "/service")
    for _ in range(10):
        peer.tell("client", "client", "/service", "Service")
        peer.wait("client")
        assert call(peer, 1) == "1 0"
        peer.delete("client")


def test_calls_survive_a_tenth_of_the_datagrams_lost(start_peer: Start, join: Join) -> None:
    ours, peer = join(loss=losing(0.1, 6)), start_peer()
    serve(ours, "/service")
    peer.tell("client", "client", "/service", "Service")
    peer.wait("client")
    assert call(peer, 40) == "40 0"


def test_a_peer_that_was_killed_and_started_again_is_served_at_once(start_peer: Start, join: Join) -> None:
    ours = join()
    serve(ours, "/service")
    writer = ours.create_writer("out", "Type", KEEP_ALL)
    for life in range(1, 4):
        peer = start_peer()
        peer.reader("out")
        peer.wait("out")
        peer.tell("client", "client", "/service", "Service")
        peer.wait("client")
        assert call(peer, 5) == "5 0"
        until(lambda life=life: len(writer.matched) == life)  # the dead have time until their lease ends
        writer.write(numbered(life))
        until(lambda peer=peer: peer.report("out")["count"])
        assert peer.report("out")["first"] == life
        peer.kill()


def test_a_participant_of_ours_that_comes_again_is_matched_again(start_peer: Start, join: Join) -> None:
    peer = start_peer()
    peer.reader("out")
    for number in range(1, 4):
        ours = join()
        writer = ours.create_writer("out", "Type", KEEP_ALL)
        peer.wait("out")
        until(lambda writer=writer: writer.matched)
        writer.write(numbered(number))
        until(lambda number=number: peer.report("out")["count"] == number)
        ours.close()


def test_what_is_deleted_disappears_on_the_other_side(start_peer: Start, join: Join) -> None:
    ours, peer = join(), start_peer()
    writer, _ = writer_for(ours, peer, "out"), reader_for(ours, peer, "in")
    assert {(end.topic, end.kind) for end in ours.discovered()} == {("out", "reader"), ("in", "writer")}
    peer.delete("out")
    until(lambda: not writer.matched)
    assert [end.topic for end in ours.discovered()] == ["in"]
    peer.quit()
    until(lambda: not ours.participants())
    assert ours.discovered() == []


def test_the_graph_shows_what_peers_say_of_themselves(start_peer: Start, join: Join) -> None:
    changes: list[int] = []
    ours = join(on_change=lambda: changes.append(1))
    peer = start_peer()
    peer.reader("topic", reliable=False)
    (end,) = until(ours.discovered)
    assert (end.kind, end.topic, end.type_name, end.qos) == (
        "reader",
        "topic",
        "Type",
        Qos(False, False, None),
    )
    assert (end.participant.name, end.participant.user_data) == ("peer", b"enclave=/;")
    assert end.participant.vendor == 0x010F
    until(lambda: changes)


def test_the_history_of_a_writer_that_keeps_all_empties_when_all_have_acknowledged(
    start_peer: Start, join: Join
) -> None:
    ours, peer = join(), start_peer()
    writer = writer_for(ours, peer, "out")
    for number in range(1, 101):
        writer.write(numbered(number))
    until(lambda: not len(writer._history))
