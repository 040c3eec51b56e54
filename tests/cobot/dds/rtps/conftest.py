"""Participants of ours and Fast DDS peers, in a domain of each test's own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from dds_peers import own_domain
from rtps_peer import Peer

from cobot.dds.rtps import Participant


@pytest.fixture
def domain() -> Iterator[int]:
    with own_domain() as free:
        yield free


@pytest.fixture
def start_peer(domain: int) -> Iterator[Callable[[], Peer]]:
    peers: list[Peer] = []

    def start() -> Peer:
        peers.append(Peer(domain))
        return peers[-1]

    yield start
    for peer in peers:
        peer.kill()


@pytest.fixture
def join(domain: int) -> Iterator[Callable[..., Participant]]:
    """Makes participants in the test's domain; afterwards none may have had an error of its own."""
    made: list[Participant] = []

    def make(**options: Any) -> Participant:
        made.append(Participant(domain, localhost_only=True, **options))
        return made[-1]

    yield make
    for participant in made:
        participant.close()
    assert [participant.statistics.failed for participant in made] == [0] * len(made)
