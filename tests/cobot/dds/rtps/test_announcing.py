"""How hundreds of endpoints become known, and how those of a killed participant are forgotten."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest
from cobot_run import HELPER_ENVIRONMENT
from ros_peer import Peer, until

from cobot.dds.rtps import Participant, ParticipantRecord, Qos
from cobot.ros.messages import Messages

Join = Callable[..., Participant]
ENDPOINTS = 600
"""About so many has the node of one robot."""
KILLED = """
import os, signal, sys
from cobot.dds.rtps import ParticipantRecord, Participant, Qos
participant = Participant(int(sys.argv[1]), localhost_only=True)
participant.create_writer("rt/left", "std_msgs::msg::dds_::String_", Qos())
participant.record_in(ParticipantRecord(int(sys.argv[2])))
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.fixture
def peer(domain: int) -> Iterator[Peer]:
    with Peer(domain, Messages()) as made:
        yield made


@pytest.mark.thorough
def test_hundreds_of_endpoints_are_announced_in_a_few_datagrams(domain: int, join: Join) -> None:
    ours = join()
    for number in range(ENDPOINTS // 2):
        ours.create_writer(f"rr/service{number}Reply", "Type", Qos())
        ours.create_reader(f"rq/service{number}Request", "Type", Qos(), lambda sample: None)
    before = ours.statistics.datagrams_sent
    with Peer(domain, Messages()) as late:
        until(lambda: len([each for each in late.found if "service" in each[1]]) == ENDPOINTS, "not all")
        assert ours.statistics.datagrams_sent - before < ENDPOINTS / 5


def test_endpoints_that_are_made_together_are_announced_together(peer: Peer, join: Join) -> None:
    ours = join()
    until(lambda: ours.participants(), "the peer is not found")
    before = ours.statistics.datagrams_sent
    for number in range(ENDPOINTS):
        ours.create_writer(f"rt/topic{number}", "Type", Qos())
    until(lambda: len([each for each in peer.found if "topic" in each[1]]) == ENDPOINTS, "not all")
    assert ours.statistics.datagrams_sent - before < ENDPOINTS / 2


def test_a_killed_participant_is_forgotten_when_its_successor_says_so(domain: int, peer: Peer) -> None:
    descriptor = os.memfd_create("last words")
    ParticipantRecord(descriptor).announce_end()  # the first of all has nobody to speak for
    killed = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(domain), str(descriptor)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=HELPER_ENVIRONMENT,
        pass_fds=(descriptor,),
    )
    with killed:
        assert killed.stdout is not None
        assert killed.stdout.readline() == b"ready\n"
        left = ("w", "rt/left", "std_msgs::msg::dds_::String_")
        until(lambda: left in peer.found, "not found")
        killed.kill()
        killed.wait()
    assert left in peer.found  # its lease is not over
    ParticipantRecord(descriptor).announce_end()
    until(lambda: left not in peer.found, "it is still there")
    os.close(descriptor)
