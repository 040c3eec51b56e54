"""Motions with force on virtual time, against a table that is a spring.

Oracle: the table. It pushes at the TCP of the simulation as far as that is below its surface, and notes what
it has pushed with; neither the service nor rtloop knows of it.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from programs_here import run_lua, run_sequence
from thorough import few
from virtual_service import VirtualService, virtual_service
from wired_arm import WiredService

from app.services.streaming import force_motions, force_run
from cobot.types import Array

PAGE = Path(__file__).parents[4] / "docs" / "force.md"
STIFFNESS = 20_000.0
"""Of the table, N/m."""
HEIGHT_M = 0.03
"""The table's surface is so far below where the TCP starts."""
WALL_FROM_M, WALL_TO_M = 1e-3, 2e-3
"""A TCP that is so far below the surface, and no further outside of the hole, is in the hole. A push of 15 N
makes the surface give way by less."""
START = {"x": 0.5, "y": 0.0, "z": 0.4, "a": 0.0, "b": 3.14159265, "c": 0.0, "speed": 1.0}
DOWN = {"direction": {"x": 0.0, "y": 0.0, "z": -1.0}, "frame": "base"}


class Table:
    """A surface at a height, with a hole. It knows the TCP's place from MuJoCo."""

    def __init__(self, run: VirtualService) -> None:
        self._simulation = run.rig.simulation
        self._site = self._simulation._data.site(run.rig.settings.robot.tcp)
        self.surface = lambda x, y: -np.inf
        self.hole: tuple[float, float, float] | None = None  # x, y, radius
        self.forces: list[float] = []
        self.places: list[Array] = []

    def push(self) -> None:
        x, y, z = place = self._site.xpos.copy()
        wall = self._simulation.push[:2] = self._wall(place)
        height = self.surface(*self.hole[:2]) if self.hole is not None and wall.any() else self.surface(x, y)
        force = max(0.0, STIFFNESS * (height - z))
        self.forces.append(force)
        self.places.append(place)
        self._simulation.push[2] = force

    def _wall(self, place: Array) -> Array:
        """What the wall of the hole does to a TCP that is in it."""
        if self.hole is None or place[2] > START["z"] - HEIGHT_M - WALL_FROM_M:
            return np.zeros(2)
        out = place[:2] - self.hole[:2]
        r = float(np.linalg.norm(out))
        beyond = r - self.hole[2]
        return -STIFFNESS * beyond / r * out if 0.0 < beyond < WALL_TO_M else np.zeros(2)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[VirtualService]:
    with virtual_service(tmp_path_factory.mktemp("force")) as started:
        yield started


@pytest.fixture
def table(service: VirtualService) -> Iterator[Table]:
    table = Table(service)
    service.go_home()
    assert service.post("/robot/move/pose", START).json()["success"]
    service.sleep(0.5)
    cycle = service.cycles[service.name]
    cycle.watch = table.push
    table.surface = lambda x, y: START["z"] - HEIGHT_M
    yield table
    table.hole = None
    cycle.watch = lambda: None
    service.rig.simulation.push[:] = 0.0
    service.post("/stop")


def done(answer: httpx.Response) -> dict[str, Any]:
    assert answer.status_code == 200, answer.text
    found: dict[str, Any] = answer.json()
    return found


def test_a_press_holds_its_force_and_takes_it_away(service: VirtualService, table: Table) -> None:
    found = done(service.post("/robot/force/press", {**DOWN, "force": 10.0, "duration_s": 2.0}))
    assert (found["success"], found["stopped_by"]) == (True, "duration"), found
    assert found["contact"]["distance_m"] == pytest.approx(HEIGHT_M, abs=2e-3)
    assert found["force_n"] == pytest.approx(10.0, abs=1.5), "mean over all of the hold, its beginning too"
    held = table.forces[-1500:-500]
    assert np.mean(table.forces[-1300:-1000]) == pytest.approx(10.0, abs=0.5), (min(held), max(held))
    assert max(table.forces) < 16.0, "N, no blow when it touches"
    assert table.forces[-1] < 1.5, "N, when it has let go"
    assert service.health()["robot"]["mode"] == "HOLD"


