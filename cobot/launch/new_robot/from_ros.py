"""The robot description that a running ROS 2 system publishes."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

from cobot.errors import ConfigError

TIMEOUT_S, MARGIN_S = 10.0, 20.0
MAX_DOMAIN = 232


def save_description(namespace: str, file: Path) -> None:
    """Write the URDF on NAMESPACE/robot_description to a file. ROS's environment variables give the domain
    and the networks. A separate process speaks DDS.

    Raises:
        ConfigError: no URDF arrives, or the domain is invalid.
    """
    domain = os.environ.get("ROS_DOMAIN_ID") or "0"
    if not domain.isdecimal() or int(domain) > MAX_DOMAIN:
        raise ConfigError(f"ROS_DOMAIN_ID is {domain[:80]!r}; it must be a number from 0 to {MAX_DOMAIN}")
    settings = {
        "domain_id": int(domain),
        "interfaces": [],
        "localhost_only": os.environ.get("ROS_LOCALHOST_ONLY") == "1",
        "peers": [],
        "namespace": f"/{namespace.strip('/')}".rstrip("/"),
        "timeout_s": TIMEOUT_S,
    }
    try:
        ended = subprocess.run(
            [sys.executable, "-P", "-m", "cobot.dds.description", json.dumps(settings)],
            capture_output=True,
            text=True,
            encoding="utf-8",
            timeout=TIMEOUT_S + MARGIN_S,
            check=False,
        )
    except subprocess.TimeoutExpired as exc:
        raise ConfigError("the process that reads robot_description does not end; try again") from exc
    if ended.returncode:
        raise ConfigError(ended.stderr.strip().splitlines()[-1] if ended.stderr.strip() else "no description")
    file.write_text(ended.stdout, encoding="utf-8")
