"""A process with a Cyclone DDS participant that writes to the topic "in" what it reads from "out".

A process, because a write that waits for acknowledgements holds Python's lock, and so keeps ours from coming.
Usage: python cyclone_echo.py DOMAIN; it ends with its input.
"""

import sys
import threading
from dataclasses import dataclass
from typing import Any

from cyclone_peer import cyclone_participant
from cyclonedds.core import Policy, Qos
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=60)), Policy.History.KeepAll)


@dataclass
class Numbered(IdlStruct, typename="Type"):
    number: uint32
    content: sequence[uint8]


def main() -> None:
    with cyclone_participant(int(sys.argv[1])) as participant:
        reader: Any = DataReader(participant, Topic(participant, "out", Numbered), qos=RELIABLE)
        writer: Any = DataWriter(participant, Topic(participant, "in", Numbered), qos=RELIABLE)
        input_ended = threading.Event()
        threading.Thread(target=lambda: (sys.stdin.read(), input_ended.set()), daemon=True).start()
        while not input_ended.wait(0.002):
            if not writer.get_matched_subscriptions():
                continue  # what is written before is for nobody
            for sample in reader.take(N=100):
                writer.write(Numbered(sample.number, sample.content))


if __name__ == "__main__":
    main()
