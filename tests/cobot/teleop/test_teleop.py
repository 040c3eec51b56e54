"""Moving by hand. Oracles: the kernel's format of joystick events; the service on virtual time, whose arm
moves while something is held and rests when it is not."""

from __future__ import annotations

import os
import pty
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import cast

import numpy as np
import pytest
from virtual_service import virtual_service

from cobot.clock import Clock
from cobot.errors import InputError, UnavailableError
from cobot.launch.cli import main
from cobot.teleop.gamepad import Gamepad
from cobot.teleop.hand import JogVelocity
from cobot.teleop.keyboard import HELD_S, Keyboard
from cobot.teleop.teleop import PERIOD_S, Teleoperation

BUTTON, AXIS, INITIAL = 1, 2, 128
LEFT_SHOULDER, RIGHT_SHOULDER, A, START = 4, 5, 0, 7


class Hand:
    """A device that holds what a test says."""

    def __init__(self) -> None:
        self.velocity: JogVelocity | None = None
        self.ended = False

    def read_velocity(self, now_s: float) -> JogVelocity | None:
        return self.velocity

    def close(self) -> None: ...


def event(kind: int, number: int, value: int) -> bytes:
    """As the kernel's documentation of the joystick interface has it: time, value, type, number."""
    return struct.pack("=IhBB", 1234, value, kind, number)


@pytest.fixture
def pad(tmp_path: Path) -> Iterator[tuple[Gamepad, int]]:
    """A gamepad, and where its events are put in."""
    path = tmp_path / "js0"
    os.mkfifo(path)
    gamepad = Gamepad(path)
    events = os.open(path, os.O_WRONLY)
    yield gamepad, events
    gamepad.close()
    os.close(events)


def test_a_stick_moves_nothing_without_the_dead_man_s_button(pad: tuple[Gamepad, int]) -> None:
    gamepad, events = pad
    os.write(events, event(AXIS, 1, -32767))
    assert gamepad.read_velocity(0.0) is None
    os.write(events, event(BUTTON, RIGHT_SHOULDER, 1))
    assert gamepad.read_velocity(0.0) == JogVelocity((1.0, -0.0, -0.0, 0.0, 0.0, -0.0))
    os.write(events, event(BUTTON, RIGHT_SHOULDER, 0))
    assert gamepad.read_velocity(0.0) is None


def test_the_left_button_is_slower_and_a_changes_the_frame(pad: tuple[Gamepad, int]) -> None:
    gamepad, events = pad
    os.write(events, event(BUTTON, A, 1) + event(BUTTON, A, 0))
    os.write(events, event(BUTTON, LEFT_SHOULDER, 1) + event(AXIS, 4, 32767))
    held = gamepad.read_velocity(0.0)
    assert held is not None
    assert held.frame == "tool"
    assert held.twist[2] == pytest.approx(-0.5)


def test_a_stick_that_nobody_touches_is_still(pad: tuple[Gamepad, int]) -> None:
    gamepad, events = pad
    os.write(events, event(BUTTON, RIGHT_SHOULDER, 1) + event(AXIS, 0, 4000) + event(AXIS, 1, -4000))
    assert gamepad.read_velocity(0.0) is None


def test_a_button_that_is_held_at_the_start_counts_for_none(pad: tuple[Gamepad, int]) -> None:
    gamepad, events = pad
    os.write(events, event(BUTTON | INITIAL, RIGHT_SHOULDER, 1) + event(AXIS | INITIAL, 1, -32767))
    assert gamepad.read_velocity(0.0) is None


def test_an_event_may_come_in_parts_and_start_ends(pad: tuple[Gamepad, int]) -> None:
    gamepad, events = pad
    whole = event(BUTTON, START, 1)
    os.write(events, whole[:3])
    gamepad.read_velocity(0.0)
    assert not gamepad.ended
    os.write(events, whole[3:])
    gamepad.read_velocity(0.0)
    assert gamepad.ended


def test_a_gamepad_that_is_pulled_out_lets_go(tmp_path: Path) -> None:
    path = tmp_path / "js0"
    os.mkfifo(path)
    gamepad = Gamepad(path)
    events = os.open(path, os.O_WRONLY)
    os.write(events, event(BUTTON, RIGHT_SHOULDER, 1) + event(AXIS, 1, -32767))
    assert gamepad.read_velocity(0.0) is not None
    os.close(events)
    with pytest.raises(UnavailableError, match="js0: it has been disconnected"):
        gamepad.read_velocity(0.0)
    gamepad.close()
    with pytest.raises(InputError, match="js9: No such file"):
        Gamepad(tmp_path / "js9")


def test_what_is_no_gamepad_is_said_to_be_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "file"
    file.write_bytes(bytes(80))
    for path in (file, tmp_path, Path("/dev/null")):
        with pytest.raises(InputError, match=f"gamepad {path}: is not a gamepad; use one of /dev/input/js"):
            Gamepad(path)
    monkeypatch.setattr("cobot.teleop.gamepad.FOLDER", tmp_path)
    with pytest.raises(InputError, match=r"no js.*; without --gamepad the keyboard is used"):
        Gamepad()


@pytest.fixture
def terminal() -> Iterator[tuple[Keyboard, int]]:
    """A keyboard, and where its keys are put in."""
    ours, theirs = pty.openpty()
    keyboard = Keyboard(theirs)
    yield keyboard, ours
    keyboard.close()
    os.close(ours)
    os.close(theirs)


