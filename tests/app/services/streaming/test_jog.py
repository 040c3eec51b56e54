"""Jogging over the WebSocket on virtual time.

Oracles: the arm's state by REST; MuJoCo's distances between geoms; joint_limits.yaml; finite differences of
what rtloop commands.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from streaming_client import Frames
from virtual_service import VirtualService

from app.services.streaming.jog import SILENCE_S
from app.services.streaming.jog_limits import TCP_M_S, JogLimits, damped
from cobot.robot.description import RobotDescription
from cobot.types import Array

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
EVERY_S = 0.05
WALL = {"shape": "box", "size": [0.02, 1.0, 1.0], "x": 0.6, "y": 0.0, "z": 0.6}


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    yield service
    service.cycles[service.name].watch = lambda: None
    service.until(lambda: service.health()["session"] is None)


@pytest.fixture
def client(run: VirtualService) -> Iterator[Frames]:
    with Frames(run.connect("/robot/stream")) as connected:
        yield connected


def hold(run: VirtualService, client: Frames, seconds: float, **frame: Any) -> dict[str, Any]:
    """As a button that is held; the last answer."""
    answer: dict[str, Any] = {}
    for _ in range(round(seconds / EVERY_S)):
        client.send("jog", **frame)
        answer = client.answer()
        assert answer["type"] == "jog", answer
        run.sleep(EVERY_S)
    return answer


def let_go(client: Frames) -> dict[str, Any]:
    client.send("jog")
    while (answer := client.answer())["type"] != "jog_ended":
        pass
    return answer


def joint(index: int, rate: float) -> dict[str, Any]:
    return {"joints": [rate if each == index else 0.0 for each in range(7)]}


def tcp(run: VirtualService) -> Array:
    position = run.get("/robot/pose").json()["position"]
    return np.array([position[axis] for axis in "xyz"])


def orientation(run: VirtualService) -> Array:
    turned = run.get("/robot/pose").json()["orientation"]["quaternion"]
    return np.array([turned[part] for part in "wxyz"])


class Commands:
    """What rtloop has commanded, cycle by cycle."""

    def __init__(self, run: VirtualService) -> None:
        self.rows: list[Array] = []
        state = run.rig.memory.state.data
        run.cycles[run.name].watch = lambda: self.rows.append(state["commanded_position"].copy())

    def rates(self, order: int) -> Array:
        return np.diff(np.array(self.rows), order, axis=0) / 0.001**order


def interventions(run: VirtualService) -> dict[str, int]:
    found: dict[str, int] = run.health()["interventions"]
    return found


def test_a_joint_moves_while_it_is_held_and_rests_when_it_is_let_go(
    run: VirtualService, client: Frames
) -> None:
    before, commands = interventions(run), Commands(run)
    answer = hold(run, client, 1.0, **joint(0, 0.3))
    assert answer == {"type": "jog", "share": 1.0, "limited_by": ""}
    assert run.health()["session"]["client"].startswith("WS /robot/stream from 127.0.0.1")
    assert let_go(client) == {"type": "jog_ended", "reason": ""}
    moved = np.array(run.joints()) - HOME
    assert moved[0] == pytest.approx(0.3, abs=0.1), "a second at 0.3 rad/s, with a ramp at both ends"
    np.testing.assert_allclose(moved[1:], 0.0, atol=2e-3)
    run.sleep(1.0)
    np.testing.assert_allclose(np.array(run.joints()) - HOME, moved, atol=2e-3)
    assert interventions(run) == before, "it is as smooth as a stream has to be"
    assert np.abs(commands.rates(1)).max() < 0.35
    reached = commands.rates(1)[700:1000, 0]
    np.testing.assert_allclose(reached.mean(), 0.3, rtol=0.02)
    assert np.abs(commands.rates(2)).max() < 5.0, "rad/s²: as joint_limits.yaml has it"


@pytest.mark.parametrize(("frame", "axis"), [("base", [0.0, 0.0, 1.0]), ("tool", [0.0, 0.0, -1.0])])
def test_the_tcp_moves_straight_in_the_frame_that_is_asked_for(
    run: VirtualService, client: Frames, frame: str, axis: list[float]
) -> None:
    """At home the tool points down: its z is the base's -z."""
    begin = tcp(run)
    path: list[Array] = []
    for _ in range(10):
        hold(run, client, 0.1, twist=[0.0, 0.0, 0.1, 0.0, 0.0, 0.0], frame=frame)
        path.append(tcp(run) - begin)
    let_go(client)
    end = tcp(run) - begin
    assert 0.07 < end @ axis < 0.13
    for place in [*path, end]:
        assert np.linalg.norm(place - (place @ axis) * np.array(axis)) < 1e-3, "off the straight line"


