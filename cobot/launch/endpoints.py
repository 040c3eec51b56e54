"""Whether `api_endpoints.yaml` is right: only the service knows which endpoints there are, so it is asked."""

from __future__ import annotations

import subprocess
from pathlib import Path

from cobot.config import EndpointChange, load_endpoints
from cobot.errors import ConfigError
from cobot.launch.process import RUN_MODULE

MAX_WAIT_S = 60.0
"""How long the service may take to tell which endpoints it has, s: 2 s, and more on a computer under load."""


def check_endpoints(path: Path) -> dict[str, EndpointChange]:
    """Read the file. A file that changes nothing costs no look at the service.

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
                f"{path}: the service has not told within {MAX_WAIT_S:g} s which endpoints it has: start "
                "again when the computer has less to do"
            ) from exc
        if done.returncode != 0:
            said = done.stderr.strip().splitlines()
            raise ConfigError(said[-1] if said else f"{path}: the service ends with status {done.returncode}")
    return changes
