"""Participants on several computers, which are network namespaces here.

The oracle is Fast DDS 2.9 on the other ones, and the kernel, which lets nothing through but over the cables.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack

import pytest
from cobot_run import until
from network_namespaces import Host, connect, hosts, route
from rtps_peer import Peer, number_of, numbered

from cobot.dds.rtps import Participant, Qos, Writer

KEEP_ALL = Qos(depth=None)


class Net:
    """Participants of ours on one computer and Fast DDS on others."""

    def __init__(self, near: Host, far: list[Host], domain: int) -> None:
        self.near, self.far, self.domain = near, far, domain
        self.ends = ExitStack()

    def join(self, *, interfaces: tuple[str, ...] | None = None, peers: tuple[str, ...] = ()) -> Participant:
        with self.near.inside():
            made = Participant(self.domain, interfaces, peers=peers)
        self.ends.callback(made.close)
        return made

    def peer(self, host: Host) -> Peer:
        with host.inside():
            made = Peer(self.domain)
        self.ends.callback(made.kill)
        return made


@pytest.fixture
def net(domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Net]:
    monkeypatch.setenv("ROS_LOCALHOST_ONLY", "0")
    with hosts(3) as (near, *far):
        made = Net(near, far, domain)
        with made.ends:
            yield made


def send_and_check(writer: Writer, peers: list[Peer], first: int, last: int) -> None:
    for number in range(first, last + 1):
        writer.write(numbered(number, 200))
    for peer in peers:
        until(lambda peer=peer: peer.report("out")["last"] == last)
        report = peer.report("out")
        assert (report["count"], report["wrong"], report["unordered"]) == (last, 0, 0)


def writer_to(ours: Participant, peers: list[Peer]) -> Writer:
    writer = ours.create_writer("out", "Type", KEEP_ALL)
    for peer in peers:
        peer.reader("out")
        peer.wait("out")
    until(lambda: len(writer.matched) == len(peers))
    return writer


def test_two_networks_reach_a_computer_on_each_and_one_that_breaks_and_heals_loses_nothing(net: Net) -> None:
    for number, host in enumerate(net.far):
        connect(net.near, host, number)
    ours, peers = net.join(), [net.peer(host) for host in net.far]
    writer = writer_to(ours, peers)
    numbers: list[int] = []
    ours.create_reader("in", "Type", KEEP_ALL, lambda sample: numbers.append(number_of(sample.payload)))
    peers[1].writer("in")
    peers[1].wait("in")
    send_and_check(writer, peers, 1, 100)
    net.near.ip("link", "set", "net0", "down")
    send_and_check(writer, peers[1:], 101, 200)
    peers[1].write("in", 100, 200)
    until(lambda: numbers == list(range(1, 101)))
    net.near.ip("link", "set", "net0", "up")
    send_and_check(writer, peers, 201, 300)


def test_a_named_interface_is_the_only_one_that_is_used(net: Net) -> None:
    for number, host in enumerate(net.far):
        connect(net.near, host, number)
    ours, peers = net.join(interfaces=("net1",)), [net.peer(host) for host in net.far]
    send_and_check(writer_to(ours, peers[1:]), peers[1:], 1, 10)
    assert [end.participant.name for end in ours.discovered()] == ["peer"]


def test_a_network_that_comes_up_later_is_used(net: Net) -> None:
    ours = net.join()
    connect(net.near, net.far[0], 0)
    peer = net.peer(net.far[0])
    send_and_check(writer_to(ours, [peer]), [peer], 1, 10)


def test_a_peer_that_is_named_is_found_beyond_a_router(net: Net) -> None:
    router, host = net.far
    route(net.near, router, host)
    unaware, ours, peer = net.join(), net.join(peers=("10.9.1.2",)), net.peer(host)
    send_and_check(writer_to(ours, [peer]), [peer], 1, 10)
    assert [each.guid for each in unaware.participants()] == [ours.guid]
