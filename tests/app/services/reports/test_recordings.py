"""Requests to the recorder. Oracle: a recorder of the test that answers on the socket."""

from __future__ import annotations

import asyncio
import os
import time
from pathlib import Path

import pytest
from cobot_run import unique_name

from app.services.reports import recordings
from cobot.config import Settings
from cobot.errors import UnavailableError
from cobot.ipc.recording_memory import RecordingMemory


@pytest.mark.parametrize("begins", [True, False])
def test_a_request_waits_for_a_recorder_that_has_yet_to_begin(
    settings: Settings, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begins: bool
) -> None:
    """`cobot record start` just after `cobot run` was rejected, because the recorder was not there yet."""
    path, name = tmp_path / "socket", unique_name()
    named = settings.robot.model_copy(update={"name": name})
    monkeypatch.setattr(recordings, "socket_path", lambda robot: path)
    memory = RecordingMemory.create(name, 7, 0.001, 1.0, [f"joint{number}" for number in range(1, 8)])
    service = recordings.RecordingService(
        settings.model_copy(update={"robot": named, "logs": tmp_path}), name
    )

    def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b'{"names": ["made"]}\n')
        writer.close()

    async def asking() -> list[str]:
        looks, servers = 0, list[asyncio.Server]()

        async def pause(seconds: float) -> None:
            nonlocal looks
            looks += 1
            assert not task.done()
            if looks == 3 and begins:
                servers.append(await asyncio.start_unix_server(answer, path))
                memory.status.data["pid"], memory.status.data["monotonic_ns"] = (
                    os.getpid(),
                    time.monotonic_ns(),
                )
                memory.status.publish()
            elif looks == 3:
                monkeypatch.setattr(recordings, "START_S", 0.0)  # it is given up

        monkeypatch.setattr(recordings.asyncio, "sleep", pause)
        task = asyncio.create_task(service.ask("start", None, 60.0))
        try:
            return await task
        finally:
            for server in servers:
                server.close()

    try:
        if begins:
            assert asyncio.run(asking()) == ["made"]
        else:
            with pytest.raises(UnavailableError, match="the recorder is not running"):
                asyncio.run(asking())
    finally:
        memory.unlink()
