"""What begins and ends with the application. Oracle: its events, on virtual time."""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest
from cobot_run import unique_name
from virtual_service import virtual_service

from app.main import create_app
from cobot.config import Settings
from cobot.errors import UnavailableError

AWAY = {"joints": [0.3, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0], "speed": 0.1}


def test_a_start_without_a_robot_says_why_and_ends_what_it_has_begun(
    settings: Settings, tmp_path: Path
) -> None:
    robot = settings.robot.model_copy(update={"name": unique_name()})
    alone = settings.model_copy(update={"robot": robot, "logs": tmp_path})
    app = create_app(alone, None, "http://robot.test")

    async def live() -> None:
        async with app.router.lifespan_context(app):
            pass

    with pytest.raises(UnavailableError) as caught:
        asyncio.run(live())
    assert app.state.start_failure is caught.value
    assert app.state.events.closed


def test_the_end_of_the_service_stops_the_arm_and_interrupts_its_job(tmp_path: Path) -> None:
    with virtual_service(tmp_path) as service:
        moving = service.begin(service.asking("POST", "/robot/move/joints", json=AWAY))
        service.until(lambda: service.rig.mode.name == "TRAJECTORY")
    assert moving.done()
    events: list[dict[str, Any]] = [json.loads(each.text) for each in service.app.state.events.since(0, 5000)]
    stop = next(each for each in events if each["type"] == "stop")
    assert stop["data"]["reason"] == "stopped by the end of the service"
    (ended,) = [each for each in events if each["type"] == "motion" and each["data"]["what"] != "begun"]
    assert ended["data"]["what"] == "stopped"
    assert [each["data"]["state"] for each in events if each["type"] == "job"][-1] == "interrupted"
