"""`api_endpoints.yaml`: which endpoints there are, and how long each may take."""

from __future__ import annotations

from pathlib import Path

from cobot.config.section import Section, naming, parse
from cobot.config.values import Positive
from cobot.errors import ConfigError
from cobot.strict import unknown_key
from cobot.yaml_file import read_mapping

MIN_STOP_S = 4.0
"""POST /stop has to be given this timeout at least, s: a stop of the arm may take some 2.5 s."""
ENDPOINTS = (
    "GET /robot/joint_states",
    "GET /robot/pose",
    "GET /robot/positions",
    "POST /robot/positions",
    "DELETE /robot/positions/{name}",
    "GET /robot/geometry",
    "GET /robot/control",
    "POST /robot/control",
    "DELETE /robot/control",
    "GET /robot/freedrive",
    "POST /robot/freedrive",
    "DELETE /robot/freedrive",
    "POST /robot/move/named",
    "POST /robot/move/pose",
    "POST /robot/move/joints",
    "POST /robot/move/arc",
    "POST /robot/move/sequence",
    "POST /robot/plan/named",
    "POST /robot/plan/pose",
    "POST /robot/plan/joints",
    "POST /robot/plan/arc",
    "POST /robot/plan/path",
    "POST /robot/plan/sequence",
    "POST /robot/execute",
    "GET /robot/motion",
    "GET /robot/plans",
    "GET /robot/plans/{plan}",
    "POST /robot/plans/{plan}/rehearse",
    "POST /robot/approve",
    "GET /robot/tool",
    "POST /robot/tool",
    "GET /robot/io",
    "PUT /robot/io/{name}",
    "GET /scene",
    "POST /scene",
    "POST /robot/reset",
    "POST /robot/acknowledge",
    "POST /trajectory/send",
    "POST /trajectory/send_csv",
    "GET /trajectory/logs",
    "GET /recordings",
    "POST /recordings",
    "GET /recordings/{name}",
    "GET /recordings/{name}/path",
    "DELETE /recordings/{name}",
    "POST /sequences/start",
    "GET /sequences/status",
    "GET /sequences/logs",
    "GET /events",
    "WS /events",
    "WS /foxglove",
    "GET /jobs",
    "GET /jobs/{job}",
    "POST /jobs/{job}/cancel",
    "POST /jobs/{job}/pause",
    "POST /jobs/{job}/resume",
    "POST /jobs/{job}/step",
    "GET /robot/speed_override",
    "POST /robot/speed_override",
    "POST /stop",
    "GET /health",
    "GET /health/live",
    "GET /health/ready",
    "GET /metrics",
    "POST /admin/reload",
    "GET /robots",
    "GET /audit",
    "WS /robot/stream",
    "WS /rosbridge",
    "POST /{robot}/{Class}/{method}",
)


class Endpoint(Section):
    enabled: bool = True
    timeout_s: Positive


class _EndpointsFile(Section):
    endpoints: dict[str, Endpoint]


@naming("web.endpoints")
def load_endpoints(path: Path) -> dict[str, Endpoint]:
    """Read `api_endpoints.yaml`: an entry for each of `ENDPOINTS`, and no other.

    Raises:
        ConfigError: see `load_settings`, or an endpoint is missing or unknown, or there would be no stop.
    """
    endpoints = parse(_EndpointsFile, path, read_mapping(path)).endpoints
    for name in endpoints:
        if name not in ENDPOINTS:
            raise ConfigError(f"{path}: endpoints: {unknown_key(name, list(ENDPOINTS))}")
    missing = [name for name in ENDPOINTS if name not in endpoints]
    if missing:
        raise ConfigError(f"{path}: endpoints: missing {', '.join(missing)}")
    stop = endpoints["POST /stop"]
    if not stop.enabled or stop.timeout_s < MIN_STOP_S:
        raise ConfigError(
            f"{path}: POST /stop: must be enabled, with a timeout_s of {MIN_STOP_S:g} at least: a stop may "
            "take that long"
        )
    return endpoints
