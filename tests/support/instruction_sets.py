"""The sets of instructions with which spheres are checked; see `cobot.robot.clearance.INSTRUCTIONS`."""

from __future__ import annotations

import numpy as np

from cobot.robot.clearance import Clearance
from cobot.types import Array

SETS = ("plain", "avx2", "avx512")


def require_same_bits(clearance: Clearance, rows: Array, rates: Array) -> int:
    """Check that all sets that the processor has give the bits of the first one. Returns their number."""
    plain = clearance.sphere_verdicts(rows, SETS[0], rates, 0.05)
    assert plain is not None
    found = [clearance.sphere_verdicts(rows, name, rates, 0.05) for name in SETS]
    for other in found:
        assert other is None or all(np.array_equal(*pair) for pair in zip(plain, other, strict=True))
    return sum(other is not None for other in found)


def sound_verdicts(clearance: Clearance, rows: Array, least_m: float) -> tuple[Array, Array, Array]:
    """Check that spheres call no row free that is nearer than `least_m`, and none a hit that is not. The
    oracle is the exact distance. Returns it, the hits and the rows that spheres cannot decide."""
    nearest = clearance.distances(rows, 1.0).min(axis=1)
    found = clearance.sphere_verdicts(rows)
    assert found is not None
    hit, _, unsure, _ = found
    assert (nearest[~unsure] >= least_m).all()
    assert (nearest[hit] < least_m).all()
    return nearest, hit, unsure
