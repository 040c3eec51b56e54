"""Freedrive on virtual time: a push of the simulation's own takes the arm along.

Oracles: the simulated push (MuJoCo's xfrc_applied) and the arm's state by REST; joint_limits.yaml; MuJoCo's
distances between geoms.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import httpx
import numpy as np
import pytest
from virtual_service import VirtualService

from app.services.streaming.freedrive import (
    MAX_LEAD_RAD,
    PUSHED_SHARE,
    ROOM_RAD,
    FreedriveService,
    Guidance,
    outside,
)
from app.services.streaming.jog_limits import TCP_M_S
from cobot.errors import NotSupportedError
from cobot.ipc.device_record import device_of, fill_capabilities
from cobot.robot.description import RobotDescription
from cobot.types import Array
from rtloop.backends.mujoco import MujocoBackend

PATH = "/robot/freedrive"
HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
PUSH_N = 30.0
WALL = {"shape": "box", "size": [1.0, 0.02, 1.0], "x": 0.4, "y": 0.25, "z": 0.6}


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    service.sleep(1.0)
    yield service
    service.rig.simulation.push[:] = 0.0
    service.ask("DELETE", PATH).raise_for_status()


def begin(run: VirtualService, **body: Any) -> dict[str, Any]:
    answer = run.post(PATH, body)
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def state(run: VirtualService) -> dict[str, Any]:
    found: dict[str, Any] = run.get(PATH).json()
    return found


def refused(answer: httpx.Response, status: int) -> str:
    assert answer.status_code == status, answer.text
    detail: str = answer.json()["detail"]
    return detail


def tcp(run: VirtualService) -> Array:
    position = run.get("/robot/pose").json()["position"]
    return np.array([position[axis] for axis in "xyz"])


def push(run: VirtualService, seconds: float, session: int, force: list[float]) -> list[list[float]]:
    """As a hand does, while the panel renews; where the joints were."""
    run.rig.simulation.push[:3] = force
    places = []
    for _ in range(round(seconds / 0.1)):
        begin(run, session=session, timeout_s=60.0)
        run.sleep(0.1)
        places.append(run.joints())
    run.rig.simulation.push[:] = 0.0
    return places


def test_the_arm_goes_where_it_is_pushed_and_rests_where_it_is_let_go(run: VirtualService) -> None:
    answer = begin(run, timeout_s=60.0)
    assert 59.0 < answer["left_s"] <= 60.0
    before = tcp(run)
    run.sleep(1.0)
    np.testing.assert_allclose(tcp(run), before, atol=1e-4, err_msg="nobody pushes")
    push(run, 2.0, answer["session"], [0.0, PUSH_N, 0.0])
    let_go = tcp(run)
    assert let_go[1] - before[1] > 0.05, "m, along the push"
    run.sleep(1.0)
    rests = tcp(run)
    assert np.linalg.norm(rests - let_go) < 0.03, "no spring takes it back"
    assert rests[1] - before[1] > 0.05
    joints = run.joints()
    run.sleep(3.0)
    np.testing.assert_allclose(run.joints(), joints, atol=1e-3, err_msg="it rests there")
    ended = run.ask("DELETE", PATH).raise_for_status().json()
    assert (ended["session"], ended["ended"]) == (None, "freedrive was switched off")
    run.sleep(1.0)
    np.testing.assert_allclose(run.joints(), joints, atol=5e-3, err_msg="and is held there")
    assert run.health()["robot"]["mode"] == "HOLD"


def test_a_hand_that_does_not_stop_gets_no_joint_past_its_limit(run: VirtualService) -> None:
    limits = run.rig.robot.limits
    session = begin(run, timeout_s=60.0)["session"]
    places = push(run, 10.0, session, [0.0, 2.0 * PUSH_N, 0.0])
    reached = np.array(places)
    assert (reached < limits.max_position).all()
    assert (reached > limits.min_position).all()
    rates = np.diff(reached, axis=0) / 0.1
    assert (np.abs(rates) < limits.max_velocity).all()
    assert state(run)["session"] == session, "no limit has ended it"


def test_a_joint_is_held_before_its_limit_and_says_so(run: VirtualService) -> None:
    """Held by joint 1 alone: the push goes round about it."""
    near = run.rig.robot.limits.max_position[0] - 0.2
    run.post("/robot/move/joints", {"joints": [near, *HOME[1:]], "speed": 1.0})
    session = begin(run, timeout_s=60.0)["session"]
    sideways = [-PUSH_N * np.sin(near), PUSH_N * np.cos(near), 0.0]
    run.rig.simulation.push[:3] = sideways
    run.sleep(4.0)
    found = state(run)
    assert "joint1 is at" in found["limited_by"]
    assert "near its limit of 2.97 rad" in found["limited_by"]
    assert (found["reason_code"], found["reason_of"], found["reason_unit"]) == (
        "joint_limit",
        "joint1",
        "rad",
    )
    assert found["reason_values"] == pytest.approx([run.joints()[0], 2.97], abs=0.01)
    assert near < run.joints()[0] < run.rig.robot.limits.max_position[0] - ROOM_RAD / 2
    assert found["session"] == session


def test_it_is_held_before_an_obstacle_and_can_be_pulled_away(run: VirtualService) -> None:
    run.post("/scene", {"objects": {"wall": WALL}}).raise_for_status()
    try:
        session = begin(run, timeout_s=60.0)["session"]
        run.rig.simulation.push[1] = PUSH_N
        run.sleep(4.0)
        held = tcp(run)
        found = state(run)
        assert "wall" in found["limited_by"]
        assert found["reason_code"] == "near_obstacle"
        assert "wall" in found["reason_of"]
        run.rig.simulation.push[1] = -PUSH_N
        run.sleep(2.0)
        assert tcp(run)[1] < held[1] - 0.05
        assert state(run)["session"] == session
    finally:
        run.rig.simulation.push[:] = 0.0
        run.ask("DELETE", PATH)
        run.post("/scene", {"clear": True}).raise_for_status()


def test_who_does_not_renew_it_loses_it(run: VirtualService) -> None:
    session = begin(run, timeout_s=1.0)["session"]
    for _ in range(4):
        run.sleep(0.8)
        assert begin(run, session=session, timeout_s=1.0)["session"] == session
    run.until(lambda: state(run)["session"] is None)
    assert state(run)["ended"] == "freedrive was not renewed for 1 s"
    detail = refused(run.post(PATH, {"session": session}), 409)
    assert detail == "freedrive has ended: freedrive was not renewed for 1 s"
    run.until(lambda: run.health()["robot"]["mode"] == "HOLD")


def test_a_stop_ends_it_and_a_renewal_does_not_take_it_up_again(run: VirtualService) -> None:
    session = begin(run, timeout_s=60.0)["session"]
    assert run.post("/stop").json()["success"]
    assert "stop" in refused(run.post(PATH, {"session": session}), 409)
    assert "there is no freedrive session" in refused(run.post(PATH, {"session": session + 7}), 409)
    again = begin(run)
    assert again["session"] != session


def test_it_has_the_arm_alone_and_heeds_who_has_the_control(run: VirtualService) -> None:
    begin(run, timeout_s=60.0)
    move = {"joints": HOME, "speed": 1.0}
    assert "POST /robot/freedrive" in refused(run.post("/robot/move/joints", move), 409)
    assert "POST /robot/freedrive" in refused(run.post(PATH, {}), 409)
    run.ask("DELETE", PATH).raise_for_status()
    token = run.post("/robot/control", {"timeout_s": 60.0}).json()["token"]
    try:
        assert "has control of the robot" in refused(run.post(PATH, {}), 409)
        assert run.ask("POST", PATH, json={}, headers={"X-Control-Token": token}).status_code == 200
    finally:
        run.ask("DELETE", PATH)
        run.ask("DELETE", "/robot/control", headers={"X-Control-Token": token}).raise_for_status()


def test_only_who_has_begun_it_renews_it_and_not_against_who_has_the_control(run: VirtualService) -> None:
    control = run.post("/robot/control", {"timeout_s": 60.0}).json()["token"]
    shown = {"X-Control-Token": control}
    try:
        session = run.ask("POST", PATH, json={"timeout_s": 60.0}, headers=shown).json()["session"]
        again = {"session": session, "timeout_s": 60.0}

        async def another() -> httpx.Response:
            transport = httpx.ASGITransport(run.app, client=("192.0.2.7", 4000))
            async with httpx.AsyncClient(transport=transport, base_url=run.url, headers=shown) as client:
                return await client.post(PATH, json=again)

        run.sleep(1.0)
        detail = refused(run.run(another()), 409)
        assert detail == "freedrive was started by anonymous from 127.0.0.1; no other client may renew it"
        assert "has control of the robot" in refused(run.post(PATH, again), 409)
        assert state(run)["left_s"] < 59.5, "nobody has renewed it"
        assert run.ask("POST", PATH, json=again, headers=shown).status_code == 200
    finally:
        run.ask("DELETE", PATH)
        run.ask("DELETE", "/robot/control", headers=shown).raise_for_status()


def test_an_arm_that_is_pushed_already_is_not_let_go(run: VirtualService) -> None:
    run.rig.simulation.push[1] = PUSH_N
    run.sleep(0.5)
    detail = refused(run.post(PATH, {}), 409)
    allowed = PUSHED_SHARE * run.rig.robot.limits.max_effort[2]
    assert "joint3 already feels" in detail
    assert f"allowed: {allowed:.1f} N·m" in detail
    run.rig.simulation.push[:] = 0.0


def test_a_backend_that_cannot_is_refused_by_its_name(run: VirtualService) -> None:
    block = run.rig.memory.device
    try:
        fill_capabilities(block.data, replace(MujocoBackend.capabilities, freedrive=False))
        block.publish()
        detail = refused(run.post(PATH, {}), 501)
    finally:
        fill_capabilities(block.data, MujocoBackend.capabilities)
        block.publish()
    assert detail.startswith(
        "guiding the arm by hand needs freedrive, which the backend mujoco does not have; "
    )


def test_freedrive_that_the_settings_switch_off_is_refused_with_the_setting(run: VirtualService) -> None:
    backend = SimpleNamespace(capabilities=replace(MujocoBackend.capabilities, freedrive=False))
    link: Any = SimpleNamespace(device=lambda: ("ur", backend))
    streams: Any = None
    service = FreedriveService(run.rig.robot, link, streams, is_switched_off=True)
    with pytest.raises(NotSupportedError, match=r"robot\.backend\.freedrive is false; set it to true"):
        asyncio.run(service.begin("Ada", 1.0, 1.0))


@pytest.mark.parametrize("guides", [False, True])
def test_a_device_that_releases_its_arm_needs_no_springs(run: VirtualService, guides: bool) -> None:
    """Also if it has springs. What rtloop reports arrives through the shared memory."""
    block = run.rig.memory.device
    try:
        fill_capabilities(block.data, replace(MujocoBackend.capabilities, impedance=True, guides=guides))
        link: Any = SimpleNamespace(device=lambda: ("ur", device_of(block.data)))
        streams: Any = None
        assert FreedriveService(run.rig.robot, link, streams)._require_able() is guides
    finally:
        fill_capabilities(block.data, MujocoBackend.capabilities)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        ({"timeout_s": 0.4}, "timeout_s"),
        ({"timeout_s": 61.0}, "timeout_s"),
        ({"session": 0}, "session"),
        ({"on": True}, "unknown key 'on'"),
    ],
)
def test_what_makes_no_sense_is_refused(run: VirtualService, body: dict[str, Any], words: str) -> None:
    assert words in refused(run.post(PATH, body), 422)
    assert state(run)["session"] is None


def test_a_push_within_the_threshold_moves_nothing_and_a_hard_one_not_too_fast(
    robot: RobotDescription,
) -> None:
    """Random pushes. Oracle: the speed of the TCP by the Jacobian."""
    rng = np.random.default_rng(14)
    limits = robot.limits
    stiffness = np.full(limits.dof, 100.0)
    low, high = limits.min_position + 0.3, limits.max_position - 0.3
    touched = Guidance(robot, stiffness)
    for _ in range(200):
        external = rng.uniform(-1.0, 1.0, limits.dof) * limits.max_effort
        position = rng.uniform(low, high)
        still, _ = touched.step(position, position, 0.0049 * external, 0.02)
        np.testing.assert_array_equal(still, position)
        guidance = Guidance(robot, stiffness)
        target = position
        for _ in range(5):
            target, _ = guidance.step(target, position, external, 0.02)
        assert np.abs(target - position).max() < MAX_LEAD_RAD * 10
        _, _, jacobian = robot.model.forward_and_jacobian(position)
        assert np.linalg.norm(jacobian[:3] @ guidance.velocity) <= TCP_M_S * 1.001
        assert (np.abs(guidance.velocity) <= limits.max_velocity).all()
        moves = np.abs(guidance.velocity) > 1e-9
        assert (np.sign(guidance.velocity) == np.sign(external))[moves].all(), "each joint gives way"


def test_a_joint_that_a_device_lets_pass_its_limit_is_named(run: VirtualService) -> None:
    limits = run.rig.robot.limits
    within = (limits.min_position + limits.max_position) / 2.0
    assert outside(limits, within) == ""
    position = within.copy()
    position[2] = limits.max_position[2] + 0.1
    said = outside(limits, position)
    assert said.startswith(f"{limits.names[2]} is at {position[2]:.2f} rad, outside its limits of ")
    assert said.endswith("guide it back")
