"""The recorder process, from its command line to its answers."""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import signal
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cobot.config import Settings, load_settings
from cobot.errors import CobotError, NotFoundError
from cobot.ipc.recording_memory import RecordingMemory
from cobot.launch.process import Niceness, set_niceness
from cobot.logs import start_logging
from cobot.recorder.robot import RobotRecorder
from cobot.recording.control import LINE_BYTES, refusal, socket_path

LAST_ANSWERS_S = 0.5
"""Time for clients to read the last answers before the process ends, s."""

log = logging.getLogger("cobot.recorder")


def main() -> int:
    """Record until SIGTERM. Returns the exit status: 0, or 2 if the recorder could not start."""
    parser = argparse.ArgumentParser(prog="python -m cobot.recorder", description=__doc__)
    parser.add_argument("--config", type=Path, help="settings file; by default the one that is part of cobot")
    arguments = parser.parse_args()
    start_logging("recorder")
    try:
        settings = load_settings(arguments.config)
        start_logging("recorder", settings.logging)
        robots = {
            name: RobotRecorder(each, RecordingMemory.attach(name, history=True))
            for name, each in settings.each.items()
        }
    except CobotError as exc:
        log.error("%s", exc)
        return 2
    set_niceness(Niceness.BACKGROUND)  # after the start, so that a busy computer does not delay it
    asyncio.run(_serve(settings, robots))
    return 0


async def _serve(settings: Settings, robots: Mapping[str, RobotRecorder]) -> None:
    loop, ended = asyncio.get_running_loop(), asyncio.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, ended.set)

    answering: set[asyncio.Task[None]] = set()

    def accept(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.create_task(_serve_one(robots, reader, writer))
        answering.add(task)
        task.add_done_callback(answering.discard)

    path = socket_path(settings.robot.name)
    path.unlink(missing_ok=True)  # a killed recorder leaves its socket behind
    server = await asyncio.start_unix_server(accept, path, limit=LINE_BYTES)
    for robot in robots.values():
        robot.start()
    await ended.wait()
    server.close()
    path.unlink(missing_ok=True)
    for robot in robots.values():
        robot.close()  # this answers all open requests
    if answering:
        await asyncio.wait(answering, timeout=LAST_ANSWERS_S)
    for task in answering:  # clients that have sent no request, or do not read
        task.cancel()
    await asyncio.gather(*answering, return_exceptions=True)


async def _serve_one(
    robots: Mapping[str, RobotRecorder], reader: asyncio.StreamReader, writer: asyncio.StreamWriter
) -> None:
    """Read one request and write its answer."""
    try:
        answered = await _answer(robots, json.loads(await reader.readline()))
        writer.write(json.dumps(answered).encode() + b"\n")
        await writer.drain()
    except (OSError, ValueError):
        pass  # the client has disconnected, or does not speak this protocol
    finally:
        writer.close()


async def _answer(robots: Mapping[str, RobotRecorder], request: dict[str, Any]) -> dict[str, Any]:
    try:
        robot = robots.get(request.get("robot", ""))
        if robot is None:
            raise NotFoundError(
                f"there is no robot {request.get('robot')!r}; valid names: {', '.join(robots)}"
            )
        return await asyncio.wrap_future(robot.ask(request))
    except CobotError as exc:
        return refusal(exc)
