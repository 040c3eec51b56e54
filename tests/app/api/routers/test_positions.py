"""Named positions that are taught, over REST, on virtual time.

Oracle: where the arm is; the SRDF's file, which stays as it is.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual_service import VirtualService, virtual_service

from app.services.motion import positions as taught_positions
from app.services.motion.goals import Goals
from app.services.motion.positions import PositionService
from cobot.config import load_settings
from cobot.errors import NotFoundError

HOME = [0.0, 0.0, 0.0, -1.57, 0.0, 1.57, 0.0]
BESIDE = [0.3, *HOME[1:]]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("positions")


@pytest.fixture(scope="module")
def service(folder: Path) -> Iterator[VirtualService]:
    with virtual_service(folder, more=f"kept: {folder}/kept\n") as started:
        yield started


@pytest.fixture
def run(service: VirtualService) -> Iterator[VirtualService]:
    service.go_home()
    yield service
    for name in names(service, taught=True):
        service.ask("DELETE", f"/robot/positions/{name}").raise_for_status()


def names(run: VirtualService, *, taught: bool) -> list[str]:
    return [each["name"] for each in run.get("/robot/positions").json() if each["taught"] == taught]


def file(run: VirtualService, folder: Path) -> Path:
    return folder / "kept" / f"{run.name}.positions.json"


def test_a_place_gets_a_name_that_motions_and_plans_know(run: VirtualService, folder: Path) -> None:
    before = names(run, taught=False)
    taught = run.post("/robot/positions", {"name": "beside", "joints": BESIDE, "description": "left of it"})
    assert taught.status_code == 200, taught.text
    assert taught.json() == {
        "name": "beside",
        "label": "beside",
        "group": "taught",
        "description": "left of it",
        "joints": BESIDE,
        "taught": True,
    }
    assert run.get("/robot/positions").json()[-1] == taught.json()
    assert run.post("/robot/move/named", {"name": "beside", "speed": 1.0}).json()["success"]
    np.testing.assert_allclose(run.joints(), BESIDE, atol=1e-3)
    assert run.post("/robot/plan/named", {"name": "beside"}).json()["duration_s"] == 0.0
    assert names(run, taught=False) == before
    assert json.loads(file(run, folder).read_text())["beside"]["joints"] == BESIDE


def test_without_joints_it_is_where_the_arm_is_and_may_be_moved(run: VirtualService) -> None:
    run.post("/robot/positions", {"name": "place", "joints": BESIDE}).raise_for_status()
    here = run.post("/robot/positions", {"name": "place"}).raise_for_status().json()
    np.testing.assert_allclose(here["joints"], HOME, atol=1e-6)
    assert names(run, taught=True) == ["place"]


def test_its_label_is_in_any_language(run: VirtualService, folder: Path) -> None:
    client = run.client(run.url)
    taught = client.teach_position("box-1", BESIDE, label=" Über Kiste 1 取料点 ")
    assert (taught["name"], taught["label"]) == ("box-1", "Über Kiste 1 取料点")
    assert run.get("/robot/positions").json()[-1]["label"] == taught["label"]
    assert json.loads(file(run, folder).read_text())["box-1"]["label"] == taught["label"]
    assert run.post("/robot/move/named", {"name": "box-1", "speed": 1.0}).json()["success"]
    for label in ("", "  ", "a\nb", "x" * 101):
        refused = run.post("/robot/positions", {"name": "box-2", "label": label})
        assert (refused.status_code, refused.json()["code"]) == (422, "input"), label
    assert names(run, taught=True) == ["box-1"]


def test_one_is_removed_and_unknown_then(run: VirtualService) -> None:
    run.post("/robot/positions", {"name": "beside"}).raise_for_status()
    left = run.ask("DELETE", "/robot/positions/beside")
    assert left.status_code == 200
    assert "beside" not in [each["name"] for each in left.json()]
    again = run.ask("DELETE", "/robot/positions/beside")
    assert again.status_code == 404
    unknown = run.post("/robot/move/named", {"name": "beside"})
    assert unknown.status_code == 422
    assert "home" in unknown.json()["detail"]
    with pytest.raises(NotFoundError, match="was taught"):
        run.client(run.url).forget_position("home")


@pytest.mark.parametrize(
    ("body", "status", "said"),
    [
        ({"name": "home"}, 409, "SRDF"),
        ({"name": "a b"}, 422, "name"),
        ({"name": ""}, 422, "name"),
        ({"name": "x", "joints": [0.0] * 6}, 422, "7 angles"),
        ({"name": "x", "joints": [9.0, *HOME[1:]]}, 422, "joint1"),
        ({"name": "x", "place": 1}, 422, "place"),
        ({}, 422, "name"),
    ],
)
def test_what_cannot_be_is_refused(run: VirtualService, body: dict[str, Any], status: int, said: str) -> None:
    answer = run.post("/robot/positions", body)
    assert answer.status_code == status, answer.text
    assert said in answer.json()["detail"]
    assert names(run, taught=True) == []


def test_there_are_not_too_many(run: VirtualService, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(taught_positions, "MAX_TAUGHT", 1)
    client = run.client(run.url)
    assert client.teach_position("one", BESIDE, "the first")["description"] == "the first"
    client.teach_position("one")
    refused = run.post("/robot/positions", {"name": "two"})
    assert refused.status_code == 409
    assert "there are already 1 taught positions" in refused.json()["detail"]


def again(run: VirtualService, kept: Path) -> PositionService:
    """As after a restart."""
    parts = run.app.state.services
    return PositionService(parts.robot, parts.link, Goals(parts.robot, load_settings().planning), kept)


def test_they_are_there_after_a_restart(run: VirtualService, folder: Path) -> None:
    run.post("/robot/positions", {"name": "beside", "joints": BESIDE}).raise_for_status()
    made = again(run, file(run, folder))
    assert list(made.all()[-1].joints) == BESIDE
    assert made.problem == ""


def entry(joints: str, name: str = "bad") -> str:
    return f'"bad": {{"name": "{name}", "group": "taught", "joints": [{joints}], "description": ""}}'


GOOD = f'"good": {{"name": "good", "group": "taught", "joints": {HOME}, "description": ""}}'


@pytest.mark.parametrize(
    ("content", "said", "left"),
    [
        ('{"beside": 3}', "beside: ", []),
        ("{" + GOOD, "invalid JSON", []),
        ("", "invalid JSON", []),
        (f"{{{GOOD}, {entry('0, 0, 0, 0, 0, 0')}}}", "'bad' has 6 joints, but this arm has 7", ["good"]),
        (f"{{{GOOD}, {entry('NaN, 0, 0, 0, 0, 0, 0')}}}", "'bad' has joints that are not numbers", ["good"]),
        (
            f"{{{GOOD}, {entry('0, 0, 0, 0, 0, 0, 0', 'else')}}}",
            "'bad' contains the different name 'else'",
            ["good"],
        ),
    ],
)
def test_a_spoilt_file_is_set_aside_and_what_is_good_in_it_stays(
    run: VirtualService, tmp_path: Path, content: str, said: str, left: list[str]
) -> None:
    kept = tmp_path / "arm.positions.json"
    (tmp_path / "arm.positions.json.spoilt-1").write_text("of another time")
    kept.write_text(content)
    made = again(run, kept)
    assert [each.name for each in made.all() if each.group == "taught"] == left
    assert said in made.problem
    assert "it was set aside as arm.positions.json.spoilt-2: check that file" in made.problem
    assert (tmp_path / "arm.positions.json.spoilt-2").read_text() == content
    once_more = again(run, kept)
    assert [each.name for each in once_more.all() if each.group == "taught"] == left
    for each in (made, once_more):
        assert "spoilt-2" in each.problem, "also after a restart"
    (tmp_path / "arm.positions.json.spoilt-2").unlink()
    for each in (made, once_more):
        assert each.problem == ""


def test_health_tells_of_a_file_that_was_set_aside(run: VirtualService, folder: Path) -> None:
    aside = folder / "aside"
    aside.write_text("")
    run.app.state.services.positions._aside = aside
    run.app.state.services.positions._problem = "it was set aside"
    health = run.health()
    assert health["problems"] == ["it was set aside"]
    assert health["status"] == "degraded"
    aside.unlink()
    assert run.healthy()
