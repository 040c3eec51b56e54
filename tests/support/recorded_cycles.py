"""Cycles as rtloop would record them, and a recorder that is stepped by hand."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from cobot_run import unique_name
from rig import Rig

from cobot.config import RecordingSection, Settings
from cobot.ipc.recording_memory import RecordingMemory
from cobot.ipc.state_fields import state_dtype
from cobot.recorder.robot import RobotRecorder
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode
from rtloop.recording import CycleRecorder

PERIOD_NS = 1_000_000
MEASURED = ("position", "velocity", "effort", "desired_effort", "external_effort")
COMMANDED = ("commanded_position", "commanded_velocity", "commanded_acceleration")


class Cycles:
    """Writes cycles of random values into a recording memory.

    Attributes:
        written: the values of each cycle, by name.
        folder: of the recordings.
    """

    def __init__(
        self, settings: Settings, robot: RobotDescription, folder: Path, ring_s: float = 8.0
    ) -> None:
        section = RecordingSection(folder=None, ring_s=ring_s, before_s=2.0, after_s=0.5, max_mb=200)
        name = settings.robot.model_copy(update={"name": unique_name()})
        self.settings = settings.model_copy(update={"robot": name, "logs": folder, "recording": section})
        self.robot = robot
        self.dof = robot.limits.dof
        self.memory = RecordingMemory.create(
            self.settings.robot.name, self.dof, 0.001, ring_s, robot.limits.names
        )
        self.folder = self.settings.recording_folder
        self._random = np.random.default_rng(5)
        self._rig = Rig(settings, robot)
        self._writer = CycleRecorder(self.memory)
        self._now_ns = time.monotonic_ns()
        self._recorder: RobotRecorder | None = None
        self.number = 0
        self.written: list[dict[str, np.ndarray]] = []

    def close(self) -> None:
        self._kill()
        self._rig.close()
        self.memory.unlink()

    def _kill(self) -> None:
        """Of its files stays what it has handed over to the system."""
        for writing in self._recorder._writings if self._recorder else ():
            writing.file._file.close()

    def restart_rtloop(self) -> None:
        """As after kill -9: another process goes on with the numbers."""
        self._writer = CycleRecorder(self.memory)

    def write(self, count: int, mode: LoopMode = LoopMode.HOLD, reason: str = "", **more: float) -> None:
        """So many cycles more; with more of the state's scalars by their names."""
        state = np.zeros((), state_dtype(self.dof))
        for field, value in more.items():
            state[field] = value
        safety = self._rig.loop.controller.safety
        for _ in range(count):
            self.number += 1
            self._now_ns += PERIOD_NS
            state["cycle"], state["mode"] = self.number, mode
            state["monotonic_ns"] = self._now_ns
            state["measured_monotonic_ns"] = self._now_ns - 50_000
            state["path_time_s"] = 0.001 * self.number
            measured = self._random.normal(size=5 * self.dof + 12)
            command = self._random.normal(size=(3, self.dof))
            tcp = self._random.normal(size=7)
            phases = self._random.integers(0, 1_000_000, 4)
            rows = zip(MEASURED, measured[: 5 * self.dof].reshape(5, self.dof), strict=True)
            for name, row in [*rows, *zip(COMMANDED, command, strict=True)]:
                state[name] = row
            state["wrench"], state["sensor"], state["tcp"] = measured[-12:-6], measured[-6:], tcp
            self._writer.heed(safety, reason, mode, self.number, self._now_ns)
            self._writer.record(state, phases, fresh=True)
            self.written.append({"measured": measured, "command": command, "tcp": tcp, "phases": phases})

    def recorder(self) -> RobotRecorder:
        """One that is stepped by hand, as a new process would begin. The one before it has been killed."""
        self._kill()
        self._recorder = made = RobotRecorder(
            self.settings, RecordingMemory.attach(self.memory.robot, history=True)
        )
        made.take_over()
        return made

    def names(self) -> list[str]:
        """Of the finished recordings, the oldest first."""
        return sorted(file.name for file in self.folder.glob("*.mcap"))


def stepped(recorder: RobotRecorder, times: int = 200) -> None:
    """Until there is nothing more to write."""
    for _ in range(times):
        if not recorder.step():
            return
    raise AssertionError(f"still busy after {times} steps")
