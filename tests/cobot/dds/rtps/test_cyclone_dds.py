"""Topics with Cyclone DDS, the library under rmw_cyclonedds: the oracle, it decodes and encodes all again."""

from __future__ import annotations

import os
import random
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from cobot_run import until
from cyclone_peer import String, cyclone_participant, cyclone_reader
from folders import SUPPORT

from cobot.dds.rtps import Participant, Qos, Sample

ECHO = Path(__file__).parents[1] / "cyclone_echo.py"
SIZES = [0, 1, 2, 3, 1000, 70_000, 1 << 20, 2 << 20]


@pytest.fixture
def echo(domain: int) -> Iterator[None]:
    """`cyclone_echo.py` in the test's domain."""
    command = [sys.executable, str(ECHO), str(domain)]
    environment = os.environ | {"PYTHONPATH": str(SUPPORT)}
    with subprocess.Popen(command, stdin=subprocess.PIPE, env=environment) as process:
        yield
        assert process.stdin is not None
        process.stdin.close()


@pytest.mark.parametrize("share", [0.0, 0.1])
def test_samples_of_all_sizes_come_back_whole_and_in_order(
    echo: None, join: Callable[..., Participant], share: float
) -> None:
    chance = random.Random(7)
    ours = join(loss=(lambda: chance.random() < share) if share else None)
    received: list[Sample] = []
    writer = ours.create_writer("out", "Type", Qos(depth=None))
    reader = ours.create_reader("in", "Type", Qos(depth=None), received.append)
    until(lambda: writer.matched and reader.matched)
    # A volatile reader of Cyclone begins with what is written after the first heartbeat that it has seen.
    hello = struct.pack("<II", 1000, 0)
    until(lambda: writer.write(b"\0\1\0\0" + hello) and received)
    contents = [random.Random(size).randbytes(size) for size in SIZES]
    sent = [struct.pack("<II", number, len(content)) + content for number, content in enumerate(contents)]
    for whole in sent:
        writer.write(b"\0\1\0\0" + whole)

    def echoed() -> list[Sample]:
        return [sample for sample in received if sample.payload[4:12] != hello]

    until(lambda: len(echoed()) == len(SIZES))
    assert [sample.payload[4 : 4 + len(whole)] for sample, whole in zip(echoed(), sent, strict=True)] == sent
    assert {sample.vendor for sample in received} == {0x0110}


def test_what_is_deleted_disappears_on_the_other_side(domain: int, join: Callable[..., Participant]) -> None:
    ours = join()
    with cyclone_participant(domain) as cyclone:
        readers: list[Any] = [cyclone_reader(cyclone, "out", String)]
        writer = ours.create_writer("out", "std_msgs::msg::dds_::String_", Qos())
        until(lambda: writer.matched and readers[0].get_matched_publications())
        writer.close()
        until(lambda: not readers[0].get_matched_publications())
        readers.clear()
        until(lambda: not [end for end in ours.discovered() if end.topic == "out"])
