"""Clients of RSI without a service: `python -m benchmarks.backends.bare_rsi PORT [CONFIG]`.

With CONFIG it is the backend. Without it, it is the least client, which repeats IPOC in an answer that is
written already.
"""

from __future__ import annotations

import math
import socket
import sys
from pathlib import Path

import numpy as np

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends import Measured
from rtloop.backends.rsi import RsiBackend
from rtloop.realtime import freeze_garbage, prepare

BEGIN, END = b"<IPOC>", b"</IPOC>"
ANSWER = (
    b'<Sen Type="cobot"><AK A1="0.000000" A2="0.000000" A3="0.000000" A4="0.000000" A5="0.000000" '
    b'A6="0.000000"/><IPOC>%b</IPOC></Sen>'
)
SWING_RAD, RATE_RAD_S = 0.2, 1.0


def echo(port: int) -> None:
    """Answer telegrams until the process is ended."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as client:
        client.bind(("127.0.0.1", port))
        while True:
            packet, sender = client.recvfrom(8192)
            stamp = packet[packet.index(BEGIN) + len(BEGIN) : packet.index(END)]
            client.sendto(ANSWER % stamp, sender)


def drive(config: Path) -> None:
    """Answer telegrams until the process is ended. Each cycle makes the same calls to the backend as rtloop,
    during a motion that does not end.
    """
    settings = load_settings(config)
    robot = load_robot(settings)
    backend, measured = RsiBackend(settings, robot.limits), Measured(robot.limits.dof)
    backend.open(np.zeros(robot.limits.dof))
    backend.enable()
    backend.read(measured)
    start, command, cycle = measured.position.copy(), np.zeros((3, robot.limits.dof)), 0
    while True:
        if not backend.wait(1.0):
            continue
        time_s = cycle * settings.rt.period_s
        command[0] = start + SWING_RAD * (1.0 - math.cos(RATE_RAD_S * time_s))
        command[1] = SWING_RAD * RATE_RAD_S * math.sin(RATE_RAD_S * time_s)
        backend.read(measured)
        backend.write(command)
        cycle += 1


def main() -> None:
    rt = load_settings(None).rt
    prepare(rt.priority, rt.cpu, rt.cpu_latency_us)
    freeze_garbage()
    if len(sys.argv) > 2:
        drive(Path(sys.argv[2]))
    else:
        echo(int(sys.argv[1]))


if __name__ == "__main__":
    main()
