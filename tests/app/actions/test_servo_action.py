"""The action ServoMode, on the stepped cycle. Oracle: its definition, and what the session itself says."""

from __future__ import annotations

import asyncio
import json

import pytest
from goal_handle import ToldHandle
from rig import Rig
from servo_bench import Bench, Run, runner

from app.actions.servo_action import DEFINITION, FEEDBACK, RESULT, ServoModeAction
from app.graph.actions import GoalStatus, RejectedGoalError
from cobot.config import Settings
from cobot.errors import ConflictError, InputError
from cobot.robot.description import RobotDescription
from cobot.types import LoopMode


@pytest.fixture
def run(rig: Rig, robot: RobotDescription, settings: Settings) -> Run:
    return runner(rig, robot, settings)


GOAL = {"mode": 3, "watchdog_timeout": 0.3, "send_period": 0.01}


def test_the_actions_messages_have_the_fields_of_its_definition() -> None:
    goal, result, feedback = (
        {line.split("#")[0].split()[1] for line in part.splitlines() if line.split("#")[0].strip()}
        for part in DEFINITION.split("---")
    )
    assert goal == set(GOAL)
    assert result == {*RESULT, "code", "message", "refused"}
    assert feedback == set(FEEDBACK)


def test_the_action_holds_a_session_open_until_it_is_cancelled(run: Run) -> None:
    async def test(bench: Bench) -> None:
        action, handle = ServoModeAction("iiwa", bench.servo), ToldHandle()
        assert action.name == "/iiwa/servo_mode"
        task = asyncio.ensure_future(action.execute(GOAL, handle))  # type: ignore[arg-type]
        await bench.active()
        for number in range(30):
            bench.point(bench.rig.home + 1e-4 * number)
            await bench.cycles(10)
        bench.point(bench.rig.home[:3])
        await bench.until(lambda: handle.told and handle.told[-1]["points_refused"] == 1)
        handle.cancel_requested.set()
        await bench.until(task.done)
        result = task.result()
        assert handle.accepted
        assert handle.status is GoalStatus.CANCELED
        assert (result["code"], result["message"]) == (0, "the goal was cancelled")
        assert (result["points_accepted"], result["points_refused"]) == (30, 1)
        assert json.loads(result["refused"]) == {"dimension": 1}
        assert bench.rig.mode is LoopMode.HOLD
        assert handle.told[-1].keys() == set(FEEDBACK)

    run(test)


def test_the_action_is_refused_when_the_session_cannot_begin(run: Run) -> None:
    async def test(bench: Bench) -> None:
        action = ServoModeAction("iiwa", bench.servo)
        with pytest.raises(RejectedGoalError, match="from 1 to 7"):
            await action.execute({**GOAL, "mode": 0}, ToldHandle())  # type: ignore[arg-type]
        with pytest.raises(InputError, match="from 0 to 7"):
            await action.execute({**GOAL, "mode": 12}, ToldHandle())  # type: ignore[arg-type]
        bench.set_mode(1)
        await bench.active()
        with pytest.raises(ConflictError, match="already running"):
            await action.execute(GOAL, ToldHandle())  # type: ignore[arg-type]

    run(test)


@pytest.mark.parametrize(
    ("how", "status", "code", "message"),
    [
        ("stop", GoalStatus.SUCCEEDED, 0, "stopped by servo_control"),
        ("watchdog", GoalStatus.ABORTED, 1, "servo watchdog: no point for 0.3 s"),
        ("estop", GoalStatus.ABORTED, 1, "e-stop requested"),
    ],
)
def test_the_action_says_how_its_session_has_ended(
    run: Run, how: str, status: GoalStatus, code: int, message: str
) -> None:
    async def test(bench: Bench) -> None:
        handle = ToldHandle()
        work = ServoModeAction("iiwa", bench.servo).execute(GOAL, handle)  # type: ignore[arg-type]
        task = asyncio.ensure_future(work)
        await bench.active()
        if how == "stop":
            bench.stop()
        elif how == "estop":
            bench.rig.request("estops")
        await bench.until(task.done)
        assert (handle.status, task.result()["code"], task.result()["message"]) == (status, code, message)

    run(test)
