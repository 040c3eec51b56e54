"""`cobot run --cell` with an example, and what becomes of the cube of pick_and_place."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import pytest
from cobot_run import ROOT, WAIT_S, Run

EXAMPLE = ROOT / "examples" / "pick_and_place"
IN_TRAY = pytest.approx([0.55, 0.3, 0.235], abs=3e-3)


class RunOfCell(Run):
    """With the cell, in real time."""

    def __init__(self, folder: Path, cell: Path = EXAMPLE) -> None:
        self.cell = cell
        super().__init__(folder, clock="realtime")

    def command(self) -> list[str]:
        return [*super().command(), "--cell", str(self.cell)]

    def ask(self, method: str, path: str, **content: Any) -> Any:
        answer = httpx.request(method, f"{self.url}{path}", timeout=WAIT_S, **content)
        assert answer.status_code < 300, answer.text
        return answer.json()

    def cube(self) -> list[float]:
        found: list[float] = self.ask("GET", "/cell")["parts"][0]["position"]
        return found

    def count(self) -> int:
        switches = {each["name"]: each["value"] for each in self.ask("GET", "/cell")["switches"]}
        return int(switches["gate.count"])
