"""The Robot API of our simulated PolyScope X. Oracle: httpx as a client, and the state of the controller."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from ur_arm import ur_folder
from ur_run import ControllerProcess

from cobot.config import SETTINGS_FILE

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="needs loopback addresses besides 127.0.0.1")
PORT, WAIT_S = 29_080, 30.0
STATE = "/robotstate/v1/state"


@pytest.fixture(scope="module")
def controller(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ControllerProcess]:
    settings: Path = ur_folder(tmp_path_factory.mktemp("arm")) / SETTINGS_FILE
    with ControllerProcess(settings, "--series", "x", "--robot-api-port", str(PORT)) as started:
        yield started


@pytest.fixture
def http(controller: ControllerProcess) -> Iterator[httpx.Client]:
    url = f"http://{controller.address}:{PORT}/universal-robots/robot-api"
    with httpx.Client(base_url=url, timeout=WAIT_S) as made:
        yield made


def mode(http: httpx.Client, path: str) -> Any:
    return http.get(path).raise_for_status().json()["mode"]


def test_the_arm_is_switched_on_and_unlocked(controller: ControllerProcess, http: httpx.Client) -> None:
    assert (mode(http, "/robotstate/v1/robotmode"), mode(http, "/system/v1/controlmode")) == (
        "POWER_OFF",
        "REMOTE",
    )
    assert http.put(STATE, json={"action": "BRAKE_RELEASE"}).status_code == 200
    until_s = time.monotonic() + WAIT_S
    while mode(http, "/robotstate/v1/robotmode") != "RUNNING":
        assert time.monotonic() < until_s
    controller.ask(safety=3, blocked="Cannot unlock")
    assert mode(http, "/robotstate/v1/safetymode") == "PROTECTIVE_STOP"
    unlock = {"action": "UNLOCK_PROTECTIVE_STOP"}
    assert http.put(STATE, json=unlock).json()["details"] == "Cannot unlock"
    controller.ask(blocked="")
    assert http.put(STATE, json=unlock).status_code == 200
    assert mode(http, "/robotstate/v1/safetymode") == "NORMAL"


def test_bad_requests_and_local_control_change_nothing(
    controller: ControllerProcess, http: httpx.Client
) -> None:
    assert http.get("/nothing").status_code == 404
    assert http.post(STATE).status_code == 405
    assert http.put(STATE, json={"action": "JUMP"}).status_code == 422
    assert http.put(STATE, content=10_000 * b"[").status_code == 422
    assert http.put("/program/v1/state", json={"action": "play"}).status_code == 409
    controller.ask(remote=False)
    assert http.put(STATE, json={"action": "POWER_OFF"}).status_code == 403
    assert mode(http, "/system/v1/controlmode") == "LOCAL"
    controller.ask(remote=True)
