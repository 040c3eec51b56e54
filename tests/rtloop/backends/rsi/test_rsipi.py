"""The backend against the controller double of RSIPI, which is not ours.

Oracle: the double's own positions and counts. It reads the Ethernet configuration that cobot writes for it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fri_run import free_udp_port
from lockstep_rsi import rsi_settings
from rsipi_double import made_double

from cobot.config import Settings
from cobot.robot.description import RobotDescription
from rtloop.backends import BackendError, Measured
from rtloop.backends.channel import UdpChannel
from rtloop.backends.rsi import RsiBackend
from rtloop.backends.rsi.options import RsiOptions
from rtloop.backends.rsi.telegrams import layout_of, validity
from rtloop.backends.rsi.xml_reader import MAX_PACKET

DEGREES = 180.0 / np.pi
AXES = [f"A{number}" for number in range(1, 7)]
TAGS = {"axis_tag": "AKorr", "external_tag": "EKorr", "sen_type": "ImFree"}
"""The double knows the elements of the corrections by these names."""


class MadeTime:
    """A channel on loopback, where what was sent is there at once, with a clock of its own."""

    strangers = 0

    def __init__(self, channel: UdpChannel) -> None:
        self._channel = channel
        self.time_s = 0.0

    def receive(self, timeout_s: float) -> list[bytes]:
        packets = self._channel.receive(0.0)
        if not packets:
            self.time_s += max(timeout_s, 0.0)
        return packets

    def send(self, packet: bytes) -> None:
        self._channel.send(packet)

    def close(self) -> None:
        self._channel.close()

    def clock(self) -> float:
        return self.time_s


class Line:
    """The double and the backend on loopback, stepped: a cycle of the one is a cycle of the other."""

    def __init__(self, double: Any, backend: RsiBackend, channel: MadeTime) -> None:
        self.double, self.backend, self.channel = double, backend, channel
        self.measured = Measured(7)
        self.command = np.zeros((3, 7))
        self.problems: list[str] = []

    def cycle(self, *, answered: bool = True) -> None:
        self.channel.time_s += 0.004
        if self.double.running:
            self.double.send_once()
        self._beat(answered=answered)
        while self.backend._beat.due:  # several packets had piled up: their cycles follow at once
            self._beat(answered=answered)
        if self.double.running and self.double.receive_and_process() is not True:
            self.double._apply_holdon_late_cycle()

    def _beat(self, *, answered: bool) -> None:
        try:
            beat = self.backend.wait(1.0 if self.double.running else 0.05)
            self.backend.read(self.measured)
            if beat and answered:
                self.backend.write(self.command)
        except BackendError as exc:
            self.problems.append(str(exc))

    def start(self) -> None:
        """Open and enable; the double sends first."""
        for _ in range(3):
            self.double.send_once()
        self.backend.open(np.zeros(7))
        self.backend.enable()
        while self.double.receive_and_process() is None:
            pass
        self.backend.read(self.measured)
        self.command[0] = self.measured.position
        for _ in range(5):  # the packets of the start are counted
            self.cycle()

    def reset(self) -> None:
        self.backend.recover_step()
        self.cycle()
        while not self.backend.enable_step():
            self.cycle()
        self.problems.clear()
        self.command[:] = 0.0
        self.command[0] = self.measured.position

    def swing(self, cycles: int, amplitude: float = 0.2) -> None:
        start = self.command[0].copy()
        for cycle in range(1, cycles + 1):
            time_s = cycle * 0.004
            self.command[0] = start + amplitude * (1.0 - np.cos(2.0 * time_s))
            self.command[1] = 2.0 * amplitude * np.sin(2.0 * time_s)
            self.cycle()
        self.command[1] = 0.0

    @property
    def position(self) -> list[float]:
        """Where the double says that its axes are, degrees."""
        state = self.double.state
        return [*(state["AIPos"][axis] for axis in AXES), state["EIPos"]["E1"]]


Make = Callable[..., Line]


@pytest.fixture
def make(
    settings: Settings,
    robot: RobotDescription,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> Iterator[Make]:
    made: list[Line] = []

    def line(mode: str = "absolute", timeout: int = 100, **options: Any) -> Line:
        own = {**TAGS, "listen": "127.0.0.1", "port": free_udp_port(), "silence_s": 0.04, **options}
        found = rsi_settings(settings, correction=mode, **own)
        double = made_double(tmp_path, monkeypatch, found, robot.limits, mode=mode, timeout=timeout)
        valid = validity(layout_of(RsiOptions(**found.robot.backend.options), robot.limits))
        udp = UdpChannel("127.0.0.1", own["port"], None, is_valid=valid, max_packet=MAX_PACKET)
        channel = MadeTime(udp)
        backend = RsiBackend(found, robot.limits, channel=channel, clock=channel.clock)
        made.append(Line(double, backend, channel))
        return made[-1]

    yield line
    for each in made:
        each.backend.close()
        each.double.udp_socket.close()


@pytest.mark.parametrize("mode", ["absolute", "relative"])
def test_each_axis_follows_the_command(make: Make, mode: str) -> None:
    line = make(mode)
    line.start()
    late = line.double.faulty_packets
    for _ in range(300):  # the transition to the command
        line.cycle()
    line.swing(1000)
    line.cycle()
    assert not line.problems
    assert line.double.faulty_packets == late
    np.testing.assert_allclose(line.position, DEGREES * line.command[0], atol=2e-6)
    assert min(np.abs(line.position)) > 5.0


def test_it_reads_back_the_outputs(make: Make) -> None:
    line = make(outputs={"open": 1, "close": 2}, inputs={"part": 3})
    line.start()
    line.backend.set_output("close", 1.0)
    for _ in range(3):
        line.cycle()
    assert {point.name: point.value for point in line.backend.io()} == {"part": 0, "open": 0, "close": 1}
    assert line.double.state["Out"] == {"o1": 0.0, "o2": 1.0}


def test_missing_answers_are_counted_and_made_up_for(make: Make) -> None:
    """The double counts them once it hears again, later than a controller."""
    line = make("relative")
    line.start()
    late = line.double.faulty_packets
    for cycle in range(400):
        line.command[0] = 0.1 * (1.0 - np.cos(min(np.pi, 0.01 * cycle)))
        line.cycle(answered=cycle % 20 != 7)
    for _ in range(400):
        line.cycle()
    assert not line.problems
    assert line.double.faulty_packets == late + 20
    assert f"{late + 20} answers late" in line.backend.status().quality
    np.testing.assert_allclose(line.position, DEGREES * line.command[0], atol=0.02)


def test_too_many_missing_answers_end_it_and_a_reset_recovers(make: Make, settings: Settings) -> None:
    line = make(timeout=10)
    line.start()
    line.swing(100, 0.05)
    while line.double.running:
        line.cycle(answered=False)
        line.cycle()
    while not line.problems:
        line.cycle()
    assert "RSI has ended" in line.problems[0]
    assert "answers were late before" in line.problems[0]
    there = line.position
    line.double.running, line.double.faulty_packets = True, 0  # its program runs again
    line.double.base_pose["AIPos"] = dict(line.double.state["AIPos"])
    line.double.base_pose["EIPos"] = dict(line.double.state["EIPos"])
    line.double.state["AxisCorrMon"] = dict.fromkeys(line.double.state["AxisCorrMon"], 0.0)
    line.double.ipoc_value += 4000
    line.command[0] += 0.3
    for _ in range(20):
        line.cycle()
    np.testing.assert_allclose(line.position, there, atol=1e-6)
    line.reset()
    line.swing(200, 0.05)
    assert not line.problems


def test_another_name_of_the_sensor_is_rejected_by_the_double(make: Make) -> None:
    line = make()
    line.double.sentype = "cobot"
    for _ in range(3):
        line.double.send_once()
    line.backend.open(np.zeros(7))
    line.backend.enable()
    line.command[0, 0] = 0.5
    for _ in range(50):
        line.cycle()
    assert line.double.faulty_packets > 40
    assert not any(line.position)
