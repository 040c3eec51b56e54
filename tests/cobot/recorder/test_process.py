"""The recorder's process without robots of its own. Oracle: what it answers, and what it logs."""

from __future__ import annotations

import asyncio
import json
import logging
import os
import signal
from concurrent.futures import Future
from pathlib import Path
from typing import Any, cast

import pytest

from cobot.config import Settings
from cobot.recorder import process
from cobot.recorder.robot import RobotRecorder


class Finishing:
    """Answers when it is closed, as a dump that has begun does."""

    def __init__(self) -> None:
        self.asked: Future[dict[str, object]] = Future()

    def start(self) -> None: ...

    def ask(self, request: dict[str, object]) -> Future[dict[str, object]]:
        return self.asked

    def close(self) -> None:
        self.asked.set_result({"names": ["whole.mcap"]})


def test_an_end_in_the_middle_of_a_request_answers_it_and_leaves_no_traceback(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    path = tmp_path / "recorder"
    monkeypatch.setattr(process, "socket_path", lambda robot: path)

    async def run() -> dict[str, Any]:
        robots = {"iiwa": cast(RobotRecorder, Finishing())}
        serving = asyncio.create_task(process._serve(settings, robots))
        while not path.exists():
            await asyncio.sleep(0.01)
        _, silent = await asyncio.open_unix_connection(path)  # has not asked yet
        reader, writer = await asyncio.open_unix_connection(path)
        writer.write(b'{"robot": "iiwa", "action": "dump"}\n')
        await asyncio.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)
        answer = await reader.readline()
        await serving
        for each in (silent, writer):
            each.close()
        return dict(json.loads(answer))

    with caplog.at_level(logging.DEBUG):
        assert asyncio.run(run()) == {"names": ["whole.mcap"]}
    assert [each for each in caplog.records if each.levelno >= logging.WARNING] == []
