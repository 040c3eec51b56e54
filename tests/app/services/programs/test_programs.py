"""Programs, without a robot.

Oracle: what the service promises, by hand.
"""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from app.services.programs import programs
from app.services.programs.programs import ProgramService


def test_programs_are_checked_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    under_way = []
    most = 0

    async def check(path: Path, _folder: Path) -> None:
        nonlocal most
        under_way.append(path)
        most = max(most, len(under_way))
        await asyncio.sleep(0.001)
        under_way.remove(path)

    async def live() -> None:
        idle: Any = SimpleNamespace(status=SimpleNamespace(status="idle"))
        nobody: Any = None
        service = ProgramService(tmp_path, nobody, idle, nobody)
        await asyncio.gather(*(service.load("a.lua") for _ in range(20)))
        assert service.loaded == "a.lua"

    monkeypatch.setattr(programs, "_check", check)
    (tmp_path / "a.lua").write_text("")
    asyncio.run(live())
    assert most == 1
