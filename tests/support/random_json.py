"""Random JSON by the thousand: hypothesis, which could shrink what it finds, takes forty times as long."""

from __future__ import annotations

import math
import random
from collections.abc import Sequence
from typing import Any

NUMBERS = (0, -1, 2**31, 2**63, -(2**64), 10**400, 0.1, -0.0, 5e-324, 1.8e308, math.inf, -math.inf, math.nan)
TEXTS = ("", "0", "nan", "\0", "\n", "\ud800", "\U0001f916", "ä" * 40, "__class__", "../..", "{}", "null")


class Garbage(random.Random):
    """Its values, of a seed."""

    def text(self, words: Sequence[str] = ()) -> str:
        return self.choice(
            (*words, *TEXTS, "".join(map(chr, self.choices(range(0x300), k=self.randrange(9)))))
        )

    def scalar(self, words: Sequence[str] = ()) -> Any:
        numbers = (
            *NUMBERS,
            self.randrange(-9, 9),
            self.uniform(-4.0, 4.0),
            math.exp(self.uniform(-700, 700)),
        )
        return self.choice((None, True, False, self.choice(numbers), self.choice(numbers), self.text(words)))

    def value(self, words: Sequence[str] = (), depth: int = 4) -> Any:
        """Any value; `words` are texts that somebody may understand."""
        kind = self.random() if depth else 0.0
        if kind < 0.5:
            return self.scalar(words)
        if kind < 0.8:
            return [self.value(words, depth - 1) for _ in range(self.randrange(9))]
        return self.mapping((), words, depth - 1)

    def mapping(self, names: Sequence[str], words: Sequence[str] = (), depth: int = 3) -> dict[str, Any]:
        """With some of the names, or with names of its own if there are none."""
        chosen = self.sample(names, self.randrange(len(names) + 1)) if names else []
        chosen = chosen or [self.text() for _ in range(self.randrange(5))]
        return {name: self.value(words, depth) for name in chosen}
