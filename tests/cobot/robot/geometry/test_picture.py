"""The picture of an arm. Oracles: the areas of solids; matplotlib, which reads the PNG."""

from __future__ import annotations

import copy
import io
import math
import re
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from cobot.config import load_settings
from cobot.errors import CobotError
from cobot.pose import Pose
from cobot.robot.description import load_robot
from cobot.robot.geometry import picture
from cobot.robot.geometry.picture import HEIGHT, MARGIN, VIEWS, WIDTH, Facets, draw, solid
from cobot.robot.scene import Scene, SceneObject, Shape
from cobot.types import Array, PictureView

RED, BLUE = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
AT_ORIGIN = Pose.from_numbers([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])


def image_of(png: bytes) -> Array:
    """Red, green and blue of each pixel, 0 to 1."""
    return np.asarray(imread(io.BytesIO(png)), dtype=float)


def drawn(*facets: Facets, view: PictureView = "iso") -> Array:
    corners = np.concatenate([each.corners for each in facets])
    colors = np.concatenate([each.colors for each in facets])
    return image_of(picture._png(picture._rendered(corners, colors, view)))


def share(image: Array, color: tuple[float, ...]) -> float:
    """The share of the pixels whose colour is a shade of red or blue."""
    main = int(np.argmax(color))
    others = [each for each in range(3) if each != main]
    return float(np.mean(image[..., main] > 2.0 * image[..., others].max(-1)))


@pytest.mark.parametrize("view", VIEWS)
def test_a_sphere_is_a_disc_without_gaps(view: PictureView) -> None:
    """Its diameter is the height of the picture without the margins."""
    diameter = (1.0 - 2.0 * MARGIN) * HEIGHT
    expected = math.pi / 4.0 * diameter**2 / (WIDTH * HEIGHT)
    found = share(drawn(solid("sphere", (0.3,)).placed(AT_ORIGIN, RED), view=view), RED)
    assert found == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("size", [(1.0, 0.5, 0.25), (0.2, 2.0, 0.1)])
def test_a_box_has_the_area_of_its_face(size: tuple[float, float, float]) -> None:
    width, height = size[:2][::-1]  # from above: y to the right, x down
    scale = (1.0 - 2.0 * MARGIN) * min(WIDTH / width, HEIGHT / height)
    expected = width * height * scale**2 / (WIDTH * HEIGHT)
    found = share(drawn(solid("box", size).placed(AT_ORIGIN, RED), view="top"), RED)
    assert found == pytest.approx(expected, rel=0.02)


def test_the_nearest_solid_hides_those_behind_it() -> None:
    near = solid("box", (0.1, 1.0, 1.0)).placed(Pose.from_numbers([1.0, 0, 0, 1, 0, 0, 0]), RED)
    far = solid("box", (0.1, 0.6, 0.6)).placed(AT_ORIGIN, BLUE)
    for order in ((near, far), (far, near)):
        image = drawn(*order, view="front")  # the camera is on the x axis
        assert share(image, RED) > 0.3
        assert share(image, BLUE) == 0.0
    assert share(drawn(near, far, view="side"), BLUE) > 0.01


def test_the_shipped_arm_is_drawn_with_its_visuals() -> None:
    robot = load_robot(load_settings())
    home = np.asarray(robot.positions["home"].joints)
    image = image_of(draw(robot, home))
    assert image.shape[:2] == (HEIGHT, WIDTH)
    orange = (image[..., 0] > 0.5) & (image[..., 2] < 0.2)
    assert np.mean(orange) > 0.005, "the covers of its joints"
    moved = home + np.array([1.0, *[0.0] * (len(home) - 1)])
    assert np.mean(np.abs(image - image_of(draw(robot, moved)))) > 0.01


def test_an_arm_with_large_meshes_is_drawn_as_the_collision_checks_see_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    robot = load_robot(load_settings())
    home = np.asarray(robot.positions["home"].joints)
    with_visuals = image_of(draw(robot, home))
    monkeypatch.setattr(picture, "MAX_DRAWN_BYTES", 1000)
    monkeypatch.setattr(picture, "_glb", None)  # no mesh is read
    image = image_of(draw(robot, home))
    assert np.mean(np.abs(image - with_visuals)) > 0.005
    assert np.mean(np.abs(image - picture.BACKGROUND).max(-1) > 0.2) > 0.05, "the arm is there"


