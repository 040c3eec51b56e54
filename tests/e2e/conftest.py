"""Running services: one that is shared, and one for the tests that break it."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from cobot_run import WAIT_S, Pair, Run, answering

pytest.register_assert_rewrite("panel")  # tests that test_panel.py imports


@pytest.fixture
def run(tmp_path: Path) -> Iterator[Run]:
    """A started `cobot run` that answers."""
    with answering(Run(tmp_path)) as started:
        yield started


@pytest.fixture(scope="package")
def shared(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Run]:
    """A `cobot run` that many tests use; they leave it able to move."""
    assert isinstance(request.node, pytest.Package), "without an __init__.py it would idle until the run ends"
    with answering(Run(tmp_path_factory.mktemp("shared"), capacity=200_000)) as started:
        yield started


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Run]:
    """One in real time, for what has to happen in the middle of a motion, or streams."""
    with answering(Run(tmp_path_factory.mktemp("service"), clock="realtime")) as started:
        yield started


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pair]:
    with answering(Pair(tmp_path_factory.mktemp("pair"))) as started:
        yield started


@pytest.fixture
def http(shared: Run) -> Iterator[httpx.Client]:
    """The shared service, its arm at home."""
    shared.go_home()
    with httpx.Client(base_url=shared.url, timeout=WAIT_S) as client:
        yield client
