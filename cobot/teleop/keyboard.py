"""The keyboard of a terminal. A key is considered held while it repeats, because a terminal does not report
when a key is released.
"""

from __future__ import annotations

import os
import termios
import tty
from dataclasses import replace

from cobot.errors import InputError, UnavailableError
from cobot.teleop.hand import JogVelocity

HELD_S = 0.2
"""Time without a repetition after which a key is considered released, s."""
TWISTS = {
    key: tuple(way if axis == each else 0.0 for each in range(6))
    for axis, keys in enumerate(("ws", "ad", "rf", "uo", "ik", "jl"))
    for key, way in zip(keys, (1.0, -1.0), strict=True)
}
WAYS = {"+": 1.0, "=": 1.0, "-": -1.0}
END = "\x1bq\x03\x04"
"""The keys Escape, q, Ctrl-C and Ctrl-D."""
HELP = """\
w s  forward, back    a d  left, right    r f  up, down
u o  about x          i k  about y        j l  about z
1 to 9  a joint, which + and - move       0  the TCP again
t  base or tool       q  end              release all keys: the arm stops"""


class Keyboard:
    """
    Args:
        descriptor: descriptor of the terminal. The terminal passes on each key immediately, until `close`.

    Raises (constructor):
        InputError: the descriptor is not a terminal.
    """

    def __init__(self, descriptor: int = 0) -> None:
        self._descriptor = descriptor
        try:
            self._before = termios.tcgetattr(descriptor)
            tty.setcbreak(descriptor)
        except termios.error as exc:
            raise InputError(
                "the keyboard needs a terminal, and there is none; use a terminal or --gamepad"
            ) from exc
        os.set_blocking(descriptor, False)
        self._velocity: JogVelocity | None = None
        self._until_s = 0.0
        self._joint: int | None = None
        self._frame = "base"
        self._ended = False

    @property
    def ended(self) -> bool:
        return self._ended

    def read_velocity(self, now_s: float) -> JogVelocity | None:
        for key in self._keys():
            self._take(key, now_s)
        if now_s >= self._until_s:
            self._velocity = None
        return self._velocity

    def close(self) -> None:
        os.set_blocking(self._descriptor, True)
        termios.tcsetattr(self._descriptor, termios.TCSADRAIN, self._before)

    def _keys(self) -> str:
        try:
            content = os.read(self._descriptor, 1024)
        except BlockingIOError:
            return ""
        except OSError as exc:
            raise UnavailableError(f"the terminal: {exc.strerror}") from exc
        if not content:
            raise UnavailableError("the terminal has been closed")
        return content.decode("ascii", "ignore")

    def _take(self, key: str, now_s: float) -> None:
        velocity = None
        if key in END:
            self._ended = True
        elif key == "t":
            self._frame = "tool" if self._frame == "base" else "base"
        elif key.isdecimal():
            self._joint = int(key) - 1 if key != "0" else None
        elif key in TWISTS:
            velocity = JogVelocity(TWISTS[key], frame=self._frame)
        elif key in WAYS and self._joint is not None:
            velocity = replace(JogVelocity(), joint=self._joint, share=WAYS[key])
        self._velocity, self._until_s = velocity, now_s + HELD_S  # any other key ends the motion
