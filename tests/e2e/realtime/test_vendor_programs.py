"""Programs, robots that move together, and faults, through vendor services over HTTP.

Oracles: where the arms are as GET /robot/joint_states shows it, numpy for the straight line between two
postures, and the process table (psutil). The clock is that of the wall: on the fast one nothing could be
caught under way.
"""

from __future__ import annotations

import json
from collections.abc import Iterator

import httpx
import numpy as np
import psutil
import pytest
from cobot_run import WAIT_S, Pair, until
from vendor_arm import VendorArm

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.4, 0.1, 0.0, -1.4, 0.0, 1.4, 0.2]
LUA = "for n = 1, 3 do print('turn', n) end\n"


@pytest.fixture
def arms(pair: Pair) -> Iterator[tuple[VendorArm, VendorArm]]:
    """Both at home."""
    with httpx.Client(base_url=pair.url, timeout=WAIT_S) as client:
        found = VendorArm(client, pair.left), VendorArm(client, pair.right)
        for arm in found:
            arm.home()
        yield found


def write(pair: Pair, name: str, *targets: list[float], speed: float = 0.3) -> None:
    content = {"waypoints": [{"joints": joints, "speed": speed} for joints in targets]}
    (pair.programs / name).write_text(json.dumps(content), encoding="utf-8")


def test_a_program_is_loaded_run_paused_resumed_and_ends_where_it_should(
    pair: Pair, arms: tuple[VendorArm, VendorArm]
) -> None:
    arm, other = arms
    write(pair, "there.json", AWAY)
    assert "there.json" in arm.ask("RuntimeMachine/getPrograms")
    arm.ask("RuntimeMachine/loadProgram", program="there.json")
    assert arm.ask("RuntimeMachine/getLoadedProgram") == "there.json"
    assert arm.state == "Stopped"
    arm.ask("RuntimeMachine/runProgram")
    assert arm.ask("RuntimeMachine/getStatus") == "Running"
    assert other.state == "Stopped"
    until(lambda: arm.speed > 0.1)
    arm.ask("RuntimeMachine/pause")
    assert arm.state == "Paused"
    until(lambda: arm.speed < 1e-3)
    here = arm.joints
    way = np.array(AWAY) - HOME
    share = (here - HOME) @ way / (way @ way)
    assert 0.0 < share < 0.99
    np.testing.assert_allclose(here, np.array(HOME) + share * way, atol=2e-3)
    for _ in range(20):
        np.testing.assert_allclose(arm.joints, here, atol=2e-3)
    arm.ask("RuntimeMachine/resume")
    until(lambda: arm.state == "Stopped")
    assert arm.ask("RuntimeMachine/getReturnCode") == 0
    np.testing.assert_allclose(arm.joints, AWAY, atol=2e-3)
    np.testing.assert_allclose(other.joints, HOME, atol=2e-3)
    assert any("arrived" in line for line in arm.ask("RuntimeMachine/getProgramLogs", number=10))


def test_a_stop_ends_a_paused_program_and_its_process(pair: Pair, arms: tuple[VendorArm, VendorArm]) -> None:
    arm, _ = arms
    write(pair, "long.json", AWAY, HOME, AWAY, HOME, speed=0.1)
    arm.ask("RuntimeMachine/loadProgram", program="long.json")
    arm.ask("RuntimeMachine/start")
    until(lambda: arm.speed > 0.02)
    service = pair.child("app")
    assert service is not None
    runners = [p for p in service.children(recursive=True) if "cobot.runner" in p.cmdline()]
    assert len(runners) == 1
    arm.ask("RuntimeMachine/pause")
    assert arm.state == "Paused"
    arm.fails("RuntimeMachine/runProgram", 40)
    arm.fails("RuntimeMachine/loadProgram", 40, program="long.json")
    arm.ask("RuntimeMachine/abort")
    assert arm.state == "Stopped"
    assert not psutil.pid_exists(runners[0].pid)
    assert arm.ask("RuntimeMachine/getReturnCode") != 0
    here = arm.joints
    for _ in range(20):
        np.testing.assert_allclose(arm.joints, here, atol=2e-3)
    arm.ask("RuntimeMachine/stop")  # nothing runs: that is no error
    arm.fails("RuntimeMachine/pause", 40)
    arm.fails("RuntimeMachine/resume", 40)


@pytest.mark.thorough
def test_a_lua_program_runs_too(pair: Pair, arms: tuple[VendorArm, VendorArm]) -> None:
    arm, _ = arms
    (pair.programs / "hello.lua").write_text(LUA, encoding="utf-8")
    arm.ask("RuntimeMachine/loadProgram", program="hello.lua")
    arm.ask("RuntimeMachine/runProgram")
    until(lambda: arm.state == "Stopped")
    lines = arm.ask("RuntimeMachine/getProgramLogs", number=50)
    assert arm.ask("RuntimeMachine/getReturnCode") == 0, lines
    assert any("turn" in line and "3" in line for line in lines)


def test_a_program_with_a_mistake_or_outside_of_the_folder_is_not_loaded(
    pair: Pair, arms: tuple[VendorArm, VendorArm]
) -> None:
    arm, _ = arms
    (pair.programs / "wrong.json").write_text('{"waypoints": [{"joints": "no"}]}', encoding="utf-8")
    (pair.programs / "wrong.lua").write_text("for for", encoding="utf-8")
    (pair.programs / "link.json").symlink_to(pair.config)
    (pair.programs.parent / "outside.json").write_text("{}", encoding="utf-8")
    assert "waypoints[0].joints" in arm.fails("RuntimeMachine/loadProgram", 10, program="wrong.json")
    assert "wrong.lua" in arm.fails("RuntimeMachine/loadProgram", 10, program="wrong.lua")
    for name in ("../outside.json", str(pair.programs.parent / "outside.json"), "link.json", "", "a\0b.json"):
        arm.fails("RuntimeMachine/loadProgram", 10, program=name)
    arm.fails("RuntimeMachine/loadProgram", 12, program="nothing.json")
    arm.fails("RuntimeMachine/loadProgram", 10, program=f"{pair.config.name}")
