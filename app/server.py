"""From the command line to a listening server."""

from __future__ import annotations

import argparse
import logging
import signal
import socket
import sys
from pathlib import Path

import uvicorn

from app.main import create_app
from cobot.config import load_settings
from cobot.errors import CobotError

ANY_ADDRESS = {"0.0.0.0": "127.0.0.1", "::": "::1"}
SHUTDOWN_S = 4


def main() -> int:
    """Serve until SIGTERM; the exit status: 0, or 2 when it could not start."""
    parser = argparse.ArgumentParser(prog="python -m app", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file; without it the shipped one")
    parser.add_argument("--host", required=True, help="address that the socket listens on")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--fd", type=int, required=True, help="descriptor of the listening socket")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s", stream=sys.stdout)
    logging.getLogger("httpx").setLevel(logging.WARNING)
    try:
        app = create_app(
            load_settings(arguments.config), arguments.config, _url(arguments.host, arguments.port)
        )
    except CobotError as exc:
        print(exc, flush=True)
        return 2
    config = uvicorn.Config(
        app,
        loop="uvloop",
        http="httptools",
        access_log=False,
        log_config=None,
        log_level="warning",
        timeout_graceful_shutdown=SHUTDOWN_S,
        server_header=False,
    )
    # uvicorn raises the signal that ended it once more when all is closed; Python shall end in peace.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    server = uvicorn.Server(config)
    server.run(sockets=[socket.socket(fileno=arguments.fd)])
    return 0 if server.started else 2


def _url(host: str, port: int) -> str:
    """Where this service is reached from this computer."""
    host = ANY_ADDRESS.get(host, host)
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"
