"""The public interface, between two participants of ours; what others make of it is tested beside this.

The oracle is what was written, and the rules of DDS 1.4 for its qualities of service.
"""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from ipaddress import IPv4Interface

import pytest
from cobot_run import until

from cobot.dds.rtps import (
    ClosedError,
    Guid,
    NetworkError,
    Participant,
    ParticipantLimits,
    Qos,
    Reader,
    Sample,
    SampleIdentity,
    SampleTooLargeError,
    Writer,
)
from cobot.dds.rtps import submessages as sub
from cobot.dds.rtps.announcements import PARTICIPANT_WRITER, ParticipantAnnouncement, pack_participant
from cobot.dds.rtps.history import Change
from cobot.dds.rtps.network import local_interfaces, reachable
from cobot.dds.rtps.types import PARTICIPANT_ENTITY, UNKNOWN_ENTITY

Join = Callable[..., Participant]
KEEP_ALL = Qos(depth=None)
HEAD = b"\0\1\0\0"


def payload(number: int) -> bytes:
    return HEAD + number.to_bytes(4, "little")


def number_of(sample: Sample) -> int:
    return int.from_bytes(sample.payload[4:8], "little")


def pair(
    here: Participant, there: Participant, on_sample: Callable[[Sample], None], qos: Qos = KEEP_ALL
) -> tuple[Writer, Reader]:
    writer = here.create_writer("topic", "Type", qos)
    reader = there.create_reader("topic", "Type", qos, on_sample)
    until(lambda: writer.matched == (reader.guid,) and reader.matched == (writer.guid,))
    return writer, reader


def test_a_sample_arrives_with_all_that_belongs_to_it(join: Join) -> None:
    samples: list[Sample] = []
    writer, _ = pair(join(), join(), samples.append)
    related = SampleIdentity(Guid(bytes(range(16))), 1 << 40)
    assert writer.write(payload(7), related) == 1
    (sample,) = until(lambda: samples)
    assert (sample.payload, sample.writer, sample.sequence) == (payload(7), writer.guid, 1)
    assert (sample.related, sample.vendor) == (related, sub.VENDOR)
    assert sample.source_time is not None


def test_a_sample_for_one_reader_does_not_reach_the_others(join: Join) -> None:
    here, there = join(), join()
    first: list[int] = []
    second: list[int] = []
    writer, reader = pair(here, there, lambda sample: first.append(number_of(sample)))
    there.create_reader("topic", "Type", KEEP_ALL, lambda sample: second.append(number_of(sample)))
    until(lambda: len(writer.matched) == 2)
    for number in range(10):
        writer.write(payload(number), only=reader.guid if number % 3 else None)
    until(lambda: first == list(range(10)) and second == [0, 3, 6, 9])
    until(lambda: not len(writer._history))


def test_a_sample_waits_for_the_one_reader_that_it_is_for(join: Join) -> None:
    here, there = join(), join()
    writer = here.create_writer("topic", "Type", KEEP_ALL)
    writer.write(payload(1))  # for nobody
    coming = Guid(there.guid.prefix + bytes((0, 0, 2, 4)))
    writer.write(payload(2), only=coming)
    other: list[int] = []
    there.create_reader("topic", "Type", KEEP_ALL, lambda sample: other.append(number_of(sample)))
    until(lambda: writer.matched)
    mine: list[int] = []
    reader = there.create_reader("topic", "Type", KEEP_ALL, lambda sample: mine.append(number_of(sample)))
    assert reader.guid == coming
    until(lambda: mine == [2])
    writer.write(payload(3))
    until(lambda: (mine, other) == ([2, 3], [3]))


def test_a_sample_waits_for_its_reader_although_the_clock_on_the_wall_jumps(
    join: Join, monkeypatch: pytest.MonkeyPatch
) -> None:
    here, there = join(), join()
    writer = here.create_writer("topic", "Type", KEEP_ALL)
    writer.write(payload(1), only=Guid(there.guid.prefix + bytes((0, 0, 2, 4))))
    now_s = time.time()
    for jump_s in (1e6, -1e6):
        monkeypatch.setattr(time, "time", lambda jump_s=jump_s: now_s + jump_s)
        writer.write(payload(2))
        assert [number_of_change(change) for change in writer._history] == [1]


def number_of_change(change: Change) -> int:
    return int.from_bytes(change.payload[4:8], "little")


def test_writers_in_many_threads_share_one_order(join: Join) -> None:
    samples: list[Sample] = []
    writer, _ = pair(join(), join(), samples.append)
    writes = [
        threading.Thread(target=lambda: [writer.write(payload(0)) for _ in range(100)]) for _ in range(5)
    ]
    for thread in writes:
        thread.start()
    for thread in writes:
        thread.join()
    until(lambda: len(samples) == 500)
    assert [sample.sequence for sample in samples] == list(range(1, 501))


