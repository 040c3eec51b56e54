"""A motion over HTTP and what ends it, on virtual time.

Oracle: what GET /health says about the arm.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from virtual import VirtualService, virtual_service


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    """One for all tests here."""
    with virtual_service(tmp_path_factory.mktemp("robot")) as started:
        yield started


def test_a_stopped_motion_answers_its_own_client_too(service: VirtualService) -> None:
    body = {"joints": [1.5, 0.5, 0, -1.57, 0, 1.57, 0], "speed": 0.01}
    mover = service.begin(service.asking("POST", "/robot/move/joints", json=body))
    service.until(lambda: service.health()["robot"]["mode"] == "TRAJECTORY")
    service.sleep(1.0)
    assert service.post("/stop").json()["at_rest"]
    answer = service.end(mover).json()
    assert answer["success"] is False
    assert answer["code"] == "stopped"
    assert "POST /stop" in answer["message"]
