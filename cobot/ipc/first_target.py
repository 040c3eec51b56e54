"""Checks whether rtloop follows the first target of a session. If not, this module writes the error for the
client.
"""

from __future__ import annotations

import numpy as np

from cobot.foreign import fixed
from cobot.ipc.layout import Intervention, Stream

ADVICE = (
    "A stream must begin at the current position of the arm: send the measured state as the first "
    "target, or move to the first target beforehand. The arm does not move until a target is near "
    "enough; further rejections are only counted"
)


class FirstTarget:
    """Watches a session until its first target is accepted or rejected."""

    def __init__(self, stream: Stream, names: list[str], state: np.ndarray) -> None:
        """
        Args:
            state: record of `cobot.ipc.state_fields.state_dtype`, read before anything is sent.
        """
        self._stream, self._names = stream, names
        self._jumps = _jumps(state)
        self._target: np.ndarray | None = None
        self._position = state["commanded_position"].copy()
        self._known = False

    def note(self, setpoint: np.ndarray) -> None:
        """Record a target before it is sent; the target is a record of `cobot.ipc.layout.setpoint_dtype`.
        Later targets are ignored.
        """
        if self._target is None and setpoint["number"]:
            self._target = setpoint.copy()

    def refusal(self, session: int, state: np.ndarray) -> str:
        """The reason why the first target was rejected. It is returned only once. "" if the target was not
        rejected, or if that is not known yet.
        """
        if self._known or self._target is None:
            return ""
        if int(state["session"]) != session or not int(state["setpoint_seen"]):
            return ""
        self._known = True
        return self._words(state) if _jumps(state) > self._jumps else ""

    def _words(self, state: np.ndarray) -> str:
        assert self._target is not None
        said = "the first target of the stream is too far from the arm and is not followed"
        if self._stream is Stream.JOINT_IMPEDANCE:
            off = np.abs(self._target["joints"] - self._position)
            joint = int(off.argmax())
            said += (
                f": {self._names[joint]} is at {fixed(self._position[joint], 3)}, but the target is at "
                f"{fixed(self._target['joints'][joint], 3)}: {fixed(off[joint], 3)} apart"
            )
        elif self._stream is Stream.CARTESIAN:
            x, y, z = (fixed(value, 3) for value in self._target["pose"][:3])
            said += f": the target is at ({x}, {y}, {z}) m in the base frame"
        return f"{said}. {ADVICE}"


def _jumps(state: np.ndarray) -> int:
    return int(state["interventions"][Intervention.JUMP])
