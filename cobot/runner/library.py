"""Reads the sequences that a sequence calls, before anything moves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from cobot.errors import InputError
from cobot.folders import below
from cobot.runner.blocks import walk
from cobot.runner.schema import Sequence, read_sequence
from cobot.runner.steps import MAX_DEPTH, CallStep

MAX_FILES = 100
"""Maximum number of files that one sequence reads."""


class Library:
    """Sequence files below one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._sequences: dict[Path, Sequence] = {}
        self._depths: dict[Path, int] = {}

    def find(self, name: str) -> Sequence:
        """Read the sequence in a file below the folder.

        Raises:
            InputError: the name leads out of the folder, or the file is not a valid sequence.
        """
        path = self._path(name)
        if path not in self._sequences:
            if len(self._sequences) == MAX_FILES:
                raise InputError(f"more than {MAX_FILES} files are called; merge some of them")
            if not path.is_file():
                raise InputError(f"there is no file {name!r} in {self._folder}")
            self._sequences[path] = _read(path, name)
        return self._sequences[path]

    def require(self, sequence: Sequence, name: str) -> None:
        """Read all files that a sequence calls.

        Args:
            name: name of the sequence's file.

        Raises:
            InputError: a called file is missing or invalid, or files call each other in a cycle or too
                deeply. The message begins with the file and the step.
        """
        self._depth(sequence, {self._folder.resolve() / name: name})

    def _depth(self, sequence: Sequence, callers: Mapping[Path, str]) -> int:
        """The nesting depth of lists of steps, including the lists in called files."""
        deepest = 1
        for place, depth, step in walk(sequence.items, f"{sequence.word}s"):
            if isinstance(step, CallStep):
                try:
                    depth += self._depth_of_call(step.call, callers)
                except InputError as exc:
                    raise InputError(f"{place}.call: {exc}") from exc
            deepest = max(deepest, depth)
            if deepest > MAX_DEPTH:
                raise InputError(
                    f"{place}: steps and calls are nested more than {MAX_DEPTH} deep; flatten them"
                )
        return deepest

    def _depth_of_call(self, name: str, callers: Mapping[Path, str]) -> int:
        path = self._path(name)
        if path in callers:
            circle = " calls ".join([*callers.values(), name])
            raise InputError(f"{circle}: a sequence cannot call itself; use repeat")
        sequence = self.find(name)
        if path not in self._depths:
            try:
                self._depths[path] = self._depth(sequence, {**callers, path: name})
            except InputError as exc:
                raise InputError(f"{name}: {exc}") from exc
        return self._depths[path]

    def _path(self, name: str) -> Path:
        return below(self._folder.resolve(), name, "call", "programs folder")


def _read(path: Path, name: str) -> Sequence:
    try:
        return read_sequence(path)
    except InputError as exc:
        raise InputError(f"{name}: {exc}") from exc