def test_both_ends_in_a_bad_network_lose_nothing(join: Join) -> None:
    chance = random.Random(3)
    here, there = join(loss=lambda: chance.random() < 0.2), join(loss=lambda: chance.random() < 0.2)
    samples: list[Sample] = []
    writer, _ = pair(here, there, samples.append)
    contents = [HEAD + chance.randbytes(4 * chance.choice((1, 100, 40_000))) for _ in range(50)]
    for content in contents:
        writer.write(content)
    until(lambda: len(samples) == len(contents))
    assert [sample.payload for sample in samples] == contents


def test_a_lost_sample_is_not_repeated_after_its_lifespan(join: Join) -> None:
    """And the next ones arrive. Oracle: a writer without a lifespan repeats it."""
    cut = threading.Event()
    here, there = join(loss=cut.is_set), join()
    old: list[int] = []
    always: list[int] = []
    short = here.create_writer("short", "Type", KEEP_ALL, lifespan_s=0.1)
    there.create_reader("short", "Type", KEEP_ALL, lambda sample: old.append(number_of(sample)))
    writer, _ = pair(here, there, lambda sample: always.append(number_of(sample)))
    until(lambda: short.matched)
    for number, is_cut in ((1, False), (2, True), (3, False)):
        (cut.set if is_cut else cut.clear)()
        short.write(payload(number))
        writer.write(payload(number))
        if is_cut:
            time.sleep(0.2)
        else:
            until(lambda: old and old[-1] == number and always and always[-1] == number)  # noqa: B023
    assert (old, always) == ([1, 3], [1, 2, 3])
    cut.set()
    short.write(HEAD + bytes(300_000))
    time.sleep(0.2)
    cut.clear()
    short.write(payload(5))
    until(lambda: old == [1, 3, 5])


def test_a_callback_that_blocks_holds_up_neither_the_wire_nor_memory(join: Join) -> None:
    here, there = join(), join(limits=ParticipantLimits(undelivered=2000))
    go_on = threading.Event()
    got: list[int] = []

    def block(sample: Sample) -> None:
        go_on.wait(60)
        got.append(number_of(sample))

    writer, reader = pair(here, there, block)
    for number in range(1000):
        writer.write(payload(number))
    until(lambda: there.statistics.refused)
    assert reader._waiting_bytes <= 2000
    second = there.create_writer("another", "Type", KEEP_ALL)
    answers: list[Sample] = []
    here.create_reader("another", "Type", KEEP_ALL, answers.append)
    until(lambda: second.matched)
    second.write(payload(1))
    until(lambda: answers)
    go_on.set()
    until(lambda: len(got) == 1000)
    assert got == list(range(1000))


def test_a_reader_with_a_depth_keeps_the_newest(join: Join) -> None:
    here, there = join(), join()
    go_on = threading.Event()
    got: list[int] = []

    def block(sample: Sample) -> None:
        go_on.wait(60)
        got.append(number_of(sample))

    writer, _ = pair(here, there, block, Qos(depth=3))
    writer.write(payload(0))
    until(lambda: writer._proxies and next(iter(writer._proxies.values())).acknowledged == 1)
    for number in range(1, 20):
        writer.write(payload(number))
        until(lambda number=number: next(iter(writer._proxies.values())).acknowledged == number + 1)
    go_on.set()
    until(lambda: len(got) == 4)
    assert got == [0, 17, 18, 19]
    assert there.statistics.overrun == 16


def test_an_error_in_a_callback_is_counted_and_the_next_is_called(
    domain: int, caplog: pytest.LogCaptureFixture
) -> None:
    here, there = Participant(domain, localhost_only=True), Participant(domain, localhost_only=True)
    got: list[int] = []

    def fail_once(sample: Sample) -> None:
        got.append(number_of(sample))
        if len(got) == 1:
            raise ValueError("from the callback")

    writer, _ = pair(here, there, fail_once)
    writer.write(payload(1))
    writer.write(payload(2))
    until(lambda: got == [1, 2])
    assert there.statistics.failed == 1
    assert "from the callback" in caplog.text
    here.close()
    there.close()


def test_when_all_is_acknowledged_no_heartbeat_is_due(join: Join) -> None:
    samples: list[Sample] = []
    writer, _ = pair(join(), join(), samples.append)
    for number in range(10):
        writer.write(payload(number))
    until(lambda: [proxy.due_s for proxy in writer._proxies.values()] == [None])


def test_a_writer_that_announces_each_fragment_is_not_answered_each_time(join: Join) -> None:
    # Cyclone DDS does when it repeats fragments; answering each brought its repair to a standstill.
    there = join()
    writer, _ = pair(join(), there, print)
    until(lambda: all(proxy.heard for proxy in there._discovery.readers[b"\0\0\1\4"]._proxies.values()))
    announcement = sub.heartbeat_fragment(UNKNOWN_ENTITY, writer.guid.entity, 5, 3, 1)
    datagram = sub.protocol_header(writer.guid.prefix) + announcement
    before = there.statistics.datagrams_sent
    with there._lock:
        for _ in range(1000):
            there._on_datagram(memoryview(datagram), "127.0.0.1")
    assert there.statistics.datagrams_sent - before < 10


