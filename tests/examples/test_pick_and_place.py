"""examples/pick_and_place as Python, Lua and a sequence, on virtual time. Oracle: the bodies of the plant."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator

import pytest
from physical_cell import EXAMPLE
from plant_service import THE_CELL, ServiceOfPlant
from programs_here import run_lua, run_sequence

from cobot import client
from cobot.errors import CobotError

MIDDLE_OF_TRAY = [0.55, 0.3]
ON_TRAY_Z = 0.21 + 0.025
"""The top of the tray, and half of the cube."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServiceOfPlant]:
    with ServiceOfPlant(tmp_path_factory.mktemp("cell"), of_robot=THE_CELL).serving() as made:
        assert isinstance(made, ServiceOfPlant)
        yield made


@pytest.fixture
def service(shared: ServiceOfPlant, monkeypatch: pytest.MonkeyPatch) -> ServiceOfPlant:
    monkeypatch.setattr(client, "Client", lambda url: shared.client(shared.url))
    shared.go_home()
    shared.post("/cell/reset").raise_for_status()
    shared.sleep(0.1)
    return shared


def run_python(service: ServiceOfPlant) -> None:
    file = EXAMPLE / "pick_and_place.py"
    exec(compile(file.read_text(encoding="utf-8"), str(file), "exec"), {"__name__": "__main__"})


PROGRAMS: dict[str, Callable[[ServiceOfPlant], object]] = {
    "Python": run_python,
    "Lua": lambda service: run_lua(
        service, (EXAMPLE / "pick_and_place.lua").read_text(encoding="utf-8"), EXAMPLE
    ),
    "sequence": lambda service: run_sequence(service, EXAMPLE / "pick_and_place.json"),
}


@pytest.mark.parametrize("form", PROGRAMS)
def test_the_cube_is_counted_and_placed_in_the_tray(
    service: ServiceOfPlant, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    others = {name: place for name, place in service.positions().items() if name != "cube"}
    assert service.switches() == {"gate": False, "gate.count": 0}
    PROGRAMS[form](service)
    service.sleep(0.1)
    now = service.positions()
    assert now.pop("cube") == pytest.approx([*MIDDLE_OF_TRAY, ON_TRAY_Z], abs=2e-3)
    assert now == {name: pytest.approx(place, abs=1e-3) for name, place in others.items()}
    assert service.switches() == {"gate": False, "gate.count": 1}
    if form == "Python":
        assert re.fullmatch(
            r"placed at z = 0\.23\d m; the light barrier has counted 1\n", capsys.readouterr().out
        )


@pytest.mark.parametrize("form", PROGRAMS)
def test_without_the_cube_the_program_ends_at_the_grasp(service: ServiceOfPlant, form: str) -> None:
    place_of = service.plant.plant
    joint = place_of.mj.body_jntadr[place_of.parts[0]]
    service.plant._plant_data.joint(joint).qpos[:3] = [0.75, 0.3, 0.225]
    with pytest.raises(CobotError, match="nothing"):
        PROGRAMS[form](service)
    assert service.switches()["gate.count"] == 0
