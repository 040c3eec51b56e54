"""`api_endpoints.yaml`. Oracle: the messages a person needs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from cobot.config import EndpointChange, load_endpoints
from cobot.errors import ConfigError
from cobot.launch import endpoints
from cobot.launch.endpoints import check_endpoints


def write(folder: Path, text: str) -> Path:
    path = folder / "endpoints.yaml"
    path.write_text(f"endpoints:\n{text}", encoding="utf-8")
    return path


def test_a_file_holds_only_what_differs(tmp_path: Path) -> None:
    text = "  GET /scene: {enabled: false}\n  POST /stop: {timeout_s: 5}\n"
    assert load_endpoints(write(tmp_path, text)) == {
        "GET /scene": EndpointChange(enabled=False),
        "POST /stop": EndpointChange(timeout_s=5.0),
    }


@pytest.mark.parametrize("stop", ["{timeout_s: 1.0}", "{enabled: false, timeout_s: 10}", "{enabled: false}"])
def test_the_stop_stays(tmp_path: Path, stop: str) -> None:
    with pytest.raises(ConfigError, match="POST /stop: must be enabled, with a timeout_s of 4 or more"):
        load_endpoints(write(tmp_path, f"  POST /stop: {stop}\n"))


def test_a_timeout_is_positive(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"timeout_s: must be greater than 0"):
        load_endpoints(write(tmp_path, "  GET /scene: {timeout_s: 0}\n"))


def test_an_unknown_name_is_an_error_with_a_suggestion(tmp_path: Path) -> None:
    path = write(tmp_path, "  POST /robot/move/poses: {timeout_s: 90}\n")
    wanted = r"unknown key 'POST /robot/move/poses' .*did you mean 'POST /robot/move/pose'"
    with pytest.raises(ConfigError, match=wanted):
        check_endpoints(path)


def test_the_service_takes_the_names_that_it_has(tmp_path: Path) -> None:
    assert len(check_endpoints(write(tmp_path, "  POST /robot/move/pose: {timeout_s: 90}\n"))) == 1


def test_an_entry_of_an_endpoint_below_a_robots_name_is_told_where_it_belongs(tmp_path: Path) -> None:
    path = write(tmp_path, "  POST /robots/{robot}/execute: {enabled: false}\n")
    with pytest.raises(ConfigError, match="below /robots/NAME have no separate entries"):
        load_endpoints(path, ["POST /robot/execute"])


def test_a_service_that_does_not_tell_its_endpoints_cannot_hang_the_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Oracle: the child sleeps for an hour."""
    monkeypatch.setattr(endpoints, "RUN_MODULE", [sys.executable, "-c", "import time; time.sleep(3600)"])
    monkeypatch.setattr(endpoints, "MAX_WAIT_S", 0.2)
    with pytest.raises(ConfigError, match=r"has not listed its endpoints within 0\.2 s"):
        check_endpoints(write(tmp_path, "  GET /scene: {enabled: false}\n"))
