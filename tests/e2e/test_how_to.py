"""The pages of docs/how-to/, block by block, beside `cobot run` with the cell that each starts.

Oracles: what each page says that its reader sees, in GET /cell and in what the commands print.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cell_run import IN_TRAY, RunOfCell
from cobot_run import ROOT, WAIT_S, answering

PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
URL = "http://localhost:8007"
BLOCK = re.compile(r"^```(bash|python)\n(.*?)\n```$", re.M | re.S)
CELL = re.compile(r"^cobot run --cell (\S+)$", re.M)
SAID = {
    "connect-a-gripper": ["simulated", "True", "allowed is 0 to 0.08 m|allows 0 to 0.08 m"],
    "count-with-a-light-barrier": ["something is in the light barrier", r'"stopped_by":"?.*gate'],
    "insert-a-peg": [r"^depth 0\.5[45]\d* 0\.1[45]"],
    "pick-and-place": ['"held": ?"cube"', "^cube$"],
    "place-by-touch": ['"stopped_by"', r"^force .* 0\.2[01]|0\.2[01]"],
    "wire-digital-io": [r'"fired": ?true', "^(True|1|1.0)$"],
}
"""Patterns of what the reader sees, by page."""


def cell_of(page: Path) -> Path:
    found = CELL.search(page.read_text(encoding="utf-8"))
    assert found, f"{page.name} starts no cell"
    return ROOT / str(found.group(1))


@pytest.fixture(scope="module")
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunOfCell]:
    with answering(RunOfCell(tmp_path_factory.mktemp("cell"), request.param)) as made:
        yield made


def outputs(page: Path, run: RunOfCell, folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    """What the blocks of a page print. Each has to succeed, also the motions that a curl asks for."""
    cobot = folder / "cobot"
    cobot.write_text(f'#!/bin/sh\nexec {sys.executable} -m cobot "$@"\n', encoding="utf-8")
    cobot.chmod(0o755)
    environment = {**os.environ, "COBOT_URL": run.url, "PATH": f"{folder}:{os.environ['PATH']}"}
    names: dict[str, Any] = {}
    printed: list[str] = []
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        block = text.replace(URL, run.url)
        if language == "python":
            exec(compile(block, page.name, "exec"), names)
            printed.append(capsys.readouterr().out)
            continue
        for line in block.splitlines():
            ended = subprocess.run(
                ["bash", "-euo", "pipefail", "-c", line.replace("curl ", "curl --fail-with-body ")],
                env=environment,
                cwd=ROOT,
                capture_output=True,
                text=True,
                timeout=WAIT_S,
                check=False,
            )
            assert ended.returncode == 0, f"{line}\n{ended.stdout}{ended.stderr}"
            if "/robot/move" in line or "/robot/gripper/" in line:
                assert json.loads(ended.stdout)["success"], f"{line}\n{ended.stdout}"
            printed.append(ended.stdout)
    if "robot" in names:
        names["robot"].close()
    return "\n".join(printed)


@pytest.mark.parametrize(
    ("run", "page"),
    [pytest.param(cell_of(page), page, id=page.stem) for page in PAGES],
    indirect=["run"],
)
def test_each_block_of_a_how_to_does_what_it_says(
    page: Path, run: RunOfCell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run.until(run.healthy)
    run.until(lambda: run.ask("GET", "/robot/gripper")["connected"])
    run.ask("POST", "/cell/reset")
    run.go_home()
    said = outputs(page, run, tmp_path, capsys)
    for pattern in SAID[page.stem]:
        assert re.search(pattern, said, re.M), f"{pattern}\n{said}"
    if page.stem == "pick-and-place":
        assert run.cube() == IN_TRAY


def test_each_how_to_is_in_the_start_page() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if f"(how-to/{page.name})" not in index] == []