@pytest.mark.parametrize("frame", ["base", "tool"])
def test_the_deviations_of_many_jogs_of_the_tcp_do_not_add_up(
    run: VirtualService, client: Frames, frame: str
) -> None:
    """A jog of 0.2 m once led 4 mm off its axis and tilted the hand by 0.7°, and each further one more."""
    begin, turned = tcp(run), orientation(run)
    for index, speed in ((0, 0.1), (1, 0.1), (0, -0.1), (1, -0.1)):
        before = tcp(run)
        hold(run, client, 2.0, twist=[speed if each == index else 0.0 for each in range(6)], frame=frame)
        way = tcp(run) - before
        assert abs(way[index]) == pytest.approx(0.18, abs=0.01)
        assert abs(tcp(run)[2] - begin[2]) < 1e-3, "m, while it is held"
        assert abs(turned @ orientation(run)) > np.cos(0.5 * np.radians(0.1)), "while it is held"
        let_go(client)
        assert abs(turned @ orientation(run)) > np.cos(0.5 * np.radians(1.0)), "after the stop of the joints"
        np.testing.assert_allclose(tcp(run)[2], begin[2], atol=4e-3)
    np.testing.assert_allclose(tcp(run), begin, atol=0.02)


def test_a_jog_after_another_motion_begins_where_the_arm_is(run: VirtualService, client: Frames) -> None:
    hold(run, client, 1.0, twist=[0.1, 0.0, 0.0, 0.0, 0.0, 0.0], frame="base")
    let_go(client)
    tilted = [0.0, 0.1, 0.0, -1.5, 0.0, 1.7, 0.0]
    assert run.post("/robot/move/joints", {"joints": tilted, "speed": 1.0}).json()["success"]
    begin, turned = tcp(run), orientation(run)
    hold(run, client, 1.0, twist=[0.0, 0.1, 0.0, 0.0, 0.0, 0.0], frame="base")
    np.testing.assert_allclose((tcp(run) - begin)[[0, 2]], 0.0, atol=1e-3)
    assert abs(turned @ orientation(run)) > np.cos(0.5 * np.radians(0.1))
    let_go(client)


def test_the_tcp_turns_where_it_is(run: VirtualService, client: Frames) -> None:
    begin = tcp(run)
    hold(run, client, 1.0, twist=[0.0, 0.0, 0.0, 0.0, 0.0, 0.3], frame="base")
    let_go(client)
    assert np.linalg.norm(tcp(run) - begin) < 4e-3
    angles = run.get("/robot/pose").json()["orientation"]["euler_rad"]
    assert abs(abs(angles["a"]) - (np.pi - 0.3)) < 0.1


def test_silence_is_letting_go(run: VirtualService, client: Frames) -> None:
    hold(run, client, 0.5, **joint(0, 0.3))
    rest = Commands(run)
    run.until(lambda: client.answer()["type"] == "jog_ended")
    still = np.flatnonzero(np.abs(rest.rates(1)).max(axis=1) > 1e-3)[-1] * 0.001
    assert still < SILENCE_S + 0.4, "s: what is granted, and the way to rest"
    client.send("jog", **joint(0, 0.3))
    answer = client.answer()
    assert (answer["share"], "let go" in answer["limited_by"]) == (0.0, True), "a button that is still held"
    client.send("jog")
    assert hold(run, client, 0.2, **joint(0, 0.3))["share"] > 0.0
    let_go(client)


