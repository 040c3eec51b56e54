"""The entry point of the service: it reads the command line and listens for connections."""

from __future__ import annotations

import argparse
import asyncio
import logging
import os
import signal
import socket
import sys
from collections.abc import Callable
from functools import partial

import uvicorn

from app.listeners.acceptor import Acceptor, crowd_for
from app.listeners.crowd import Visit
from app.listeners.http import HttpProtocol, Shared
from app.listeners.turns import Turns
from app.listeners.websocket import StreamProtocol
from app.main import create_app
from app.memory import give_back
from app.services.motion.planning import PlanningService
from cobot.access.tls import check_certificate
from cobot.client.tls import CERTIFICATE_VARIABLE
from cobot.client.wire import MAX_FRAME_BYTES
from cobot.config import ConnectionLimits, load_settings
from cobot.errors import CobotError
from cobot.launch.forked import Forked
from cobot.logs import start_logging
from cobot.logs.supervision import SupervisorLosses

ANY_ADDRESS = {"0.0.0.0": "127.0.0.1", "::": "::1"}
SHUTDOWN_S = 4
SWITCH_S = 0.001
"""Maximum time for which a thread that parses large data blocks the event loop, s."""
PING_S = 5.0

log = logging.getLogger("cobot.service")


class Server(uvicorn.Server):
    """The HTTP server. Each connection takes a place in a `Crowd`."""

    def __init__(
        self,
        config: uvicorn.Config,
        limits: ConnectionLimits,
        end_streams: Callable[[], None] = lambda: None,
    ) -> None:
        """
        Args:
            end_streams: function that is called at the end to close answers that never end on their own.
        """
        super().__init__(config)
        self._limits = limits
        self._end_streams = end_streams

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        limits = self._limits
        shared = Shared(crowd_for(limits), Turns(), limits)
        await super().startup(sockets=[])  # here uvicorn only reports that it has started

        def protocol(visit: Visit) -> HttpProtocol:
            return HttpProtocol(
                shared=shared,
                visit=visit,
                config=self.config,
                server_state=self.server_state,
                app_state=self.lifespan.state,
            )

        for listener in sockets or ():
            acceptor = Acceptor(listener, shared.crowd, protocol, self.config.ssl, limits.header_timeout_s)
            self.servers.append(acceptor)  # type: ignore[arg-type]
        self._giving_back = asyncio.create_task(give_back(), name="memory")

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        self._end_streams()
        await super().shutdown(sockets)


def main(
    arguments: argparse.Namespace, ros_token: str | None, fleet_token: str | None, blanks: list[Forked]
) -> int:
    """Serve until SIGTERM. Returns the exit status: 0, or 2 if the service could not start.

    Args:
        arguments: see `app.__main__`.
        ros_token: token of the DDS process.
        fleet_token: token of the fleet process.
        blanks: processes that were started in advance, to become the first planning processes.
    """
    start_logging("service")
    try:
        settings = load_settings(arguments.config)
        start_logging("service", settings.logging)
        secure = check_certificate(settings.web)
        app = create_app(
            settings,
            arguments.config,
            _url(arguments.host, arguments.port, secure),
            planner=partial(PlanningService, blanks=blanks),
            host=arguments.host,
            ros_token=ros_token,
            fleet_token=fleet_token,
            source=arguments.source,
        )
    except CobotError as exc:
        log.error("%s", exc)
        return 2
    if secure:  # programs started by this process trust the certificate for any host name
        os.environ[CERTIFICATE_VARIABLE] = str(settings.web.tls_certificate)
    limits = settings.web.limits
    app.state.losses = SupervisorLosses(arguments.losses_fd)
    config = uvicorn.Config(
        app,
        loop="uvloop",
        http=HttpProtocol,
        ws=StreamProtocol,
        ws_max_size=MAX_FRAME_BYTES,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PING_S,
        ws_per_message_deflate=False,  # for floats, compression takes more time than it saves
        access_log=False,
        log_config=None,
        log_level="warning",
        timeout_keep_alive=int(limits.idle_timeout_s),
        timeout_graceful_shutdown=SHUTDOWN_S,
        server_header=False,
        proxy_headers=False,  # the client is the peer of the connection, whatever its headers say
        ssl_certfile=settings.web.tls_certificate,
        ssl_keyfile=settings.web.tls_key,
    )
    # After closing everything, uvicorn raises the signal that ended it again. Python must still end without
    # an error.
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    sys.setswitchinterval(SWITCH_S)
    server = Server(config, limits, lambda: app.state.events.close())
    server.run(sockets=[socket.socket(fileno=arguments.fd)])
    return 0 if server.started else 2


def _url(host: str, port: int, secure: bool) -> str:
    """Return the URL of this service on this computer."""
    host = ANY_ADDRESS.get(host, host)
    scheme = "https" if secure else "http"
    return f"{scheme}://[{host}]:{port}" if ":" in host else f"{scheme}://{host}:{port}"