def test_nothing_to_touch_is_an_error_or_a_success(service: VirtualService, table: Table) -> None:
    body = {**DOWN, "force": 10.0, "max_distance": 0.02}
    found = done(service.post("/robot/force/press", body))
    assert (found["success"], found["stopped_by"], found["contact"]) == (False, "max_distance", None)
    assert found["code"] == "condition_not_met"
    assert "no contact within 0.02 m" in found["message"]
    assert found["distance_m"] < 0.025
    again = {**body, "max_distance": 0.005, "if_not_met": "success"}
    found = done(service.post("/robot/force/press", again))
    assert (found["success"], found["stopped_by"]) == (True, "max_distance")


def test_a_path_is_followed_with_the_force_held(service: VirtualService, table: Table) -> None:
    table.surface = lambda x, y: START["z"] - HEIGHT_M + 0.05 * y  # it rises by 5 % along y
    motion = {**START, "y": 0.15, "planner": "lin", "speed_m_s": 0.05}
    found = done(
        service.post("/robot/force/follow", {**DOWN, "force": 12.0, "motion": motion, "retract": 0.01})
    )
    assert (found["success"], found["stopped_by"]) == (True, "path_end"), found
    touching = np.array(
        [force for force, place in zip(table.forces, table.places, strict=True) if 0.06 < place[1] < 0.145]
    )
    assert touching.mean() == pytest.approx(12.0, abs=1.0)
    assert touching.min() > 8.0
    assert max(table.forces) < 24.0, "N, when the slope begins"
    assert found["pose"]["y"] == pytest.approx(0.15, abs=2e-3)
    ahead = table.places[-1][2] - table.surface(0.0, table.places[-1][1])
    assert ahead > 0.005, "m above the table after the retract"


def test_a_path_that_the_table_leaves_ends_at_its_deviation(service: VirtualService, table: Table) -> None:
    table.surface = lambda x, y: START["z"] - HEIGHT_M - (0.1 if y > 0.05 else 0.0)
    motion = {**START, "y": 0.15, "planner": "lin", "speed_m_s": 0.05}
    body = {**DOWN, "force": 12.0, "motion": motion, "max_deviation": 0.004, "max_distance": 0.3}
    found = done(service.post("/robot/force/follow", body))
    assert (found["success"], found["stopped_by"]) == (False, "max_deviation")
    assert "allowed: 4 mm" in found["message"]
    assert found["distance_m"] < HEIGHT_M + 0.02


@pytest.mark.parametrize("pattern", ["spiral", "raster"])
@pytest.mark.parametrize("speed_m_s", few([0.003, 0.006]))
def test_a_search_finds_a_hole(service: VirtualService, table: Table, pattern: str, speed_m_s: float) -> None:
    """At 6 mm/s a corner of the raster once pressed the TCP into the table, which counted as a hole."""
    hole = np.array([0.5 + 0.003, 0.002])
    table.surface = hole_at(hole, 0.0006)
    body = {
        **DOWN,
        "force": 8.0,
        "pattern": pattern,
        "radius": 0.005,
        "pitch": 0.0008,
        "search_speed": speed_m_s,
        "drop": 0.0005,
        "max_time_s": 200.0,
    }
    found = done(service.post("/robot/force/search", body))
    assert (found["success"], found["stopped_by"]) == (True, "drop"), found
    before = [force for force, place in zip(table.forces, table.places, strict=True) if place[1] < 0.0012]
    assert max(before) < 1.25 * body["force"], "N: corners of the pattern do not disturb the force"
    place = np.array([found["pose"]["x"], found["pose"]["y"]])
    assert np.linalg.norm(place - hole) < 0.0012