def test_a_lost_connection_is_letting_go(run: VirtualService) -> None:
    client = Frames(run.connect("/robot/stream"))
    hold(run, client, 0.5, **joint(0, 0.3))
    rest = Commands(run)
    client.socket.close()
    run.until(lambda: run.health()["session"] is None)
    moving = np.flatnonzero(np.abs(rest.rates(1)).max(axis=1) > 1e-3)
    assert moving[-1] * 0.001 < 0.5


def test_a_stop_ends_it_for_who_still_holds(run: VirtualService, client: Frames) -> None:
    hold(run, client, 0.5, **joint(0, 0.3))
    run.post("/stop").raise_for_status()
    while (answer := client.answer())["type"] != "jog_ended":
        pass
    assert "stop" in answer["reason"]
    before = run.joints()
    for _ in range(10):
        client.send("jog", **joint(0, 0.3))
        assert client.answer()["share"] == 0.0
        run.sleep(EVERY_S)
    np.testing.assert_allclose(run.joints(), before, atol=2e-3)
    client.send("jog")
    assert hold(run, client, 0.2, **joint(0, 0.3))["share"] > 0.0
    let_go(client)


@pytest.mark.parametrize("sign", [-1, 1])
def test_no_jog_gets_past_a_limit(
    run: VirtualService, client: Frames, robot: RobotDescription, sign: int
) -> None:
    near = {"joints": [*HOME[:6], sign * 2.2], "speed": 1.0}
    assert run.post("/robot/move/joints", near).json()["success"]
    before = interventions(run)
    answer = hold(run, client, 3.0, **joint(6, sign * 1.0))
    end = robot.limits.max_position[6] if sign > 0 else robot.limits.min_position[6]
    assert answer["share"] < 0.05
    assert f"near its limit of {end:.2f} rad" in answer["limited_by"]
    let_go(client)
    assert 0.0 < sign * (end - run.joints()[6]) < 0.03
    assert interventions(run) == before
    answer = hold(run, client, 0.3, **joint(6, sign * -0.3))
    assert answer["share"] == 1.0, "back it goes at full speed"
    let_go(client)


def test_no_jog_gets_into_a_collision(run: VirtualService, client: Frames, robot: RobotDescription) -> None:
    run.post("/scene", {"objects": {"wall": WALL}}).raise_for_status()
    try:
        answer = hold(run, client, 3.5, twist=[0.2, 0.0, 0.0, 0.0, 0.0, 0.0], frame="base")
        assert answer["share"] < 0.1
        assert "wall" in answer["limited_by"]
        assert "mm from each other" in answer["limited_by"]
        let_go(client)
        assert tcp(run)[0] > 0.43, "it has come some way"
        assert run.post("/scene", {"frames": {"there": {"x": 0, "y": 0, "z": 0}}}).json()["contacts"] == []
        assert run.post("/robot/move/joints", {"joints": HOME, "speed": 1.0}).json()["success"], (
            "a motion may begin"
        )
    finally:
        run.post("/scene", {"clear": True}).raise_for_status()


def test_near_a_singularity_it_slows_down_and_says_why(run: VirtualService, client: Frames) -> None:
    stretched = [0.0, 0.4, 0.0, -0.25, 0.0, 0.6, 0.0]
    assert run.post("/robot/move/joints", {"joints": stretched, "speed": 1.0}).json()["success"]
    outwards = (tcp(run) - [0.0, 0.0, 0.36]) / np.linalg.norm(tcp(run) - [0.0, 0.0, 0.36])
    commands = Commands(run)
    answer = hold(run, client, 3.0, twist=[*(0.1 * outwards), 0.0, 0.0, 0.0], frame="base")
    let_go(client)
    assert answer["share"] < 0.5
    assert answer["limited_by"]
    assert np.abs(commands.rates(1)).max() < 0.8, "no joint runs away"


