"""The session on Zenoh: its configuration, and errors in the words of the settings."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from cobot.errors import UnavailableError

if TYPE_CHECKING:
    import zenoh

LEASE_MS = 2000
"""Time without a sign of life after which a frozen peer counts as gone. One that dies is noticed at once."""
CONNECT_MS = 500
"""Time in which a cell's first connection must succeed. The cell then tries again."""
RETRY = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 2.0}


def open_cell(connect: Sequence[str]) -> zenoh.Session:
    """The session of a cell. After a loss it connects again by itself.

    It is a client, not a peer: a router expects of peers that they find each other, and does not tell one of
    another.

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
    return _open(values, f"fleet.connect: {', '.join(connect)}")


def open_hub(listen: Sequence[str], connect: Sequence[str] = ()) -> zenoh.Session:
    """The session of a hub, to which cells connect.

    Args:
        connect: routers that this one joins.
    """
    values: dict[str, Any] = {
        "mode": "router",
        "listen/endpoints": list(listen),
        "connect/endpoints": list(connect),
        "connect/timeout_ms": 5000,
        "connect/exit_on_failure": True,
    }
    return _open(values, f"--listen {', '.join(listen)}")


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
