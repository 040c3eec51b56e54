"""A device that fails under the whole service, on virtual time, in the middle of a motion or a stream.

Each fault finds the arm that the one before has left. Oracle: `faults.Record`, which sees every cycle.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Iterator

import numpy as np
import pytest
from faults import Record
from virtual_service import VirtualService

from cobot import Mode, Robot
from cobot.errors import CobotError
from cobot.types import LoopMode
from rtloop.modes import STREAMING

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
GOALS = [[0.8, 0.3, -0.3, -1.2, 0.3, 1.2, 0.5], HOME]
BUSY = {LoopMode.TRAJECTORY, *STREAMING}
GOOD: dict[str, object] = {
    "fail_read": "",
    "fail_write": "",
    "drive_fault": "",
    "stale": False,
    "not_finite": False,
    "jump": np.zeros(7),
}


@pytest.fixture
def record(service: VirtualService) -> Record:
    rig = service.rig
    made = Record(rig.limits, rig.settings.rt.period_s)
    service.cycles[service.name].watch = lambda: made.add(rig.memory.state.data)
    return made


def breaks(service: VirtualService, faults: dict[str, object]) -> None:
    """Break the simulated device, or mend it."""
    for name, value in faults.items():
        setattr(service.rig.simulation, name, value)


class Motion:
    """A planned motion, begun by an HTTP client that waits for its end."""

    def __init__(self, service: VirtualService) -> None:
        self._service = service
        here = np.array(service.joints())
        goal = max(GOALS, key=lambda goal: np.abs(here - goal).max())
        body = {"joints": goal, "speed": 0.15}
        self._task = service.begin(service.asking("POST", "/robot/move/joints", json=body))
        service.until(lambda: service.health()["robot"]["mode"] == "TRAJECTORY")
        service.sleep(0.3)

    def error(self) -> str:
        """What its client was told."""
        return self._service.end(self._task).text

    def end(self) -> None:
        self._service.post("/stop")
        self._service.end(self._task)


class Streaming:
    """A client that streams joints."""

    def __init__(self, service: VirtualService) -> None:
        self._service = service
        self._robot = Robot(service.name, verbose=False, clock=service.clock, client=service.client)
        self._robot.switch_mode(Mode.RT_JOINT_IMPEDANCE)
        self._control = self._robot.start_joint_impedance_control(100)
        self._task = service.begin(self._stream(self._control.get_state().q))
        service.sleep(0.5)

    async def _stream(self, home: list[float]) -> str:
        begin_s = self._service.clock.now_s()
        try:
            while True:
                angle = 0.1 * (1.0 - np.cos(2.0 * (self._service.clock.now_s() - begin_s)))
                self._control.set_target_joints([home[0] + angle, *home[1:]])
                await asyncio.sleep(0.01)
        except CobotError as exc:
            return f"{type(exc).__name__}: {exc}"

    def error(self) -> str:
        return self._service.end(self._task)

    def end(self) -> None:
        self._task.cancel()
        with contextlib.suppress(CobotError):
            self._robot.close()


TASKS = {"motion": Motion, "stream": Streaming}


@contextlib.contextmanager
def doing(service: VirtualService, task: str) -> Iterator[Motion | Streaming]:
    made = TASKS[task](service)
    try:
        yield made
    finally:
        made.end()


def require_recovery(service: VirtualService, record: Record, task: str) -> None:
    """The arm can do the task as before; no limit was violated at any time."""
    service.until(lambda: service.health()["robot"]["mode"] in ("HOLD", "ESTOP", "FAULT"))
    service.until(lambda: service.post("/robot/reset").status_code == 200 and service.healthy())
    before = len(record.modes)
    with doing(service, task):
        pass
    assert BUSY & set(record.modes[before:])
    service.until(lambda: service.health()["robot"]["mode"] == "HOLD")
    assert record.violations() == []
    assert len(record.cycles) > 500


@pytest.mark.parametrize("task", TASKS)
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        ({"fail_read": "no answer"}, "reading from the robot failed: no answer"),
        ({"fail_write": "no answer"}, "writing to the robot failed: no answer"),
        ({"stale": True}, "has reported the same values"),
        ({"jump": np.array([0.0, 0.05, 0.0, 0.0, 0.0, 0.0, 0.0])}, "has jumped by 0.0"),
        ({"not_finite": True}, "the robot reports a value that is not finite"),
        ({"drive_fault": "drive 3 hot"}, "drive 3 hot"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, dict) else "",
)
def test_a_device_that_fails_is_reported_and_may_be_used_again(
    service: VirtualService, record: Record, task: str, fault: dict[str, object], reason: str
) -> None:
    try:
        with doing(service, task) as done:
            breaks(service, fault)
            service.until(lambda: service.health()["robot"]["mode"] == "FAULT")
            assert reason in str(service.health()["problems"])
            stopped = service.post("/stop").json()
            assert stopped["at_rest"] == bool({"fail_write", "jump"} & fault.keys()), "if it can be measured"
            if task == "stream":
                error = done.error()
                assert reason in error or "UnavailableError" in error
    finally:
        breaks(service, GOOD)
    require_recovery(service, record, task)
