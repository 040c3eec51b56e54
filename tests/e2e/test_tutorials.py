"""The tutorials of learning and of cells, block by block, beside a running service."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from cobot_run import WAIT_S, Run

from cobot.access.roles import Role
from cobot.access.tokens import TokenFile

DOCS = Path(__file__).parents[2] / "docs"
URL = "http://localhost:8007"
STILL_OPEN = 28
"""What curl ends with when its --max-time is over."""


def blocks(page: str, language: str) -> list[str]:
    found = re.findall(
        rf"^```{language}\n(.*?)\n```$", (DOCS / page).read_text(encoding="utf-8"), re.M | re.S
    )
    assert len(found) >= 5
    return found


def test_each_block_of_the_learning_tutorial_does_what_it_says(
    shared: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("gymnasium", reason="gymnasium is not installed: pip install 'cobot[learning]'")
    monkeypatch.chdir(tmp_path)
    shared.go_home()
    names: dict[str, Any] = {}
    for block in blocks("tutorial-learning.md", "python"):
        exec(compile(block.replace(URL, shared.url), "tutorial-learning.md", "exec"), names)
    said = capsys.readouterr().out
    assert "8 reach" in said
    assert float(np.mean(names["learnt"])) < 0.08, said
    begun = [names["model"].poses(each.position[:1])[0, :3] for each in names["recorded"]]
    assert np.linalg.norm(np.ptp(begun, axis=0)) > 0.0
    served_m = float(said.strip().splitlines()[-1].removesuffix(" m"))
    assert served_m < 0.15, said
    shared.go_home()


def test_each_block_of_the_integrator_s_tutorial_does_what_it_says(shared: Run, tmp_path: Path) -> None:
    shared.go_home()
    cobot, settings, tokens = tmp_path / "cobot", tmp_path / "own.yaml", tmp_path / "tokens.json"
    settings.write_text(f"web: {{tokens: {tokens}}}\n", encoding="utf-8")
    cobot.write_text(f'#!/bin/sh\nexec {sys.executable} -m cobot "$@" --config {settings}\n')
    cobot.chmod(0o755)
    script = "\n".join(blocks("tutorial-integrator.md", ""))
    script = re.sub(r"^(curl .*--max-time.*)$", rf"\1 || [ $? = {STILL_OPEN} ]", script, flags=re.M)
    ended = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", script + '\necho " $JOB $COBOT_TOKEN"'],
        env={**os.environ, "COBOT_URL": shared.url, "PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    job, token = ended.stdout.split()[-2:]
    (made,) = TokenFile(tokens).read()
    assert (made.name, made.rights) == ("cell", Role.OPERATOR)
    assert len(token) > 20
    assert '"what": "taken"' in ended.stdout
    assert "event: job" in ended.stdout
    with httpx.Client(base_url=shared.url, timeout=WAIT_S) as http:
        assert http.get(job).json()["state"] == "finished"
        assert http.get("/robot/control").json()["holder"] is None
