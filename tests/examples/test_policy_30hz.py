"""The example of a policy, as it stands, on virtual time: in its own seconds, whatever the computer does."""

from __future__ import annotations

import functools
import math
import runpy
import sys
import time
from pathlib import Path

import pytest
from virtual_service import virtual_service

import cobot

SCRIPT = Path(__file__).parents[2] / "examples/policy_30hz.py"


def test_the_policy_example_moves_the_arm_and_leaves_it_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with virtual_service(tmp_path) as service:
        clock = service.clock
        before = service.joints()
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", [str(SCRIPT), "1.5"])
            patch.setenv("COBOT_ROBOT", service.name)
            patch.setattr(time, "monotonic", clock.now_s)
            patch.setattr(time, "sleep", clock.sleep)
            patch.setattr(cobot, "Robot", functools.partial(cobot.Robot, clock=clock, client=service.client))
            runpy.run_path(str(SCRIPT), run_name="__main__")
        assert capsys.readouterr().out.splitlines()[-1].startswith("and rests")
        swing = 0.15 * (1.0 - math.cos(1.5))  # where its last targets lead
        assert service.joints()[0] - before[0] == pytest.approx(swing, abs=0.02)
        assert service.health()["robot"]["settled"]