def test_what_is_closed_refuses_and_closes_twice(join: Join) -> None:
    ours = join()
    writer = ours.create_writer("topic", "Type", Qos())
    reader = ours.create_reader("topic", "Type", Qos(), print)
    for _ in range(2):
        writer.close()
        reader.close()
    with pytest.raises(ClosedError, match="topic"):
        writer.write(payload(1))
    second = ours.create_writer("topic", "Type", Qos())
    ours.close()
    ours.close()
    with pytest.raises(ClosedError, match="participant"):
        ours.create_writer("topic", "Type", Qos())
    with pytest.raises(ClosedError, match="topic"):
        second.write(payload(1))


def test_a_participant_can_be_closed_in_a_callback(join: Join) -> None:
    here, there = join(), join()
    closed = threading.Event()

    def close(_: Sample) -> None:
        there.close()
        closed.set()

    writer, _ = pair(here, there, close)
    writer.write(payload(1))
    assert closed.wait(60)
    until(lambda: not here.participants())


def test_a_sample_beyond_the_limit_is_refused_by_the_writer(join: Join) -> None:
    writer = join(limits=ParticipantLimits(payload=100)).create_writer("topic", "Type", Qos())
    with pytest.raises(SampleTooLargeError, match=r"a sample on 'topic' has 101 bytes, allowed: 100"):
        writer.write(bytes(101))


def test_a_sample_beyond_the_readers_limit_is_passed_over(join: Join) -> None:
    got: list[int] = []
    there = join(limits=ParticipantLimits(payload=100_000))
    writer, _ = pair(join(), there, lambda sample: got.append(number_of(sample)))
    for number, size in enumerate((0, 200_000, 0)):
        writer.write(payload(number) + bytes(size))
    until(lambda: got == [0, 2])
    assert there.statistics.refused


def test_a_depth_below_one_is_refused() -> None:
    with pytest.raises(ValueError, match="depth of a Qos is 0"):
        Qos(depth=0)


def test_other_types_are_not_matched(join: Join) -> None:
    here, there = join(), join()
    writer = here.create_writer("topic", "Type", Qos())
    reader = there.create_reader("topic", "Other", Qos(), print)
    until(lambda: here.discovered() and there.discovered())
    assert (writer.matched, reader.matched) == ((), ())


def test_a_participant_that_falls_silent_is_forgotten_when_its_lease_ends(join: Join) -> None:
    ours = join()
    prefix = b"invented...."
    addresses = (("127.0.0.1", 1),)
    silent = ParticipantAnnouncement(
        Guid(prefix + PARTICIPANT_ENTITY), None, "silent", b"", 0, 0.2, addresses, addresses
    )
    data = sub.data(UNKNOWN_ENTITY, PARTICIPANT_WRITER, 1, b"", pack_participant(silent), key=False)
    datagram = sub.protocol_header(prefix) + data
    with ours._lock:
        ours._on_datagram(memoryview(datagram), "127.0.0.1")
        assert [participant.name for participant in ours.participants()] == ["silent"]
    until(lambda: not ours.participants())


def test_participants_of_other_domains_are_strangers(join: Join, domain: int) -> None:
    ours = join()
    addresses = (("127.0.0.1", 1),)
    prefix = b"elsewhere..."
    foreign = ParticipantAnnouncement(
        Guid(prefix + PARTICIPANT_ENTITY), domain + 1, "", b"", 0, 10.0, addresses, addresses
    )
    data = sub.data(UNKNOWN_ENTITY, PARTICIPANT_WRITER, 1, b"", pack_participant(foreign), key=False)
    with ours._lock:
        ours._on_datagram(memoryview(sub.protocol_header(prefix) + data), "127.0.0.1")
    assert ours.participants() == []


@pytest.mark.parametrize("domain_id", [-1, 233])
def test_a_domain_that_does_not_exist_is_refused(domain_id: int) -> None:
    with pytest.raises(NetworkError, match=r"not within 0\.\.232"):
        Participant(domain_id, localhost_only=True)


def test_an_interface_that_does_not_exist_is_refused_by_name(domain: int) -> None:
    with pytest.raises(NetworkError, match="no interface 'nowhere0'"):
        Participant(domain, interfaces=("nowhere0",))


def test_interfaces_may_be_named_or_given_by_address() -> None:
    assert local_interfaces(("lo",)) == local_interfaces(("127.0.0.1",)) == [IPv4Interface("127.0.0.1/8")]


def test_of_several_addresses_of_a_peer_the_reachable_one_is_chosen() -> None:
    ours = [IPv4Interface("192.168.1.5/24"), IPv4Interface("10.0.0.5/8")]
    docker, lan, loopback = ("172.17.0.1", 1), ("192.168.1.9", 1), ("127.0.0.1", 1)
    assert reachable([docker, lan, loopback], "172.17.0.1", ours) == docker  # it was heard from there
    assert reachable([docker, lan, loopback], "8.8.8.8", ours) == lan
    assert reachable([loopback, docker], "8.8.8.8", ours) == docker
    assert reachable([], "8.8.8.8", ours) is None
