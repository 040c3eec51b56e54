"""The least client of Universal Robots, which repeats the target.

python -m benchmarks.backends.bare_ur SETTINGS
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from cobot.config import load_settings
from cobot.robot.description import load_robot
from rtloop.backends.ur import UrBackend
from rtloop.realtime import freeze_garbage, prepare


def main() -> None:
    """Repeat the target, as punctually as rtloop, until the process is ended."""
    settings = load_settings(Path(sys.argv[1]))
    backend = UrBackend(settings, load_robot(settings).limits)
    backend.open(np.zeros(6))
    backend.enable()
    prepare(settings.rt.priority, settings.rt.cpu, settings.rt.cpu_latency_us)
    freeze_garbage()
    link, program, transport = backend._link, backend._program, backend._transport
    while True:
        for data in link.poll():
            program.send_position(data["target_q"], 1)
        transport.wait(link.streams, 1.0)


if __name__ == "__main__":
    main()
