"""`cobot mcp`: connects a running service to agents that start a program and talk to it over standard input
and output.

It only forwards messages, so the service alone decides what an agent may do.
"""

from __future__ import annotations

import argparse
import sys

import anyio
import httpx2
from mcp.client.streamable_http import streamable_http_client
from mcp.server.stdio import stdio_server
from mcp.shared._stream_protocols import ReadStream, WriteStream
from mcp.shared.message import SessionMessage

from cobot.addresses import MCP
from cobot.client.tls import tls_context, token_from_environment


def main() -> int:
    """Forward messages until the input ends. Returns the exit status."""
    parser = argparse.ArgumentParser(prog="cobot mcp", description=__doc__)
    parser.add_argument("--url", required=True, help="URL of the service")
    anyio.run(_bridge, parser.parse_args().url.rstrip("/") + MCP)
    return 0


async def _bridge(url: str) -> None:
    token = token_from_environment()
    headers = {"Authorization": f"Bearer {token}"} if token else {}
    context = tls_context(True) if url.startswith("https:") else True
    async with (
        httpx2.AsyncClient(headers=headers, verify=context, timeout=None) as http,
        streamable_http_client(url, http_client=http) as (from_service, to_service),
        stdio_server() as (from_agent, to_agent),
        anyio.create_task_group() as tasks,
    ):
        tasks.start_soon(_forward, from_service, to_agent)
        await _forward(from_agent, to_service)
        # The agent has disconnected. This process ends, which ends its requests and any motion.
        tasks.cancel_scope.cancel()
        await to_agent.aclose()  # otherwise the library would wait for more messages


async def _forward(
    source: ReadStream[SessionMessage | Exception], target: WriteStream[SessionMessage]
) -> None:
    async for message in source:
        if isinstance(message, Exception):  # received data that is not a valid message
            print(f"cobot mcp: {message}", file=sys.stderr)
        else:
            await target.send(message)


if __name__ == "__main__":
    sys.exit(main())
