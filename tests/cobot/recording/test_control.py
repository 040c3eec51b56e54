"""Requests to the recorder. Oracle: what the peer at the socket does, and the sentence for a person."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from cobot.errors import UnavailableError
from cobot.recording.control import ask


@pytest.mark.parametrize("sent", [b"", b'{"names": ["cut'])
def test_a_recorder_that_is_killed_during_a_request_is_named_without_words_of_the_parser(
    tmp_path: Path, sent: bytes
) -> None:
    async def run() -> None:
        async def killed(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.readline()
            writer.write(sent)
            writer.close()

        async with await asyncio.start_unix_server(killed, tmp_path / "recorder"):
            await ask(tmp_path / "recorder", {"action": "dump"}, 5.0)

    with pytest.raises(UnavailableError, match=r"ended before it answered; cobot run restarts it; try"):
        asyncio.run(run())
