"""Motions with force in programs, in a cell on virtual time. Oracle: MuJoCo's contact forces."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from physical_cell import write_cell
from plant_service import ServiceOfPlant
from programs_here import run_lua, run_sequence
from thorough import few

from cobot.cell.plant_hands import FINGERS
from cobot.errors import CobotError, ConditionNotMet, InputError, MotionStopped, NotSupportedError
from cobot.ipc.device_record import fill_capabilities
from cobot.motions.force_bodies import FORCE_MOTIONS
from cobot.runner.interpreter import Interpreter
from cobot.runner.library import Library
from cobot.runner.progress import Progress
from cobot.runner.schema import sequence_of
from cobot.runner.steps import FORCE_STEPS

TOP_Z = 0.22
"""Surface of two plates on a table, m. Between them is a slot along y, 30 mm wide, for fingers of 24 mm."""
SLOT_X = 0.55
PLATE: dict[str, Any] = {"shape": "box", "size_m": [0.2, 0.4, 0.02]}
CELL: dict[str, Any] = {
    "hand": {},
    "fixtures": {
        "table": {"shape": "box", "size_m": [0.5, 0.9, 0.2], "position_m": [0.6, 0.0, 0.1]},
        "near": {**PLATE, "position_m": [SLOT_X - 0.115, 0.0, 0.21]},
        "far": {**PLATE, "position_m": [SLOT_X + 0.115, 0.0, 0.21]},
    },
}
DOWN: dict[str, Any] = {"direction": {"x": 0, "y": 0, "z": -1}, "frame": "base"}
POINTED: dict[str, Any] = {"a": 0.0, "b": 3.14159265, "c": 0.0}
TIPS_M = 0.01
"""The fingers end so far below the TCP."""
NEAR_X = 0.45


class Touched(ServiceOfPlant):
    """Attributes:
    forces: what the fixtures push the fingers up with, of each cycle, N.
    places: the TCP of each cycle.
    """

    def note(self) -> None:
        mj, data, force = self.plant.plant.mj, self.plant._plant_data, np.zeros(6)
        pairs, up = data.contact.geom, 0.0
        for index in np.flatnonzero(self._kinds[pairs].sum(1) == 3):
            mujoco.mj_contactForce(mj, data, int(index), force)
            up += force[0] * abs(data.contact[int(index)].frame[2])
        self.forces.append(up)
        self.places.append(data.site(self.rig.settings.robot.tcp).xpos.copy())

    @cached_property
    def _kinds(self) -> np.ndarray:
        """Of each shape: 1 a finger, 2 a fixture, 0 anything else."""
        mj = self.plant.plant.mj
        names = [mj.geom(number).name for number in range(mj.ngeom)]
        return np.array([(name in FINGERS) + 2 * (name in CELL["fixtures"]) for name in names])


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Touched]:
    folder = tmp_path_factory.mktemp("force_steps")
    with Touched(folder, of_robot=f"cell: {write_cell(folder, CELL)}").serving() as made:
        assert isinstance(made, Touched)
        yield made


@pytest.fixture
def service(shared: Touched) -> Iterator[Touched]:
    shared.go_home()
    client = shared.client(shared.url)
    client.gripper.move(0.0)
    shared.forces, shared.places = [], []
    shared.cycles[shared.name].watch = shared.note
    yield shared
    shared.cycles[shared.name].watch = lambda: None
    shared.post("/stop")


def above(x: float, **more: Any) -> dict[str, Any]:
    """A waypoint 20 mm above the plates."""
    return {"x": x, "y": 0.0, "z": TOP_Z + TIPS_M + 0.02, **POINTED, "speed": 1.0, **more}


def run(service: Touched, folder: Path, *steps: dict[str, Any]) -> list[str]:
    file = folder / "main.json"
    file.write_text(json.dumps({"steps": steps}), encoding="utf-8")
    return run_sequence(service, file)


def test_each_motion_with_force_is_a_step() -> None:
    assert FORCE_STEPS.keys() == FORCE_MOTIONS.keys()
    for name, step in FORCE_STEPS.items():
        assert step.model_fields[name].annotation is FORCE_MOTIONS[name]


def test_a_sequence_presses_and_says_how_it_ended(service: Touched, tmp_path: Path) -> None:
    press = {"press": {**DOWN, "force": 15, "duration_s": 2, "retract": 0.01}, "label": "touch"}
    lines = run(service, tmp_path, above(NEAR_X), press)
    assert np.mean(service.forces[-2500:-1500]) == pytest.approx(15.0, abs=1.5), lines
    assert service.forces[-1] == 0.0
    begun, ended = lines[-2:]
    assert begun.startswith("iteration 1/1, step 2 of 2 (touch): press (direction {")
    assert "step 2 of 2 (touch): duration after" in ended
    assert "contact at 0.02" in ended


@pytest.mark.thorough
def test_lua_presses_as_the_sequence_does(service: Touched, tmp_path: Path) -> None:
    said = run_lua(
        service,
        f"""
        move {{x = {NEAR_X}, y = 0, z = {TOP_Z + TIPS_M + 0.02}, b = 3.14159265, speed = 1}}
        local down = {{x = 0, y = 0, z = -1}}
        local found = press {{direction = down, frame = "base", force = 15, duration_s = 2}}
        print(found.stopped_by, found.contact.pose.z)
        """,
        tmp_path,
    )
    assert max(service.forces) > 10.0
    word, height = said[-1].split()
    assert word == "duration"
    assert float(height) == pytest.approx(TOP_Z + TIPS_M, abs=2e-3)


@pytest.mark.thorough
def test_a_path_at_each_place_of_a_pallet_keeps_the_force(service: Touched, tmp_path: Path) -> None:
    origin = {"x": NEAR_X, "y": -0.05, "z": TOP_Z + TIPS_M + 0.02, **POINTED}
    along = {"x": 0.0, "y": 0.04, "z": 0.0, "planner": "lin", "speed_m_s": 0.03, "frame_id": "place"}
    follow = {"follow": {**DOWN, "force": 12, "motion": along, "retract": 0.02}}
    there = {"x": 0.0, "y": 0.0, "z": 0.0, "frame_id": "place", "speed": 1.0}
    lines = run(
        service,
        tmp_path,
        {"pallet": {"origin": origin, "counts": [2], "offsets": [{"y": -0.06}]}, "do": [there, follow]},
    )
    ends = [line for line in lines if "path_end after" in line]
    assert len(ends) == 2, lines
    # The tool points down: the y axis of a place is that of the base frame. Stiff bodies touch in some cycles
    # and part in others, so the mean counts.
    forces, places = np.array(service.forces), np.array(service.places)
    for begin_y in (-0.05, -0.11):
        way = (abs(places[:, 1] - begin_y - 0.02) < 0.01) & (np.gradient(places[:, 1]) > 1e-5)
        assert way.sum() > 600, "cycles on the way"
        assert forces[way].mean() == pytest.approx(12.0, abs=1.0)


@pytest.mark.thorough
def test_a_search_and_an_insertion_find_the_slot(service: Touched, tmp_path: Path) -> None:
    beside = above(SLOT_X - 0.006)
    pattern = {"radius": 0.008, "pitch": 0.002, "search_speed": 0.006, "drop": 0.001, "max_time_s": 80}
    lines = run(
        service,
        tmp_path,
        beside,
        {"search": {**DOWN, "force": 10, **pattern, "retract": 0.02}},
        beside,
        {"insert": {**DOWN, "force": 10, **pattern, "depth": 0.01}},
    )
    assert any("drop after" in line for line in lines), lines
    assert "depth after" in lines[-1], lines
    tcp = service.get("/robot/pose").json()["position"]
    assert abs(tcp["x"] - SLOT_X) < 0.004
    assert tcp["z"] < TOP_Z + TIPS_M - 0.009


@pytest.mark.thorough
def test_what_is_not_met_is_handled_by_on_error(service: Touched, tmp_path: Path) -> None:
    miss = {"press": {**DOWN, "force": 10, "max_distance": 0.01, "retract": 0.01}}
    with pytest.raises(ConditionNotMet, match=r"step 2 of 2: there is no contact within 0.01 m"):
        run(service, tmp_path, above(NEAR_X), miss)
    lines = run(
        service,
        tmp_path,
        {"on_error": {"retry": 1, "run": [above(NEAR_X)], "go_on": True}, "do": [miss]},
        {"press": {**miss["press"], "if_not_met": "success"}},
    )
    assert sum("attempt" in line and "no contact" in line for line in lines) == 2
    assert lines[-1].endswith("no contact")
    assert "step 2 of 2: max_distance after" in lines[-1]
    assert max(service.forces) == 0.0


def test_a_mistake_moves_nothing(service: Touched, tmp_path: Path) -> None:
    before = service.joints()
    push = {"press": {**DOWN, "force": 10, "max_force": 5}}
    with pytest.raises(InputError, match=r"steps\[1\]\.press: .*it must be above force"):
        run(service, tmp_path, above(NEAR_X), push)
    retried = {
        "on_error": {"retry": 5, "go_on": True},
        "do": [{"search": {**DOWN, "force": 1, "until": {"input": "in_hole", "is": True}}}],
    }
    with pytest.raises(CobotError, match=r"step 1.1 of 1: until.input: there is no input 'in_hole'"):
        run(service, tmp_path, retried)
    assert service.joints() == before


@pytest.mark.parametrize("form", few(["sequence", "Lua"]))
def test_a_pause_keeps_the_contact_and_a_stop_ends_the_program(
    service: Touched, tmp_path: Path, form: str
) -> None:
    held: list[float] = []

    async def ask(what: str) -> None:
        (job,) = (await service.asking("GET", "/jobs?state=running&state=paused")).json()["jobs"]
        answer = await service.asking("POST", f"/jobs/{job['id']}/{what}")
        assert answer.status_code == 200, answer.text

    async def disturb() -> None:
        while not service.forces or np.mean(service.forces[-500:]) < 5.0:
            await asyncio.sleep(0.05)
        await ask("pause")
        begin = len(service.forces)
        await asyncio.sleep(3.0)
        held.extend(service.forces[begin:])
        await ask("resume")
        await asyncio.sleep(0.5)
        await ask("cancel")

    press = {"press": {**DOWN, "force": 12, "duration_s": 1.5, "max_time_s": 60}}
    disturbing = service.begin(disturb())
    retried = {"on_error": {"retry": 9, "go_on": True}, "do": [press]}
    source = f"""
        move(from_json '{json.dumps(above(NEAR_X))}')
        on_error(function() press(from_json '{json.dumps(press["press"])}') end, {{retry = 9}})
    """
    programs: dict[str, Callable[[], object]] = {
        "sequence": lambda: run(service, tmp_path, above(NEAR_X), retried),
        "Lua": lambda: run_lua(service, source, tmp_path),
    }
    with pytest.raises(MotionStopped):
        programs[form]()
    service.end(disturbing)
    assert np.mean(held) == pytest.approx(12.0, abs=2.0), "N, and the pause has not ended the press"
    assert service.health()["robot"]["mode"] == "HOLD"


@pytest.mark.thorough
def test_each_motion_with_force_waits_until_it_is_permitted(service: Touched, tmp_path: Path) -> None:
    asked: list[str] = []

    class Stepwise(Progress):
        def ask(self, place: dict[str, Any]) -> int | None:
            asked.append(f"{place['step']}, {max(service.forces, default=0.0) > 1.0}")
            return None

    press = {"press": {**DOWN, "force": 10, "duration_s": 0.1}}
    sequence = sequence_of({"steps": [above(NEAR_X), press, press]})
    client = service.client(service.url)
    Interpreter(client, Library(tmp_path), Stepwise(None, None), lambda _: None, clock=service.clock).run(
        sequence
    )
    assert asked == ["step 1 of 3, False", "step 2 of 3, False", "step 3 of 3, True"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"impedance": False},
            "needs impedance control or wrench control, which the backend mujoco does not have",
        ),
        ({"measured": frozenset({"position"})}, "needs wrench, which the backend mujoco does not measure"),
    ],
)
def test_a_robot_without_force_is_named_and_not_tried_again(
    service: Touched, tmp_path: Path, change: dict[str, Any], words: str
) -> None:
    able, block = service.plant.capabilities, service.rig.memory.device
    retried = {"on_error": {"retry": 3, "go_on": True}, "do": [{"press": {"force": 10}, "label": "touch"}]}
    try:
        fill_capabilities(block.data, replace(able, **change))
        block.publish()
        with pytest.raises(NotSupportedError) as caught:
            run(service, tmp_path, retried)
        with pytest.raises(NotSupportedError, match=words):
            run_lua(service, "on_error(function() press {force = 10} end, {retry = 3})", tmp_path)
    finally:
        fill_capabilities(block.data, able)
        block.publish()
    assert str(caught.value).startswith("iteration 1/1, step 1.1 of 1 (touch): a motion with force needs")
    assert words in str(caught.value)