def pressed(terminal: tuple[Keyboard, int], keys: bytes, now_s: float) -> JogVelocity | None:
    """What is held once the terminal has passed all keys on."""
    keyboard, ours = terminal
    os.write(ours, keys)
    wanted = keyboard._keys
    got = ""
    while len(got) < len(keys):
        got += wanted()
    keyboard._keys = lambda: got  # type: ignore[method-assign]
    try:
        return keyboard.read_velocity(now_s)
    finally:
        keyboard._keys = wanted  # type: ignore[method-assign]


def test_a_key_is_held_for_as_long_as_it_repeats(terminal: tuple[Keyboard, int]) -> None:
    keyboard, _ = terminal
    held = pressed(terminal, b"w", 10.0)
    assert held is not None
    assert held.twist == (1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert keyboard.read_velocity(10.0 + 0.9 * HELD_S) == held
    assert keyboard.read_velocity(10.0 + HELD_S) is None


def test_keys_choose_joints_and_frames_and_any_other_key_lets_go(terminal: tuple[Keyboard, int]) -> None:
    keyboard, _ = terminal
    held = pressed(terminal, b"3-", 1.0)
    assert held is not None
    assert (held.joint, held.share) == (2, -1.0)
    assert pressed(terminal, b" ", 1.01) is None
    held = pressed(terminal, b"tf", 1.02)
    assert held is not None
    assert (held.twist[2], held.frame) == (-1.0, "tool")
    assert pressed(terminal, b"0+", 1.03) is None
    assert pressed(terminal, b"q", 1.04) is None
    assert keyboard.ended


def test_no_terminal_is_said(tmp_path: Path) -> None:
    with (tmp_path / "file").open("w") as file, pytest.raises(InputError, match="there is none"):
        Keyboard(file.fileno())


def test_velocities_as_frames() -> None:
    assert JogVelocity((1.0, 0, 0, 0, 0, -0.5), frame="tool").frame_of(7, 0.5) == {
        "type": "jog",
        "twist": [0.125, 0, 0, 0, 0, -0.125],
        "frame": "tool",
    }
    assert JogVelocity(joint=1, share=-1.0).frame_of(3, 1.0) == {"type": "jog", "joints": [0.0, -0.5, 0.0]}
    with pytest.raises(InputError, match="there is no joint 9: this robot has 7"):
        JogVelocity(joint=8, share=1.0).frame_of(7, 1.0)


def test_the_arm_moves_while_something_is_held_and_rests_when_it_is_not(tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service, service.connect("/robot/stream") as socket:
        hand, lines = Hand(), []
        teleoperation = Teleoperation(socket, hand, 1.0, lines.append, service.clock)

        def go_on(seconds: float) -> None:
            for _ in range(round(seconds / PERIOD_S)):
                teleoperation.once()
                service.sleep(PERIOD_S)

        before = service.joints()[0]
        go_on(0.5)
        assert service.joints()[0] == pytest.approx(before, abs=1e-4)
        hand.velocity = JogVelocity(joint=0, share=1.0)
        go_on(1.0)
        moved = service.joints()[0] - before
        assert moved > 0.2
        hand.velocity = None
        go_on(1.0)
        rests = service.joints()[0]
        assert service.health()["robot"]["settled"]
        hand.velocity = JogVelocity(joint=0, share=-1.0)
        go_on(0.5)
        service.sleep(1.5)  # a program that hangs: no frame comes any more
        assert service.health()["robot"]["settled"]
        assert service.joints()[0] < rests


def test_a_stop_is_not_undone_by_a_hand_that_still_holds(tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service, service.connect("/robot/stream") as socket:
        hand, lines = Hand(), []
        teleoperation = Teleoperation(socket, hand, 0.5, lines.append, service.clock)
        hand.velocity = JogVelocity(joint=0, share=1.0)
        for _ in range(10):
            teleoperation.once()
            service.sleep(PERIOD_S)
        service.post("/stop").raise_for_status()
        for _ in range(40):
            teleoperation.once()
            service.sleep(PERIOD_S)
        there = service.joints()
        for _ in range(10):
            teleoperation.once()
            service.sleep(PERIOD_S)
        assert np.abs(np.subtract(service.joints(), there)).max() < 1e-4
        assert "0% of the speed" in lines[-1]


def test_the_command_names_what_it_lacks(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["teleop", "--url", "http://127.0.0.1:9"]) == 3
    assert "http://127.0.0.1:9" in capsys.readouterr().err
    assert main(["teleop", "--url", "robot"]) == 1
    assert "a valid one is http://localhost:8007" in capsys.readouterr().err
    with pytest.raises(InputError, match="speed must be above 0 and at most 1"):
        Teleoperation(None, Hand(), 0.0, print)  # type: ignore[arg-type]


class LateClock:
    """Whoever asks it has been kept from running for longer than a period."""

    def __init__(self) -> None:
        self.now = 0.0

    def now_s(self) -> float:
        self.now += 1.5 * PERIOD_S
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds >= 0.0


def test_a_computer_that_is_late_ends_nothing() -> None:
    class Socket:
        def send(self, frame: str) -> None: ...

        def recv(self) -> str:
            return '{"type": "hello", "dof": 7}'

    class Ending(Hand):
        looks = 0

        def read_velocity(self, now_s: float) -> None:
            self.looks += 1
            self.ended = self.looks == 5

    hand = Ending()
    Teleoperation(Socket(), hand, 0.5, print, cast(Clock, LateClock())).run()
    assert hand.looks == 5