def test_all_that_is_asked_for_is_slowed_down_to_what_people_may_be_near(
    run: VirtualService, client: Frames, robot: RobotDescription
) -> None:
    commands = Commands(run)
    answer = hold(run, client, 1.0, twist=[0.0, 50.0, 0.0, 0.0, 0.0, 0.0], frame="base")
    assert answer["share"] < 0.01
    let_go(client)
    rows = np.array(commands.rows)
    places = np.array([robot.model.forward(row).position for row in rows[::5]])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / 0.005
    assert 0.8 * TCP_M_S < speeds.max() < 1.05 * TCP_M_S


@pytest.mark.parametrize(
    ("frame", "said"),
    [
        ({"joints": [0.1]}, "joints must have 7 numbers"),
        ({"joints": [float("nan")] * 7}, "finite"),
        ({"twist": [0.1]}, "twist"),
        ({"joints": [0.1] * 7, "twist": [0.1] * 6}, "cannot be combined; give one of them"),
        ({"joints": [0.1] * 7, "frame": "tool"}, "frame"),
        ({"twist": [0.1] * 6, "frame": "world"}, "frame"),
        ({"rate": 1.0}, "unknown key 'rate'"),
    ],
)
def test_a_wrong_frame_moves_nothing_and_says_what_is_wrong(
    run: VirtualService, client: Frames, frame: dict[str, Any], said: str
) -> None:
    client.send("jog", **frame)
    answer = client.answer()
    assert (answer["type"], answer["code"], answer["about"]) == ("error", "input", "jog")
    assert said in answer["detail"]
    assert run.health()["session"] is None


def test_who_jogs_owns_the_arm_until_he_lets_go(run: VirtualService, client: Frames) -> None:
    hold(run, client, 0.3, **joint(0, 0.1))
    refused = run.post("/robot/move/named", {"name": "work"})
    assert refused.status_code == 409
    assert "WS /robot/stream" in refused.json()["detail"]
    with Frames(run.connect("/robot/stream")) as other:
        other.send("jog", **joint(0, -0.1))
        answer = other.answer()
        assert (answer["type"], answer["code"]) == ("error", "conflict")
    hold(run, client, 0.3, **joint(0, 0.1))
    let_go(client)
    assert run.post("/robot/move/named", {"name": "work", "speed": 1.0}).json()["success"]


def test_damped_velocities_are_exact_where_nothing_is_singular(robot: RobotDescription) -> None:
    random = np.random.default_rng(3)
    _, _, jacobian = robot.model.forward_and_jacobian(np.array([0.2, 0.5, 0.1, -1.4, 0.2, 1.2, 0.3]))
    for _ in range(20):
        twist = random.normal(size=6)
        velocity = damped(jacobian, twist)
        np.testing.assert_allclose(jacobian @ velocity, twist, atol=1e-9)
        np.testing.assert_allclose(velocity, np.linalg.pinv(jacobian) @ twist, atol=1e-9)


def test_no_velocity_leads_past_what_is_left(robot: RobotDescription) -> None:
    """At random places: within a step of 20 ms nothing comes as near as a motion must not."""
    random, limits, checked = np.random.default_rng(4), robot.limits, JogLimits(robot)
    slowed = 0
    for _ in range(600):
        position = random.uniform(limits.min_position, limits.max_position)
        if not robot.collision.is_free(position):
            continue
        velocity = random.uniform(-0.5, 0.5, 7) * limits.max_velocity
        share, reason = checked.share(position, velocity)
        assert (share < 1.0) == bool(reason)
        slowed += share < 1.0
        after = position + 0.02 * share * velocity
        assert (after <= limits.max_position).all()
        assert (after >= limits.min_position).all()
        assert robot.collision.is_free(after)
    assert slowed > 30
