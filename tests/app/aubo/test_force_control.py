"""ForceControl on the stepped simulation.

Oracles: MuJoCo's contact force on the floor; what the test pushes with; the cycle itself
(tests/support/rig.py).
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from rig import Rig, no_tokens
from vendor_calls import Caller, run

from app.services.motion.execution import MotionService
from app.services.motion.planning import PlanningService
from app.services.programs.sequences import SequenceService
from app.services.rights.ownership import Ownership
from app.services.rights.stopping import StopService
from app.services.state.link import RobotLink
from app.services.streaming.force import ForceService
from app.services.streaming.sessions import StreamService
from cobot.codes import Code
from cobot.config import Settings
from cobot.robot.description import RobotDescription
from cobot.robot.inverse_kinematics import inverse
from cobot.types import Array, LoopMode, Pose
from rtloop.main import describe

CLASS = "ForceControl"
DOWN = [False, False, True, False, False, False]
HEIGHT_M = 0.02


class Bench:
    """The simulated arm above the floor, and the service on it."""

    def __init__(self, settings: Settings, robot: RobotDescription) -> None:
        home = np.array(robot.positions["home"].joints)
        goal = Pose(np.array([0.5, 0.0, HEIGHT_M]), robot.model.forward(home).quaternion)
        self.rig = Rig(settings, robot, simulated=True, start=inverse(robot.model, goal, home))
        describe(self.rig.memory, robot, self.rig.simulation)
        self.rig.step(50)
        self.link = RobotLink(self.rig.memory.path.name.removeprefix("cobot-"), 60.0)
        self.ownership = Ownership(self.link)
        self.planning = PlanningService(None, 1)
        motion = MotionService(robot, self.link, self.planning)
        self.streams = StreamService(self.link, self.ownership, motion, settings.streaming)
        url, tokens = "http://robot.test", no_tokens()
        sequences = SequenceService(self.ownership, self.link, settings.sequences, url, 1.0, tokens)
        self.stopping = StopService(self.link, self.ownership, sequences.stop)
        self.reports: list[str] = []
        self.force = ForceService(robot, self.link, self.streams, self.stopping, self.reports.append)
        self.ask = Caller(SimpleNamespace(force=self.force), CLASS)

    def close(self) -> None:
        self.force.close()
        self.planning.close()
        self.link.close()
        self.rig.close()

    async def during(self, work: Any) -> Any:
        """The result of `work` while the cycle goes on."""
        task = asyncio.ensure_future(work)
        while not task.done():
            await self.live(5)
        return task.result()

    async def live(self, cycles: int) -> None:
        """The cycle and the service's loop, in step: whoever sleeps in the loop gets his turn."""
        for _ in range(cycles):
            self.rig.step()
            if len(self.rig.commanded) % 5 == 0:
                await asyncio.sleep(0.001)

    async def until(self, condition: Any, cycles: int = 30_000) -> None:
        for _ in range(cycles // 10):
            if condition():
                return
            await self.live(10)
        raise AssertionError(f"not within {cycles} cycles: {self.rig.mode}, {self.rig.reason}")

    @property
    def floor_force(self) -> float:
        model, data = self.rig.simulation._model, self.rig.simulation._data
        total, one = 0.0, np.zeros(6)
        for index in range(data.ncon):
            mujoco.mj_contactForce(model, data, index, one)
            total += one[0]
        return total

    @property
    def tcp(self) -> Array:
        found: Array = self.rig.memory.state.data["tcp"].copy()
        return found

    async def target(self, newtons: float, code: Code = Code.OK, **changes: Any) -> None:
        fields = {
            "feature": [],
            "compliance": DOWN,
            "wrench": [0.0, 0.0, newtons, 0.0, 0.0, 0.0],
            "limits": [],
            "frame_type": 2,
        }
        answer = await self.ask.answer("setTargetForce", **{**fields, **changes})
        assert answer.code == code, answer


@pytest.fixture
def bench(settings: Settings, robot: RobotDescription) -> Iterator[Bench]:
    made = Bench(settings, robot)
    yield made
    made.close()


def test_ten_newtons_on_the_floor_are_ten_newtons_and_twenty_are_twenty(bench: Bench) -> None:
    async def check() -> None:
        await bench.target(-10.0)
        await bench.during(bench.ask("fcEnable"))
        assert await bench.ask("isFcEnabled")
        begin = bench.tcp
        await bench.until(lambda: bench.floor_force > 1.0)
        for newtons in (10.0, 20.0):
            await bench.target(-newtons)
            await bench.live(4000)
            forces = []
            for _ in range(500):
                await bench.live(1)
                forces.append(bench.floor_force)
            assert np.mean(forces) == pytest.approx(newtons, abs=0.05 * newtons)
            assert (await bench.ask("getExternalWrench"))[2] == pytest.approx(newtons, rel=0.1)
        np.testing.assert_allclose(bench.tcp[:2], begin[:2], atol=2e-3)
        await bench.during(bench.ask("fcDisable"))
        assert not await bench.ask("isFcEnabled")
        assert bench.rig.mode is LoopMode.HOLD
        assert bench.ownership.owner is None

    run(check())


def test_without_a_force_axis_the_pose_is_held_like_a_spring(bench: Bench) -> None:
    async def check() -> None:
        stiffness = [2000.0, 2000.0, 2000.0, 200.0, 200.0, 200.0]
        await bench.ask("setDynamicModel", m=[], d=[], k=stiffness)
        await bench.target(0.0, compliance=[False] * 6)
        await bench.during(bench.ask("fcEnable"))
        begin = bench.tcp
        bench.rig.simulation.push[0] = 30.0
        await bench.live(2500)
        assert bench.tcp[0] - begin[0] == pytest.approx(30.0 / 2000.0, rel=0.1)
        await bench.during(bench.ask("fcDisable"))

    run(check())


def test_beyond_a_threshold_the_arm_stops_and_the_reason_is_told(bench: Bench) -> None:
    async def check() -> None:
        await bench.ask("fcSetSensorThresholds", thresholds=[25.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        await bench.target(0.0, compliance=[False] * 6)
        await bench.during(bench.ask("fcEnable"))
        bench.rig.simulation.push[1] = 40.0  # no threshold along y
        await bench.live(500)
        assert await bench.ask("isFcEnabled")
        bench.rig.simulation.push[0] = 40.0
        await bench.until(lambda: not bench.force.settings.enabled)
        await bench.until(lambda: bench.rig.mode is LoopMode.HOLD)
        reason = await bench.ask("getFcEndReason")
        assert "along or about x exceed the threshold of 25" in reason
        assert any(reason in report for report in bench.reports)
        await bench.until(lambda: bench.ownership.owner is None)

    run(check())


def test_beyond_a_limit_the_real_time_process_ends_it(bench: Bench) -> None:
    async def check() -> None:
        await bench.ask("fcSetSensorLimits", limits=[25.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        await bench.target(0.0, compliance=[False] * 6)
        await bench.during(bench.ask("fcEnable"))
        bench.rig.simulation.push[0] = 40.0
        await bench.until(lambda: not bench.force.settings.enabled)
        assert "contact" in await bench.ask("getFcEndReason")
        assert bench.rig.counted()["CONTACT"] == 1

    run(check())


def test_a_stop_ends_force_control(bench: Bench) -> None:
    async def check() -> None:
        await bench.target(0.0)
        await bench.during(bench.ask("fcEnable"))
        stopped = await bench.during(bench.stopping.stop(3.0))
        assert stopped.success
        await bench.until(lambda: not bench.force.settings.enabled)
        assert bench.ownership.stops == 1
        await bench.during(bench.ask("fcEnable"))
        assert await bench.ask("getFcEndReason") == ""
        await bench.during(bench.ask("fcDisable"))

    run(check())


def test_somebody_else_s_session_takes_over_and_gives_back(bench: Bench) -> None:
    async def check() -> None:
        await bench.target(0.0, compliance=[False] * 6)
        await bench.during(bench.ask("fcEnable"))
        await bench.during(bench.force.lend())
        assert bench.streams.session is None
        assert await bench.ask("isFcEnabled")
        await bench.during(bench.force.take_back())
        assert bench.rig.mode is LoopMode.CARTESIAN
        await bench.during(bench.ask("fcDisable"))
        await bench.during(bench.force.take_back())
        assert bench.rig.mode is LoopMode.HOLD

    run(check())


def test_a_stop_of_the_other_session_ends_force_control_for_good(bench: Bench) -> None:
    async def check() -> None:
        await bench.target(0.0, compliance=[False] * 6)
        await bench.during(bench.ask("fcEnable"))
        await bench.during(bench.force.lend())
        assert (await bench.during(bench.stopping.stop(3.0))).success
        await bench.during(bench.force.take_back())
        assert bench.streams.session is None
        await bench.until(lambda: not bench.force.settings.enabled)
        assert await bench.ask("getFcEndReason") == "a stop was requested"
        assert bench.ownership.stops == 1

    run(check())


def test_force_control_does_not_begin_while_somebody_else_streams(bench: Bench) -> None:
    async def check() -> None:
        await bench.target(0.0)
        assert bench.rig.stream() == ""
        await bench.live(20)
        answer = await bench.during(bench.ask.answer("fcEnable"))
        assert answer.code == Code.CONFLICT
        assert not await bench.ask("isFcEnabled")

    run(check())


def test_what_makes_no_sense_is_refused_and_nothing_changes(bench: Bench) -> None:
    async def check() -> None:
        before = bench.force.settings
        await bench.target(0.0, Code.INPUT, compliance=[True])
        await bench.target(0.0, Code.INPUT, wrench=[1.0])
        await bench.target(0.0, Code.INPUT, limits=[-1.0] * 6)
        await bench.target(0.0, Code.INPUT, feature=[0.0])
        await bench.target(0.0, Code.INPUT, frame_type=7)
        await bench.target(0.0, Code.NOT_SUPPORTED, frame_type=1)
        await bench.ask.fails("setDynamicModel", Code.NOT_SUPPORTED, m=[1.0] * 6, d=[], k=[])
        await bench.ask.fails("setDynamicModel", Code.LIMIT, m=[], d=[2.0] * 6, k=[])
        await bench.ask.fails("setDynamicModel", Code.LIMIT, m=[], d=[], k=[1e9] * 6)
        await bench.ask.fails("fcSetSensorThresholds", Code.INPUT, thresholds=[-1.0] * 6)
        await bench.ask.fails("fcSetSensorLimits", Code.INPUT, limits=[1.0])
        assert bench.force.settings == before
        await bench.during(bench.ask("fcEnable"))
        await bench.target(0.0, Code.CONFLICT)
        await bench.ask.fails("fcSetSensorLimits", Code.CONFLICT, limits=[1.0] * 6)
        await bench.during(bench.ask("fcDisable"))

    run(check())


def test_what_was_set_can_be_read(bench: Bench) -> None:
    async def check() -> None:
        await bench.target(-5.0)
        assert await bench.ask("getTargetForce") == [0.0, 0.0, -5.0, 0.0, 0.0, 0.0]
        for name in ("Thresholds", "Limits"):
            values = [10.0, 0.0, 30.0, 1.0, 2.0, 3.0]
            assert await bench.ask(f"getFcSensor{name}") == [0.0] * 6
            await bench.ask(f"fcSetSensor{name}", **{name.lower(): values})
            assert await bench.ask(f"getFcSensor{name}") == values
        assert await bench.ask("getDynamicModel") == (
            '{"m":[0.0,0.0,0.0,0.0,0.0,0.0],"d":[0.7,0.7,0.7,0.7,0.7,0.7],"k":null}'
        )

    run(check())
