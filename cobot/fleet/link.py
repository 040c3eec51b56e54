"""The session on Zenoh: its configuration, and errors in the words of the settings."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cobot.errors import UnavailableError
from cobot.fleet.certificates import AUTHORITY, CELL, HUB_FOLDER, cells_with_certificates
from cobot.fleet.names import FleetKeys

if TYPE_CHECKING:
    import zenoh

LEASE_MS = 2000
"""Time without a sign of life after which a frozen peer counts as gone. One that dies is noticed at once."""
CONNECT_MS = 500
"""Time in which a cell's first connection must succeed. The cell then tries again."""
TLS = "transport/link/tls"
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2.0}


def open_cell(connect: Sequence[str], certificates: Path | None = None) -> zenoh.Session:
    """The session of a cell. After a loss it connects again by itself.

    It is a client, not a peer: a router expects of peers that they find each other, and does not tell one of
    another.

    Args:
        certificates: folder of the cell's certificate, for addresses that begin with tls.

    Raises:
        UnavailableError: the hub does not answer now.
    """
    values: dict[str, Any] = {
        "mode": "client",
        "connect/endpoints": list(connect),
        "connect/timeout_ms": CONNECT_MS,
        "connect/exit_on_failure": True,
        "connect/retry": RETRY,
    }
    if certificates is not None:
        values |= _client_tls(certificates, CELL)
    return _open(values, f"fleet.connect: {', '.join(connect)}")


def open_hub(
    fleet: str, listen: Sequence[str], connect: Sequence[str] = (), certificates: Path | None = None
) -> zenoh.Session:
    """The session of a hub, to which cells connect.

    Args:
        connect: routers that this one joins.
        certificates: folder of the fleet. With it, each cell reaches its own keys only.
    """
    values: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/timeout_ms": 5000,
        "connect/exit_on_failure": True,
    }
    if certificates is not None:
        hub = certificates / HUB_FOLDER
        values |= _client_tls(hub, HUB_FOLDER) | {
            f"{TLS}/listen_certificate": str(hub / f"{HUB_FOLDER}.pem"),
            f"{TLS}/listen_private_key": str(hub / f"{HUB_FOLDER}.key"),
            "access_control": _rights(FleetKeys(fleet), cells_with_certificates(certificates)),
        }
    return _open(values, f"--listen {', '.join(listen)}")


def _client_tls(folder: Path, name: str) -> dict[str, Any]:
    return {
        f"{TLS}/enable_mtls": True,
        f"{TLS}/root_ca_certificate": str(folder / f"{AUTHORITY}.pem"),
        f"{TLS}/connect_certificate": str(folder / f"{name}.pem"),
        f"{TLS}/connect_private_key": str(folder / f"{name}.key"),
        f"{TLS}/close_link_on_expiration": True,
    }


def _rights(keys: FleetKeys, cells: Sequence[str]) -> dict[str, Any]:
    """Zenoh's access control: a cell publishes and answers below its own name, and asks for the time."""
    out, into = ["egress"], ["ingress"]

    def rule(name: str, flows: list[str], messages: list[str], *allowed: str) -> dict[str, Any]:
        return {
            "id": name,
            "permission": "allow",
            "flows": flows,
            "messages": messages,
            "key_exprs": list(allowed),
        }

    hears = ["query", "declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"]
    shared = [
        rule("asks-hub", into, ["query"], keys.time, keys.bundle("*")),
        rule("hub-answers", out, ["reply"], keys.time, keys.bundle("*")),
        rule("asks-cells", out, hears, keys.of("*", "*", "**"), keys.alive("*", "*")),
    ]
    own = [
        rule(f"cell-{cell}", into,
             ["put", "declare_queryable", "reply", "liveliness_token", "liveliness_query"],
             keys.of(cell, "*", "**"), keys.alive(cell, "*"))
        for cell in cells
    ]  # fmt: skip
    own += [rule(f"told-{cell}", out, ["liveliness_token", "reply"], keys.alive(cell, "*")) for cell in cells]
    names = [each["id"] for each in shared]
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": shared + own,
        "subjects": [{"id": cell, "cert_common_names": [cell]} for cell in cells],
        "policies": [
            {"rules": [*names, f"cell-{cell}", f"told-{cell}"], "subjects": [cell]} for cell in cells
        ],
    }


def _open(values: dict[str, Any], place: str) -> zenoh.Session:
    import zenoh

    config = zenoh.Config()
    common = {
        # Nothing is announced to the network: each side knows whom it connects to.
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/tx/keep_alive": 4,
    }
    try:
        for key, value in {**common, **values}.items():
            config.insert_json5(key, json.dumps(value))
        return zenoh.open(config)
    except zenoh.ZError as exc:
        reason = str(exc).split(" at /")[0]  # without the place in Zenoh's own sources
        if "Address already in use" in reason:
            raise UnavailableError(
                f"{place}: the address is in use: another hub runs here; stop it, or choose another port"
            ) from exc
        raise UnavailableError(f"{place}: {reason}") from exc


def has_router(session: zenoh.Session) -> bool:
    """Whether a router is connected: the hub, or one between."""
    return bool(list(session.info.routers_zid()))


def payloads(replies: Iterable[zenoh.Reply]) -> list[bytes]:
    """The content of the replies that are not errors."""
    return [bytes(reply.ok.payload) for reply in replies if reply.ok is not None]
