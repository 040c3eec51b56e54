"""Datagrams that no honest peer sends. The oracle: a Fast DDS peer is served all the same."""

from __future__ import annotations

import random
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import psutil
from cobot_run import until
from rtps_peer import Peer, number_of, numbered

from cobot.dds.rtps import Guid, Participant, ParticipantLimits, Qos
from cobot.dds.rtps import submessages as sub
from cobot.dds.rtps.announcements import (
    PARTICIPANT_WRITER,
    EndpointAnnouncement,
    ParticipantAnnouncement,
    pack_endpoint,
    pack_participant,
)
from cobot.dds.rtps.types import PARTICIPANT_ENTITY, UNKNOWN_ENTITY

Start = Callable[[], Peer]
Join = Callable[..., Participant]
KEEP_ALL = Qos(depth=None)
LIMITS = ParticipantLimits(
    buffered_per_writer=4 << 20, buffered=8 << 20, participants=20, endpoints_per_participant=30
)
PUBLICATIONS_WRITER, PUBLICATIONS_READER = bytes((0, 0, 3, 0xC2)), bytes((0, 0, 3, 0xC7))
ROUNDS = 20_000


def throw(target: Participant, datagram: bytes) -> None:
    """Hand a datagram to a participant as if it had come from its socket, where many might get lost."""
    with target._lock:
        target._on_datagram(memoryview(datagram), "127.0.0.1")


@contextmanager
def recording(ours: Participant) -> Iterator[list[bytes]]:
    """All datagrams that come in meanwhile."""
    recorded: list[bytes] = []
    handle = ours._wire._on_datagram

    def tap(view: memoryview, host: str) -> None:
        recorded.append(view.tobytes())
        handle(view, host)

    ours._wire._on_datagram = tap
    yield recorded
    ours._wire._on_datagram = handle


def still_serves(ours: Participant, peer: Peer, topic: str) -> None:
    numbers: list[int] = []
    ours.create_reader(
        f"{topic}_in", "Type", KEEP_ALL, lambda sample: numbers.append(number_of(sample.payload))
    )
    writer = ours.create_writer(f"{topic}_out", "Type", KEEP_ALL)
    peer.reader(f"{topic}_out")
    peer.writer(f"{topic}_in")
    for name in (f"{topic}_out", f"{topic}_in"):
        peer.wait(name)
    until(lambda: writer.matched)
    for number in range(1, 11):
        writer.write(numbered(number, 100_000))
    peer.write(f"{topic}_in", 10, 100_000)
    until(lambda: peer.report(f"{topic}_out")["count"] == 10 and len(numbers) == 10)


def mutated(datagram: bytes, chance: random.Random) -> bytes:
    """A valid datagram with a few bytes changed, cut, repeated or set to extreme numbers."""
    changed = bytearray(datagram)
    for _ in range(chance.randrange(1, 5)):
        where = chance.randrange(20, max(21, min(len(changed), 400)))
        kind = chance.randrange(5)
        if kind == 0:
            changed[where : where + 1] = chance.randbytes(1)
        elif kind == 1:
            changed[where : where + 4] = chance.choice(
                (b"\xff" * 4, b"\0" * 4, b"\xff\xff\xff\x7f", b"\1\0\0\0")
            )
        elif kind == 2:
            del changed[where:]
        elif kind == 3:
            changed += changed[20:where]
        else:
            del changed[where : where + chance.randrange(1, 8)]
    return bytes(changed[:65_000])


def test_mutations_of_real_traffic_neither_stop_a_participant_nor_fill_its_memory(
    start_peer: Start, join: Join
) -> None:
    ours, model = join(limits=LIMITS), start_peer()
    with recording(ours) as recorded:
        still_serves(ours, model, "model")
    model.kill()
    honest = start_peer()  # only now: what is forged in its name may well end the pairing, as DDS is made
    until(lambda: len(ours.participants()) == 2)
    corpus = list(dict.fromkeys(datagram for datagram in recorded if len(datagram) < 2000))
    corpus += [datagram for datagram in recorded if len(datagram) >= 2000][:5]
    chance = random.Random(8)
    before = psutil.Process().memory_info().rss
    for _ in range(ROUNDS):
        throw(ours, mutated(chance.choice(corpus), chance))
    for _ in range(ROUNDS // 10):
        throw(ours, b"RTPS\2\2" + chance.randbytes(chance.randrange(200)))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        for address in ours._wire.metatraffic + ours._wire.user:
            for size in (0, 1, 19, 20, 21, 65_507):
                sender.sendto(chance.randbytes(size), address)
    assert ours.statistics.malformed > ROUNDS // 10
    assert ours.statistics.failed == 0
    assert ours._inbound.used <= LIMITS.buffered
    assert psutil.Process().memory_info().rss - before < 64 << 20
    still_serves(ours, honest, "honest")
    still_serves(ours, start_peer(), "newcomer")


def announced(prefix: bytes, port: int) -> bytes:
    """The announcement of a participant that does not exist."""
    addresses = (("127.0.0.1", port),)
    made = ParticipantAnnouncement(
        Guid(prefix + PARTICIPANT_ENTITY), None, "x" * 200, b"", 0x0103, 1e9, addresses, addresses
    )
    data = sub.data(UNKNOWN_ENTITY, PARTICIPANT_WRITER, 1, b"", pack_participant(made), key=False)
    return sub.protocol_header(prefix) + data


def endpoint_of(prefix: bytes, number: int) -> bytes:
    guid = Guid(prefix + number.to_bytes(3, "big") + b"\3")
    made = EndpointAnnouncement(guid, f"topic{number}", "Type", Qos(), b"x" * 1000, ())
    data = sub.data(PUBLICATIONS_READER, PUBLICATIONS_WRITER, number, b"", pack_endpoint(made), key=False)
    return sub.protocol_header(prefix) + data


def test_a_crowd_of_invented_participants_is_held_at_the_door(start_peer: Start, join: Join) -> None:
    ours, honest = join(limits=LIMITS), start_peer()
    until(ours.participants)
    for number in range(1, 2001):
        throw(ours, announced(number.to_bytes(12, "big"), 1))
    assert len(ours.participants()) == LIMITS.participants
    assert ours.statistics.refused >= 2000 - LIMITS.participants
    still_serves(ours, honest, "honest")


def test_an_invented_participant_cannot_announce_endpoints_without_end(start_peer: Start, join: Join) -> None:
    ours, honest = join(limits=LIMITS), start_peer()
    until(ours.participants)
    prefix = b"invented...."
    throw(ours, announced(prefix, 1))
    for number in range(1, 1001):
        throw(ours, endpoint_of(prefix, number))
    invented = [end for end in ours.discovered() if end.guid.prefix == prefix]
    assert len(invented) == LIMITS.endpoints_per_participant
    still_serves(ours, honest, "honest")


def test_nobody_can_announce_an_endpoint_of_another(join: Join) -> None:
    ours = join()
    throw(ours, announced(b"invented....", 1))
    until(ours.participants)
    stolen = endpoint_of(b"somebodyelse", 1).replace(
        b"RTPS\2\2\1\x7esomebodyelse", b"RTPS\2\2\1\x7einvented...."
    )
    throw(ours, stolen)
    until(lambda: ours.statistics.malformed)
    assert ours.discovered() == []
