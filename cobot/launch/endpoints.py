"""Check of `api_endpoints.yaml` by the service, because only the service knows which endpoints exist."""

from __future__ import annotations

import subprocess
from pathlib import Path

from cobot.config import EndpointChange, load_endpoints
from cobot.errors import ConfigError
from cobot.launch.process import RUN_MODULE

MAX_WAIT_S = 60.0
"""Timeout for the service to list its endpoints, s. Usually the service needs 2 s, but more on a busy
computer.
"""


def check_endpoints(path: Path) -> dict[str, EndpointChange]:
    """Read and check the file. If it changes any endpoint, this starts the service to get the list of
    endpoints.

    Raises:
        ConfigError: see `load_endpoints`.
    """
    changes = load_endpoints(path)
    if changes:
        command = [*RUN_MODULE, "app.endpoint_table", "--check", str(path)]
        try:
            done = subprocess.run(
                command,
                stdin=subprocess.DEVNULL,
                capture_output=True,
                text=True,
                check=False,
                timeout=MAX_WAIT_S,
            )
        except subprocess.TimeoutExpired as exc:
            raise ConfigError(
                f"{path}: the service has not listed its endpoints within {MAX_WAIT_S:g} s; start again "
                "when the computer is less busy"
            ) from exc
        if done.returncode != 0:
            said = done.stderr.strip().splitlines()
            raise ConfigError(
                said[-1] if said else f"{path}: the service exited with status {done.returncode}"
            )
    return changes
