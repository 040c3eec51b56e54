"""Named frames. They form a tree, whose root is the world. Each frame's pose is given in its parent frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cobot.errors import ConflictError, InputError, LimitError, NotFoundError
from cobot.strict import shown
from cobot.types import Pose

WORLD = "world"
MAX_FRAMES = 1000
MAX_NAME = 200


@dataclass(slots=True)
class Frame:
    """A frame, with its pose in the parent frame."""

    parent: str
    pose: Pose


class Frames:
    """The tree of frames."""

    def __init__(self) -> None:
        self._frames: dict[str, Frame] = {}

    def add(self, name: str, pose: Pose, parent: str = WORLD) -> None:
        """Add a frame.

        Raises:
            ConflictError: a frame with this name exists.
            InputError, NotFoundError: the name is invalid, or the parent does not exist.
        """
        if not 1 <= len(name) <= MAX_NAME:
            raise InputError(f"a name must be 1 to {MAX_NAME} characters long, got {shown(name)}")
        if name == WORLD or name in self._frames:
            raise ConflictError(f"the frame {shown(name)} already exists", details={"cause": "name_taken"})
        if len(self._frames) >= MAX_FRAMES:
            raise LimitError(f"there are already {MAX_FRAMES} frames, which is the maximum")
        self._require(parent)
        self._frames[name] = Frame(parent, pose)

    def attach(self, name: str, parent: str) -> None:
        """Attach a frame, with its descendants, to a different parent. The frame's pose in the world stays
        the same.

        Raises:
            NotFoundError: there is no such frame or parent.
            ConflictError: the new parent is a descendant of the frame.
        """
        frame = self._frame(name)
        self._require(parent)
        if name in self.way_up(parent):
            raise ConflictError(f"{shown(parent)} is attached to {shown(name)}, so this would be a cycle")
        frame.pose = self.between(name, parent)
        frame.parent = parent

    def move(self, name: str, pose: Pose, reference: str = "") -> None:
        """Move a frame and its descendants. Its parent stays the same.

        Args:
            reference: the frame in which `pose` is given; "" for the parent.
        """
        frame = self._frame(name)
        if reference in ("", frame.parent):
            frame.pose = pose
        elif name in self.way_up(reference):
            raise ConflictError(f"{shown(reference)} is attached to {shown(name)} and would move with it")
        else:
            frame.pose = self.between(reference, frame.parent) @ pose

    def remove(self, name: str) -> None:
        """Delete a frame.

        Raises:
            NotFoundError: there is no such frame.
            ConflictError: the frame has children.
        """
        self._frame(name)
        children = self.children(name)
        if children:
            raise ConflictError(f"{', '.join(children)} are attached to {shown(name)}; delete them first")
        del self._frames[name]

    def remove_all(self) -> None:
        self._frames.clear()

    def names(self) -> list[str]:
        return [WORLD, *self._frames]

    def parent(self, name: str) -> str:
        return "" if name == WORLD else self._frame(name).parent

    def children(self, name: str) -> list[str]:
        self._require(name)
        return [each for each, frame in self._frames.items() if frame.parent == name]

    def between(self, name: str, reference: str) -> Pose:
        """Return the pose of a frame in a reference frame.

        Raises:
            NotFoundError: a frame does not exist.
        """
        return self._in_world(reference).inverse() @ self._in_world(name)

    def way_up(self, name: str) -> list[str]:
        """Yield the names of the frame and of its ancestors, except the world."""
        way = []
        while name != WORLD:
            way.append(name)
            name = self._frame(name).parent
        return way

    def _in_world(self, name: str) -> Pose:
        place = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
        for each in self.way_up(name):
            place = self._frames[each].pose @ place
        return place

    def _frame(self, name: str) -> Frame:
        self._require(name)
        if name == WORLD:
            raise InputError(f"{WORLD} is the root of all frames and cannot be moved or deleted")
        return self._frames[name]

    def _require(self, name: str) -> None:
        if name != WORLD and name not in self._frames:
            raise NotFoundError(f"there is no frame {shown(name)}; valid names: {', '.join(self.names())}")
