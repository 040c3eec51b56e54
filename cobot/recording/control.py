"""Requests from the service to the recorder, over a Unix socket with one line of JSON in each direction.

A request contains the `robot` and the `action`. The answer contains the result, or `error` and `code`.
"""

from __future__ import annotations

import asyncio
import json
from pathlib import Path
from typing import Any

from cobot.errors import BY_CODE, CobotError, UnavailableError
from cobot.launch.running_config import RunningConfig

LINE_BYTES = 1 << 20
SILENT_S = 3.0
"""Time without a heartbeat after which the recorder is considered unresponsive, in seconds. Requests then no
longer wait for it.
"""
HANG_S = 6.0
"""Time without a heartbeat after which `cobot run` replaces the recorder, in seconds. Shared memory still
contains all cycles at this time, so the new recorder misses none.
"""


def socket_path(default_robot: str) -> Path:
    """Path of the socket on which the recorder of a `cobot run` listens.

    Its folder is private to the user.
    """
    return RunningConfig.of(default_robot).folder / "recorder"


async def ask(path: Path, request: dict[str, Any], timeout_s: float) -> dict[str, Any]:
    """Send a request to the recorder and return its answer.

    Raises:
        UnavailableError: the recorder is not running, or does not answer in time.
        CobotError: the recorder has reported an error, whose `code` determines the class.
    """
    try:
        async with asyncio.timeout(timeout_s):
            reader, writer = await asyncio.open_unix_connection(path, limit=LINE_BYTES)
            try:
                writer.write(json.dumps(request).encode() + b"\n")
                line = await reader.readline()
            finally:
                writer.close()
        answer: dict[str, Any] = json.loads(line)
    except TimeoutError as exc:
        raise UnavailableError(
            f"the recorder has not answered within {timeout_s:g} s; the recorder keeps running"
        ) from exc
    except OSError as exc:
        raise UnavailableError(f"the recorder is not running ({exc}); cobot run restarts it") from exc
    except ValueError as exc:
        raise UnavailableError(
            "the recorder ended before it answered; cobot run restarts it; try again"
        ) from exc
    if "error" in answer:
        raise BY_CODE.get(answer.get("code", ""), CobotError)(answer["error"])
    return answer


def refusal(error: CobotError) -> dict[str, Any]:
    """The answer that reports this error. When `ask` receives the answer, it raises the error again in the
    service.
    """
    return {"error": str(error), "code": error.code}
