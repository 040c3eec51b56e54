"""The looks of a robot. Oracle of the shipped meshes: trimesh reads them as closed solids."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest
import trimesh

from cobot.errors import ConfigError, NotFoundError
from cobot.robot.geometry.visuals import MAX_MESH_BYTES, has_visuals, visuals_of
from cobot.shipped import FOLDER

ENTRY = "{link: a, shape: mesh, position: [0, 0, 0], quaternion: [1, 0, 0, 0], file: FILE}"


def robot(folder: Path, entries: str, name: str = "visuals.yaml") -> Path:
    """The file of a model with a manifest beside it."""
    (folder / name).write_text(f"visuals: [{entries}]\n", encoding="utf-8")
    return folder / "model.xml"


@pytest.mark.parametrize("arm", ["iiwa14", "fr3"])
def test_the_shipped_arms_have_a_closed_mesh_for_each_link_near_its_collision_shapes(arm: str) -> None:
    model_file = FOLDER / "config" / f"{arm}.xml"
    found = visuals_of(model_file)
    model = mujoco.MjModel.from_xml_path(str(model_file))
    assert {each.link for each in found.visuals} == {
        model.body(index).name for index in range(1, model.nbody)
    }
    size = 0
    for visual in found.visuals:
        number = found.number(visual)
        assert number is not None
        content = found.read_mesh(number)
        size += len(content)
        scene = trimesh.load_scene(trimesh.util.wrap_as_stream(content), file_type="glb")
        assert all(each.is_watertight and each.volume > 0 for each in scene.geometry.values())
        body = model.body(visual.link)
        for geom in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
            assert scene.bounds is not None
            center = model.geom_pos[geom]
            assert np.all(scene.bounds[0] - 0.05 < center)
            assert np.all(center < scene.bounds[1] + 0.05)
    assert size < 1_000_000


def test_without_a_manifest_there_are_no_visuals(tmp_path: Path) -> None:
    assert not has_visuals(tmp_path / "model.xml")
    assert visuals_of(tmp_path / "model.xml").visuals == visuals_of(None).visuals == []


def test_a_manifest_with_the_models_name_comes_first(tmp_path: Path) -> None:
    robot(tmp_path, ENTRY.replace("FILE", "one.glb"))
    model_file = robot(tmp_path, ENTRY.replace("FILE", "two.glb"), "model.visuals.yaml")
    assert list(visuals_of(model_file).meshes) == ["two.glb"]


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        (ENTRY.replace("FILE", "../secret.glb"), "outside the folder"),
        (ENTRY.replace("FILE", "/etc/passwd"), "outside the folder"),
        (ENTRY.replace("mesh", "cone"), r"visuals\.0\.shape"),
        (ENTRY.replace("[1, 0, 0, 0]", "[.nan, 0, 0, 0]"), r"visuals\.0\.quaternion\.0"),
        (ENTRY.replace("}", ", texture: t}"), r"visuals\.0\.texture"),
        ("3", r"visuals\.0"),
    ],
)
def test_an_invalid_manifest_is_refused_with_the_entry(tmp_path: Path, entry: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        visuals_of(robot(tmp_path, entry))


def test_a_mesh_that_is_missing_or_huge_is_named(tmp_path: Path) -> None:
    found = visuals_of(robot(tmp_path, ENTRY.replace("FILE", "a.glb")))
    with pytest.raises(NotFoundError, match=r"mesh 0: a\.glb cannot be read"):
        found.read_mesh(0)
    with (tmp_path / "a.glb").open("wb") as file:
        file.truncate(MAX_MESH_BYTES + 1)
    with pytest.raises(NotFoundError, match=f"allowed: {MAX_MESH_BYTES}"):
        found.read_mesh(0)
    with pytest.raises(NotFoundError, match="there is no mesh -1; the robot has 1"):
        found.read_mesh(-1)
