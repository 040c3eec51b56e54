"""Obstacles that streams must avoid and that are not part of the model: the scene's objects and the tool's
shapes, read from their files.

A thread reads and compiles the obstacles while the arm is at rest and no session may begin. The cycle only
switches to the finished collision monitor.
"""

from __future__ import annotations

import sys
import threading

from cobot.cell.surroundings import scene_file, tool_file
from cobot.config import Settings
from cobot.errors import CobotError
from cobot.launch.process import leave_real_time
from cobot.robot.model import RobotModel
from rtloop.results import LATER, Later, Rejected
from rtloop.streaming.collision_monitor import CollisionMonitor

SWITCH_S = 1e-4
"""Maximum time for which the thread's Python code may block the cycle, s."""


class Surroundings:
    """Creates collision monitors from the scene and tool files.

    Attributes:
        busy: whether a monitor is being made.
        version: version of the scene that was read last.
    """

    def __init__(self, settings: Settings, model: RobotModel) -> None:
        self._settings = settings
        self._model = model
        self._thread: threading.Thread | None = None
        self._made: CollisionMonitor | Later | Rejected = LATER
        self.version = 0

    @property
    def busy(self) -> bool:
        return self._thread is not None

    def read(self) -> CollisionMonitor:
        """Create a monitor from the files' current content.

        Raises:
            CobotError: a file is damaged, or MuJoCo rejects its content.
        """
        scene = scene_file(self._settings).read(by_voxels=False)
        self.version = scene.version
        tool = tool_file(self._settings).read_checked(
            self._settings.robot.max_payload_kg, self._model.file_gravity
        )
        return CollisionMonitor(
            self._model,
            self._settings.streaming,
            self._settings.rt.period_s,
            self._model.among(scene, tool),
            tool.mounted(scene).may_touch(),
        )

    def begin(self) -> None:
        """Begin to make a monitor in a thread."""
        self._switch_s = sys.getswitchinterval()
        sys.setswitchinterval(SWITCH_S)
        self._thread = threading.Thread(target=self._make, name="surroundings", daemon=True)
        self._thread.start()

    def take(self) -> CollisionMonitor | Later | Rejected:
        """Return the monitor that the thread has finished; `Later` if there has been no new one since the
        last call.
        """
        if self._thread is None or self._thread.is_alive():
            return LATER
        self._thread = None
        sys.setswitchinterval(self._switch_s)
        made, self._made = self._made, LATER
        return made

    def _make(self) -> None:
        leave_real_time()
        try:
            self._made = self.read()
        except CobotError as exc:
            self._made = Rejected(str(exc))
        except Exception as exc:  # noqa: BLE001 - any error must be reported to the cycle
            self._made = Rejected(f"{type(exc).__name__}: {exc}")
