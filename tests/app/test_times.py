"""When service and cycle give up on each other and on their clients, to the millisecond of robot time.

Oracle: the settings as shipped, and the virtual clock.
"""

from __future__ import annotations

import asyncio

import numpy as np
import pytest
from streaming_client import Frames
from virtual_service import VirtualService
from virtual_time import VirtualClock, VirtualLoop

from cobot.types import LoopMode

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
CYCLE_S = 0.001


@pytest.fixture(autouse=True)
def home(service: VirtualService) -> None:
    service.go_home()


def passed_until(service: VirtualService, mode: LoopMode) -> float:
    """How long it takes until the arm is in this mode, s."""
    begun_s = service.clock.now_s()
    while service.rig.mode is not mode:
        service.sleep(CYCLE_S)
        assert service.clock.now_s() < begun_s + 60.0
    return service.clock.now_s() - begun_s


def send(service: VirtualService, seconds: float) -> None:
    points = [{"positions": [0.5, *HOME[1:]], "time_from_start": seconds}]
    service.post("/trajectory/send", {"points": points}).raise_for_status()


def test_a_day_goes_by_when_nothing_waits_for_a_cycle() -> None:
    """Of the tests' own loop: what it costs is the timers, not the time."""
    loop = VirtualLoop()
    clock = VirtualClock(loop)
    begun_s, wall_ns = clock.now_s(), clock.wall_ns()
    clock.sleep(86_400.0)
    assert clock.now_s() - begun_s == pytest.approx(86_400.0)
    assert clock.wall_ns() - wall_ns == pytest.approx(86_400e9)
    ticks: list[int] = []
    ticker = clock.ticker(1000.0, ticks.append)
    clock.sleep(1.0005)
    ticker.close()
    clock.sleep(1.0)
    assert sum(ticks) == 1000
    with pytest.raises(AssertionError, match="nothing will ever happen"):
        loop.run_until_complete(loop.create_future())
    loop.close()


def test_an_rtloop_that_stands_still_is_missed_after_a_quarter_of_a_second(service: VirtualService) -> None:
    cycle = service.cycles[service.name]
    cycle.stopped = True
    service.sleep(0.24)
    assert service.healthy()
    service.sleep(0.02)
    assert not service.healthy()
    begun_s = service.clock.now_s()
    answer = service.get("/robot/joint_states")
    assert answer.status_code == 503
    assert "rtloop" in answer.json()["detail"]
    assert service.clock.now_s() - begun_s < 3.0
    stopped = service.post("/stop").json()
    assert (stopped["success"], stopped["at_rest"]) == (False, False)
    cycle.stopped = False
    service.sleep(0.1)
    assert service.healthy()


def test_a_motion_that_is_lost_sight_of_ends_when_rtloop_goes_on(service: VirtualService) -> None:
    send(service, 20.0)
    service.sleep(1.0)
    service.cycles[service.name].stopped = True
    service.until(lambda: "its state is unknown" in service.output)
    service.cycles[service.name].stopped = False
    passed_until(service, LoopMode.HOLD)
    assert service.health()["robot"]["motion_result"] == "STOPPED"


def test_a_service_that_falls_silent_is_missed_after_half_a_second(service: VirtualService) -> None:
    send(service, 20.0)
    service.sleep(1.0)
    link = service.app.state.services.link
    (beat,) = (task for task in asyncio.all_tasks(service.loop) if task.get_name() == "heartbeat")
    beat.cancel()
    service.sleep(0.0)
    silent_s = passed_until(service, LoopMode.STOPPING)
    assert 0.45 <= silent_s <= 0.5 + 2 * CYCLE_S, "the last beat was up to 0.05 s ago"
    passed_until(service, LoopMode.HOLD)
    assert "the service has been silent for 0.5" in service.rig.reason
    service.begin(link.heartbeat.beat()).set_name("heartbeat")
    service.sleep(0.1)


@pytest.mark.parametrize("gone", [False, True], ids=["silent", "gone"])
def test_a_streams_arm_is_given_half_a_second_after_its_last_target(
    service: VirtualService, gone: bool
) -> None:
    client = Frames(service.connect("/robot/stream"))
    client.session(inner_control_hz=50)
    counted = service.rig.counted().get("COMMAND_TIMEOUT", 0)
    for step in range(30):
        client.target([0.1 * np.sin(0.04 * step), *HOME[1:]])
        service.sleep(0.02)
    if gone:
        client.socket.close()
        service.sleep(0.47)
        assert service.health()["session"] is not None
        service.sleep(0.05)
        assert service.rig.mode in (LoopMode.STOPPING, LoopMode.HOLD)
    else:
        service.sleep(0.47)
        assert service.rig.counted().get("COMMAND_TIMEOUT", 0) == counted
        service.sleep(0.02)
        assert service.rig.counted().get("COMMAND_TIMEOUT", 0) == counted + 1
        client.ended()
        client.socket.close()
    service.until(lambda: service.health()["session"] is None)


@pytest.mark.parametrize("timeout_s", [0.05, 2.0])
def test_a_watchdog_runs_out_at_its_time_and_not_before(service: VirtualService, timeout_s: float) -> None:
    def ask(method: str, **fields: object) -> object:
        answer = service.post(f"/{service.name}/RegisterControl/{method}", fields).json()
        assert answer["code"] == 0, answer
        return answer["result"]

    ask("setWatchDog", key="plc", timeout=timeout_s, action=0)
    for _ in range(3):
        service.sleep(0.9 * timeout_s)
        ask("setInt32", key="plc", value=1)
    service.sleep(timeout_s - CYCLE_S)
    assert not ask("isWatchDogExpired", key="plc")
    service.sleep(2 * CYCLE_S)
    assert ask("isWatchDogExpired", key="plc")
    ask("setWatchDog", key="plc", timeout=0.0, action=0)