def test_parts_are_drawn_too() -> None:
    robot = load_robot(load_settings())
    home = np.asarray(robot.positions["home"].joints)
    part = solid("box", (0.2, 0.2, 0.2)).placed(Pose.from_numbers([0.5, 0.0, 0.1, 1, 0, 0, 0]), RED)
    assert (
        share(image_of(draw(robot, home, others=[part])), RED)
        > 0.01
        > share(image_of(draw(robot, home)), RED)
    )


VISUAL = "visuals: [{{link: {link}, shape: {shape}, position: [0, 0, 0], quaternion: [1, 0, 0, 0]{more}}}]"


@pytest.mark.parametrize(
    ("link", "shape", "more", "words"),
    [
        (
            "elbow",
            "box",
            ", size: [1, 1, 1]",
            "name the link 'elbow', which the model does not have; valid names: ",
        ),
        ("link1", "box", "", "a box needs size"),
        ("link1", "cylinder", ", radius: [1]", "a cylinder needs length"),
        ("link1", "mesh", "", "a mesh needs file"),
        ("link1", "mesh", ", file: none.glb", "none.glb cannot be read: No such file"),
        ("link1", "mesh", ", file: text.glb", "text.glb: is not a valid GLB file: "),
        ("link1", "mesh", ", file: short.glb", "short.glb: is not a valid GLB file: "),
    ],
)
def test_visuals_that_cannot_be_drawn_are_named(
    tmp_path: Path, link: str, shape: str, more: str, words: str
) -> None:
    (tmp_path / "visuals.yaml").write_text(VISUAL.format(link=link, shape=shape, more=more))
    (tmp_path / "text.glb").write_bytes(b"hello")
    (tmp_path / "short.glb").write_bytes(b"glTF\x02\0\0\0" + bytes(9))
    robot = copy.copy(load_robot(load_settings()))
    object.__setattr__(robot, "model_file", tmp_path / "model.xml")
    with pytest.raises(CobotError, match=re.escape(words)):
        draw(robot, np.zeros(7))


def test_a_mesh_that_has_changed_is_read_again(tmp_path: Path) -> None:
    robot = copy.copy(load_robot(load_settings()))
    object.__setattr__(robot, "model_file", tmp_path / "model.xml")
    more = ", file: a.glb, color: [0, 0, 1, 1]"
    (tmp_path / "visuals.yaml").write_text(VISUAL.format(link="link1", shape="mesh", more=more))
    shares = []
    for size in (0.3, 0.8):
        (tmp_path / "a.glb").write_bytes(trimesh.creation.box((size,) * 3).export(file_type="glb"))
        shares.append(share(image_of(draw(robot, np.zeros(7))), BLUE))
    assert shares[1] > 2.0 * shares[0] > 0.0


@pytest.mark.parametrize(
    ("shape", "size"), [("box", (0.2, 0.2, 0.2)), ("sphere", (0.1,)), ("cylinder", (0.1, 0.2))]
)
def test_objects_of_the_scene_are_drawn(shape: Shape, size: tuple[float, ...]) -> None:
    """Oracle: the same solid, given as a part."""
    robot = load_robot(load_settings())
    home = np.asarray(robot.positions["home"].joints)
    at = (0.5, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0)
    alone = image_of(draw(robot, home))
    part = image_of(draw(robot, home, others=[solid(shape, size).placed(Pose.from_numbers(at), RED)]))
    robot.collision.surround(Scene(1, {"thing": SceneObject(shape, size, at)}))
    found = image_of(draw(robot, home))
    covered = np.abs(part - alone).max(-1) > 0.01
    assert np.array_equal(np.abs(found - alone).max(-1) > 0.01, covered)
    assert covered.mean() > 0.01


def test_an_arm_without_visuals_is_drawn_as_the_collision_checks_see_it() -> None:
    robot = copy.copy(load_robot(load_settings()))
    object.__setattr__(robot, "model_file", None)
    assert share(image_of(draw(robot, np.zeros(7))), RED) > 0.03, "its capsules are orange"
