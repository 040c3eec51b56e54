"""A network that omits, delays or corrupts data packages. The same seed causes the same faults."""

from __future__ import annotations

import math
from collections.abc import Mapping
from random import Random
from typing import Any

SPOILED = ("actual_q", "actual_qd", "target_moment", "actual_TCP_force", "actual_current_as_torque")


class DataNetwork:
    """
    Attributes:
        loss: share of the packages that the controller omits, as a busy controller does.
        reorder: share of the packages that arrive after their successor, which never happens with TCP itself.
        spoil: how the measured values are corrupted: "frozen", "nan", or "" if they are not.
        lost: number of packages that were omitted.
    """

    def __init__(self, seed: int = 0) -> None:
        self.loss = self.reorder = 0.0
        self.spoil = ""
        self.lost = 0
        self._random = Random(seed)
        self._known: dict[str, Any] | None = None
        self._late: Mapping[str, Any] | None = None

    def to_client(self, values: dict[str, Any]) -> list[Mapping[str, Any]]:
        """Return the data package that is sent in this period."""
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
