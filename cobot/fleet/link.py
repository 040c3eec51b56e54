"""The session on Zenoh: its configuration, and errors that name the settings to change."""

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
"""Time without a heartbeat after which a hung peer is considered lost, ms. The end of a peer is noticed at
once.
"""
CONNECT_MS = 3000
"""Timeout for a cell's first connection, ms. TLS takes several round trips. After the timeout, the cell tries
again.
"""
TLS = "transport/link/tls"
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2.0}


def open_cell(connect: Sequence[str], certificates: Path | None = None) -> zenoh.Session:
    """Open the session of a cell. After the connection is lost, it reconnects automatically.

    The cell is a client and not a peer, because a router expects that peers find each other, and does not
    introduce them to each other.

    Args:
        certificates: the cell's certificate folder, for addresses that begin with tls.

    Raises:
        UnavailableError: the hub does not answer.
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
    """Open the session of a hub, which cells connect to.

    Args:
        connect: routers that this hub connects to.
        certificates: folder of the fleet. With it, each cell can access only its own keys.
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
    """Settings of Zenoh's access control. A cell may publish and reply only under its own name, and may query
    the time.
    """
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
        # Nothing is announced to the network, because each side knows the addresses it connects to.
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
        reason = str(exc).split(" at /")[0]  # without the place in Zenoh's source code
        if "Address already in use" in reason:
            raise UnavailableError(
                f"{place}: the address is in use: another hub may be running here; stop it, or choose "
                "another port"
            ) from exc
        raise UnavailableError(f"{place}: {reason}") from exc


def has_router(session: zenoh.Session) -> bool:
    """Whether a router is connected: either the hub, or a router between this cell and the hub."""
    return bool(list(session.info.routers_zid()))


def payloads(replies: Iterable[zenoh.Reply]) -> list[bytes]:
    """The contents of all replies that are not errors."""
    return [bytes(reply.ok.payload) for reply in replies if reply.ok is not None]
