"""Whatever ends in whatever way leaves nothing behind, on virtual time; with processes that are killed:
tests/e2e/realtime/test_crashes.py.

Each row of SET_BY begins something, each row of ENDED_BY ends it, and each pair is a test. Oracle: the table
"What a job leaves behind" in docs/architecture.md: afterwards the service is as it was, and somebody else's
motion runs at full speed.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from asgi_client import Leaving
from virtual_service import VirtualService

from app.services.clients import CLIENT, RequestClient
from cobot.errors import ExecutionError
from cobot.types import LoopMode

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
FAR = {"joints": [1.5, *HOME[1:]], "speed": 0.1}
LIVE = "state=queued&state=planning&state=running&state=paused"
FULL_SPEED_S = 4.0
"""Longer than a motion home takes at full speed, from wherever a test leaves the arm, and settling."""


@dataclass
class Begun:
    """What a test has begun.

    Attributes:
        jobs: that can be cancelled.
        leave: its client goes away; None if it has no connection.
        wait_s: after which it ends by itself if nothing more comes; None: never.
        undo: called when the test is over.
    """

    jobs: list[str] = field(default_factory=list)
    leave: Callable[[], None] | None = None
    wait_s: float | None = None
    undo: Callable[[], None] = lambda: None


@pytest.fixture
def run(service: VirtualService) -> VirtualService:
    service.go_home()
    assert not left_behind(service)
    return service


def vendor(run: VirtualService, method: str, headers: dict[str, str] | None = None, **fields: Any) -> None:
    answer = run.ask("POST", f"/{run.name}/{method}", json=fields, headers=headers or {})
    assert answer.json()["code"] == 0, answer.text


def live(run: VirtualService, kind: str = "") -> list[str]:
    jobs = run.get(f"/jobs?{LIVE}").raise_for_status().json()["jobs"]
    return [job["id"] for job in jobs if kind in ("", job["kind"])]


def under_way(run: VirtualService) -> None:
    run.until(lambda: run.rig.mode is LoopMode.TRAJECTORY)
    run.sleep(0.5)


# What is set


def a_motion(run: VirtualService) -> Begun:
    job = run.post("/robot/move/joints?wait=false", FAR).raise_for_status().json()["id"]
    under_way(run)
    return Begun([job])


def a_motion_that_is_waited_for(run: VirtualService) -> Begun:
    request = Leaving(run, "POST", "/robot/move/joints", FAR)
    under_way(run)
    return Begun(live(run), request.leave)


def a_pause(run: VirtualService) -> Begun:
    begun = a_motion_that_is_waited_for(run)
    run.post(f"/jobs/{begun.jobs[0]}/pause").raise_for_status()
    return begun


def a_plan_in_the_making(run: VirtualService) -> Begun:
    planning = run.app.state.services.planning
    compute = planning.compute

    async def slow(*arguments: Any) -> Any:
        await asyncio.sleep(15.0)
        return await compute(*arguments)

    planning.compute = slow

    def undo() -> None:
        planning.compute = compute

    request = Leaving(run, "POST", "/robot/move/joints", FAR)
    run.sleep(0.5)
    return Begun(live(run), request.leave, undo=undo)


def a_queue(run: VirtualService) -> Begun:
    for joint in (1.5, 1.0, 0.5):
        body = {"joints": [joint, *HOME[1:]], "speed": 0.3}
        run.post("/robot/move/joints?queue=true", body).raise_for_status()
    under_way(run)
    return Begun(live(run, "queue"))


def a_paused_queue(run: VirtualService) -> Begun:
    begun = a_queue(run)
    run.post(f"/jobs/{begun.jobs[0]}/pause").raise_for_status()
    return begun


def a_paused_motion_of_a_queue(run: VirtualService) -> Begun:
    a_queue(run)
    first = run.get("/jobs?state=running").json()["jobs"]
    job = next(each["id"] for each in first if each["kind"] == "move")
    run.post(f"/jobs/{job}/pause").raise_for_status()
    return Begun([job])


def an_override_of_a_lease(run: VirtualService) -> Begun:
    token = run.post("/robot/control", {"timeout_s": 2.0}).raise_for_status().json()["token"]
    vendor(run, "MotionControl/setSpeedFraction", {"X-Control-Token": token}, fraction=0.3)
    return Begun(wait_s=3.0)


def a_lease_of_a_connection(run: VirtualService) -> Begun:
    socket = run.connect("/robot/stream")
    socket.send('{"type": "control", "timeout_s": 600}')
    run.until(lambda: run.get("/robot/control").json()["held"])
    return Begun(leave=socket.close)


def a_stream(run: VirtualService) -> Begun:
    socket = run.connect("/robot/stream")
    socket.send('{"type": "session"}')
    run.until(lambda: run.app.state.services.streams.session is not None)
    return Begun(leave=socket.close)


def a_servo_session(run: VirtualService) -> Begun:
    socket = run.connect("/rosbridge")
    begin = {"type": "servo_control", "command": "set_mode", "mode": 1, "watchdog_timeout": 2.0}
    message = {"data": json.dumps(begin)}
    socket.send(json.dumps({"op": "publish", "topic": f"/{run.name}/joint_cmd", "msg": message}))
    run.until(lambda: run.app.state.services.streams.session is not None)
    return Begun(leave=socket.close, wait_s=3.0)


def a_goal(run: VirtualService) -> Begun:
    socket = run.connect("/rosbridge")
    points = [
        {"positions": [joint, *HOME[1:]], "time_from_start": {"sec": second, "nanosec": 0}}
        for second, joint in ((0, 0.0), (20, 1.5))
    ]
    names = list(run.app.state.services.robot.limits.names)
    goal = {"trajectory": {"joint_names": names, "points": points}}
    action = f"/{run.name}/follow_joint_trajectory"
    socket.send(json.dumps({"op": "send_action_goal", "id": "g", "action": action, "args": goal}))
    under_way(run)
    return Begun(live(run), socket.close)


def freedrive(run: VirtualService) -> Begun:
    run.post("/robot/freedrive", {"timeout_s": 2.0}).raise_for_status()
    return Begun(wait_s=3.0)


def a_press(run: VirtualService) -> Begun:
    body = {"force": 5.0, "speed": 0.001, "max_time_s": 60.0}
    request = Leaving(run, "POST", "/robot/force/press", body)
    run.until(lambda: run.app.state.services.streams.session is not None)
    return Begun(live(run), request.leave)


def force_control(run: VirtualService) -> Begun:
    vendor(run, "ForceControl/fcEnable")
    return Begun()


def a_program(run: VirtualService) -> Begun:
    """Its runner slows the arm down, pauses, and is killed; a lease is lost meanwhile."""
    ownership = run.app.state.services.ownership
    token = run.post("/robot/control", {"timeout_s": 600.0}).raise_for_status().json()["token"]
    shown = {"X-Control-Token": token}
    vendor(run, "MotionControl/setSpeedFraction", shown, fraction=0.5)
    before = CLIENT.set(RequestClient("anonymous", "127.0.0.1", frozenset({token})))
    ownership.claim_for_sequence("sequence 1", "secret")
    CLIENT.reset(before)
    run.ask("DELETE", "/robot/control", headers=shown).raise_for_status()
    own = {"X-Motion-Token": "secret"}
    vendor(run, "MotionControl/setSpeedFraction", own, fraction=0.3)
    job = live(run, "sequence")[0]
    run.post(f"/jobs/{job}/pause").raise_for_status()
    return Begun(leave=lambda: ownership.release_sequence(ExecutionError("the runner was killed")))


# How it ends


def a_stop(run: VirtualService, begun: Begun) -> None:
    assert run.post("/stop").json()["success"]


def cobot_stop(run: VirtualService, begun: Begun) -> None:
    run.rig.memory.outside_stops.add()
    run.sleep(0.5)  # the service sees it with its next heartbeat, and stops what has begun until then


def an_estop(run: VirtualService, begun: Begun) -> None:
    run.rig.memory.outside_estops.add()
    run.until(lambda: run.rig.mode is LoopMode.ESTOP)
    run.sleep(1.0)
    run.post("/robot/reset").raise_for_status()


def a_cancel(run: VirtualService, begun: Begun) -> None:
    for job in begun.jobs:
        assert run.post(f"/jobs/{job}/cancel").json()["state"] == "cancelled"


def its_client_going_away(run: VirtualService, begun: Begun) -> None:
    assert begun.leave is not None
    begun.leave()


def its_time(run: VirtualService, begun: Begun) -> None:
    assert begun.wait_s is not None
    run.sleep(begun.wait_s)


def a_take_over(run: VirtualService, begun: Begun) -> None:
    token = run.post("/robot/control", {"force": True}).raise_for_status().json()["token"]
    run.ask("DELETE", "/robot/control", headers={"X-Control-Token": token}).raise_for_status()


def a_silent_rtloop(run: VirtualService, begun: Begun) -> None:
    cycle = run.cycles[run.name]
    cycle.stopped = True
    run.sleep(12.0)
    cycle.stopped = False


SET_BY: dict[Callable[[VirtualService], Begun], str] = {
    a_motion: "stop outside estop cancel over silent",
    a_motion_that_is_waited_for: "stop outside estop cancel gone over silent",
    a_pause: "stop outside estop cancel gone over silent",
    a_plan_in_the_making: "stop outside cancel gone over",
    a_queue: "stop outside estop cancel over silent",
    a_paused_queue: "stop outside estop cancel over silent",
    a_paused_motion_of_a_queue: "stop outside estop cancel over silent",
    an_override_of_a_lease: "time over",
    a_lease_of_a_connection: "gone over",
    a_stream: "stop outside estop gone over silent",
    a_servo_session: "stop outside estop gone time over silent",
    a_goal: "stop outside estop cancel gone over silent",
    freedrive: "stop outside estop time over silent",
    a_press: "stop outside estop cancel gone over silent",
    force_control: "stop outside estop over silent",
    a_program: "gone",
}
ENDED_BY: dict[str, Callable[[VirtualService, Begun], None]] = {
    "stop": a_stop,
    "outside": cobot_stop,
    "estop": an_estop,
    "cancel": a_cancel,
    "gone": its_client_going_away,
    "time": its_time,
    "over": a_take_over,
    "silent": a_silent_rtloop,
}
PAIRS = [(begin, ENDED_BY[name]) for begin, names in SET_BY.items() for name in names.split()]


def left_behind(run: VirtualService) -> dict[str, Any]:
    """What is not as it is when nobody has asked for anything."""
    services = run.app.state.services
    control = run.get("/robot/control").json()
    found: dict[str, Any] = {
        "jobs": live(run),
        "control": control["holder"],
        "owner": services.ownership.owner,
        "pause": services.ownership.speed_override.paused,
        "speed": services.ownership.speed_fraction - 1.0,
        "queue": services.queue.size,
        "session": services.streams.session,
        "servo": services.servo.active,
        "freedrive": services.freedrive.state.session,
        "force": services.force.settings.enabled,
        "planning": services.planning.status.busy,
    }
    return {name: value for name, value in found.items() if value}


@pytest.mark.parametrize(
    ("begin", "end"), PAIRS, ids=[f"{begin.__name__}-{end.__name__}" for begin, end in PAIRS]
)
def test_nothing_is_left_behind(
    run: VirtualService,
    begin: Callable[[VirtualService], Begun],
    end: Callable[[VirtualService, Begun], None],
) -> None:
    begun = begin(run)
    try:
        assert left_behind(run), "it has begun"
        end(run, begun)
    finally:
        begun.undo()
    run.until(lambda: not left_behind(run) and run.rig.mode is LoopMode.HOLD)
    begun_s = run.clock.now_s()
    next_motion = run.post("/robot/move/named", {"name": "home", "speed": 1.0}).json()
    assert next_motion["success"], next_motion
    assert run.clock.now_s() - begun_s < FULL_SPEED_S
    if begun.leave is not None and end is not its_client_going_away and begin is not a_program:
        begun.leave()
