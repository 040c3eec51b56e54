from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from cobot.types import Array

def cover(
    points: Array,
    faces: Sequence[Sequence[int]] | npt.NDArray[np.integer[Any]],
    loss_m: float,
    floor_m: float,
) -> Array: ...
