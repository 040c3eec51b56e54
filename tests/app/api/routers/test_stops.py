"""Stop categories and the first contact, as clients of REST see them, on virtual time.

Oracle: the limits, and the cycle's own record of what was commanded.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from virtual_service import VirtualService, virtual_service

from cobot.robot.device import Capabilities
from cobot.types import LoopMode
from rtloop.device import DeviceWatch

AWAY = [0.8, 0.3, -0.3, -1.2, 0.3, 1.2, 0.5]
FOUND = "First contact: the device reports joint1 0.0 degrees"


def stopped_in_motion(service: VirtualService, path: str) -> dict[str, Any]:
    service.go_home()
    body = {"joints": AWAY, "speed": 1.0}
    moving = service.begin(service.asking("POST", "/robot/move/joints", json=body))
    service.until(lambda: service.health()["robot"]["mode"] == "TRAJECTORY")
    service.sleep(0.25)
    answer = service.post(path)
    assert answer.status_code == 200, answer.text
    moved = service.end(moving).json()
    found: dict[str, Any] = answer.json()
    return found | {"moved": moved}


def test_by_default_the_arm_is_held_on_its_path(service: VirtualService) -> None:
    for path in ("/stop", "/stop?category=2", f"/robots/{service.name}/stop?category=2"):
        stopped = stopped_in_motion(service, path)
        assert (stopped["success"], stopped["category"], stopped["confirmed_by"]) == (True, 2, "cobot")
        assert stopped["moved"]["code"] == "stopped"
        assert service.rig.mode is LoopMode.HOLD


def test_a_fast_stop_is_sooner_within_the_limits_and_ends_with_the_drives_off(
    service: VirtualService,
) -> None:
    rig = service.rig
    rig.commanded.clear()
    driven: list[int] = []
    service.cycles[service.name].watch = lambda: driven.append(not rig.loop.controller.drives.off)
    stopped = stopped_in_motion(service, "/stop?category=1")
    assert (stopped["success"], stopped["category"], stopped["confirmed_by"]) == (True, 1, "cobot")
    assert stopped["at_rest"]
    assert stopped["moved"]["success"] is False
    assert not driven[-1]
    del rig.commanded[sum(driven) :]  # then it follows the arm, and nobody is told
    for rate in rig.rates():
        assert rate.max() <= 1.01
    health = service.health()["robot"]
    assert (health["mode"], health["reason"]) == ("ESTOP", "fast stop requested")
    assert health["device"]["drives_off"] is True
    refused = service.post("/robot/move/named", {"name": "home"})
    assert refused.status_code == 503
    assert "fast stop requested" in refused.json()["detail"]
    service.post("/robot/reset").raise_for_status()
    assert service.health()["robot"]["device"]["drives_off"] is False
    service.go_home()


def test_a_fast_stop_without_category_1_holds_the_arm_and_says_so(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    watch = service.rig.loop._device
    monkeypatch.setattr(watch, "capabilities", Capabilities(stops={2: True}))
    service.rig.memory.device.data["stops"] = [0, 0, 2]
    watch._publish()
    stopped = service.post("/stop?category=1").json()
    assert (stopped["success"], stopped["category"], stopped["confirmed_by"]) == (True, 2, "device")
    assert "the drives hold the arm: the backend mujoco has no stop category 1" in stopped["message"]
    assert service.rig.mode is LoopMode.ESTOP
    service.rig.memory.device.data["stops"] = [0, 1, 1]
    watch._publish()
    service.post("/robot/reset").raise_for_status()


@pytest.mark.parametrize("category", ["0", "3", "-1", "one", "", "1.5", "nan"])
def test_a_category_that_is_none_is_refused_by_its_name(service: VirtualService, category: str) -> None:
    answer = service.post(f"/stop?category={category}")
    assert (answer.status_code, answer.json()["code"]) == (422, "input")
    assert "category" in answer.json()["detail"]


def test_the_client_has_the_category_too(service: VirtualService) -> None:
    client = service.client(service.url)
    assert client.stop(category=1)["category"] == 1
    client.reset()
    assert client.stop()["category"] == 2


@pytest.fixture
def unacknowledged(service: VirtualService) -> DeviceWatch:
    """As if the arm were hardware that has just been met."""
    watch: DeviceWatch = service.rig.loop._device
    watch._acknowledged = False
    watch.meet(FOUND)
    service.rig.loop.controller.clock.scale(watch.share)
    return watch


@pytest.mark.usefixtures("unacknowledged")
def test_to_acknowledge_needs_a_word_about_the_payload(service: VirtualService) -> None:
    device = service.health()["robot"]["device"]
    assert (device["unacknowledged"], device["speed_share"]) == (FOUND, pytest.approx(0.1))
    refused = service.post("/robot/acknowledge", {})
    assert refused.status_code == 422
    assert "tool and load are not confirmed" in refused.json()["detail"]
    assert service.post("/robot/acknowledge", {"payload_checked": 7}).status_code == 422
    done = service.post("/robot/acknowledge", {"payload_checked": True}).json()
    assert done == {"success": True, "message": "acknowledged: the robot moves at full speed", "found": FOUND}
    device = service.health()["robot"]["device"]
    assert (device["unacknowledged"], device["speed_share"]) == ("", 1.0)
    again = service.client(service.url).acknowledge()
    assert (again["message"], again["found"]) == ("there was nothing to acknowledge", "")


@pytest.mark.usefixtures("unacknowledged")
def test_a_tool_that_was_set_is_word_enough(service: VirtualService) -> None:
    service.post("/robot/tool", {"mass": 0.5, "name": "gripper"}).raise_for_status()
    assert service.post("/robot/acknowledge", {}).json()["found"] == FOUND
    service.post("/robot/tool", {"clear": True}).raise_for_status()


def test_the_drives_of_several_robots(tmp_path: Path) -> None:
    with virtual_service(tmp_path, robots=2) as pair:
        one, other = pair.names
        stopped = pair.post(f"/robots/{one}/stop?category=1").json()
        assert stopped["category"] == 1
        assert pair.rigs[other].mode is LoopMode.HOLD
        stopped = pair.post("/stop?category=1").json()
        assert (stopped["category"], stopped["success"]) == (1, True)
        assert pair.rigs[other].mode is LoopMode.ESTOP
