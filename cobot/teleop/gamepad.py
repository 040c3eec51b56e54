"""A gamepad, through the joystick interface of Linux: /dev/input/js0, events of eight bytes.

The arm moves only while a dead-man button is held: the left shoulder button for half speed, the right one for
full speed. The left stick moves the TCP horizontally. The right stick moves it up and down and turns it about
the vertical axis. The cross turns it about the two other axes. The numbers of buttons and sticks are those of
the kernel's driver for Xbox pads, which other drivers also use.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import stat
import struct
from pathlib import Path

from cobot.errors import InputError, UnavailableError
from cobot.teleop.hand import JogVelocity

EVENT = struct.Struct("<IhBB")
"""An event: time in ms, value, kind and number."""
GET_VERSION = 0x80046A01
"""The request JSIOCGVERSION in linux/joystick.h. Only joysticks answer it."""
BUTTON, AXIS, INITIAL = 0x01, 0x02, 0x80
FULL = 32767
DEAD_ZONE = 0.15
"""Largest reading of an untouched stick, as a fraction of its range."""
SLOW, FAST, TOOL, END = 4, 5, 0, 7
"""Numbers of the buttons: left shoulder, right shoulder, A, start."""
SLOW_SHARE = 0.5
LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, CROSS_X, CROSS_Y = 0, 1, 3, 4, 6, 7
FOLDER = Path("/dev/input")


class Gamepad:
    """A gamepad.

    Args:
        path: path of its device; by default the first gamepad that is found.

    Raises (constructor): InputError: there is no gamepad, or it cannot be read.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._path = path or _first()
        try:
            self._file = os.open(self._path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError as exc:
            raise InputError(f"gamepad {self._path}: {exc.strerror}") from exc
        if not _has_events(self._file):
            self.close()
            raise InputError(f"gamepad {self._path}: is not a gamepad; use one of {FOLDER}/js*")
        self._axes: dict[int, float] = {}
        self._buttons: dict[int, bool] = {}
        self._part = b""
        self._tool = False
        self._ended = False

    @property
    def ended(self) -> bool:
        return self._ended

    def read_velocity(self, now_s: float) -> JogVelocity | None:
        self._read()
        share = 1.0 if self._buttons.get(FAST) else SLOW_SHARE if self._buttons.get(SLOW) else 0.0
        if not share:
            return None
        along = (-self._axis(LEFT_Y), -self._axis(LEFT_X), -self._axis(RIGHT_Y))
        about = (self._axis(CROSS_X), self._axis(CROSS_Y), -self._axis(RIGHT_X))
        twist = tuple(share * value for value in (*along, *about))
        return JogVelocity(twist, frame="tool" if self._tool else "base") if any(twist) else None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            os.close(self._file)

    def _axis(self, number: int) -> float:
        value = self._axes.get(number, 0.0)
        beyond = max(0.0, abs(value) - DEAD_ZONE) / (1.0 - DEAD_ZONE)
        return beyond if value > 0.0 else -beyond

    def _read(self) -> None:
        """Read the available events. An incomplete event is kept until its remaining bytes arrive."""
        while True:
            try:
                content = os.read(self._file, 64 * EVENT.size)
            except BlockingIOError:
                return
            except OSError as exc:
                self._buttons.clear()
                raise UnavailableError(f"gamepad {self._path}: {exc.strerror}") from exc
            if not content:
                self._buttons.clear()
                raise UnavailableError(f"gamepad {self._path}: it has been disconnected")
            whole = self._part + content
            end = len(whole) // EVENT.size * EVENT.size
            self._part = whole[end:]
            for _, value, kind, number in EVENT.iter_unpack(whole[:end]):
                self._take(value, kind, number)

    def _take(self, value: int, kind: int, number: int) -> None:
        if kind & ~INITIAL == AXIS:
            self._axes[number] = max(-1.0, value / FULL)
        elif kind & ~INITIAL == BUTTON:
            self._buttons[number] = (
                bool(value) and not kind & INITIAL
            )  # a button that was held before the start is ignored
            if value and not kind & INITIAL:
                self._tool ^= number == TOOL
                self._ended |= number == END


def _has_events(descriptor: int) -> bool:
    """Whether the file provides joystick events. It may be a kernel joystick device, or a pipe from another
    program.
    """
    if stat.S_ISFIFO(os.fstat(descriptor).st_mode):
        return True
    try:
        fcntl.ioctl(descriptor, GET_VERSION, bytes(4))
    except OSError:
        return False
    return True


def _first() -> Path:
    found = sorted(FOLDER.glob("js*"))
    if not found:
        raise InputError(f"there is no gamepad: no js* in {FOLDER}; without --gamepad the keyboard is used")
    return found[0]
