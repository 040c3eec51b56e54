"""`api_endpoints.yaml`: a user's changes to the endpoints that the service declares."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from cobot.addresses import ROBOTS
from cobot.config.section import Section, naming, parse
from cobot.config.values import Positive
from cobot.errors import ConfigError
from cobot.strict import shown, unknown_key
from cobot.yaml_file import read_mapping

MIN_STOP_S = 4.0
"""Minimum timeout that a user may set for POST /stop, s. A stop of the arm may take about 2.5 s."""


class EndpointChange(Section):
    """Changes of one endpoint. Omitted values keep those that the service declares."""

    enabled: bool = True
    timeout_s: Positive | None = None


class _EndpointsFile(Section):
    endpoints: dict[str, EndpointChange]


@naming("web.endpoints")
def load_endpoints(path: Path, known: Iterable[str] | None = None) -> dict[str, EndpointChange]:
    """Read `api_endpoints.yaml`.

    Args:
        known: the names of all endpoints; None to skip the check of the names, see `app.endpoints`.

    Raises:
        ConfigError: see `load_settings`. Also if a name is unknown, or if the stop would be disabled.
    """
    changes = parse(_EndpointsFile, path, read_mapping(path)).endpoints
    _check_stop(path, changes)
    if known is not None:
        valid = list(known)
        for name in changes:
            if name not in valid:
                raise ConfigError(f"{path}: endpoints: {_unknown(name, valid)}")
    return changes


def _unknown(name: str, valid: list[str]) -> str:
    if f" {ROBOTS}/" in name:
        return (
            f"{shown(name)}: endpoints below {ROBOTS}/NAME have no separate entries; give the path "
            "without it, such as 'POST /robot/execute', whose entry applies to both"
        )
    return unknown_key(name, valid)


def _check_stop(path: Path, changes: Mapping[str, EndpointChange]) -> None:
    stop = changes.get("POST /stop", EndpointChange())
    if not stop.enabled or (stop.timeout_s or MIN_STOP_S) < MIN_STOP_S:
        raise ConfigError(
            f"{path}: POST /stop: must be enabled, with a timeout_s of {MIN_STOP_S:g} or more, because "
            "a stop may take that long"
        )
