"""The examples of docs/programs.md, at a service on virtual time. Oracles: its outputs, and its TCP."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cell_arm import ServiceOfCell
from programs_here import run_lua, run_sequence

from cobot import client

PAGE = Path(__file__).parents[1] / "docs" / "programs.md"
TEXT = PAGE.read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)\n```$", TEXT, re.M | re.S)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfCell]:
    with ServiceOfCell(tmp_path_factory.mktemp("cell")).serving() as made:
        assert isinstance(made, ServiceOfCell)
        yield made


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """The page's sequence files, in its order; those without a name are numbered."""
    names = iter(re.findall(r"^`(\w+\.json)`:\n\n```json", TEXT, re.M))
    written = []
    for number, block in enumerate(blocks("json")):
        written.append(tmp_path / next(names, f"block{number}.json"))
        written[-1].write_text(block, encoding="utf-8")
    return written


def run(service: ServiceOfCell, file: Path) -> list[str]:
    """The log of a run."""
    service.arm.was_set.clear()
    return run_sequence(service, file)


def tcp(service: ServiceOfCell) -> list[float]:
    position = service.get("/robot/pose").json()["position"]
    return [position[axis] for axis in "xyz"]


def test_the_tray_is_filled_and_the_log_is_as_the_page_shows_it(
    service: ServiceOfCell, files: list[Path]
) -> None:
    service.go_home()
    assert [file.name for file in files[:2]] == ["tray.json", "fetch.json"]
    lines = run(service, files[0])
    assert service.arm.was_set == [("belt", 1.0), ("belt", 0.0)] * 3 + [("lamp", 0.0)]
    np.testing.assert_allclose(tcp(service), [0.55, -0.1, 0.45], atol=2e-3)
    shown = re.search(r"^iteration 1/1, step 1\.1\.1 .*$", TEXT, re.M)
    assert shown is not None
    assert shown[0] in lines


@pytest.mark.thorough
def test_the_lines_are_polished_on_a_table(service: ServiceOfCell, files: list[Path]) -> None:
    """The table is a spring below the TCP, of which neither the service nor rtloop knows."""
    service.go_home()
    site, pushed = service.arm._data.site(service.rig.settings.robot.tcp), []

    def push() -> None:
        service.arm.push[2] = force = max(0.0, 20_000.0 * (0.37 - site.xpos[2]))
        pushed.append((site.xpos[1], force))

    cycle = service.cycles[service.name]
    cycle.watch = push
    try:
        assert files[2].name == "polish.json"
        lines = run(service, files[2])
    finally:
        cycle.watch = lambda: None
        service.arm.push[:] = 0.0
    assert sum("path_end after" in line for line in lines) == 2, lines
    shown = re.search(r"`(step 2 of 3 \(is the table there\?\): duration after) ", TEXT)
    assert shown is not None
    assert any(shown[1] in line for line in lines), lines
    y, force = np.array(pushed).T
    for begin in (-0.05, -0.10):
        way = (y > begin + 0.01) & (y < begin + 0.03) & (force > 0.0)
        assert force[way].mean() == pytest.approx(12.0, abs=1.5)


def test_each_other_sequence_of_the_page_runs(service: ServiceOfCell, files: list[Path]) -> None:
    service.go_home()
    conditions, layers = files[3:]
    run(service, conditions)
    assert service.arm.was_set == [
        ("lamp", 1.0),
        ("belt", 1.0),
    ]  # the belt brings a part, which ends the loop
    run(service, layers)
    np.testing.assert_allclose(tcp(service), [0.4, -0.05, 0.45], atol=2e-3)


def test_the_lua_of_the_page_does_what_it_says(service: ServiceOfCell, files: list[Path]) -> None:
    service.go_home()
    service.arm.was_set.clear()
    (block,) = blocks("lua")
    said = run_lua(service, block, files[0].parent)
    assert service.arm.was_set == [("belt", 1.0), ("belt", 0.0)] * 2
    assert [line for line in said if "of 3" in line] == ["1 of 3", "2 of 3", "3 of 3"]
    assert said[-1] == "fetch.json step 5 of 5: wait 0.2 s"


def test_the_python_of_the_page_does_what_it_says(
    service: ServiceOfCell, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service.go_home()
    service.arm.was_set.clear()
    monkeypatch.setattr(client, "Client", lambda url: service.client(service.url))
    (block,) = blocks("python")
    names: dict[str, Any] = {}
    exec(compile(block, str(PAGE), "exec"), names)
    assert service.arm.was_set == [("belt", 1.0), ("belt", 0.0)]
    np.testing.assert_allclose(tcp(service), [0.55, -0.1, 0.4], atol=2e-3)
    assert capsys.readouterr().out.splitlines() == ["1 of 3", "2 of 3", "3 of 3"]
