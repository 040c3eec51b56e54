"""`cobot fleet serve` and `cobot fleet certificate`: run the hub on this computer, and create
certificates.
"""

from __future__ import annotations

import argparse
import logging
import re
import signal
import socket
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cobot.access.authentication import Authenticator, is_loopback
from cobot.access.tokens import TokenFile
from cobot.addresses import NAME, NAME_RULE
from cobot.errors import ConfigError, InputError, UnavailableError
from cobot.launch.fleet_extra import require_zenoh
from cobot.logs import start_logging

if TYPE_CHECKING:
    from cobot.fleet.recordings import FleetRecordingStore

MAX_DAYS = 3650
PANEL_PORT = 8071
LISTEN = "tcp/127.0.0.1:7447"
HOST = "[A-Za-z0-9][A-Za-z0-9.:-]{0,252}"
"""Pattern for the name or the address of a computer in a certificate."""


def add_serve(actions: Any) -> None:
    """Add the command `serve`."""
    serve = actions.add_parser("serve", help="run the hub until Ctrl-C")
    serve.add_argument(
        "--name", default="cobot", metavar="FLEET", help="name of the fleet, as in fleet.name of its cells"
    )
    serve.add_argument(
        "--listen",
        nargs="+",
        default=[],
        metavar="tls/HOST:PORT",
        help=f"addresses for cells; default: {LISTEN}, or the same address "
        "with tls if there are certificates",
    )
    serve.add_argument(
        "--connect",
        nargs="+",
        default=[],
        metavar="tls/HOST:PORT",
        help="routers of Zenoh that the hub joins",
    )
    serve.add_argument(
        "--host", default="127.0.0.1", metavar="H", help="address of the page and the REST API"
    )
    serve.add_argument(
        "--port",
        type=int,
        default=8070,
        metavar="P",
        help="port of the page and the REST API; 0 picks a free port",
    )
    serve.add_argument(
        "--panel-port",
        type=int,
        default=PANEL_PORT,
        metavar="P",
        help="port of the panels of cells, which need certificates; 0 picks a free port; default: "
        f"{PANEL_PORT}",
    )
    serve.add_argument(
        "--certificates",
        type=Path,
        metavar="FOLDER",
        help="folder of the fleet's certificates; with certificates, connections are encrypted, clients "
        "need tokens, and all commands are possible, not only stops",
    )
    serve.add_argument(
        "--tokens",
        type=Path,
        metavar="FILE",
        help="file of tokens; needs --certificates FOLDER; default: FOLDER/tokens.json",
    )
    serve.add_argument(
        "--recordings",
        type=Path,
        metavar="FOLDER",
        help="fetch the recordings of cells with fleet.recordings to FOLDER/CELL/ROBOT",
    )
    serve.add_argument(
        "--recordings-gb",
        type=float,
        default=20.0,
        metavar="GB",
        help="maximum size of all recordings; the oldest are deleted to stay below it; default: 20",
    )
    serve.set_defaults(run=_serve)


def add_certificate(actions: Any) -> None:
    """Add the command `certificate`."""
    certificate = actions.add_parser("certificate", help="create certificates for hub and cells")
    certificate.add_argument(
        "folder", type=Path, metavar="FOLDER", help="folder of the fleet's certificates; keep it private"
    )
    certificate.add_argument("of", choices=("hub", "cell"))
    certificate.add_argument(
        "names",
        nargs="+",
        metavar="NAME",
        help="hub: names and addresses of the hub; cell: names of cells",
    )
    certificate.add_argument(
        "--days", type=int, default=730, metavar="N", help=f"validity in days, 1 to {MAX_DAYS}; default: 730"
    )
    certificate.set_defaults(run=_certificate)


def _certificate(chosen: argparse.Namespace) -> int:
    require_zenoh("cobot fleet certificate")
    from cobot.fleet.certificates import issue_cell, issue_hub, make_authority

    folder: Path = chosen.folder.absolute()
    if not 1 <= chosen.days <= MAX_DAYS:
        raise InputError(f"--days: is {chosen.days}, allowed: 1 to {MAX_DAYS}")
    allowed, rule = (HOST, "a computer's name or address") if chosen.of == "hub" else (NAME, NAME_RULE)
    for name in chosen.names:
        if not re.fullmatch(allowed, name):
            raise InputError(f"NAME: {name!r} is not valid: {rule}")
    make_authority(folder, folder.name)
    if chosen.of == "hub":
        issue_hub(folder, chosen.names, chosen.days)
        print(f"the hub: cobot fleet serve --certificates {folder} --listen tls/{chosen.names[0]}:7447")
        return 0
    for cell in chosen.names:
        own = issue_cell(folder, cell, chosen.days)
        print(f"{cell}: copy {own} to the cell, and set fleet.certificates to the copy", flush=True)
    print("a running hub accepts the new cells after a restart", file=sys.stderr)
    return 0


