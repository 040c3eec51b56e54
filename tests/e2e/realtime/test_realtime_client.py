"""`cobot.Robot` against a running simulation: every method that libpyflexiv's README names, by both names.

Oracles: what REST says about the same arm; pinocchio's kinematics; the numbers of joint_limits.yaml.
"""

from __future__ import annotations

import json
import socket
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, Run, until

from cobot import Mode, Robot
from cobot.errors import (
    InputError,
    LimitError,
)

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]


@pytest.fixture
def robot(service: Run) -> Iterator[Robot]:
    """Connected, IDLE, its arm at home."""
    httpx.post(f"{service.url}/robot/reset", timeout=WAIT_S)
    service.go_home()
    with Robot(service.name, verbose=False) as connected:
        yield connected


def joint_control(robot: Robot, **options: object):  # type: ignore[no-untyped-def]
    robot.SwitchMode(Mode.RT_JOINT_IMPEDANCE)
    return robot.start_joint_impedance_control(**options)


def test_close_stops_what_runs_and_may_be_called_again(service: Run) -> None:
    robot = Robot(service.name, verbose=False)
    robot.switch_mode(Mode.NRT_PRIMITIVE_EXECUTION)
    robot.execute_primitive("MoveJ", {"target": [1.0, *HOME[1:]], "speed": 0.2})
    assert robot.busy()
    robot.close()
    robot.close()
    health = httpx.get(f"{service.url}/health").json()
    assert health["robot"]["mode"] == "HOLD"
    with pytest.raises(InputError, match="has been closed"):
        robot.states()


# Plans and primitives


def test_a_plan_is_a_named_position(robot: Robot) -> None:
    robot.SwitchMode(Mode.NRT_PLAN_EXECUTION)
    robot.ExecutePlan("work", speed=1.0)
    until(lambda: not robot.busy())
    robot.ExecutePlan("PLAN-Home", speed=1.0)
    assert robot.busy()
    until(lambda: not robot.busy())
    np.testing.assert_allclose(robot.states().q, HOME, atol=2e-3)


def test_a_plan_may_be_a_sequence(robot: Robot, service: Run, tmp_path: Path) -> None:
    file = tmp_path / "up.json"
    file.write_text('{"waypoints": [{"joints": [0, 0.1, 0, -1.57, 0, 1.57, 0], "speed": 1.0}]}')
    robot.SwitchMode(Mode.NRT_PLAN_EXECUTION)
    robot.ExecutePlan(str(file))
    until(lambda: httpx.get(f"{service.url}/sequences/status").json()["status"] == "finished")
    log = "\n".join(httpx.get(f"{service.url}/sequences/logs").json()["lines"])
    assert "iteration 1/1, waypoint 1/1: arrived" in log


def test_primitives_move_the_joints_and_the_tcp(robot: Robot) -> None:
    robot.SwitchMode(Mode.NRT_PRIMITIVE_EXECUTION)
    robot.ExecutePrimitive("MoveJ", {"target": [0.3, *HOME[1:]], "speed": 1.0})
    until(lambda: not robot.busy())
    assert robot.states().q[0] == pytest.approx(0.3, abs=2e-3)
    pose = robot.states().tcp_pose
    pose[2] -= 0.1
    robot.ExecutePrimitive("MoveL", {"target": pose, "speed": 1.0})
    until(lambda: not robot.busy())
    np.testing.assert_allclose(robot.states().tcp_pose[:3], pose[:3], atol=2e-3)
    robot.execute_primitive("Home", {"speed": 1.0})
    until(lambda: not robot.busy())


def test_a_primitive_that_the_service_refuses_raises_its_error(robot: Robot) -> None:
    robot.SwitchMode(Mode.NRT_PRIMITIVE_EXECUTION)
    with pytest.raises(LimitError, match="joint1"):
        robot.ExecutePrimitive("MoveJ", {"target": [5.0, *HOME[1:]]})


def test_stop_may_be_called_many_times_and_from_threads(robot: Robot) -> None:
    control = joint_control(robot)
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda _: control.stop(), range(16)))
    control.stop()
    assert not control.is_running()


def test_a_client_that_goes_away_stops_the_arm(service: Run) -> None:
    """An HTTP client, in the middle of its motion."""

    def health() -> dict[str, Any]:
        found: dict[str, Any] = httpx.get(f"{service.url}/health", timeout=WAIT_S).json()
        return found

    service.go_home()
    body = json.dumps({"joints": [1.5, 0.5, 0, -1.57, 0, 1.57, 0], "speed": 0.01}).encode()
    host, port = service.url.removeprefix("http://").split(":")
    with socket.create_connection((host, int(port))) as client:
        client.sendall(
            b"POST /robot/move/joints HTTP/1.1\r\nContent-Type: application/json\r\n"
            + f"Host: {host}:{port}\r\nContent-Length: {len(body)}\r\n\r\n".encode()
            + body
        )
        until(lambda: health()["robot"]["mode"] == "TRAJECTORY")
    until(lambda: health()["robot"]["mode"] == "HOLD")
    assert health()["robot"]["motion_result"] == "STOPPED"
    until(lambda: health()["service"]["motion"] is None)
