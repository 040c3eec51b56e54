"""The streaming backend with a simulated forward position controller in the same process, which counts
periods, for the contract checks.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cobot.config import Settings
from cobot.types import Array, JointLimits
from rtloop.backends.protocols import Backend
from rtloop.backends.ros2_control.link import Facts

TOPIC, CONTROLLER = "/forward_position_controller/commands", "forward_position_controller"
SILENCE_S = 5.0
LOST_EACH = 20
STOPS = frozenset({"e_stop", "protective_stop"})


class StreamRig:
    """A `ContractRig` for streaming. A stop of the robot deactivates the controller, as drivers do. Its
    faults do not include reordered packets, because DDS restores the order.
    """

    faults = frozenset({"disconnect", "frozen", "nan", "loss", *STOPS})

    def __init__(self, kind: Callable[..., Backend], settings: Settings, limits: JointLimits) -> None:
        self._kind, self._settings, self._limits = kind, settings, limits
        start = 0.4 * limits.min_position + 0.6 * limits.max_position
        self.position = np.where(np.isfinite(start), start, 0.0)
        self.before = self.position.copy()
        self.names = list(limits.names)
        self.period_s = settings.rt.period_s
        self.active: set[str] = set()
        self.gpio: dict[str, float] = {}
        self.wire: list[Array] = []

    def backend(self) -> Backend:
        return self._kind(self._settings, self._limits, RigStream(self))

    def inject(self, fault: str) -> None:
        self.active.add(fault)

    def clear(self, fault: str) -> None:
        self.active.discard(fault)


class RigStream:
    """A `StreamLink` to the simulated controller of the rig."""

    threaded = False

    def __init__(self, rig: StreamRig) -> None:
        self._rig = rig
        self._seen = np.zeros((3, len(rig.names)))
        self._seen[0] = rig.position
        self._count = 0

    def open(self) -> None: ...

    def close(self) -> None: ...

    def pause(self, duration_s: float) -> None: ...

    def set_output(self, interface: str, value: float) -> None:
        self._rig.gpio[interface] = value

    def forget(self) -> None: ...

    def load(self, times_s: Array, rows: Array) -> None: ...

    def start(self) -> None: ...

    def cancel(self) -> str:
        return ""

    def facts(self) -> Facts:
        rig = self._rig
        rows = np.zeros((3, len(rig.names)))
        age_s = self.latest(rows)
        state = "inactive" if STOPS & rig.active else "active"
        return Facts(
            action=TOPIC,
            ready="disconnect" not in rig.active,
            controllers=[{"name": CONTROLLER, "state": state, "joints": rig.names}],
            controller=CONTROLLER,
            age_s=age_s,
            rate_hz=1.0 / rig.period_s,
            position=rows[0].tolist(),
            velocity=rows[1].tolist(),
            gpio=dict(rig.gpio),
            gpio_age_s=0.0,
            effort=rows[2].tolist(),
        )

    def latest(self, rows: Array) -> float:
        rig = self._rig
        away = "disconnect" in rig.active
        if not (away or "frozen" in rig.active):
            self._seen[0] = rig.position
            self._seen[1] = (rig.position - rig.before) / rig.period_s
        rows[:] = self._seen
        if "nan" in rig.active:
            rows[0, 0] = np.nan
        return SILENCE_S if away else 0.0

    def command(self, position: Array) -> None:
        rig = self._rig
        self._count += 1
        rig.before[:] = rig.position
        if "disconnect" in rig.active or STOPS & rig.active:
            return
        if "loss" in rig.active and self._count % LOST_EACH == 0:
            return
        rig.position[:] = position
        rig.wire.append(position.copy())
