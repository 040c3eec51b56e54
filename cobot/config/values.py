"""Checks of setting values, in addition to their types. Each error names the valid values."""

from __future__ import annotations

import re
from ipaddress import IPv4Address
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, ValidationInfo

from cobot.access.roles import RoleName
from cobot.addresses import NAME, ROBOTS, VERSION
from cobot.strict import shown

if TYPE_CHECKING:
    from cobot.config.sections import ConnectionLimits

Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Rate = Annotated[float, Field(ge=1e-3, le=1e4)]
Metres = Annotated[float, Field(ge=-1000.0, le=1000.0)]
Corner = Annotated[tuple[Metres, Metres, Metres], Field(strict=False)]


def _a_robot_name(value: str) -> str:
    if f"/{value}" in (ROBOTS, VERSION):
        raise ValueError(
            f"{value!r} is reserved, because the service has endpoints below {ROBOTS}/ and {VERSION}/; "
            "choose another name"
        )
    return value


def _an_ipv4_address(value: str) -> str:
    try:
        IPv4Address(value)
    except ValueError as exc:
        raise ValueError(f"{shown(value)} is not an IPv4 address, such as 192.168.0.20") from exc
    return value


def _matching(pattern: str, what: str) -> AfterValidator:
    """Require text that matches a pattern. `what` completes the sentence of the error, with an example."""

    def check(value: str) -> str:
        if not re.fullmatch(pattern, value):
            raise ValueError(f"{shown(value)} is not {what}")
        return value

    return AfterValidator(check)


FleetName = Annotated[str, Field(pattern=f"^{NAME}$")]
RobotName = Annotated[FleetName, AfterValidator(_a_robot_name)]
LeastRole = Literal[RoleName, "none"]
ZenohEndpoint = Annotated[
    str,
    _matching(
        r"(tcp|tls)/([A-Za-z0-9._-]+|\[[0-9a-f:.]+\]):[0-9]{1,5}",
        "the address of a hub, such as tls/hall-3.example:7447",
    ),
]
PanelUrl = Annotated[
    str, _matching(r"https?://[^\s<>\"']+", "the address of a panel, such as http://cell-3.example:8007")
]
IPv4 = Annotated[str, AfterValidator(_an_ipv4_address)]
Host = Annotated[
    str,
    _matching(
        r"[a-z0-9_]([a-z0-9._-]*[a-z0-9_])?|[0-9a-f:.]*:[0-9a-f:.]*",
        "a host name or address such as robot.example or 192.168.0.10: in lower case, without a scheme, a "
        "port or a wildcard",
    ),
]
Origin = Annotated[
    str,
    _matching(
        r"[a-z][a-z0-9+.-]*://[^/?#\s@*A-Z]+",
        "the origin of a web page, such as https://app.example or http://localhost:3000: a scheme, a host in "
        "lower case, and the port if it is not the default one",
    ),
]

# Field validators that also use earlier fields of the same section.


def for_its_hub(certificates: Path | None, info: ValidationInfo) -> Path | None:
    """Check `fleet.certificates`. It is required for addresses with TLS, and not allowed for others."""
    for hub in info.data.get("connect", ()):
        if hub.startswith("tls/") and certificates is None:
            raise ValueError(f"{hub} needs the folder of this cell's certificate: `cobot fleet certificate`")
        if hub.startswith("tcp/") and certificates is not None:
            raise ValueError(f"{hub} is not encrypted; with certificates, the address must begin with tls/")
    return certificates


def for_other_computers(peers: list[str], info: ValidationInfo) -> list[str]:
    """Check that the addresses in `ros.peers` can be reached."""
    if peers and info.data.get("localhost_only"):
        raise ValueError(f"{shown(peers)} cannot be reached: set ros.localhost_only to false")
    return peers


def with_its_certificate(key: Path | None, info: ValidationInfo) -> Path | None:
    """Check `web.tls_key`. A key and a certificate must be given together."""
    if (key is None) != (info.data.get("tls_certificate") is None):
        raise ValueError("web.tls_certificate and web.tls_key go together: give both, or neither")
    return key


def with_room_for_a_body(limits: ConnectionLimits, info: ValidationInfo) -> ConnectionLimits:
    """Check that the largest request body fits within `web.limits`."""
    largest = max(info.data.get(name, 0) for name in ("max_body_bytes", "max_json_bytes"))
    if limits.bodies_bytes < largest:
        raise ValueError(
            f"bodies_bytes: is {limits.bodies_bytes}, but one body may have {largest} bytes; increase "
            "bodies_bytes"
        )
    return limits


def above_low(high: tuple[float, float, float], info: ValidationInfo) -> tuple[float, float, float]:
    """Check `mcp.fence.high`. The volume of the box must not be 0."""
    low = info.data.get("low")
    if low is not None and not all(a < b for a, b in zip(low, high, strict=True)):
        raise ValueError(f"{high} must be above low, {low}, in x, y and z")
    return high
