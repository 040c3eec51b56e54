"""Two robots of one service, on virtual time: each moves and stops by itself.

Oracle: where the arms are as HTTP shows it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import httpx
import pytest
from asgi_client import Refused
from streaming_client import Frames
from virtual_service import VirtualService

from cobot import Robot

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
AWAY = [0.4, 0.1, 0.0, -1.4, 0.0, 1.4, 0.2]
EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture
def http(pair: VirtualService) -> VirtualService:
    """Both arms at home."""
    assert pair.healthy()
    pair.post("/stop").raise_for_status()
    moves = [pair.begin(home(pair, name)) for name in pair.names]
    for each in moves:
        answer = pair.end(each)
        assert answer.json()["success"], answer.text
    return pair


async def home(pair: VirtualService, robot: str) -> httpx.Response:
    return await pair.asking("POST", f"/robots/{robot}/move/joints", json={"joints": HOME, "speed": 1.0})


def move(client: VirtualService, robot: str, joints: list[float], speed: float = 0.5) -> httpx.Response:
    return client.post(f"/robots/{robot}/move/joints", json={"joints": joints, "speed": speed})


def send(client: VirtualService, robot: str, seconds: float, joints: list[float] = AWAY) -> int:
    """Have it move for so long; the motion's number."""
    body = {"points": [{"positions": joints, "time_from_start": seconds}]}
    answer = client.post(f"/robots/{robot}/trajectory/send", json=body)
    assert answer.status_code == 200, answer.text
    return int(answer.json()["motion_id"])


def robot_health(client: VirtualService, robot: str) -> dict[str, Any]:
    answer = client.get(f"/robots/{robot}/health").json()
    return {**answer, **answer["robot"]}


def moving(client: VirtualService, robot: str) -> bool:
    return bool(robot_health(client, robot)["mode"] == "TRAJECTORY")


def arrived(client: VirtualService, robot: str, motion: int) -> bool:
    lines = client.get(f"/robots/{robot}/trajectory/logs").json()["lines"]
    ended = [line for line in lines if f"motion {motion}: " in line and "accepted" not in line]
    assert not ended or ended[-1].endswith("arrived and settled"), ended
    return bool(ended)


def joints(client: VirtualService, robot: str) -> list[float]:
    answer = client.get(f"/robots/{robot}/joint_states")
    answer.raise_for_status()
    return list(answer.json()["position"])


def test_both_are_listed_and_the_first_is_the_default_one(pair: VirtualService, http: VirtualService) -> None:
    assert [(each["name"], each["default"]) for each in http.get("/robots").json()] == [
        (pair.names[0], True),
        (pair.names[1], False),
    ]
    health = http.get("/health").json()
    assert list(health["robots"]) == [pair.names[0], pair.names[1]]
    assert health["robot"]["name"] == pair.names[0]
    assert http.get("/robot/positions").content == http.get(f"/robots/{pair.names[0]}/positions").content


def test_both_move_at_the_same_time_and_each_where_it_was_sent(
    pair: VirtualService, http: VirtualService
) -> None:
    left = send(http, pair.names[0], 3.0)
    right = send(http, pair.names[1], 3.0, [-value for value in AWAY[:3]] + HOME[3:])
    assert moving(http, pair.names[0])
    assert moving(http, pair.names[1])
    pair.until(lambda: arrived(http, pair.names[0], left) and arrived(http, pair.names[1], right))
    assert joints(http, pair.names[0]) == pytest.approx(AWAY, abs=2e-3)
    assert joints(http, pair.names[1]) == pytest.approx([-0.4, -0.1, 0.0, *HOME[3:]], abs=2e-3)
    assert http.get("/robot/joint_states").json()["position"] == pytest.approx(AWAY, abs=2e-3)


def test_one_plans_and_moves_while_the_other_is_owned_by_somebody(
    pair: VirtualService, http: VirtualService
) -> None:
    send(http, pair.names[0], 20.0)
    refused = http.post("/robot/move/named", json={"name": "home"})
    assert refused.status_code == 409
    assert move(http, pair.names[1], AWAY).json()["success"]
    assert moving(http, pair.names[0])


def test_a_stop_with_a_name_stops_one_and_without_a_name_both(
    pair: VirtualService, http: VirtualService
) -> None:
    left = send(http, pair.names[0], 6.0)
    send(http, pair.names[1], 60.0)
    stopped = http.post(f"/robots/{pair.names[1]}/stop").json()
    assert stopped["success"]
    assert len(stopped["stopped"]) == 1
    assert moving(http, pair.names[0])
    pair.until(lambda: arrived(http, pair.names[0], left))
    send(http, pair.names[0], 60.0, HOME)
    send(http, pair.names[1], 60.0, HOME)
    both = http.post("/stop").json()
    assert both["success"]
    assert [item.partition(": ")[0] for item in both["stopped"]] == [pair.names[0], pair.names[1]]
    assert not moving(http, pair.names[0])
    assert not moving(http, pair.names[1])


def test_an_emergency_stop_of_one_leaves_the_motion_of_the_other_alone(
    pair: VirtualService, http: VirtualService
) -> None:
    left = send(http, pair.names[0], 4.0)
    with Frames(pair.connect(f"/robots/{pair.names[1]}/stream")) as client:
        assert client.hello["robot"] == pair.names[1]
        client.session()
        client.send("estop")
        pair.until(lambda: robot_health(http, pair.names[1])["mode"] == "ESTOP")
        # until it rests, the session owns the arm
        pair.until(lambda: robot_health(http, pair.names[1])["session"] is None)
    assert moving(http, pair.names[0])
    health = http.get("/health").json()
    assert health["status"] == "ok"
    assert {name: each["status"] for name, each in health["robots"].items()} == {
        pair.names[0]: "ok",
        pair.names[1]: "degraded",
    }
    refused = move(http, pair.names[1], AWAY).json()
    assert refused["code"] == "not_ready"
    assert refused["detail"].endswith(f"then POST /robots/{pair.names[1]}/reset")
    pair.until(lambda: arrived(http, pair.names[0], left))
    assert http.post(f"/robots/{pair.names[1]}/reset").json()["success"]
    assert move(http, pair.names[1], AWAY).json()["success"]


def test_an_unknown_name_is_refused_and_the_valid_ones_are_listed(
    pair: VirtualService, http: VirtualService
) -> None:
    valid = f"there is no robot 'nobody'; valid names: {pair.names[0]}, {pair.names[1]}"
    answer = move(http, "nobody", HOME)
    assert (answer.status_code, answer.json()) == (404, {"detail": valid, "code": "not_found"})
    with pytest.raises(Refused) as caught:
        pair.connect("/robots/nobody/stream")
    assert caught.value.status == 404
    assert json.loads(caught.value.body) == {"detail": valid, "code": "not_found"}


def test_stopping_a_robot_of_python_leaves_the_other_alone(
    pair: VirtualService, http: VirtualService
) -> None:
    left = send(http, pair.names[0], 4.0)
    with Robot(pair.names[1], clock=pair.clock, client=pair.client) as robot:
        robot.stop()
    pair.until(lambda: arrived(http, pair.names[0], left))


def test_what_they_log_says_whose_it_is(pair: VirtualService, http: VirtualService) -> None:
    right = send(http, pair.names[1], 2.0)
    pair.until(lambda: f"{pair.names[1]}: motion {right}: arrived and settled" in pair.output)
