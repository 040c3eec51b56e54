"""The examples of docs/learning.md, as they stand."""

from __future__ import annotations

import functools
import re
import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_peers import answering, need
from virtual import virtual_service

import cobot

EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_environment_s_example_gets_nearer(capsys: pytest.CaptureFixture[str]) -> None:
    need("gymnasium")
    runpy.run_path(str(EXAMPLES / "learning_env.py"), run_name="__main__")
    first, best, _ = map(float, re.findall(r"[\d.]+", capsys.readouterr().out))
    assert best < first


def test_the_policy_s_example_moves_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    need("msgpack")
    from learning import policy
    from learning.openpi import packed, unpacked

    async def serve(socket: Any) -> None:
        await socket.send(packed({"model": "a little further"}))
        async for content in socket:
            here = unpacked(content)["observation/state"]
            await socket.send(packed({"actions": here + 0.01 * np.arange(1, 16)[:, None] * np.eye(7)[0]}))

    with virtual_service(tmp_path) as service, answering(serve) as address:
        before = service.joints()
        local = functools.partial(cobot.Robot, clock=service.clock, client=service.client)
        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", ["openpi_policy.py", address, "1.5"])
            patch.setenv("COBOT_ROBOT", service.name)
            patch.setattr(cobot, "Robot", local)
            patch.setattr(policy, "PolicyRunner", functools.partial(policy.PolicyRunner, clock=service.clock))
            runpy.run_path(str(EXAMPLES / "openpi_policy.py"), run_name="__main__")
        assert re.match(r"\d+ chunks", capsys.readouterr().out)
        assert service.joints()[0] - before[0] > 0.1
        assert service.joints()[1:] == pytest.approx(before[1:], abs=0.01)
