"""The pages of docs/how-to/, block by block, beside `cobot run` with the cell that each starts.

Oracles: what each page says that its reader sees, in GET /cell and in what the commands print.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from cell_run import IN_TRAY, RunOfCell
from cobot_run import ROOT, WAIT_S, answering

from cobot.motions.bodies import MoveNamed

PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
URL = "http://localhost:8007"
BLOCK = re.compile(r"^```(bash|python)\n(.*?)\n```$", re.M | re.S)
RUN = [page for page in PAGES if BLOCK.search(page.read_text(encoding="utf-8"))]
"""The others only have commands for a network, or for an installation."""
CELL = re.compile(r"^cobot run --cell (\S+)$", re.M)
SAID = {
    "calibrate-a-tcp": [r"^tcp \[-?0.0, -?0.0, 0.\d+\] error 0.0", "^rejected: .*same orientation"],
    "change-the-speed": ['"fraction": ?0.5', "^override 0.5$"],
    "connect-a-gripper": ["simulated", "True", "allowed is 0 to 0.08 m|allows 0 to 0.08 m"],
    "count-with-a-light-barrier": ["something is in the light barrier", r'"stopped_by":"?.*gate'],
    "insert-a-peg": [r"^depth 0\.5[45]\d* 0\.1[45]"],
    "keep-out-zones": ["^rejected: .*people"],
    "pick-and-place": ['"held": ?"cube"', "^cube$"],
    "place-by-touch": ['"stopped_by"', r"^force .* 0\.2[01]|0\.2[01]"],
    "recover-from-a-stop": ['"mode"', '"state"'],
    "start-a-program-at-power-on": [],
    "windows-csharp-labview-node-red": ['"position"', '"success"'],
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
                [
                    "bash",
                    "-euo",
                    "pipefail",
                    "-c",
                    re.sub(r"^curl (?!.*--fail)", "curl --fail-with-body ", line),
                ],
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
    [pytest.param(cell_of(page), page, id=page.stem) for page in RUN],
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


def test_the_unit_of_a_program_is_one_of_systemd(tmp_path: Path) -> None:
    """Oracle: systemd-analyze."""
    if (analyze := shutil.which("systemd-analyze")) is None:
        pytest.skip("needs systemd-analyze: apt-get install systemd")
    page = ROOT / "docs" / "how-to" / "start-a-program-at-power-on.md"
    found = re.search(r"^```ini\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S)
    assert found
    unit = (
        found.group(1).replace("/opt/cobot/bin/cobot", sys.executable).replace("/usr/bin/curl", "/bin/true")
    )
    (tmp_path / "cell.service").write_text(unit, encoding="utf-8")
    for needed in ("cobot.service", "multi-user.target"):
        (tmp_path / needed).write_text("[Unit]\nDescription=needed\n", encoding="utf-8")
    (tmp_path / "cobot.service").write_text("[Service]\nExecStart=/bin/true\n", encoding="utf-8")
    ended = subprocess.run(
        [analyze, "verify", "--man=no", str(tmp_path / "cell.service")],
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert "cell.service" not in ended.stderr, ended.stderr


def test_the_flow_of_node_red_sends_what_the_service_takes() -> None:
    """The flow is JSON whose nodes lead to each other, and sends a body of POST /robot/move/named."""
    page = ROOT / "docs" / "how-to" / "windows-csharp-labview-node-red.md"
    found = re.search(r"^```json\n(.*?)^```$", page.read_text(encoding="utf-8"), re.M | re.S)
    assert found
    nodes = {each["id"]: each for each in json.loads(found.group(1))}
    (move,) = (nodes[name] for name in nodes["button"]["wires"][0])
    assert (move["method"], move["url"]) == ("POST", f"{URL}/robot/move/named")
    assert set(move["wires"][0]) <= set(nodes)
    assert MoveNamed.model_validate_json(nodes["button"]["payload"]).name == "home"
