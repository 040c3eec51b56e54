"""Data packages that a controller omits, delays or falsifies. The same seed gives the same faults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from random import Random
from typing import Any

SPOILED = ("actual_q", "actual_qd", "target_moment", "actual_TCP_force", "actual_current_as_torque")


class DataNetwork:
    """
    Attributes:
        loss: share of the packages that the controller leaves out, as a busy one does.
        reorder: share of the packages that come after their successor, which TCP itself never does.
        spoil: how the measured values are corrupted: "frozen", "nan", or "" for not at all.
        lost: packages that were left out.
    """

    def __init__(self, seed: int = 0) -> None:
        self.loss = self.reorder = 0.0
        self.spoil = ""
        self.lost = 0
        self._random = Random(seed)
        self._known: dict[str, Any] | None = None
        self._late: Mapping[str, Any] | None = None

    def to_client(self, values: dict[str, Any]) -> list[Mapping[str, Any]]:
        """The data package that is sent in this period."""
        if self.spoil:
            self._known = self._known or {name: values[name] for name in SPOILED}
            values.update(self._known)
            if self.spoil == "nan":
                values["actual_q"] = [math.nan] * len(values["actual_q"])
        else:
            self._known = None
        if self.loss and self._random.random() < self.loss:
            self.lost += 1
            return []
        late, self._late = self._late, None
        if late is not None:
            return [values, late]
        if self.reorder and self._random.random() < self.reorder:
            self._late = values
            return []
        return [values]
