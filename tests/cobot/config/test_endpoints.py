"""`api_endpoints.yaml`. Oracle: the messages a person needs."""

from __future__ import annotations

from pathlib import Path

import pytest

from cobot.config import ENDPOINTS, load_endpoints
from cobot.errors import ConfigError


def write(folder: Path, text: str) -> Path:
    path = folder / "endpoints.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_endpoints_file_names_all_endpoints_and_no_other(tmp_path: Path) -> None:
    every = "".join(f"  {name}: {{timeout_s: 1.0}}\n" for name in ENDPOINTS)
    with pytest.raises(ConfigError, match="missing POST /stop"):
        load_endpoints(
            write(tmp_path, "endpoints:\n" + every.replace("  POST /stop: {timeout_s: 1.0}\n", ""))
        )
    with pytest.raises(ConfigError, match=r"unknown key 'POST /halt' .*valid are: GET /robot/joint_states"):
        load_endpoints(write(tmp_path, "endpoints:\n" + every + "  POST /halt: {timeout_s: 1.0}\n"))
    for stop in ("{timeout_s: 1.0}", "{enabled: false, timeout_s: 10.0}"):
        other = every.replace("1.0", "5.0").replace("POST /stop: {timeout_s: 5.0}", f"POST /stop: {stop}")
        with pytest.raises(ConfigError, match="POST /stop: must be enabled, with a timeout_s of 4 at least"):
            load_endpoints(write(tmp_path, "endpoints:\n" + other))
    with pytest.raises(ConfigError, match=r"timeout_s: must be greater than 0"):
        load_endpoints(write(tmp_path, "endpoints:\n" + every.replace("1.0", "0.0")))
