"""How the service asks the recorder: a Unix socket, a line of JSON each way.

The request names the `robot` and the `action`; the answer holds what came of it, or `error` and `code`.
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
"""Nobody waits for a recorder that has shown no sign of life for so long."""
HANG_S = 6.0
"""After so long `cobot run` ends it and starts another one, which finds all cycles in shared memory still."""


def socket_path(default_robot: str) -> Path:
    """Where the recorder of a `cobot run` listens; that folder is its user's alone."""
    return RunningConfig.of(default_robot).folder / "recorder"


async def ask(path: Path, request: dict[str, Any], timeout_s: float) -> dict[str, Any]:
    """The recorder's answer.

    Raises:
        UnavailableError: it does not run, or does not answer in time.
        CobotError: what it could not do, of the class that its `code` names.
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
        raise UnavailableError(f"the recorder has not answered within {timeout_s:g} s; it goes on") from exc
    except (OSError, ValueError) as exc:
        raise UnavailableError(f"the recorder does not run ({exc}); cobot run restarts it") from exc
    if "error" in answer:
        raise BY_CODE.get(answer.get("code", ""), CobotError)(answer["error"])
    return answer


def refusal(error: CobotError) -> dict[str, Any]:
    """The answer that `ask` raises as this error."""
    return {"error": str(error), "code": error.code}
