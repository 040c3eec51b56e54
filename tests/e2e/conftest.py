"""Running services: one that is shared, and one for the tests that break it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from running import WAIT_S, Run


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    """A started `cobot run` that answers."""
    yield from _running(Run(tmp_path))


@pytest.fixture(scope="session")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """A `cobot run` that many tests use; they leave it able to move."""
    yield from _running(Run(tmp_path_factory.mktemp("shared")))


@pytest.fixture
def http(shared: Run) -> Iterator[httpx.Client]:
    """The shared service, its arm at home."""
    with httpx.Client(base_url=shared.url, timeout=WAIT_S) as client:
        client.post("/stop").raise_for_status()
        home = client.post("/robot/move/named", json={"name": "home", "speed": 1.0})
        assert home.json()["success"], home.text
        yield client


def _running(started: Run) -> Iterator[Run]:
    try:
        started.until(started.healthy)
        yield started
    finally:
        started.end()
