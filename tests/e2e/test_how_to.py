"""The pages of docs/how-to/, block by block, beside `cobot run` with the cell that each starts.

Oracles: what each page shows that its reader sees, in GET /cell and in what the commands print.
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
from cobot_run import ROOT, WAIT_S, Run, answering
from thorough import few

from cobot.client import Client
from cobot.motions.bodies import MoveNamed

PAGES = sorted((ROOT / "docs" / "how-to").glob("*.md"))
URL = "http://localhost:8007"
BLOCK = re.compile(r"^```(bash|python|text)\n(.*?)\n```$", re.M | re.S)
NUMBER = re.compile(r"(?<![\d.])-?\d+(?:\.\d+)?(?:e-?\d+)?(?![\d.])")
NEAR = 0.02
"""Largest difference between a number that is shown and one that is printed: rounding, contact."""
RUN = [
    page for page in PAGES if "\n```bash\n" in page.read_text(encoding="utf-8") or "calibrate" in page.stem
]
"""The others only have commands for a network, or for an installation."""
CELL = re.compile(r"^cobot run --cell (\S+)$", re.M)


def cell_of(page: Path) -> Path:
    found = CELL.search(page.read_text(encoding="utf-8"))
    assert found, f"{page.name} starts no cell"
    return ROOT / str(found.group(1))


@pytest.fixture(scope="module")
def run(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunOfCell]:
    with answering(RunOfCell(tmp_path_factory.mktemp("cell"), request.param)) as made:
        yield made


def is_shown(expected: str, printed: str) -> bool:
    """Whether a text is in what was printed: `...` stands for anything, spaces do not count."""
    wanted = [float(number) for number in NUMBER.findall(expected)]
    pieces = (re.escape(piece).replace(r"\.\.\.", ".*?") for piece in NUMBER.split(expected))
    joined = f"({NUMBER.pattern})".join(re.sub(r"(\\?\s)+", r"\\s*", piece) for piece in pieces)
    pattern = re.compile(joined, re.S)
    start = 0
    while (found := pattern.search(printed, start)) is not None:
        if all(
            abs(float(number) - value) <= NEAR for number, value in zip(found.groups(), wanted, strict=True)
        ):
            return True
        start = found.start() + 1
    return False


def test_what_is_shown_is_found_and_another_value_is_not() -> None:
    printed = '{"at":[0.5499,1],"held":"cube","id":7}\n{"at":[0.2,1]}'
    assert is_shown('{"at": [0.55, 1], ... "id": 7}', printed)
    assert is_shown('... {"at": [0.2, ...', printed)
    assert not is_shown('{"at": [0.6, ...', printed)
    assert not is_shown('"held": "can"', printed)
    assert is_shown("0.03\n0.08", "0.0299997\n0.0799996\n")
    assert not is_shown("0.03 0.08", "0.0299997\n")


def follow(page: Path, run: RunOfCell, folder: Path, capsys: pytest.CaptureFixture[str]) -> int:
    """Run the blocks of a page. Each has to succeed and to print what the page shows below it.

    Returns:
        How many outputs the page shows.
    """
    cobot = folder / "cobot"
    cobot.write_text(f'#!/bin/sh\nexec {sys.executable} -m cobot "$@"\n', encoding="utf-8")
    cobot.chmod(0o755)
    environment = {**os.environ, "COBOT_URL": run.url, "PATH": f"{folder}:{os.environ['PATH']}"}
    names: dict[str, Any] = {}
    printed, shown = "", 0
    for language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
        block = text.replace(URL, run.url)
        if language == "text":
            assert is_shown(text, printed), f"{text}\nis not in\n{printed}"
            shown += 1
        elif language == "python":
            exec(compile(block, page.name, "exec"), names)
            printed = capsys.readouterr().out
        else:
            printed = "".join(printed_by(line, environment) for line in block.splitlines())
    if "robot" in names:
        names["robot"].close()
    return shown


def printed_by(line: str, environment: dict[str, str]) -> str:
    """What a line for the shell prints. Motions that a curl asks for have to succeed too."""
    command = re.sub(r"^curl (?!.*--fail)", "curl --fail-with-body ", line)
    ended = subprocess.run(
        ["bash", "-euo", "pipefail", "-c", command],
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
    return f"{ended.stdout}\n"


@pytest.mark.parametrize(
    ("run", "page"),
    few([pytest.param(cell_of(page), page, id=page.stem) for page in RUN]),
    indirect=["run"],
)
def test_each_block_of_a_how_to_does_what_it_says(
    page: Path, run: RunOfCell, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run.until(run.healthy)
    run.until(lambda: run.ask("GET", "/robot/gripper")["connected"])
    run.ask("POST", "/cell/reset")
    run.go_home()
    assert follow(page, run, tmp_path, capsys) > 0
    if page.stem == "pick-and-place":
        assert run.cube() == IN_TRAY


def test_each_how_to_is_in_the_start_page() -> None:
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    assert [page.name for page in PAGES if f"(how-to/{page.name})" not in index] == []


@pytest.mark.thorough
def test_a_backup_has_what_a_restore_brings_back(tmp_path: Path) -> None:
    """Oracle: what was taught, set and saved before all of it was deleted."""
    page = (ROOT / "docs" / "how-to" / "back-up-and-restore.md").read_text(encoding="utf-8")
    back_up, restore, _ = re.findall(r"^```sh\n(.*?)^```$", page, re.M | re.S)
    (listed,) = re.findall(r"^```text\n(.*?)^```$", page, re.M | re.S)
    settings, state = tmp_path / "etc" / "cobot", tmp_path / "var" / "lib" / "cobot"
    settings.mkdir(parents=True)
    program = tmp_path / "bin" / "cobot"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m cobot "$@"\n', encoding="utf-8")
    program.chmod(0o755)

    def follow(block: str) -> str:
        for name in ("/etc/cobot", "/var/lib/cobot"):
            block = block.replace(name, f"{tmp_path}{name}")
        block = re.sub(r"^sudo systemctl .*$", "", block, flags=re.M).replace("sudo ", "")
        ended = subprocess.run(
            ["bash", "-euc", block],
            env={**os.environ, "PATH": f"{program.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT)},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=WAIT_S,
            check=False,
        )
        assert ended.returncode == 0, f"{block}\n{ended.stdout}{ended.stderr}"
        return ended.stdout

    run = Run(settings, more=f"kept: {state}/kept\n")
    with answering(run), Client(run.url) as robot:
        robot.set_tool(mass=1.5, centre=[0.0, 0.0, 0.05])
        robot.teach_position("over_the_box", [0.1, 0.2, 0.3, -1.2, 0.1, 1.0, 0.2])
        robot.save_program("one", "One", {"waypoints": [{"named": "work"}]})
    run.config = run.config.rename(settings / "cobot-setting.yaml")
    files = follow(back_up)
    for line in listed.replace("iiwa", run.name).splitlines():
        assert line in files
    shutil.rmtree(settings)
    shutil.rmtree(state)
    follow(restore)
    run.start()
    with answering(run), Client(run.url) as robot:
        assert robot.tool()["mass"] == 1.5
        assert "over_the_box" in [each["name"] for each in robot.positions()]
        assert [each["id"] for each in robot.programs()] == ["one"]


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
