"""The tree of frames. Oracle: homogeneous 4x4 matrices, multiplied by numpy along the test's own tree."""

from __future__ import annotations

import random

import numpy as np
import pytest

from app.aubo.poses import numbers_of, pose_of
from app.services.motion.frames import MAX_FRAMES, WORLD, Frames
from cobot.errors import ConflictError, InputError, LimitError, NotFoundError
from cobot.types import Pose

SEED = 20261122


def random_pose(dice: random.Random) -> list[float]:
    return [dice.uniform(-2.0, 2.0) for _ in range(3)] + [dice.uniform(-1.5, 1.5) for _ in range(3)]


def by_definition(pose: list[float]) -> np.ndarray:
    """R = Rz(rz) Ry(ry) Rx(rx)."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(pose[3:]), np.sin(pose[3:])
    x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = z @ y @ x, pose[:3]
    return matrix


def matrix(pose: Pose) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = pose.rotation, pose.position
    return made


def test_a_pose_turns_about_fixed_axes_and_comes_back() -> None:
    dice = random.Random(SEED)
    for _ in range(200):
        pose = random_pose(dice)
        np.testing.assert_allclose(matrix(pose_of(pose)), by_definition(pose), atol=1e-12)
        np.testing.assert_allclose(numbers_of(pose_of(pose)), pose, atol=1e-12)


def test_frames_are_where_the_matrices_say_through_all_changes() -> None:
    dice, frames = random.Random(SEED), Frames()
    places, parents = {WORLD: np.eye(4)}, dict[str, str]()

    def moved(name: str, place: np.ndarray) -> None:
        """What hangs on a frame goes with it."""
        change = place @ np.linalg.inv(places[name])
        for each in [each for each in parents if name in frames.way_up(each)]:
            places[each] = change @ places[each]

    for number in range(120):
        name, pose = f"f{number}", random_pose(dice)
        parent = dice.choice(list(places))
        frames.add(name, pose_of(pose), parent)
        parents[name], places[name] = parent, places[parent] @ by_definition(pose)
        name, other = dice.choice(list(parents)), dice.choice(list(places))
        if other != WORLD and name in frames.way_up(other):
            with pytest.raises(ConflictError):
                frames.attach(name, other)
            with pytest.raises(ConflictError):
                frames.move(name, pose_of(pose), other)
        elif number % 2:
            frames.attach(name, other)  # and stays where it is
            parents[name] = other
        else:
            frames.move(name, pose_of(pose), other)
            moved(name, places[other] @ by_definition(pose))
        assert frames.parent(name) == parents[name]
    for name, place in places.items():
        np.testing.assert_allclose(matrix(frames.between(name, WORLD)), place, atol=1e-9)
        expected = np.linalg.inv(place) @ places["f7"]
        np.testing.assert_allclose(matrix(frames.between("f7", name)), expected, atol=1e-9)


def test_what_cannot_be_is_refused() -> None:
    frames, here = Frames(), pose_of([0.0] * 6)
    frames.add("a", here)
    frames.add("b", here, "a")
    for change, error, sentence in (
        (lambda: frames.add("a", here), ConflictError, "the frame 'a' already exists"),
        (lambda: frames.add(WORLD, here), ConflictError, "the frame 'world' already exists"),
        (lambda: frames.add("", here), InputError, "a name must be 1 to 200 characters long"),
        (lambda: frames.add("c", here, "z"), NotFoundError, "no frame 'z'; valid names: world, a, b"),
        (lambda: frames.remove("a"), ConflictError, "b are attached to 'a'; delete them first"),
        (lambda: frames.move(WORLD, here), InputError, "world is the root"),
        (lambda: pose_of([0.0] * 5), InputError, "pose"),
    ):
        with pytest.raises(error, match=sentence):
            change()
    frames.remove("b")
    frames.remove("a")
    assert frames.names() == [WORLD]


def test_there_are_not_more_than_so_many() -> None:
    frames, here = Frames(), pose_of([0.0] * 6)
    for number in range(MAX_FRAMES):
        frames.add(str(number), here)
    with pytest.raises(LimitError, match=f"there are already {MAX_FRAMES} frames"):
        frames.add("one more", here)
