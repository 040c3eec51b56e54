"""Creates the answers to the controller's packets."""

from __future__ import annotations

import numpy as np

from cobot.types import Array
from rtloop.backends.beat import CommandTransition
from rtloop.backends.fri.encoding import encode_command
from rtloop.backends.fri.messages import (
    COMMAND_ID,
    CommandMessage,
    FriHeader,
    MonitoringMessage,
    SessionState,
)
from rtloop.backends.fri.options import FriOptions
from rtloop.backends.fri.outputs import Outputs
from rtloop.backends.fri.session import interpolator
from rtloop.results import ACCEPTED, Accepted, Rejected

_COUNTER = 1 << 32


class Answers:
    """Answers to the packets of one session.

    Attributes:
        torque, wrench: torques and wrench that are sent with the position, shapes (dof,) and (6,), N·m and N.
        outputs: outputs to set at the cabinet.
    """

    def __init__(self, options: FriOptions, names: tuple[str, ...], period_s: float) -> None:
        self._options, self._names = options, names
        self._entry = CommandTransition(len(names), period_s)
        self.torque, self.wrench = np.zeros(len(names)), np.zeros(6)
        self.outputs = Outputs(period_s)
        self._sequence = self._unanswered = 0

    @property
    def are_begun(self) -> bool:
        """Whether commands have been sent during the controller's current motion."""
        return self._entry.sent is not None

    def forget(self) -> None:
        """Handle the end of the controller's motion. The next motion begins at the arm's position."""
        self._entry.forget()

    def held(self, message: MonitoringMessage) -> tuple[float, ...]:
        """Return the position that the arm holds: the last command during a motion, otherwise the position of
        the controller's interpolator.
        """
        sent = self._entry.sent
        if sent is None or message.state != SessionState.COMMANDING_ACTIVE:
            return interpolator(message)
        return tuple(sent.tolist())

    def begin(self, message: MonitoringMessage, command: Array) -> Accepted | Rejected:
        """Begin to command the arm at the position that the controller holds, if the first command is close
        to this position.
        """
        here = np.array(self.held(message))
        off = np.abs(here - command)
        joint = int(off.argmax())
        if not off[joint] <= self._options.entry_rad:
            return Rejected(
                f"{self._names[joint]} is commanded {off[joint]:.4f} rad from the controller's "
                f"interpolator, allowed: {self._options.entry_rad} rad (robot.backend.entry_rad)"
            )
        self._entry.begin(here, command)
        return ACCEPTED

    def encode(self, message: MonitoringMessage, command: Array | None) -> bytes:
        """Encode the answer to a packet; b"" if the packet needs none.

        Args:
            command: joint positions, shape (dof,), rad. If None, the arm stays at the controller's position.
        """
        position = self.held(message)
        if command is not None:
            position = tuple(self._entry.follow(command).tolist())
            self._entry.pass_period()
        self._unanswered += 1
        if message.state == SessionState.IDLE or self._unanswered < message.receive_multiplier:
            return b""
        self._unanswered = 0
        self._sequence = (self._sequence + 1) % _COUNTER
        return encode_command(
            CommandMessage(
                FriHeader(COMMAND_ID, self._sequence, message.header.sequence),
                position=position,
                torque=self._overlaid("torque", self.torque, message, command),
                wrench=self._overlaid("wrench", self.wrench, message, command),
                io=self.outputs.values_in_answer(message, self._sequence),
                framed=message.framed,
            )
        )

    def _overlaid(
        self, overlay: str, values: Array, message: MonitoringMessage, command: Array | None
    ) -> tuple[float, ...]:
        if self._options.overlay != overlay or message.state < SessionState.COMMANDING_WAIT:
            return ()
        return tuple(values.tolist()) if command is not None else (0.0,) * len(values)
