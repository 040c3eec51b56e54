"""The place in a sequence that is being executed, for the log, the status and errors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from cobot.client.pallets import PalletPlace


@dataclass(frozen=True, slots=True)
class Where:
    """The place of a list of steps, or of one step.

    Attributes:
        word: name of an entry of the outermost list: step or waypoint.
        total: number of steps of the outermost list of the file.
        numbers: numbers of the nested steps, such as `3`, `2` for the second step inside the third step.
        notes: rounds and pallet places, outermost first.
        caller: place from which the file is called, with a comma; empty for the file that was started.
        frames: places of pallets, by the names that the steps give them.
        begin: share of an iteration before this place, 0 to 1.
        width: share of an iteration for this place.
    """

    word: str
    total: int
    numbers: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    caller: str = ""
    frames: Mapping[str, PalletPlace] = field(default_factory=dict)
    begin: float = 0.0
    width: float = 1.0

    def at(self, number: int, of: int) -> Where:
        """The place of a step in this list.

        Args:
            number: number of the step.
            of: number of steps in the list.
        """
        width = self.width / of
        begin = self.begin + max(number - 1, 0) * width
        return replace(self, numbers=(*self.numbers, str(number)), begin=begin, width=width)

    def in_part(self, name: str) -> Where:
        """The place of a list of steps that is not the main list of this step."""
        return replace(self, numbers=(*self.numbers, name))

    def in_round(self, name: str, number: int, of: int | None) -> Where:
        """The place in round `number` of this step. If `of` is None, the total number of rounds is
        unknown.
        """
        note = f"{name} {number}" if of is None else f"{name} {number} of {of}"
        width = 0.0 if of is None else self.width / of
        begin = self.begin + (number - 1) * width
        return replace(self, notes=(*self.notes, note), begin=begin, width=width)

    def with_place(self, name: str, place: PalletPlace) -> Where:
        """A copy for steps at a place of a pallet: poses in the frame with this name are relative to this
        place.
        """
        return replace(self, frames={**self.frames, name: place})

    def in_file(self, name: str, word: str, total: int) -> Where:
        """The place of the outermost list of steps in a file that this step calls."""
        caller = f"{self}, {name} "
        return replace(self, word=word, total=total, numbers=(), notes=(), caller=caller)

    def __str__(self) -> str:
        if self.numbers == ("0",):
            return f"{self.caller}home"
        of = "/" if self.word == "waypoint" else " of "
        notes = f" ({', '.join(self.notes)})" if self.notes else ""
        return f"{self.caller}{self.word} {'.'.join(self.numbers)}{of}{self.total}{notes}"
