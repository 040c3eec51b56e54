"""Each example, the tour in each of its languages, against a running service."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import tree_sitter
import tree_sitter_matlab
from running import Run

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.mark.parametrize(
    "command", [["bash", str(EXAMPLES / "tour.sh")], [sys.executable, str(EXAMPLES / "tour.py")]]
)
def test_the_tour_runs_from_its_first_to_its_last_step(shared: Run, command: list[str]) -> None:
    tour = subprocess.run(
        command,
        env={**os.environ, "COBOT_URL": shared.url, "http_proxy": "http://127.0.0.1:9"},
        capture_output=True,
        text=True,
        timeout=240,
        check=False,
    )
    assert tour.returncode == 0, tour.stdout + tour.stderr
    assert "ok" in tour.stdout.splitlines()[-1] + tour.stdout.splitlines()[-2]
    assert "return code 0" in tour.stdout


def test_the_streaming_plot_is_drawn(shared: Run, tmp_path: Path) -> None:
    picture = tmp_path / "streaming.png"
    assert example(shared, "streaming_plot.py", "--seconds", "1.5", "--output", str(picture))
    assert picture.read_bytes().startswith(b"\x89PNG\r\n")


def example(run: Run, script: str, *arguments: str) -> list[str]:
    """What it prints."""
    name = run.memory.name.removeprefix("cobot-")
    ended = subprocess.run(
        [sys.executable, str(EXAMPLES / script), *arguments],
        env={**os.environ, "COBOT_ROBOT": name},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
    return ended.stdout.splitlines()


def test_the_matlab_tour_is_matlab() -> None:
    """Oracle: the MATLAB grammar of tree-sitter. It does not run here: webwrite is MATLAB's own."""
    parser = tree_sitter.Parser(tree_sitter.Language(tree_sitter_matlab.language()))
    source = (EXAMPLES / "tour.m").read_bytes()
    assert not parser.parse(source).root_node.has_error
    assert parser.parse(source.replace(b"webread([", b"webread([(", 1)).root_node.has_error
