"""The least client of Stream Motion, which holds the arm.

python -m benchmarks.backends.bare_fanuc PORT RMI
"""

from __future__ import annotations

import sys
from functools import partial

from cobot.config import load_settings
from rtloop.backends.fanuc.codec import decode_received, encode_command, encode_start
from rtloop.backends.fanuc.messages import CommandPacket, StatusPacket
from rtloop.backends.fanuc.rmi import RmiClient, TcpLines
from rtloop.backends.fanuc.stream import UdpClient
from rtloop.realtime import freeze_garbage, prepare


def main() -> None:
    """Hold the arm, as punctually as rtloop, until the process is ended."""
    rt = load_settings(None).rt
    channel = UdpClient("127.0.0.1", int(sys.argv[1]))
    rmi = RmiClient("127.0.0.1", int(sys.argv[2]), 5.0, partial(TcpLines, "127.0.0.1"))
    channel.send(encode_start(3))
    rmi.connect()
    rmi.command("Initialize", "initialize")
    rmi.call("STREAM_MOTN", rmi.status().next_sequence or 1)
    prepare(rt.priority, rt.cpu, rt.cpu_latency_us)
    freeze_garbage()
    held: tuple[float, ...] = ()
    while True:
        for packet in channel.receive(1.0):
            state = decode_received(packet)
            if isinstance(state, StatusPacket) and state.motion_possible:
                held = held or state.joints
                channel.send(encode_command(CommandPacket(3, state.sequence, held)))


if __name__ == "__main__":
    main()
