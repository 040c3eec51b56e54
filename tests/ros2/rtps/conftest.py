"""Participants of ours and Fast DDS peers, in a domain of each test's own."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from rtps_peer import SOURCE, Peer, own_domain

from ros2.rtps import Participant


@pytest.fixture(scope="session")
def peer_binary(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if shutil.which("g++") is None:
        pytest.skip("needs g++ to build the Fast DDS peer (apt-get install g++)")
    if not Path("/usr/include/fastdds").is_dir():
        pytest.skip("needs the headers of Fast DDS (apt-get install libfastrtps-dev)")
    binary = tmp_path_factory.mktemp("peer") / "peer"
    command = ["g++", "-std=c++17", "-O0", "-o", str(binary), str(SOURCE), "-lfastrtps", "-lfastcdr"]
    subprocess.run(command, check=True)
    return binary


@pytest.fixture
def domain() -> Iterator[int]:
    with own_domain() as free:
        yield free


@pytest.fixture
def start_peer(peer_binary: Path, domain: int) -> Iterator[Callable[[], Peer]]:
    peers: list[Peer] = []

    def start() -> Peer:
        peers.append(Peer(peer_binary, domain))
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
