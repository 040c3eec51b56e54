"""The least client of FRI, which echoes the interpolator: `python -m benchmarks.backends.bare_fri PORT`."""

from __future__ import annotations

import sys

from cobot.config import load_settings
from rtloop.backends.fri.channel import fri_channel
from rtloop.backends.fri.codec import decode_monitoring
from rtloop.backends.fri.encoding import encode_command
from rtloop.backends.fri.messages import COMMAND_ID, CommandMessage, FriHeader, MonitoringMessage
from rtloop.realtime import freeze_garbage, prepare


def main() -> None:
    """Echo the interpolator's positions, as punctually as rtloop, until the process is ended."""
    rt = load_settings(None).rt
    prepare(rt.priority, rt.cpu, rt.cpu_latency_us)
    freeze_garbage()
    channel = fri_channel("127.0.0.1", int(sys.argv[1]), None)
    sequence = 0
    while True:
        for packet in channel.receive(1.0):
            message = decode_monitoring(packet)
            if isinstance(message, MonitoringMessage):
                sequence += 1
                header = FriHeader(COMMAND_ID, sequence, message.header.sequence)
                channel.send(encode_command(CommandMessage(header, message.ipo_position)))


if __name__ == "__main__":
    main()
