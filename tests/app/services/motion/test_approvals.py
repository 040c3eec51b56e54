"""What agents may run: the parts of the fence that no plan shows, and approvals.

Oracles: `zoneinfo` for the time of day, and what has been put on the flange.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import datetime
from types import SimpleNamespace
from typing import Any, cast
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from app.services.motion.approvals import Approvals
from app.services.motion.plan import Plan
from cobot.config import Settings
from cobot.errors import NotFoundError, PermissionDenied
from cobot.motions.signals import Action, PathPlace, Placed, PlacedAction
from cobot.robot.description import RobotDescription
from cobot.robot.tool import BARE, Tool

ZONE = "Asia/Shanghai"
START = PathPlace("fraction", 0.0)


class World:
    """Where a plan that moves nothing is in question, at a time of day."""

    def __init__(self, robot: RobotDescription, settings: Settings) -> None:
        self.robot, self.wall_s = robot, 0.0
        forecast = cast(Any, SimpleNamespace(trajectory=None))
        self.plan = Plan("1", np.zeros(7), forecast, robot.limits, 0.0, planners=frozenset({"ptp"}))
        self.plans = {"1": self.plan}
        self.settings = settings.mcp

    def approvals(self, **fence: Any) -> Approvals:
        settings = self.settings.model_copy(
            update={"execution": "fenced", "fence": self.settings.fence.model_copy(update=fence)}
        )
        clock = SimpleNamespace(wall_ns=lambda: int(self.wall_s * 1e9))
        return Approvals(self.robot, cast(Any, clock), cast(Any, self), settings)

    def get(self, plan_id: str) -> Plan:
        if plan_id not in self.plans:
            raise NotFoundError(f"there is no plan {plan_id}")
        return self.plans[plan_id]

    def list_valid(self) -> list[Plan]:
        return list(self.plans.values())


@pytest.fixture
def world(robot: RobotDescription, settings: Settings, monkeypatch: pytest.MonkeyPatch) -> Iterator[World]:
    monkeypatch.setenv("TZ", ZONE)
    time.tzset()
    yield World(robot, settings)
    robot.model.carry(BARE)
    monkeypatch.undo()
    time.tzset()


DAY, NIGHT = "08:00-18:00", "22:00-06:00"


@pytest.mark.parametrize(
    ("hours", "clock", "permitted"),
    [
        (DAY, "07:59:59", False),
        (DAY, "08:00:00", True),
        (DAY, "18:00:59", True),
        (DAY, "18:01:00", False),
        (NIGHT, "21:59:59", False),
        (NIGHT, "22:00:00", True),
        (NIGHT, "00:00:00", True),
        (NIGHT, "06:00:59", True),
        (NIGHT, "06:01:00", False),
        (NIGHT, "12:00:00", False),
        ("00:00-23:59", "23:59:59", True),
    ],
)
def test_outside_of_its_hours_an_agent_runs_nothing(
    world: World, hours: str, clock: str, permitted: bool
) -> None:
    world.wall_s = datetime.fromisoformat(f"2026-11-25T{clock}").replace(tzinfo=ZoneInfo(ZONE)).timestamp()
    approvals = world.approvals(hours=hours)
    if permitted:
        assert approvals.permit(world.plan) is not None
        return
    with pytest.raises(PermissionDenied, match=f"the time is {clock[:5]}, but mcp.fence.hours is {hours}"):
        approvals.permit(world.plan)


@pytest.mark.parametrize(("mass", "permitted"), [(0.0, True), (3.0, True), (3.01, False)])
def test_with_more_than_its_payload_an_agent_runs_nothing(world: World, mass: float, permitted: bool) -> None:
    world.robot.model.carry(Tool(1, mass=mass))
    approvals = world.approvals(payload_kg=3.0)
    if permitted:
        assert approvals.permit(world.plan) is not None
        return
    with pytest.raises(PermissionDenied, match=r"the arm carries 3.01 kg, but mcp.fence.payload_kg is 3 kg"):
        approvals.permit(world.plan)


def test_what_an_operator_has_approved_asks_neither_for_hours_nor_payload(world: World) -> None:
    world.robot.model.carry(Tool(1, mass=9.0))
    approvals = world.approvals(payload_kg=3.0, hours="03:00-03:01")
    approvals.approve("1", "anna")
    assert approvals.permit(world.plan) is None
    assert approvals.approved_by("1") == "anna"
    approvals.withdraw("1")
    with pytest.raises(PermissionDenied):
        approvals.permit(world.plan)


def test_an_approval_of_a_plan_that_is_forgotten_is_forgotten(world: World) -> None:
    approvals = world.approvals()
    approvals.approve("1", "anna")
    world.plans = {"2": replace(world.plan, plan_id="2")}
    approvals.approve("2", "anna")
    assert approvals.approved_by("1") is None
    with pytest.raises(NotFoundError):
        approvals.approve("1", "anna")


@pytest.mark.parametrize(
    ("action", "says"),
    [
        (Action("actions[0]", START, output="glue", value=1.0), "(set glue to 1)"),
        (Action("actions[0]", START, gripper={"command": "release"}), "(gripper release)"),
        (Action("actions[0]", START, event="half way"), ""),
    ],
)
def test_an_agent_sets_no_output_and_commands_no_gripper_unasked(
    world: World, action: Action, says: str
) -> None:
    plan = replace(world.plan, signals=Placed((PlacedAction(1, 0.0, action),)))
    approvals = world.approvals(hours="00:00-23:59")
    if not says:
        assert approvals.permit(plan) is not None
        return
    with pytest.raises(PermissionDenied) as refused:
        approvals.permit(plan)
    assert says in str(refused.value)
    world.plans["1"] = plan
    approvals.approve("1", "an operator")
    assert approvals.permit(plan) is None