def test_a_search_ends_at_an_input(tmp_path: Path) -> None:
    with WiredService(tmp_path).serving() as service:
        assert isinstance(service, WiredService)
        service.rig.__dict__["simulation"] = service.arm
        service.go_home()
        assert service.post("/robot/move/pose", START).json()["success"]
        table = Table(service)
        table.surface = lambda x, y: START["z"] - HEIGHT_M
        service.cycles[service.name].watch = table.push
        body = {**DOWN, "force": 8.0, "radius": 0.02, "until": {"input": "part", "is": True}}
        job = service.post("/robot/force/search?wait=false", body).json()["id"]
        service.until(lambda: table.forces and table.forces[-1] > 5.0)
        service.sleep(2.0)
        assert service.get(f"/jobs/{job}").json()["state"] == "running"
        service.arm.inputs["part"] = 1.0
        record = service.until(lambda: (found := service.get(f"/jobs/{job}").json())["ended_at"] and found)
        assert record["state"] == "finished", record
        for until, words in (
            ({"input": "nothing", "is": True}, "until.input: there is no input 'nothing'; valid names: part"),
            ({"input": "part", "above": 1.0}, "until: part is boolean; give is"),
            ({"input": "distance", "is": True}, "until: distance is analog; give above or below"),
        ):
            answer = service.post("/robot/force/search", {**body, "until": until})
            assert answer.status_code == 422
            assert words in answer.text


def test_an_input_of_a_device_without_inputs_is_rejected(service: VirtualService, table: Table) -> None:
    body = {**DOWN, "force": 8.0, "until": {"input": "part", "is": True}}
    answer = service.post("/robot/force/search", body)
    assert answer.status_code == 501
    assert "until: the backend" in answer.json()["detail"]


def test_a_search_without_a_hole_comes_to_its_end(service: VirtualService, table: Table) -> None:
    body = {**DOWN, "force": 8.0, "radius": 0.002, "pitch": 0.0008}
    found = done(service.post("/robot/force/search", body))
    assert (found["success"], found["stopped_by"]) == (False, "pattern_end")


def hole_at(centre: Array, radius_m: float, floor_m: float = 0.05) -> Callable[[float, float], float]:
    top = START["z"] - HEIGHT_M
    return lambda x, y: top - (floor_m if np.hypot(x - centre[0], y - centre[1]) < radius_m else 0.0)


def test_an_insertion_reaches_its_depth_or_says_how_far_it_came(
    service: VirtualService, table: Table
) -> None:
    hole = np.array([0.5, 0.001])
    body = {
        **DOWN,
        "force": 10.0,
        "radius": 0.003,
        "pitch": 0.0006,
        "search_speed": 0.002,
        "drop": 0.0005,
        "max_time_s": 200.0,
    }
    table.surface, table.hole = hole_at(hole, 0.0006), (*hole, 0.0006)
    found = done(service.post("/robot/force/insert", {**body, "depth": 0.02}))
    assert (found["success"], found["stopped_by"]) == (True, "depth"), found
    assert found["distance_m"] == pytest.approx(HEIGHT_M + 0.02, abs=4e-3)


def test_an_insertion_that_meets_a_floor_says_how_far_it_came(service: VirtualService, table: Table) -> None:
    table.surface, table.hole = hole_at(np.array([0.5, 0.001]), 0.0006, floor_m=0.01), (0.5, 0.001, 0.0006)
    body = {
        **DOWN,
        "force": 10.0,
        "radius": 0.003,
        "pitch": 0.0006,
        "search_speed": 0.002,
        "drop": 0.0005,
        "max_time_s": 200.0,
        "depth": 0.02,
    }
    found = done(service.post("/robot/force/insert", body))
    assert (found["success"], found["stopped_by"]) == (False, "force"), found
    assert "mm beyond the contact" in found["message"]


def test_the_largest_force_stops_the_arm_in_the_cycle(service: VirtualService, table: Table) -> None:
    table.surface = lambda x, y: START["z"] - HEIGHT_M if len(table.forces) < 8000 else START["z"]
    body = {**DOWN, "force": 10.0, "max_force": 40.0, "duration_s": 60.0, "max_time_s": 100.0}
    found = done(service.post("/robot/force/press", body))
    assert not found["success"]
    assert "contact" in found["message"]
    assert "allowed: 40" in found["message"]
    assert service.health()["robot"]["mode"] == "HOLD"


