"""Cell files that are wrong. Oracle: the error names the file, the place, the value and what is valid."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from physical_cell import EXAMPLE, with_cell, write_cell

from cobot.cell import load_cell
from cobot.cell.cell import MAX_PARTS
from cobot.cell.plant import build_plant, check_cell
from cobot.cell.surroundings import fixtures_in_scene, hand_as_tool
from cobot.config import Settings
from cobot.errors import CobotError, CollisionError, ConfigError
from cobot.robot.description import RobotDescription

BOX: dict[str, Any] = {
    "shape": "box",
    "size_m": [0.05, 0.05, 0.05],
    "mass_kg": 0.2,
    "position_m": [0.6, 0.0, 0.3],
}
GATE = {"type": "light_barrier", "from_m": [0.5, 0.0, 0.5], "to_m": [0.6, 0.0, 0.5]}
NAN = float("nan")


def part(**changes: object) -> dict[str, Any]:
    return {"parts": {"cube": {**BOX, **changes}}}


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"part": {}}, "unknown key 'part' (did you mean 'parts'?); valid keys: floor_m, hand"),
        (part(weight=1.0), "parts.cube: unknown key 'weight'; valid keys: shape, size_m"),
        ({"hand": {"stroke": 0.1}}, "hand: unknown key 'stroke' (did you mean 'stroke_m'?)"),
        (part(mass_kg="heavy"), "parts.cube.mass_kg: must be a number, got 'heavy'"),
        (part(mass_kg=NAN), "parts.cube.mass_kg: must be less than or equal to 100, got NaN"),
        (part(mass_kg=-1.0), "parts.cube.mass_kg: must be greater than or equal to 0.001, got -1.0"),
        (part(mass_kg=1e6), "parts.cube.mass_kg: must be less than or equal to 100, got 1000000.0"),
        (part(friction=NAN), "parts.cube.friction: must be less than or equal to 5, got NaN"),
        (
            part(position_m=[0.0, NAN, 0.0]),
            "parts.cube.position_m[1]: must be less than or equal to 20, got NaN",
        ),
        (part(position_m=[0.0, 0.0, 1e9]), "parts.cube.position_m[2]: must be less than or equal to 20"),
        (part(position_m=[0.0, 0.0]), "parts.cube.position_m[2]: is missing"),
        (part(size_m=[0.1, NAN, 0.1]), "parts.cube: size_m: NaN is out of range, allowed: 0.002 to 2 m"),
        (part(size_m=[3.0, 0.1, 0.1]), "parts.cube: size_m: 3.0 is out of range, allowed: 0.002 to 2 m"),
        (part(size_m=[0.1]), "parts.cube: size_m has 1 length; a box needs 3"),
        (part(shape="mesh"), "parts.cube: file is missing: a mesh needs an STL or OBJ file"),
        (part(shape="cone"), "parts.cube.shape: must be 'box', 'cylinder', 'sphere' or 'mesh', got 'cone'"),
        ({"parts": []}, "parts: must be an object, got []"),
        ({"parts": {"": BOX}}, "parts"),
        ({"parts": {"a/b": BOX}}, "string should match pattern"),
        ({"parts": {f"p{i}": BOX for i in range(MAX_PARTS + 1)}}, "parts: must have at most 32 items"),
        ({"parts": {"hand": BOX}}, "the name 'hand' is reserved for the tool at the flange"),
        ({"parts": {"cup": BOX}}, "the name 'cup' is reserved for the tool at the flange"),
        (
            {
                "parts": {"a": BOX},
                "fixtures": {"a": {"shape": "sphere", "size_m": [0.1], "position_m": [1, 1, 1]}},
            },
            "the name 'a' occurs twice",
        ),
        ({"switches": {"a": GATE}, "outputs": {"a": {"kind": "boolean"}}}, "the name 'a' occurs twice"),
        ({"outputs": {"a": {"kind": "loud"}}}, "outputs.a.kind: must be 'boolean', 'digital' or 'analog'"),
        (
            {"switches": {"a": {"type": "eye"}}},
            "switches.a: type 'eye' is unknown; valid values: 'light_barrier'",
        ),
        (
            {"switches": {"a": {**GATE, "to_m": GATE["from_m"]}}},
            "from_m and to_m are the same point; they must be at least 0.001 m apart",
        ),
        (
            {"switches": {"a": {"type": "contact", "body": "b"}}, **part()},
            "switches.a.body: there is no 'b'; valid names: cube",
        ),
        (
            {
                "switches": {
                    "a": {"type": "distance", "from_m": [0, 0, 1], "direction": [0, 0, 0], "range_m": 1}
                }
            },
            "direction is [0, 0, 0]; it must not be zero",
        ),
        ({"hand": {"stroke_m": 5.0}}, "hand.stroke_m: must be less than or equal to 0.5, got 5.0"),
        ({"hand": {"tcp_from_tip_m": 0.2}}, "it must be at most the length of a finger, 0.055 m"),
    ],
)
def test_a_bad_cell_file_is_rejected_with_its_name_and_the_place(
    tmp_path: Path, content: dict[str, Any], words: str
) -> None:
    file = write_cell(tmp_path, copy.deepcopy(content))
    with pytest.raises(ConfigError) as caught:
        load_cell(file)
    assert str(caught.value).startswith(f"{file}: ")
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("file", "words"),
    [
        ("none.json", "none.json: no such file"),
        ("../none.json", "is outside the folder of the cell file"),
        ("/etc/none.json", "is outside the folder of the cell file"),
        ("program.py", "examples.Pick: string should match pattern"),
        ("binary.json", "binary.json: it is not UTF-8 text"),
        ("large.json", "large.json has 400001 bytes, allowed: 400000"),
    ],
)
def test_a_bad_example_program_is_rejected_with_its_file(tmp_path: Path, file: str, words: str) -> None:
    (tmp_path / "binary.json").write_bytes(b"\xff")
    (tmp_path / "large.json").write_bytes(b" " * 400_001)
    (tmp_path / "program.py").touch()
    (tmp_path / "cell.yaml").write_text(f"examples: {{Pick: {file}}}\n", encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        load_cell(tmp_path)
    assert str(caught.value).startswith(f"{tmp_path / 'cell.yaml'}: examples")
    assert words in str(caught.value)


def test_a_name_that_occurs_twice_in_a_section_is_rejected_with_its_line(tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text("outputs:\n  a: {kind: boolean}\n  a: {kind: analog}\n", encoding="utf-8")
    with pytest.raises(ConfigError, match=r"'a' occurs twice.*line 3"):
        load_cell(file)


def test_a_folder_stands_for_its_cell_file_and_a_missing_file_is_named(tmp_path: Path) -> None:
    assert load_cell(EXAMPLE) == load_cell(EXAMPLE / "cell.yaml")
    with pytest.raises(ConfigError, match=r"cell.yaml: no such file; it must be a cell file, or a folder"):
        load_cell(tmp_path)


@pytest.mark.parametrize(
    ("content", "error", "words"),
    [
        (
            {"parts": {"a": BOX, "b": {**BOX, "position_m": [0.62, 0.0, 0.3]}}},
            CollisionError,
            "a and b overlap by 30.0 mm at the start, allowed: 1 mm: move one of them",
        ),
        (part(position_m=[0.6, 0.0, 0.01]), CollisionError, "cube overlap by 15.0 mm at the start"),
        (part(position_m=[0.0, 0.0, 0.3]), CollisionError, "cube overlap"),
        ({"parts": {"link4": BOX}}, ConfigError, "the arm has a body or site named 'link4': give the entry"),
    ],
)
def test_a_cell_that_cannot_be_simulated_is_rejected_with_the_file(
    settings: Settings,
    robot: RobotDescription,
    tmp_path: Path,
    content: dict[str, Any],
    error: type[CobotError],
    words: str,
) -> None:
    file = write_cell(tmp_path, copy.deepcopy(content))
    with pytest.raises(error) as caught:
        check_cell(robot, with_cell(settings, file))
    assert str(caught.value).startswith(f"{file}: ")
    assert words in str(caught.value)


def test_the_example_is_sound(settings: Settings, robot: RobotDescription) -> None:
    assert "a hand, 3 parts, 2 fixtures, 0 belts, 1 switches" in check_cell(
        robot, with_cell(settings, EXAMPLE)
    )


def test_fixtures_stand_in_the_scene_where_they_stand_in_the_plant(robot: RobotDescription) -> None:
    """Oracle: the frames of MuJoCo's model; the shipped arm's base is the world's origin."""
    cell = load_cell(EXAMPLE)
    plant = build_plant(robot.model, cell, "base_link", "tcp")
    scene = fixtures_in_scene(cell)
    assert set(scene) == {"table", "tray"}
    for name, solid in scene.items():
        body = plant.mj.body(name)
        assert solid.pose == pytest.approx([*body.pos, *body.quat])
        assert 0.5 * np.array(solid.size) == pytest.approx(plant.mj.geom(name).size)


def test_the_hand_as_a_tool_has_the_mass_and_the_centre_of_the_plants_hand(robot: RobotDescription) -> None:
    """Oracle: MuJoCo's centre of mass of the subtree of the hand."""
    import mujoco

    cell = load_cell(EXAMPLE)
    assert cell.hand is not None
    plant = build_plant(robot.model, cell, "base_link", "tcp")
    data = mujoco.MjData(plant.mj)
    mujoco.mj_forward(plant.mj, data)
    hand = data.body("hand")
    tool = hand_as_tool(cell.hand)
    centre = hand.xmat.reshape(3, 3).T @ (hand.subtree_com - hand.xpos)
    assert tool.mass == pytest.approx(plant.mj.body_subtreemass[plant.mj.body("hand").id])
    assert tool.centre == pytest.approx(centre, abs=1e-9)
