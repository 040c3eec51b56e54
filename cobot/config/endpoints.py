"""`api_endpoints.yaml`: what a user wants otherwise of the endpoints that the service declares."""

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
"""The shortest timeout that a user may give to POST /stop, s: a stop of the arm may take some 2.5 s."""


class EndpointChange(Section):
    """Of one endpoint. What is not given stays as the service declares it."""

    enabled: bool = True
    timeout_s: Positive | None = None


class _EndpointsFile(Section):
    endpoints: dict[str, EndpointChange]


@naming("web.endpoints")
def load_endpoints(path: Path, known: Iterable[str] | None = None) -> dict[str, EndpointChange]:
    """Read `api_endpoints.yaml`.

    Args:
        known: the names of all endpoints; None where they cannot be known, see `app.endpoints`.

    Raises:
        ConfigError: see `load_settings`, or a name is unknown, or there would be no stop.
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
            f"{shown(name)}: the endpoints below {ROBOTS}/NAME have no entries of their own, name the one "
            "without it, as in 'POST /robot/execute': its entry holds for both"
        )
    return unknown_key(name, valid)


def _check_stop(path: Path, changes: Mapping[str, EndpointChange]) -> None:
    stop = changes.get("POST /stop", EndpointChange())
    if not stop.enabled or (stop.timeout_s or MIN_STOP_S) < MIN_STOP_S:
        raise ConfigError(
            f"{path}: POST /stop: must be enabled, with a timeout_s of {MIN_STOP_S:g} at least: a stop may "
            "take that long"
        )
