"""From the command line to a listening server."""

from __future__ import annotations

import argparse
import logging
import signal
import socket
import sys
from asyncio import BaseTransport, Transport
from pathlib import Path
from typing import cast

import uvicorn
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.http11 import Request

from app.main import create_app
from app.rosbridge import router as rosbridge
from cobot.client.wire import MAX_FRAME_BYTES
from cobot.config import load_settings
from cobot.errors import CobotError

ANY_ADDRESS = {"0.0.0.0": "127.0.0.1", "::": "::1"}
SHUTDOWN_S = 4
PING_S = 5.0
UNREAD_S = 10.0
"""A WebSocket whose client reads nothing for so long is closed."""
UNSENT_BYTES = 4096


class StreamProtocol(WebSocketsSansIOProtocol):
    """Buffers next to nothing for a client that reads slowly: what is sent shall be new."""

    def handle_connect(self, event: Request) -> None:
        if event.path.partition("?")[0] == rosbridge.PATH:
            self.conn.max_message_size = rosbridge.MAX_FRAME_BYTES
        super().handle_connect(event)

    def connection_made(self, transport: BaseTransport) -> None:
        super().connection_made(transport)
        cast(Transport, transport).set_write_buffer_limits(high=0)
        connection = transport.get_extra_info("socket")
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, UNSENT_BYTES)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1000 * UNREAD_S))


def main() -> int:
    """Serve until SIGTERM; the exit status: 0, or 2 when it could not start."""
    parser = argparse.ArgumentParser(prog="python -m app", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file; without it the shipped one")
    parser.add_argument("--source", type=Path, help="what the user edits, where the settings file is a copy")
    parser.add_argument("--host", required=True, help="address that the socket listens on")
    parser.add_argument("--port", type=int, required=True)
    parser.add_argument("--fd", type=int, required=True, help="descriptor of the listening socket")
    arguments = parser.parse_args()
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s", stream=sys.stdout)
    logging.getLogger("httpx").setLevel(logging.WARNING)
    try:
        app = create_app(
            load_settings(arguments.config),
            arguments.config,
            _url(arguments.host, arguments.port),
            source=arguments.source,
        )
    except CobotError as exc:
        print(exc, flush=True)
        return 2
    config = uvicorn.Config(
        app,
        loop="uvloop",
        http="httptools",
        ws=StreamProtocol,
        ws_max_size=MAX_FRAME_BYTES,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PING_S,
        ws_per_message_deflate=False,  # it costs more time than floats of ours get shorter
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
