"""The REST API of a hub while other requests wait. Oracle: docs/fleet.md, "Look and stop"."""

from __future__ import annotations

import importlib.util
import threading
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, cast

import pytest
from cobot_run import until
from fastapi.testclient import TestClient

if importlib.util.find_spec("zenoh") is None:
    pytest.skip("Zenoh is not installed: it is in the extra fleet", allow_module_level=True)
from cobot.access.authentication import Authenticator
from cobot.access.roles import Role
from cobot.access.tokens import TokenFile
from cobot.fleet.hub import Hub
from cobot.fleet.web import MAX_PICTURES, make_app

REQUESTS = 60
"""More than the 40 threads that FastAPI has for all requests."""


class WaitingHub:
    """Its cell answers to stops at once, and to all else when `answer` is set."""

    fleet = "hall"

    def __init__(self) -> None:
        self.answer = threading.Event()
        self.asked = 0
        self.forgotten: list[str] = []

    def picture(self, cell: str, robot: str) -> bytes:
        self.asked += 1
        self.answer.wait()
        return b""

    def programs(self, cell: str, robot: str) -> list[Any]:
        self.picture(cell, robot)
        return []

    def forget(self, cell: str) -> None:
        self.forgotten.append(cell)

    def command(self, *_: Any, **__: Any) -> list[dict[str, Any]]:
        return [{"cell": "one", "robot": "arm", "code": "ok", "text": ""}]


@pytest.fixture
def hub() -> WaitingHub:
    return WaitingHub()


@pytest.fixture
def client(hub: WaitingHub) -> Iterator[TestClient]:
    with TestClient(make_app(cast(Hub, hub), ["testserver"])) as made:
        yield made
        hub.answer.set()


def test_a_stop_does_not_wait_for_other_requests(hub: WaitingHub, client: TestClient) -> None:
    with ThreadPoolExecutor(REQUESTS + 1) as pool:
        waiting = [pool.submit(client.get, "/cells/one/robots/arm/programs") for _ in range(REQUESTS)]
        until(lambda: hub.asked >= 40)
        try:
            assert pool.submit(client.post, "/stop").result(10.0).json()["at_rest"]
        finally:
            hub.answer.set()
        assert {each.result().status_code for each in waiting} == {200}


def test_too_many_pictures_at_once_are_rejected(hub: WaitingHub, client: TestClient) -> None:
    with ThreadPoolExecutor(MAX_PICTURES) as pool:
        path = "/cells/one/robots/arm/picture"
        waiting = [pool.submit(client.get, path) for _ in range(MAX_PICTURES)]
        until(lambda: hub.asked == MAX_PICTURES)
        rejected = client.get(path)
        hub.answer.set()
        assert (rejected.status_code, rejected.json()["code"]) == (409, "busy")
        assert "try again" in rejected.json()["detail"]
        assert Counter(each.result().status_code for each in waiting) == {200: MAX_PICTURES}
        assert client.get(path).status_code == 200


@pytest.mark.parametrize(("role", "status"), [(Role.OBSERVER, 403), (Role.AGENT, 403), (Role.OPERATOR, 200)])
def test_the_removal_of_a_cell_needs_an_operator(
    hub: WaitingHub, tmp_path: Path, role: Role, status: int
) -> None:
    file = TokenFile(tmp_path / "tokens.json")
    app = make_app(cast(Hub, hub), ["testserver"], Authenticator(file))
    token = file.create("bob", role)
    answer = TestClient(app).delete("/cells/one", headers={"Authorization": f"Bearer {token}"})
    assert answer.status_code == status
    assert ("the removal of a cell needs the role operator" in answer.text) is (status == 403)
    assert hub.forgotten == (["one"] if status == 200 else [])