def _serve(chosen: argparse.Namespace) -> int:
    import uvicorn

    from cobot.fleet.connections import HubServer
    from cobot.fleet.hub import Hub
    from cobot.fleet.panel_web import PanelServer
    from cobot.fleet.web import make_app

    require_zenoh("cobot fleet serve")
    folder: Path | None = chosen.certificates
    if not re.fullmatch(NAME, chosen.name):
        raise InputError(f"--name: {chosen.name!r} is not valid: {NAME_RULE}")
    listen: list[str] = chosen.listen or [LISTEN if folder is None else LISTEN.replace("tcp", "tls")]
    _require_protected(listen, chosen.host, folder)
    tokens, store = _authenticator(chosen), _store(chosen)
    with ExitStack() as opened:
        listener = opened.enter_context(_listener(chosen.host, chosen.port, "--port"))
        panels = None
        if folder is not None:
            panels = opened.enter_context(_listener(chosen.host, chosen.panel_port, "--panel-port"))
        hub = Hub(chosen.name, listen, chosen.connect, folder, store)
        opened.callback(hub.close)
        port = listener.getsockname()[1]
        host = f"[{chosen.host}]" if ":" in chosen.host else chosen.host
        scheme = "http" if folder is None else "https"
        print(
            f"fleet {chosen.name}: {scheme}://{host}:{port}; cells connect to {', '.join(listen)}", flush=True
        )
        # At these signals uvicorn ends, and then raises them again. That would end this process before it can
        # close its session.
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: None)
        start_logging("fleet")  # errors at the start are printed on the terminal unchanged
        logging.getLogger("uvicorn").setLevel(logging.WARNING)
        hosts = [chosen.host, host, "localhost", "127.0.0.1", *hub.hosts]
        if folder is not None and panels is not None:
            opened.callback(PanelServer(hub, panels, hosts, folder).close)
        config = uvicorn.Config(
            make_app(hub, hosts, tokens, 0 if panels is None else panels.getsockname()[1]),
            log_config=None,
            access_log=False,
            timeout_graceful_shutdown=1,
            ssl_certfile=folder and folder / "hub" / "hub.pem",
            ssl_keyfile=folder and folder / "hub" / "hub.key",
        )
        HubServer(config).run(sockets=[listener])
    return 0


def _authenticator(chosen: argparse.Namespace) -> Authenticator | None:
    """The object that checks tokens; None for a hub without certificates."""
    if chosen.certificates is not None:
        return Authenticator(TokenFile(chosen.tokens or chosen.certificates / "tokens.json"))
    if chosen.tokens is not None:
        raise ConfigError("--tokens: tokens need encrypted connections; also give --certificates")
    return None


def _store(chosen: argparse.Namespace) -> FleetRecordingStore | None:
    """The store for recordings; None if the hub does not fetch recordings."""
    from cobot.fleet.recordings import FleetRecordingStore

    if chosen.recordings is None:
        return None
    if not 0.001 <= chosen.recordings_gb <= 1e6:
        raise InputError(f"--recordings-gb: is {chosen.recordings_gb:g}, allowed: 0.001 to 1000000")
    return FleetRecordingStore(chosen.recordings, int(chosen.recordings_gb * 1e9))


def _require_protected(listen: list[str], host: str, folder: Path | None) -> None:
    """Check that a hub without certificates cannot be reached from other computers.

    Raises:
        ConfigError: another computer could reach it, or an address is invalid.
    """
    scheme = "tcp" if folder is None else "tls"
    hosts = {"--host": [host], "--listen": [_host_of(each, scheme) for each in listen]}
    if folder is not None:
        return
    for option, names in hosts.items():
        for name in names:
            if name != "localhost" and not is_loopback(name):
                raise ConfigError(
                    f"{option}: {name} can be reached from other computers, so every client there could "
                    "stop the cells and change the data on the page; use 127.0.0.1, or --certificates "
                    "(see `cobot fleet certificate`)"
                )


def _host_of(endpoint: str, scheme: str) -> str:
    found = re.fullmatch(rf"{scheme}/(\[[0-9a-f:.]+\]|[^:/\[\]]+):([0-9]{{1,5}})", endpoint)
    if found is None or int(found[2]) > 65535:
        raise ConfigError(f"--listen: {endpoint!r} is not an address such as {scheme}/127.0.0.1:7447")
    return found[1].strip("[]")


def _listener(host: str, port: int, option: str) -> socket.socket:
    if not 0 <= port <= 65535:
        raise InputError(f"{option}: is {port}, allowed: 0 to 65535; choose another port")
    try:
        return socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET, backlog=100
        )
    except OSError as exc:
        raise UnavailableError(
            f"{option}: {host}:{port}: {exc.strerror or exc}; choose another port"
        ) from exc
