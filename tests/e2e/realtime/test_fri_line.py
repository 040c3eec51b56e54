"""The shipped settings with one line changed, beside `cobot simulate fri` as it is.

What the test needs for itself (a name, free ports, folders of its own) are further lines, which say nothing
of the arm.
"""

from __future__ import annotations

import re
from pathlib import Path

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, Run, unique_name
from fri_run import CabinetProcess

from cobot.config import load_settings

pytestmark = pytest.mark.thorough

SHIPPED = Path(__file__).parents[3] / "config" / "cobot-setting.yaml"
LINE = "  backend: mujoco "


class OneLine(Run):
    def __init__(self, folder: Path, port: int) -> None:
        self.name, self.asking, self.lines = unique_name(), {}, []
        text = SHIPPED.read_text(encoding="utf-8")
        own = {
            "  name: iiwa ": f"  name: {self.name} ",
            "  port: 8007\n": "  port: 0\n",
            "~/.local/state/cobot": "state",
        }
        for line, other in {**own, LINE: f"  backend: {{type: fri, port: {port}}} "}.items():
            assert line in text
            text = text.replace(line, other)
        text = re.sub(r"(\nros: .*\n  enabled:) true", r"\1 false", text)
        self.config = folder / "one-line.yaml"
        self.config.write_text(text, encoding="utf-8")
        self.start()


def test_one_changed_line_moves_the_arm_behind_a_cabinet(tmp_path: Path) -> None:
    """Nothing here is patient, but the cabinet: what a busy computer has ended is begun again."""
    there = [0.2, 0.1, 0.0, -1.5, 0.0, 1.5, 0.1]
    with CabinetProcess(period_ms=None) as cabinet:
        run = OneLine(tmp_path, cabinet.port)
        try:
            with httpx.Client(base_url=run.url, timeout=WAIT_S) as http:

                def held() -> bool:
                    return run.healthy() or (http.post("/robot/reset").is_success and run.healthy())

                def arrived() -> bool:
                    run.until(held)
                    answer = http.post("/robot/move/joints", json={"joints": there})
                    return answer.is_success and bool(answer.json()["success"])

                run.until(held)
                acknowledged = http.post("/robot/acknowledge", json={"payload_checked": True})
                assert acknowledged.is_success, acknowledged.text
                run.until(arrived)
            np.testing.assert_allclose(cabinet.ask()["measured"], there, atol=2e-3)
            assert cabinet.ask()["period_ms"] == 1e3 * load_settings(None).rt.period_s
        finally:
            run.end()
