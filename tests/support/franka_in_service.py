"""A Franka in rtloop's own process, for a whole service: `robot.backend: {type: franka_in_service:StandIn}`.

The backend is that of a robot; in place of pylibfranka is the stand-in that the contract runs on, with the
dynamics of the model under its torques, and in real time. It waits for a busy computer. Its `address` is
where it listens: a datagram {"fault": NAME} has one of its faults last, "" none; the answer is how it is.
"""

from __future__ import annotations

import json
import socket
import time
from typing import Any, ClassVar

import mujoco
import numpy as np

from cobot.config import Settings
from cobot.robot.model import RobotModel
from cobot.types import Array, JointLimits
from rtloop.backends.franka import FrankaBackend
from rtloop.backends.franka.options import FrankaOptions
from rtloop.backends.franka.rig import FrankaRig
from rtloop.backends.franka.stand_in import PERIOD_S, FrankaStandIn

PUBLISHED = np.array(
    [
        [2.175] * 4 + [2.61] * 3,
        [10.0, 7.5, 10.0, 10.0, 10.0, 10.0, 10.0],
        [5000.0, 3750.0, 5000.0, 5000.0, 5000.0, 5000.0, 5000.0],
    ]
)
"""The least of what Franka Robotics publishes for the FR3 and the Panda: rad/s, rad/s², rad/s³."""


class MovingArm(FrankaStandIn):
    """Attributes:
    worst: shares of velocity, acceleration and jerk of commanded positions, of what is published.
    """

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        super().__init__()
        names = settings.robot
        self._model = RobotModel.load(names.model, limits, base=names.base_frame, tcp=names.tcp).mj
        self._data = mujoco.MjData(self._model)
        self._gravity = np.zeros(limits.dof)
        self._due_s = 0.0
        self.worst = np.zeros(3)

    def move(self, position: Array) -> None:
        super().move(position)
        del self.wire[:-4]
        rows = (
            (self.positions[:1] * 3 + self.positions)[-4:] if len(self.positions) < 4 else self.positions[-4:]
        )
        for order in (1, 2, 3):
            rates = np.abs(np.diff(rows[-1 - order :], order, axis=0)) / PERIOD_S**order
            self.worst[order - 1] = max(self.worst[order - 1], (rates / PUBLISHED[order - 1]).max())

    def turn(self, torque: Array) -> None:
        """As its own dynamics have it; it makes up for gravity."""
        data = self._data
        mujoco.mj_step1(self._model, data)
        velocity = data.qvel.copy()
        data.qvel[:] = 0.0
        mujoco.mj_rne(self._model, data, 0, self._gravity)
        data.qvel[:] = velocity
        data.qfrc_applied[:] = torque + self._gravity
        mujoco.mj_step2(self._model, data)
        self.q = self.q_d = data.qpos.copy()
        del self.torques[:-4]

    def begin(self, kind: str) -> None:
        self._data.qpos[:], self._data.qvel[:] = self.q, 0.0

    def velocity(self) -> list[float]:
        found: list[float] = self._data.qvel.tolist()
        return found if self.controlled == "torques" else super().velocity()

    def pass_period(self) -> None:
        self._due_s = max(self._due_s + PERIOD_S, time.monotonic())
        time.sleep(max(0.0, self._due_s - time.monotonic()))


class StandIn(FrankaBackend):
    Options: ClassVar[type[FrankaOptions]] = FrankaOptions
    sdk: ClassVar[str] = ""

    def __init__(self, settings: Settings, limits: JointLimits) -> None:
        self._arm = MovingArm(settings, limits)
        super().__init__(settings, limits, library=self._arm.library, knock=self._arm.knock)
        self._faults = FrankaRig(settings, limits, self._arm)
        host, _, port = self._options.address.rpartition(":")
        self._asked = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._asked.bind((host, int(port)))
        self._asked.setblocking(False)

    def wait(self, timeout_s: float) -> bool:
        self._heed()
        self._arm.pass_period()
        return super().wait(timeout_s)

    def close(self) -> None:
        super().close()
        self._asked.close()

    def _heed(self) -> None:
        try:
            content, sender = self._asked.recvfrom(1000)
        except BlockingIOError:
            return
        request: dict[str, Any] = json.loads(content)
        for fault in list(self._arm.faults):
            self._faults.clear(fault)
        if request["fault"]:
            self._faults.inject(request["fault"])
        told = {"q": self._arm.q.tolist(), "worst": self._arm.worst.tolist()}
        self._asked.sendto(json.dumps(told).encode(), sender)
