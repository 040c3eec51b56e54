"""The picture of an arm. Oracles: the areas of solids; matplotlib, which reads the PNG."""

from __future__ import annotations

import io
import math

import numpy as np
import pytest
from matplotlib.image import imread

from cobot.config import load_settings
from cobot.pose import Pose
from cobot.robot import picture
from cobot.robot.description import load_robot
from cobot.robot.picture import HEIGHT, MARGIN, VIEWS, WIDTH, Facets, draw, solid
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


def test_parts_are_drawn_too() -> None:
    robot = load_robot(load_settings())
    home = np.asarray(robot.positions["home"].joints)
    part = solid("box", (0.2, 0.2, 0.2)).placed(Pose.from_numbers([0.5, 0.0, 0.1, 1, 0, 0, 0]), RED)
    assert (
        share(image_of(draw(robot, home, others=[part])), RED)
        > 0.01
        > share(image_of(draw(robot, home)), RED)
    )
