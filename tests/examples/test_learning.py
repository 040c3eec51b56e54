"""The examples of docs/learning.md, as they stand, and what they say where something is missing."""

from __future__ import annotations

import functools
import re
import runpy
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_peers import answering, need
from lerobot_stand_in import plugin_beside_it
from virtual_service import VirtualService, virtual_service

import cobot
from cobot.learning.episodes import read_episode

EXAMPLES = Path(__file__).parents[2] / "examples"
SWING_S = 1.5
NOBODY = "http://127.0.0.1:9"


def run(script: str, patch: pytest.MonkeyPatch, *arguments: str, at: VirtualService | None = None) -> None:
    """Run an example, on the clock of the service if there is one."""
    patch.setattr(sys, "argv", [script, *arguments])
    if at is not None:
        patch.setenv("COBOT_ROBOT", at.name)
        patch.setattr(time, "monotonic", at.clock.now_s)
        patch.setattr(time, "sleep", at.clock.sleep)
    runpy.run_path(str(EXAMPLES / script), run_name="__main__")


def test_the_environment_s_example_gets_nearer(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    need("gymnasium")
    run("learning_env.py", monkeypatch)
    first, best, _ = map(float, re.findall(r"[\d.]+", capsys.readouterr().out))
    assert best < first


def test_the_policy_s_example_moves_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    need("msgpack")
    from cobot.learning import policy
    from cobot.learning.openpi import pack, unpack

    async def serve(socket: Any) -> None:
        await socket.send(pack({"model": "a little further"}))
        async for content in socket:
            here = unpack(content)["observation/state"]
            await socket.send(pack({"actions": here + 0.01 * np.arange(1, 16)[:, None] * np.eye(7)[0]}))

    with virtual_service(tmp_path) as service, answering(serve) as address:
        before = service.joints()
        local = functools.partial(cobot.Robot, clock=service.clock, client=service.client)
        with monkeypatch.context() as patch:
            patch.setenv("COBOT_ROBOT", service.name)
            patch.setattr(cobot, "Robot", local)
            patch.setattr(policy, "PolicyRunner", functools.partial(policy.PolicyRunner, clock=service.clock))
            run("openpi_policy.py", patch, address, str(SWING_S))
        assert re.match(r"\d+ chunks", capsys.readouterr().out)
        assert service.joints()[0] - before[0] > 0.1
        assert service.joints()[1:] == pytest.approx(before[1:], abs=0.01)


def test_an_episode_is_recorded_with_a_camera(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with virtual_service(tmp_path) as service:
        with monkeypatch.context() as patch:
            patch.chdir(tmp_path)
            local = functools.partial(cobot.Robot, clock=service.clock, client=service.client)
            patch.setattr(cobot, "Robot", local)
            run("record_episode.py", patch, str(SWING_S), at=service)
        assert service.health()["robot"]["settled"]
    assert "actions (45, 7), pictures (45, 72, 96, 3)" in capsys.readouterr().out
    found = read_episode(tmp_path / "episode.mcap")
    assert found.about["success"] == "true"
    assert found.position[-1] - found.position[0] == pytest.approx([0.13, 0, 0, 0, 0, 0, 0], abs=0.02)
    assert (found.pictures["front"][0] != found.pictures["front"][-1]).any()


def test_lerobot_moves_the_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with virtual_service(tmp_path) as service:
        before = service.joints()
        with monkeypatch.context() as patch, plugin_beside_it(patch) as plugin:
            local = functools.partial(cobot.Robot, service.name, clock=service.clock, client=service.client)
            patch.setattr(f"{plugin.__name__}.robot.Robot", lambda url, token: local())
            run("lerobot_arm.py", patch, str(SWING_S), at=service)
        assert capsys.readouterr().out.startswith("joint1 is at ")
        assert service.joints()[0] - before[0] == pytest.approx(0.14, abs=0.02)
        assert service.health()["robot"]["settled"]


@pytest.mark.parametrize(
    ("script", "said"),
    [
        ("own_hand.py", f"own_hand.py: .*{NOBODY}.*; `make run` starts a service"),
        ("record_episode.py", f"record_episode.py: {NOBODY}: "),
        (
            "lerobot_arm.py",
            r"lerobot_arm.py: .*: pip install \./packages/cobot-client \./packages/lerobot",
        ),
    ],
)
def test_what_is_missing_is_said_in_one_line(monkeypatch: pytest.MonkeyPatch, script: str, said: str) -> None:
    for name in ("COBOT_URL", "COBOT_ROBOT"):
        monkeypatch.setenv(name, NOBODY)
    monkeypatch.setattr(cobot, "Robot", functools.partial(cobot.Robot, connect_retries=0))
    monkeypatch.setitem(sys.modules, "lerobot_robot_cobot", None)
    with pytest.raises(SystemExit, match=said) as caught:
        run(script, monkeypatch)
    assert "\n" not in str(caught.value)


def test_the_policy_s_example_says_how_it_is_called(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    need("msgpack")
    with pytest.raises(SystemExit, match="2"):
        run("openpi_policy.py", monkeypatch)
    assert "openpi_policy.py [-h] HOST:PORT [SECONDS]" in capsys.readouterr().err
    with pytest.raises(SystemExit, match=r"openpi_policy\.py: ws://127\.0\.0\.1:9: "):
        run("openpi_policy.py", monkeypatch, "127.0.0.1:9")