@pytest.mark.usefixtures("table")
def test_a_bound_that_is_met_at_once_is_answered(
    service: VirtualService, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not as a silent rtloop: the service may never see a state of a session that ends in its first cycle.

    As when something pushes the arm just then; no request has such a bound.
    """
    monkeypatch.setattr(force_motions, "_max_force", lambda _: 1e-200)
    for _ in range(3):
        found = done(service.post("/robot/force/press", {**DOWN, "force": 1.0}))
        assert not found["success"]
        assert "allowed:" in found["message"], found
        assert service.health()["robot"]["mode"] == "HOLD"


def test_a_job_is_paused_resumed_and_cancelled(service: VirtualService, table: Table) -> None:
    body = {**DOWN, "force": 8.0, "radius": 0.02, "pitch": 0.0008, "max_time_s": 600.0}
    accepted = service.post("/robot/force/search?wait=false", body)
    assert accepted.status_code == 202
    job = accepted.headers["location"]
    service.until(lambda: table.forces[-1] > 5.0)
    service.sleep(3.0)
    assert service.post(f"{job}/pause").json()["state"] == "paused"
    service.sleep(1.0)
    before = table.places[-1].copy()
    service.sleep(2.0)
    assert np.linalg.norm(table.places[-1] - before) < 1e-4, "m: the search waits"
    assert table.forces[-1] > 5.0, "N: in contact"
    assert service.post(f"{job}/resume").json()["state"] == "running"
    service.until(lambda: np.linalg.norm(table.places[-1] - before) > 1e-3)
    record = service.post(f"{job}/cancel").json()
    assert record["state"] == "cancelled", record
    assert service.get("/robot/control").status_code == 200
    assert service.post("/robot/move/named", {"name": "home", "speed": 1.0}).json()["success"], (
        "nothing is left"
    )


@pytest.mark.thorough
def test_a_pause_is_bounded_as_those_of_moves(
    service: VirtualService, table: Table, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(force_run, "MAX_PAUSE_S", 5.0)
    body = {**DOWN, "force": 8.0, "duration_s": 60.0, "max_time_s": 10.0, "retract": 0.01}
    accepted = service.post("/robot/force/press?wait=false", body)
    service.until(lambda: table.forces[-1] > 5.0)
    job = accepted.headers["location"]
    assert service.post(f"{job}/pause").json()["state"] == "paused"
    service.sleep(5.0)
    assert service.get(job).json()["state"] == "paused"
    service.sleep(21.0)  # its own time, and as much for the way back, which is paused too
    record = service.get(job).json()
    assert record["state"] == "failed", record
    assert record["error"]["code"] == "motion_timeout"
    assert "within 10 s" in record["error"]["detail"]


@pytest.mark.parametrize("end", ["/stop", "job"])
def test_a_stop_ends_it(service: VirtualService, table: Table, end: str) -> None:
    job = service.post("/robot/force/press?wait=false", {**DOWN, "force": 8.0, "duration_s": 60.0}).json()[
        "id"
    ]
    service.until(lambda: table.forces[-1] > 5.0)
    service.post("/stop" if end == "/stop" else f"/jobs/{job}/cancel")
    record = service.until(lambda: (found := service.get(f"/jobs/{job}").json())["ended_at"] and found)
    assert record["state"] == "cancelled"
    assert service.health()["robot"]["mode"] == "HOLD"


@pytest.mark.parametrize(
    ("path", "change", "words"),
    [
        ("press", {"force": 0.09}, "force"),
        ("press", {"force": 0.1, "max_force": 0.9}, "max_force"),
        ("press", {"force": 10.0, "max_force": 5.0}, "it must be above force"),
        ("press", {"force": 10.0, "direction": {"x": 0.0, "y": 0.0, "z": 0.0}}, "direction: is zero"),
        ("press", {"force": 10.0, "frame": "world"}, "frame"),
        ("follow", {"force": 10.0, "motion": {**START, "planner": "ptp"}}, "does not follow a TCP path"),
        ("follow", {"force": 10.0, "motion": {**START, "planner": "lin"}}, "already at the end"),
        (
            "follow",
            {
                "force": 10.0,
                "motion": {**START, "y": 0.1, "planner": "lin", "until": {"input": "part", "is": True}},
            },
            "motion.until: a path with force cannot have actions or conditions",
        ),
        ("search", {"force": 10.0, "pattern": "zigzag"}, "spiral"),
        ("insert", {"force": 10.0}, "depth"),
    ],
)
def test_bad_input_moves_nothing(
    service: VirtualService, table: Table, path: str, change: dict[str, Any], words: str
) -> None:
    before = service.joints()
    answer = service.post(f"/robot/force/{path}", {**DOWN, **change})
    assert answer.status_code == 422, answer.text
    assert words in answer.text
    np.testing.assert_array_equal(service.joints(), before)


@pytest.mark.thorough
def test_the_examples_of_the_page_work(service: VirtualService, table: Table) -> None:
    page = PAGE.read_text(encoding="utf-8").replace("\\\n", "")
    commands = re.findall(r"\$COBOT_URL(/robot/force/\w+) .*?-d '(.*?)'", page)
    assert [path.rsplit("/", 1)[1] for path, _ in commands] == ["press", "follow", "search", "insert"]
    hole = (0.501, 0.002, 0.0006)
    for path, body in commands:
        table.hole = hole if path.endswith(("search", "insert")) else None
        table.surface = hole_at(np.array(hole[:2]), hole[2] if table.hole else 0.0)
        found = done(service.post(path, json.loads(body)))
        assert found["success"], (path, found)
        assert service.post("/robot/move/pose", {**START, "planner": "lin"}).json()["success"]


def test_the_programs_of_the_page_work(service: VirtualService, table: Table, tmp_path: Path) -> None:
    page = PAGE.read_text(encoding="utf-8")
    sequence, program = (
        re.findall(rf"^```{language}\n(.*?)\n```$", page, re.M | re.S) for language in ("json", "lua")
    )
    file = tmp_path / "touch.json"
    file.write_text("".join(sequence), encoding="utf-8")
    assert "duration after" in run_sequence(service, file)[-1]
    assert max(table.forces) > 8.0
    height, force = map(float, run_lua(service, "".join(program), tmp_path)[-1].split())
    assert height == pytest.approx(START["z"] - HEIGHT_M, abs=2e-3)
    assert force == pytest.approx(10.0, abs=1.5)


@pytest.mark.thorough
def test_a_request_that_waits_ends_with_its_timeout(service: VirtualService, table: Table) -> None:
    body = {**DOWN, "force": 10.0, "duration_s": 300.0, "max_time_s": 600.0}
    found = done(service.post("/robot/force/press", body))
    assert (found["success"], found["stopped_by"], found["code"]) == (False, "max_time", "motion_timeout")
    assert found["duration_s"] < 65.0


def test_the_speed_override_slows_a_search_down(service: VirtualService, table: Table) -> None:
    body = {**DOWN, "force": 8.0, "radius": 0.02, "pitch": 0.0008, "max_time_s": 600.0}
    job = service.post("/robot/force/search?wait=false", body).headers["location"]
    service.until(lambda: table.forces[-1] > 5.0)
    service.sleep(12.0)  # until the turns of the spiral are so wide that it has its full speed

    def way_m() -> float:
        begin = len(table.places)
        service.sleep(2.0)
        places = np.array(table.places[begin:])[:, :2]
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())

    fast_m = way_m()
    answer = service.post("/robot/speed_override", {"fraction": 0.2})
    assert answer.status_code == 200, answer.text
    service.sleep(0.5)
    assert way_m() == pytest.approx(0.2 * fast_m, rel=0.15)
    assert service.post("/robot/speed_override", {"fraction": 1.0}).status_code == 200
    service.post(f"{job}/cancel").raise_for_status()
